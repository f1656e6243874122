"""Arguments that were swapped are recognised by what the files are."""

from __future__ import annotations

import sys

import pytest

from smsid.campaign import load_campaign
from smsid.cli.app import main
from smsid.description import load_description
from smsid.errors import SmsidError
from smsid.experiments import load_experiment
from smsid.recording.mapping import load_mapping


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["identify", "r.nc", "d.toml"], "'r.nc' is a recording; the description (TOML or URDF) comes first"),
        (["diagnose", "r.nc", "d.toml"], "'r.nc' is a recording; the description (TOML or URDF) comes first"),
        (["view", "r.nc", "d.toml"], "'r.nc' is a recording; the description"),
        (["identify", "d.toml", "log.csv"], "'log.csv' is a log; the recordings (.nc) come second"),
        (["export", "e.json", "d.toml", "-o", "x"], "'e.json' is a JSON"),
        (["control", "d.toml", "r.nc"], "'r.nc' is a recording; the estimate (JSON) comes second"),
        (["simulate", "d.toml", "d.urdf"], "'d.urdf' is a URDF; the experiment"),
        (["import", "log.csv", "--map", "log.csv"], "'log.csv' is a log; --map takes the mapping"),
        (["diagnose", "d.toml", "r.nc", "--estimate", "r.nc"], "--estimate takes the estimate"),
    ],
)
def test_swapped_arguments_are_named(words, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["smsid", *words])
    with pytest.raises(SystemExit) as left:
        main()
    err = capsys.readouterr().err
    assert left.value.code == 1 and told in err and "Traceback" not in err


def test_one_key_of_another_kind_is_a_wrong_key(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text('schema = 1\nname = "x"\nurdf = "x.urdf"\nduration = 1.0\n', encoding="utf-8")
    with pytest.raises(SmsidError, match="duration: unknown key"):
        load_description(path)


TOMLS = {
    "experiment": 'name = "x"\nduration = 1.0\n',
    "mapping": '[channel."imu.angular_rate"]\ncolumns = ["a", "b", "c"]\n',
    "campaign_plan": "runs = 3\n",
    "description": 'name = "x"\nurdf = "x.urdf"\n',
}


@pytest.mark.parametrize("wanted", TOMLS)
@pytest.mark.parametrize("given", TOMLS)
def test_a_toml_of_another_kind_is_named_and_its_keys_are_not_judged(wanted, given, tmp_path):
    load = {
        "experiment": load_experiment,
        "mapping": load_mapping,
        "campaign_plan": load_campaign,
        "description": load_description,
    }[wanted]
    path = tmp_path / "x.toml"
    path.write_text(TOMLS[given], encoding="utf-8")
    try:
        load(path)
    except SmsidError as error:
        told = f"is of the kind '{given.replace('_', ' ')}', no {wanted.replace('_', ' ')}"
        assert (told in str(error)) == (given != wanted)
        assert given == wanted or "unknown key" not in str(error)
    else:
        assert given == wanted
