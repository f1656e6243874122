"""What a diagnosis has written is identified like any other description: bodies shifted, a cause listed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.description import load_description, save_description
from smsid.diagnose._extended_description import (
    WIDE,
    extended_point,
    with_body_errors,
    with_inertial_shifts,
)
from smsid.effects import BodyError, Payload, SensorScale
from smsid.estimation.identify import identify_spacecraft
from smsid.estimation.parameter_vector import Point
from smsid.model import build_model
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
    fit = SimpleNamespace(
        point=point, problem=SimpleNamespace(parts=(), shift=0.0), unknowns=(unknown,), told=np.array([True]),
        covariance=lambda: np.array([[1e-5]]),
    )  # fmt: skip
    nominal = SimpleNamespace(point=Point.of(given))
    own = SimpleNamespace(score=SimpleNamespace(candidate=SimpleNamespace(effect=cause)))
    search = SimpleNamespace(last=fit, nominal=nominal, causes=(own,))
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


def bodies(description):
    return np.array([i.toDynamicParameters() for i in build_model(description).pin.inertias])


def test_bodies_that_were_extended_before_are_extended_further(tmp_path):
    """A second diagnosis starts from what the first has written: its shifts are added to that."""
    given = guess(tmp_path, RIGID, tank=False, panel=False)
    twice = given
    for shift in ({0: 20.0, 4: -6.0}, {0: -5.0, 9: 4.0}):
        before = bodies(twice)
        twice, notes = with_inertial_shifts(replace(Point.of(twice), inertial=shift), None)
        assert not notes
        change = (bodies(twice) - before)[1]
        assert np.allclose(change, [shift.get(k, 0.0) for k in range(10)], atol=1e-9)
    assert [e.kind for e in twice.effect].count("body_error") == 1
    save_description(twice, tmp_path / "twice.toml")
    assert np.allclose(bodies(load_description(tmp_path / "twice.toml")), bodies(twice))


def test_no_effect_is_lost_to_a_body_that_is_shifted(tmp_path):
    """What is named as a shift would be, and is none of this body, stays."""
    given = guess(tmp_path, RIGID, tank=False, panel=False)
    held = Payload(name="body_error_bus", frame="bus", mass=3.0)
    shift = np.array([2.0, *np.zeros(9)])
    both = with_body_errors(given.with_effects(held), {"bus": shift})
    assert [(e.name, e.kind) for e in both.effect][-2:] == [
        ("body_error_bus", "payload"),
        ("body_error_bus_2", "body_error"),
    ]
    whole = given.with_effects(BodyError(name="dense", body="bus", density=0.5))
    change = bodies(with_body_errors(whole, {"bus": shift})) - bodies(whole)
    assert np.allclose(change[1], shift)


@pytest.mark.parametrize("listed", [False, True])
def test_what_a_diagnosis_found_is_known_as_well_as_it_was_found(tmp_path, listed):
    """By a wide prior, of what was fitted: else the next takes it for exact, or for as known as before."""
    given = guess(tmp_path, RIGID, tank=False, panel=False)
    held = Payload(name="held", frame="bus", mass=2.0, com=(0.08, 0.0, 0.0))
    before = held.model_copy(update={"mass": 1.0, "prior": {"mass": 1e-6, "com.y": 0.5}, "known": ("com.z",)})
    names, sigmas = ("held.mass", "held.com.x"), np.array([0.01, 0.04])
    now = before.model_copy(update={"mass": 2.0, "com": held.com}) if listed else held
    fit = SimpleNamespace(
        point=Point.of(given.with_effects(now)), problem=SimpleNamespace(parts=(), shift=0.0),
        unknowns=tuple(SimpleNamespace(name=n) for n in names), told=np.array([True, True]),
        covariance=lambda: np.diag(sigmas**2),
    )  # fmt: skip
    own = SimpleNamespace(score=SimpleNamespace(candidate=SimpleNamespace(effect=now)))
    nominal = SimpleNamespace(point=Point.of(given.with_effects(before) if listed else given))
    search = SimpleNamespace(last=fit, nominal=nominal, causes=(own,))
    (found,) = extended_point(search).description.effect
    wide = {"mass": WIDE * 0.01, "com.x": WIDE * 0.04}
    assert found.prior == pytest.approx(wide | ({"com.y": 0.5} if listed else {}))
    assert found.known == (("com.z",) if listed else ("com.y", "com.z"))
    search.causes = ()  # a nominal one that was refitted within its prior keeps that
    assert not listed or extended_point(search).description.effect[0].prior == before.prior
