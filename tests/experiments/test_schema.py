"""Experiments as TOML: round trip, and bad input told with its place."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import ExperimentError
from smsid.experiments import (
    ConstantProfile,
    Experiment,
    FourierProfile,
    StepProfile,
    load_experiment,
    save_experiment,
)

FULL = Experiment(
    name="all",
    note="one of each",
    duration=12.0,
    hold_attitude=False,
    lock_wheels=True,
    force=StepProfile(times=(0.0, 2.0), values=((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    torque=ConstantProfile(value=(0.0, 0.1, 0.0)),
    wheel_torque=FourierProfile(frequency=0.1, cos=((0.1,),) * 3, sin=((0.2,),) * 3),
    joint_motion=FourierProfile(frequency=0.1, cos=((0.1,),) * 3, sin=((0.0,),) * 3, offset=(0.3, -0.6, 0.9)),
    joints=(0.4, -0.6, 0.9),
)


@pytest.mark.parametrize("experiment", [FULL, Experiment(name="nothing", duration=1.0)], ids=lambda e: e.name)
def test_round_trip(tmp_path, experiment: Experiment):
    path = tmp_path / "e.toml"
    save_experiment(experiment, path)
    assert load_experiment(path) == experiment
    assert "schema = 1" in path.read_text()


def test_signals_are_what_the_profiles_say():
    inputs = FULL.inputs()
    assert inputs.force is not None and inputs.torque is not None and inputs.wheel_torque is not None
    np.testing.assert_array_equal(inputs.force(1.99), [1, 0, 0])
    np.testing.assert_array_equal(inputs.force(2.0), [0, 0, 0])
    np.testing.assert_array_equal(inputs.torque(5.0), [0, 0.1, 0])
    expected = 0.1 * np.cos(0.6 * np.pi) + 0.2 * np.sin(0.6 * np.pi)
    np.testing.assert_allclose(inputs.wheel_torque(3.0), expected)
    motion = inputs.joint_motion
    assert motion is not None
    np.testing.assert_allclose(motion.position(0.0), [0.4, -0.5, 1.0])
    h = 1e-5
    for slope, signal in ((motion.velocity, motion.position), (motion.acceleration, motion.velocity)):
        np.testing.assert_allclose(slope(3.3), (signal(3.3 + h) - signal(3.3 - h)) / (2 * h), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("duration = 1.0", "name"),
        ('name = "x"', "duration"),
        ('name = "x"\nduration = -1.0', "duration"),
        ('name = "x"\nduration = 1.0\nforse = 1', "forse"),
        ('schema = 2\nname = "x"\nduration = 1.0', "schema"),
        ('name = "x"\nduration = 1.0\n[force]\nkind = "ramp"', "force"),
        ('name = "x"\nduration = 1.0\n[force]\nkind = "steps"\ntimes = [0.0]', "values"),
        (
            'name = "x"\nduration = 1\n[force]\nkind = "fourier"\nfrequency = 0.0\ncos = [[1]]\nsin = [[1]]',
            "frequency",
        ),
        ("name = ", "not valid TOML"),
    ],
)
def test_bad_input_is_told_with_its_place(tmp_path, text: str, message: str):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ExperimentError, match=message) as caught:
        load_experiment(path)
    assert "bad.toml" in str(caught.value)


def test_missing_file_is_told(tmp_path):
    with pytest.raises(ExperimentError, match="does not exist"):
        load_experiment(tmp_path / "none.toml")


def test_series_of_unequal_rows_are_told():
    profile = FourierProfile(frequency=0.1, cos=((1.0, 2.0),), sin=((1.0,),))
    with pytest.raises(ExperimentError, match="same number of rows and terms"):
        profile.signal()
