"""Each cause of a change in flight is named in time, with its size: the numpy satellite with a panel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import ExternalWrench, JointFriction, ThrusterGain
from smsid.model import build_model
from smsid.recording import Recording
from smsid.tracking import ChangeDetector, Tracker, load_tracker, save_tracker
from smsid.tracking._sample import samples_of
from smsid.tracking._setting import Setting
from tests.estimation.satellite import Satellite, guess, recorded

from .craft import STEP

GUESS = Satellite(tank=(1e-9, 1e-9, 1e-9), centre=(0.0, 0.0, 0.0))
AT, AFTER = 20.0, 18.0  # [s]
GRASPED = np.array([[4.0, 0.5, 0.0], [0.5, 3.0, -0.4], [0.0, -0.4, 6.0]])  # [kg m^2]
LEAK = np.array([0.05, 0.0, -0.03]), np.array([0.004, -0.002, 0.001])  # [N], [N m]
HEAVY = 60.0  # times `GRASPED`
DRAG = 2e-3  # [N m s/rad] of the first wheel
FOLLOW: dict[str, float | None] = dict.fromkeys(
    (
        "bus.I*",
        "leak.*",
        "thrust.gain.*",
        "drag.viscous",
        "panel.mode1.frequency",
        "gyro.angular_rate.bias.*",
    ),
    0.0,
)


def commanded(t):
    """Return force and wheel torques (3,): telemetry has them at its samples, straight in between."""
    force = 2.0 * np.sin(2 * np.pi * np.array([0.11, 0.07, 0.05]) * t + np.arange(3.0))
    return force, 0.3 * np.sin(2 * np.pi * np.array([0.1, 0.14, 0.18]) * t)


def rigid(description):
    """Return the satellite whose rigid bodies are the described ones, wheels locked and panel at rest."""
    model = build_model(description)
    m = pin.crba(model.pin, model.data, model.home)[:6, :6]
    m = np.triu(m) + np.triu(m, 1).T
    centre = np.array([m[4, 2], m[5, 0], m[3, 1]]) * [-1.0, -1.0, -1.0] / m[0, 0]
    return replace(GUESS, mass=m[0, 0], centre=tuple(centre), inertia=tuple(map(tuple, m[3:, 3:])))


def between(t):
    k, share = divmod(10.0 * t, 1.0)
    return [
        (1.0 - share) * a + share * b
        for a, b in zip(commanded(0.1 * k), commanded(0.1 * k + 0.1), strict=True)
    ]


def drive(begin, *, leak=(np.zeros(3), np.zeros(3)), gain=np.ones(3), drag=0.0, momenta=None):
    """Return what acts over steps of the world from ``begin`` on; a dragging wheel is solved by itself."""
    h = [np.zeros(3) if momenta is None else momenta.copy()]

    def at(t):
        force, torque = between(begin + t + 0.5 * STEP)
        wheel = torque - np.array([drag, 0.0, 0.0]) * h[-1] / GUESS.wheel
        h.append(h[-1] + STEP * wheel)
        return gain * force + leak[0], leak[1], wheel

    return at


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    plain = guess(tmp_path_factory.mktemp("craft"), GUESS, off=0.0, tank=False)
    return plain.with_effects(
        *plain.effect,
        ExternalWrench(name="leak", prior={f"{f}.{a}": 0.01 for f in ("force", "torque") for a in "xyz"}),
        ThrusterGain(name="thrust", prior={f"gain.{a}": 0.01 for a in "xyz"}),
        JointFriction(name="drag", joint="rw1", prior={"viscous": 1e-4}),
    )


@pytest.fixture(scope="module")
def truth(description):
    return rigid(description)


@pytest.fixture(scope="module")
def before(truth):
    return truth.fly(AT, drive(0.0), step=STEP)


def flown(truth, before, after=None, drift=0.0, seed=3, seconds=AFTER, **more):
    """Return the recording of a flight on which something happens at `AT`."""
    rest = (after(truth) if after else truth).fly(
        seconds, drive(AT, momenta=before[1][-1, 21:24], **more), step=STEP, start=before[1][-1, :24]
    )
    whole = tuple(np.concatenate([a, b[1:]]) for a, b in zip(before, rest, strict=True))
    times = np.arange(len(whole[0])) * STEP
    found = recorded(truth, (times, *whole[1:]), np.random.default_rng(seed))
    channels = {c: found[c].copy() for c in found.channels if c != "command.torque"}
    t = found.time()
    channels["command.force"], channels["command.wheel_torque"] = (
        np.array([commanded(x)[i] for x in t]) for i in (0, 1)
    )
    channels["gyro.angular_rate"][:, 1] += drift * np.maximum(t - AT, 0.0)
    return Recording.from_arrays(t, channels, labels=found.labels, name="flight")


def watched(description, recording):
    plain = Tracker(description, follow=FOLLOW, cad=0.005)
    setting = Setting.of(plain.description, plain.origin.base, hold="linear")
    tracker = Tracker(description, follow=FOLLOW, cad=0.005, setting=setting)
    detector = ChangeDetector.watch(tracker)
    tracker.update_all(samples_of(recording))
    return detector.changes


def heavier(sign):
    return lambda truth: replace(truth, inertia=tuple(map(tuple, np.array(truth.inertia) + sign * GRASPED)))


def soft(truth):
    return replace(truth, panel=(0.995 * truth.panel[0], *truth.panel[1:]))


def inertia_of(sign):
    return {f"bus.I{'xyz'[i]}{'xyz'[k]}": sign * GRASPED[i, k] for i in range(3) for k in range(i, 3)}


CAUSES = {
    "grasped": ("bus", {"after": heavier(1.0)}, inertia_of(1.0)),
    "released": ("bus", {"after": heavier(-1.0)}, inertia_of(-1.0)),
    "leak": (
        "leak",
        {"leak": LEAK},
        {f"leak.force.{a}": x for a, x in zip("xyz", LEAK[0], strict=True)}
        | {f"leak.torque.{a}": x for a, x in zip("xyz", LEAK[1], strict=True)},
    ),
    "weak thruster": ("thrust", {"gain": np.array([0.9, 1.0, 1.0])}, {"thrust.gain.x": -0.1}),
    "dragging wheel": ("drag", {"drag": DRAG}, {"drag.viscous": DRAG}),
    "soft panel": (
        "panel",
        {"after": soft},
        {"panel.mode1.frequency": -0.005 * GUESS.panel[0]},
    ),
    "drifting gyro": ("gyro.angular_rate.bias", {"drift": 3e-6}, {}),
}  # fmt: skip


SLOW = (
    "released",  # what is grasped, the other way round
    "grasped",  # `test_a_body_several_times_as_heavy_as_the_craft_is_measured`, and `test_change_detection`
    "drifting gyro",  # a gyro that jumps: `test_change_detection`
    "dragging wheel",  # a parameter that acts by the motion, as the soft panel's
)


@pytest.mark.parametrize(
    "cause", [pytest.param(c, marks=[pytest.mark.slow] if c in SLOW else []) for c in CAUSES]
)
def test_a_cause_is_named_in_time_with_its_size(description, truth, before, cause):
    group, what, size = CAUSES[cause]
    changes = watched(description, flown(truth, before, **what))
    assert changes, "nothing was seen"
    first = changes[0]
    assert first.group == group, (first.sentence, first.others)
    grows = cause in ("drifting gyro", "soft panel")  # what is seen of it does: a bias, a phase
    assert 0.0 < first.alarm - AT < (10.0 if grows else 5.0)
    if size:  # a jump: its time, and its size within its interval
        assert abs(first.began - AT) <= first.grid + 0.1
        jumps = dict(zip(first.names, zip(first.jumps, first.sigmas, strict=True), strict=True))
        for name, true in size.items():
            jump, sigma = jumps[name]
            assert abs(jump - true) < 4.0 * sigma, (name, jump, true, sigma)


@pytest.mark.parametrize("share", (0.7, pytest.param(1.3, marks=pytest.mark.slow)))
def test_a_large_jump_of_a_frequency_is_measured(tmp_path, share):
    """A linear filter sees another group in it and takes it for a jump of the bus."""
    description = guess(tmp_path, GUESS, off=0.0, tank=False)
    truth = rigid(description)
    jumped = flown(
        truth,
        truth.fly(AT, drive(0.0), step=STEP),
        after=lambda t: replace(t, panel=(share * t.panel[0], *t.panel[1:])),
        seconds=26.0,
    )
    follow = dict.fromkeys(("bus.I*", "panel.mode1.frequency", "gyro.angular_rate.bias.*"), 0.0)
    plain = Tracker(description, follow=follow, cad=0.005)
    setting = Setting.of(plain.description, plain.origin.base, hold="linear")
    tracker = Tracker(description, follow=follow, cad=0.005, setting=setting)
    detector = ChangeDetector.watch(tracker)
    tracker.update_all(samples_of(jumped))
    (change,) = detector.changes
    assert change.group == "panel" and change.alarm - AT < 4.0
    assert abs(change.began - AT) <= change.grid <= 2.0
    off = tracker.values - tracker.start.mean
    k = tracker.names.index("panel.mode1.frequency")
    off[k] -= (share - 1.0) * GUESS.panel[0]
    assert tracker.sigmas[k] < 1e-3 * GUESS.panel[0]
    assert np.abs(off / tracker.sigmas).max() < 4.0


def test_a_body_several_times_as_heavy_as_the_craft_is_measured(description, truth, before):
    """What a linear filter makes of it is far off, in size and in time: begun there, the motion is lost."""
    (change, *_) = watched(description, flown(truth, before, after=heavier(HEAVY)))
    assert change.group == "bus" and change.alarm - AT < 2.0
    assert abs(change.began - AT) <= change.grid + 0.1
    jumps = dict(zip(change.names, zip(change.jumps, change.sigmas, strict=True), strict=True))
    for name, true in inertia_of(HEAVY).items():
        jump, sigma = jumps[name]
        assert abs(jump - true) < 4.0 * sigma, (name, jump, true, sigma)


@pytest.mark.parametrize("at", (40, pytest.param(90, marks=pytest.mark.slow), 150))
def test_a_tracker_whose_commands_depend_on_a_parameter_is_restored_exactly(
    description, truth, before, tmp_path, at
):
    """Also while its beginning may still be filtered again: what was commanded is asked again."""
    samples = list(samples_of(flown(truth, before)))
    follow = dict.fromkeys(("bus.Ixx", "thrust.gain.x"), 0.0)
    plain = Tracker(description, follow=follow, cad=0.2)
    setting = Setting.of(plain.description, plain.origin.base, hold="linear")
    whole, first = (Tracker(description, follow=follow, cad=0.2, setting=setting) for _ in range(2))
    assert whole.filter.at.drives
    for sample in samples[:at]:
        whole.update(sample)
        first.update(sample)
    save_tracker(first, tmp_path / "state.npz")
    second = load_tracker(tmp_path / "state.npz", description)
    again = whole.filter.again
    for sample in samples[at : at + 250]:
        whole.update(sample)
        second.update(sample)
    assert whole.filter.again != again or whole.filter.begun is None  # it was filtered again
    assert np.array_equal(whole.filter.values, second.filter.values)
    assert np.array_equal(whole.covariance, second.covariance)
