"""``smsid design`` on the command line: the file it writes flies."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.cli.design import share
from smsid.errors import ExperimentError
from smsid.paths import urdf_folder

DESCRIPTION = str(urdf_folder() / "paper_sms.toml")


def test_the_file_is_flown_by_simulate(tmp_path):
    out = tmp_path / "mine.toml"
    asked = ["--for", "tank.damping.x", "--stroke", "0.1", "--duration", "12"]
    done = CliRunner().invoke(app, ["design", DESCRIPTION, *asked, "-o", str(out), "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    (parameter,) = document["design"]["parameters"]
    assert parameter["name"] == "tank.damping.x"
    assert 0.0 < parameter["sigma"] < parameter["sigma_before"]
    flown = CliRunner().invoke(app, ["simulate", DESCRIPTION, str(out), "-o", str(tmp_path / "r.nc")])
    assert flown.exit_code == 0, flown.output
    assert (tmp_path / "r.nc").is_file()


@pytest.mark.parametrize("options", [[], ["--for", "slosh", "--separate", "a,b"]])
def test_one_question_at_a_time(tmp_path, options):
    done = CliRunner().invoke(app, ["design", DESCRIPTION, *options, "-o", str(tmp_path / "e.toml")])
    assert done.exit_code == 1
    assert "Say what the experiment is for" in str(done.exception)
    assert not (tmp_path / "e.toml").exists()


@pytest.mark.parametrize(("text", "value"), [("10%", 0.1), ("0.1", 0.1), (" 2.5 % ", 0.025), ("1e-2", 0.01)])
def test_shares(text: str, value: float):
    assert share(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["ten", "10 percent", "%", "1e", ""])
def test_shares_that_are_none_are_told(text: str):
    with pytest.raises(ExperimentError, match="is no precision"):
        share(text)
