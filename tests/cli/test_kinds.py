"""Arguments that were swapped are recognised by what the files are."""

from __future__ import annotations

import sys

import pytest

from smsid.cli.app import main


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
