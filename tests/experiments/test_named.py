"""Experiments by name."""

from __future__ import annotations

import pytest

from smsid.errors import ExperimentError
from smsid.experiments import named_experiment, save_experiment, thrust_experiment


@pytest.mark.parametrize(
    ("name", "axes"), [("exp1", "xyz"), ("exp1_x", "x"), ("exp1_z", "z"), ("exp1_xz", "xz")]
)
def test_exp1_by_its_axes(model, name: str, axes: str):
    found = named_experiment(name, model)
    assert found == thrust_experiment(axes)
    assert found.name == name


def test_exp2_and_its_validation_differ(model):
    first, validation = (named_experiment(n, model) for n in ("exp2", "exp2val"))
    assert (first.name, validation.name) == ("exp2", "exp2val")
    assert first.joint_motion != validation.joint_motion
    assert first.wheel_torque != validation.wheel_torque
    assert first.duration == 80.0 and not first.hold_attitude


def test_a_file_by_its_path(model, tmp_path):
    path = tmp_path / "mine.toml"
    save_experiment(thrust_experiment("y", force=5.0), path)
    assert named_experiment(str(path), model) == thrust_experiment("y", force=5.0)


@pytest.mark.parametrize("name", ["exp3", "exp1_w", "exp1_", "EXP1"])
def test_unknown_names_are_told(model, name: str):
    with pytest.raises(ExperimentError, match=f"There is no experiment '{name}'") as caught:
        named_experiment(name, model)
    assert "exp1_xyz" in caught.value.advice


def test_a_missing_file_is_told(model, tmp_path):
    with pytest.raises(ExperimentError, match="does not exist"):
        named_experiment(str(tmp_path / "none.toml"), model)
