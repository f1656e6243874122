"""Recordings with holes, spikes and limits: bridged where that costs nothing, and said."""

from __future__ import annotations

import numpy as np
import pytest
from likelihood import twin
from likelihood.faulty import changed, dead, missing, never_commanded, not_finite, outliers, saturated

from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.estimate import ParameterEstimate
from smsid.identify.gap_filling import LONGEST, bridge, even_clock, fill_gaps
from smsid.identify.paper.pipeline import BRIDGED, identify
from smsid.likelihood.combinations import effects_and_mass
from smsid.likelihood.parameters import Parameters
from smsid.recording import Recording

MOTION = ("encoder.joint_position", "encoder.joint_velocity", "tachometer.wheel_rate")
HOLE = (20.0, 22.0)  # [s]
FAR = 4.5  # standard deviations: 40 parameters stay within with 99.97 %


@pytest.fixture(scope="module")
def exp1() -> Recording:
    return twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)


@pytest.fixture(scope="module")
def exp2() -> Recording:
    return twin.noisy(twin.exp2(40.0), 0)


def single_holes(name: str, times: np.ndarray, values: np.ndarray):
    values[np.random.default_rng(len(name)).random(len(values)) < 0.01] = np.nan
    return times, values


def true_values() -> dict[str, float]:
    """Slosh, panel and total mass of the twin: the description is its own."""
    at = Parameters.of(twin.model())
    return {c.name: c.value for c in effects_and_mass(at, at)}


def inside(estimate, least: int, truth: dict[str, float]) -> None:
    """At least so many parameters are identifiable, and all of those within their interval."""
    known = [p for p in estimate.parameters if p.status == "identifiable" and p.name in truth]
    assert len(known) >= least
    for p in known:
        assert abs(p.value - truth[p.name]) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"


@pytest.mark.parametrize("change", [outliers, single_holes])
def test_single_samples_cost_exp1_nothing(exp1: Recording, change):
    estimate = identify(twin.description(), [changed(exp1, change)]).estimate
    inside(estimate, 9, true_values())
    assert any("bridged" in note for note in estimate.notes)


@pytest.mark.parametrize("change", [outliers, pytest.param(single_holes, marks=pytest.mark.slow)])
def test_single_samples_cost_exp2_nothing(exp2: Recording, change):
    def seen(recording: Recording) -> dict[str, ParameterEstimate]:
        found = identify(twin.description(), [recording]).estimate.group("exp2.step_b")
        return {p.name: p for p in found if p.status == "identifiable"}

    before, after = seen(exp2), seen(changed(exp2, change))
    assert len(after) >= 0.9 * len(before) > 15
    for p in after.values():
        assert p.nominal is not None  # the description is the truth
        assert abs(p.value - p.nominal) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        (not_finite(*HOLE), True),
        (missing(*HOLE), True),
        # of a saturated Exp. 1 nothing looks identifiable in the first place
        (saturated("imu.acceleration", "panel.acceleration"), False),
    ],
    ids=["not finite", "missing", "saturated"],
)
@pytest.mark.parametrize("which", ["exp1", "exp2"])
def test_what_a_long_bridge_spoils_is_not_called_identifiable(which: str, change, seen: bool, request):
    # what is stuck for a third of the time is refused unless it is asked for
    recording = changed(request.getfixturevalue(which), change).unchecked()
    found = identify(twin.description(), [recording])
    assert not [p.name for p in found.estimate.parameters if p.status == "identifiable"]
    assert any("bridged" in note for note in found.estimate.notes)
    lost = [p for p in found.estimate.parameters if np.isfinite(p.sigma) and p.status != "by_product"]
    # a saturated Exp. 1 tells nothing: all of it stays as described
    assert len(lost) >= 5 or (which == "exp1" and not seen and found.translation is not None)
    assert all(BRIDGED in p.note and "maximum likelihood" in p.note for p in lost)
    if seen:
        assert sum(p.note.startswith(BRIDGED) for p in lost) >= 5


def test_too_short_for_exp1(exp1: Recording):
    """Two seconds of a slosh that swings in 70: nothing is told, all stays as described."""
    estimate = identify(twin.description(), [exp1.window(0.0, 2.0)]).estimate
    assert not [p.name for p in estimate.parameters if p.status == "identifiable"]
    mass = estimate["total.mass"]
    assert mass.value == mass.nominal and "no slosh to start from" in mass.note


def test_too_short_for_exp2(exp2: Recording):
    with pytest.raises(NotIdentifiableError, match="too short"):
        identify(twin.description(), [exp2.window(0.0, 10.0)])


def test_an_axis_without_thrust():
    recording = twin.noisy(twin.exp1((1, 0, 0), 60.0), 0)
    estimate = identify(twin.description(), [recording]).estimate
    inside(estimate, 3, true_values())
    lost = [p for p in estimate.parameters if p.name.endswith((".y", ".z")) or p.name.startswith("panel.")]
    assert len(lost) == 11
    for p in lost:
        assert p.status == "not_identifiable"
        assert p.value == p.nominal
        assert f"no thrust along {p.name[-1] if p.name.startswith('tank.') else 'z'}" in p.note
    assert any("no thrust along y, z" in note for note in estimate.notes)


@pytest.mark.parametrize(
    ("without", "match"),
    [
        (
            (),
            r"no thrust along x \('command.force' is zero there\); no thrust along y .* no joint or wheel",
        ),
        (("command.force",), r"no thrust along z \(there is no channel 'command.force'\)"),
        (MOTION, "no thrust along x .* encoders and tachometers are not recorded"),
    ],
)
def test_no_thrust_at_all(without: tuple[str, ...], match: str):
    recording = twin.noisy(twin.exp1((0, 0, 0), 5.0), 0)
    for name in without:
        recording = recording.without(name)
    with pytest.raises(NotIdentifiableError, match=f"'exp1' identifies nothing: .*{match}") as caught:
        identify(twin.description(), [recording])
    assert set(caught.value.evidence["reasons"]) == set("xyz")


def test_thrust_that_noise_hides(exp1: Recording):
    """A thousandth of the thrust moves less than the accelerometer's noise: nothing of that is known."""
    weak = {
        n: exp1[n] + (1e-3 - 1.0) * twin.exp1((1, 1, 1), 60.0)[n]
        for n in exp1.channels
        if n.startswith(("pose.pos", "pose.vel", "imu.acc", "panel.", "command."))
    }
    estimate = identify(twin.description(), [exp1.with_channels(weak)]).estimate
    inside(estimate, 0, true_values())
    assert estimate["total.mass"].status == estimate["panel.linear_density"].status == "not_identifiable"


def test_a_recording_without_fault_comes_out_as_it_went_in(exp1: Recording):
    found = fill_gaps(exp1, twin.description().sensor)
    assert found.recording is exp1
    assert found.bridged == {}
    assert found.longest() == ("", 0.0)


def test_holes_are_found_again(exp1: Recording):
    found = fill_gaps(changed(exp1, missing(*HOLE)), twin.description().sensor)
    np.testing.assert_allclose(found.recording.time("imu.acceleration"), exp1.time("imu.acceleration"))
    name, longest = found.longest(("acceleration",))
    assert name in ("imu.acceleration", "panel.acceleration")
    assert longest > 2.0 > LONGEST


def test_bridges_follow_what_is_cubic():
    t = np.linspace(0.0, 1.0, 101)
    x = np.column_stack([t**3 - t, 2.0 * t**2])
    bad = np.zeros(101, dtype=bool)
    bad[[3, 40, 41, 60]] = True
    bad[70:90] = True
    np.testing.assert_allclose(bridge(np.where(bad[:, None], np.nan, x), bad), x, atol=1e-12)


def test_bridges_at_ends_and_beside_jumps():
    t = np.linspace(0.0, 1.0, 101)
    x = np.where(t < 0.5, t**2, 7.0 - t)[:, None]
    bad = np.zeros(101, dtype=bool)
    bad[[0, 1, 48, 49, 50, 100]] = True
    np.testing.assert_allclose(bridge(np.where(bad[:, None], np.nan, x), bad, np.array([50])), x, atol=1e-12)
    bad[:] = False
    bad[:10] = True
    np.testing.assert_array_equal(bridge(x, bad)[:10], np.tile(x[10], (10, 1)))


def test_even_clocks():
    times = np.delete(np.arange(100) * 0.01, [5, 6, 50])
    clock, place = even_clock(times)
    np.testing.assert_allclose(clock, np.arange(100) * 0.01, atol=1e-15)
    np.testing.assert_array_equal(clock[place], times)
    uneven = np.cumsum(np.random.default_rng(0).uniform(0.005, 0.02, 50))
    np.testing.assert_array_equal(even_clock(uneven)[0], uneven)


def test_a_dead_channel_is_refused(exp1: Recording):
    with pytest.raises(RecordingError, match=r"samples of 'imu\.acceleration' \(33 %\)"):
        fill_gaps(changed(exp1, dead("imu.acceleration")), twin.description().sensor)


def test_commands_that_are_not_finite_are_refused(exp1: Recording):
    with pytest.raises(RecordingError, match=r"'command\.force' is not finite"):
        identify(twin.description(), [never_commanded(exp1)])
