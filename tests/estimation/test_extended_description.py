"""What a diagnosis has written is identified like any other description: bodies shifted, a cause listed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from smsid.description import load_description, save_description
from smsid.diagnose.extended_description import extended_point, with_inertial_shifts
from smsid.effects import SensorScale
from smsid.estimation.identify import identify_spacecraft
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from tests.estimation.satellite import Satellite, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))


def drive(t):
    turns = 2 * np.pi * np.array([0.05, 0.083, 0.031]) * t
    return np.zeros(3), 0.05 * np.sin(turns + np.arange(3.0)), 0.1 * np.sin(turns)


def test_an_extended_description_is_identified(tmp_path):
    """A gyro whose scale is off, and shifts of the bus: the cause is estimated, the shifts are the bus's."""
    made = recorded(RIGID, RIGID.fly(20.0, drive), np.random.default_rng(5))
    channels = {c: np.asarray(made[c]) for c in made.channels}
    channels["gyro.angular_rate"] = channels["gyro.angular_rate"] * np.array([1.0, 1.0, 1.02])
    recording = Recording.from_arrays(
        made.time(), channels, labels={"wheel": ("rw1", "rw2", "rw3")}, name="r"
    )
    given = guess(tmp_path, RIGID, tank=False, panel=False)
    cause = SensorScale(name="cause", sensor="gyro", quantity="angular_rate", error=(0.0, 0.0, 0.015))
    point = replace(Point.of(given.with_effects(cause)), inertial={0: 20.0, 4: -6.0, 9: -4.0})
    unknown = SimpleNamespace(name="cause.error.z")
    fit = SimpleNamespace(point=point, problem=SimpleNamespace(parts=()), unknowns=(unknown,))
    nominal = SimpleNamespace(point=Point.of(given))
    search = SimpleNamespace(last=fit, nominal=nominal)
    extended, notes = with_inertial_shifts(extended_point(search), fit)
    hint = SimpleNamespace(effect=cause)  # a hint is no cause: its effect is not in what the gain is of
    assert not extended_point(search, [hint]).description.effect
    assert not notes
    assert {e.kind for e in extended.effect} == {"sensor_scale", "body_error"}
    save_description(extended, tmp_path / "extended.toml")
    found = identify_spacecraft(load_description(tmp_path / "extended.toml"), [recording])
    assert found.quality is not None and found.quality.judgement == "explained"
    scale = found.estimate["cause.error.z"]
    assert scale.status == "identifiable" and abs(scale.value - 0.02) < 4.0 * scale.sigma
    assert not [p.name for p in found.estimate.parameters if "body_error" in p.name]
    assert not [p.name for p in found.estimate.parameters if p.name in ("cause.error.x", "cause.error.y")]
    told = [n for n in found.estimate.notes if "not estimated" in n]
    assert any("'body_error_bus' mass, first_moment.x" in n and "marked `known`" in n for n in told)
    assert any("'cause' error.x, error.y are not estimated: marked `known`" in n for n in told)
