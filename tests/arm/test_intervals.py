"""Intervals of an arm hold the truth, at every option; nothing is biased by what nobody sees."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from smsid.arm import identify_arm, torque_scales, with_joint_effects, with_torque_gains
from smsid.arm.regression import solve_joints
from smsid.arm.torque_calibration import with_signal_gears
from smsid.description import Description
from smsid.recording import Recording

URDF = """<robot name="two"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.3 0 0"/><mass value="5"/>
<inertia ixx="0.01" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="50" velocity="5"/></joint>
<link name="l2"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.005" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.6 0 0"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="5"/></joint></robot>"""
VISCOUS, COULOMB = np.array([2.0, 1.0]), np.array([3.0, 1.5])
SEEDS = 12


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Description:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "two.urdf").write_text(URDF)
    bare = Description(name="two", urdf="two.urdf", folder=folder, root="fixed", gravity=(0.0, 0.0, -9.81))
    return with_joint_effects(bare, ("j1", "j2"), "joint_friction")


@pytest.fixture(scope="module")
def clean():
    """Motion and rigid torques by rate: sums of five sines."""
    model = pin.buildModelFromXML(URDF)
    made = {}

    def at(rate: float):
        if rate not in made:
            t = np.arange(0.0, 20.0, 1.0 / rate)
            draw = np.random.default_rng(1)
            omega = 2.0 * np.pi * 0.1 * np.arange(1, 6)
            size, phase = draw.uniform(0.1, 0.4, (2, 5, 1)), draw.uniform(0.0, 6.0, (2, 5, 1))
            arg = omega[:, None] * t + phase
            q = np.sum(size * np.sin(arg), axis=1).T
            v = np.sum(size * omega[:, None] * np.cos(arg), axis=1).T
            a = -np.sum(size * omega[:, None] ** 2 * np.sin(arg), axis=1).T
            data = model.createData()
            made[rate] = t, q, v, np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])
        return made[rate]

    return at


def scores(arm, clean, *, rate=100.0, noise=1e-4, width=0.005, cutoff=None, seeds=SEEDS) -> np.ndarray:
    """Deviations (seeds, parameters) from the truth in standard deviations."""
    t, q, v, rigid = clean(rate)
    out = []
    for seed in range(seeds):
        draw = np.random.default_rng(100 + seed)
        torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / width) + [0.5, 0.2] * draw.normal(size=v.shape)
        channels = {"e.joint_position": q + noise * draw.normal(size=q.shape), "d.joint_torque": torque}
        log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
        found = identify_arm(arm, log, cutoff=cutoff).estimate
        truth = {f"friction_j{k + 1}.viscous": x for k, x in enumerate(VISCOUS)}
        truth |= {f"friction_j{k + 1}.coulomb": x for k, x in enumerate(COULOMB)}
        out.append([(p.value - truth.get(p.name, p.nominal)) / p.sigma for p in found.parameters])
    return np.array(out)


@pytest.mark.parametrize(
    "option",
    [
        {},
        {"cutoff": 20.0},
        {"cutoff": 3.0},
        {"width": 0.05},
        {"noise": 2e-4},
        {"rate": 250.0, "noise": 1e-5, "seeds": 8},
    ],
    ids=str,
)
def test_intervals_hold_at_every_option(arm, clean, option):
    z = scores(arm, clean, **option)
    inside = float(np.mean(np.abs(z) < 1.96))
    band = 3.0 * np.sqrt(0.05 * 0.95 / z.size)
    assert 0.95 - band < inside
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.25
    # the mean of a parameter's deviations over the seeds is chance
    assert np.abs(z.mean(axis=0)).max() < 3.2 / np.sqrt(len(z))


def test_the_width_of_frictions_sign_is_found_and_kept_in_the_description(arm, clean):
    t, q, v, rigid = clean(100.0)
    draw = np.random.default_rng(3)
    torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / 0.03) + [0.5, 0.2] * draw.normal(size=v.shape)
    channels = {"e.joint_position": q + 1e-5 * draw.normal(size=q.shape), "d.joint_torque": torque}
    log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
    found = identify_arm(arm, log)
    for w in found.shapes:
        assert w.status == "found" and abs(np.log(w.value / 0.03)) < 4.0 * w.sigma < 2.0
        assert found.description.get_effect(w.effect).smoothing == w.value
    stated = [e.model_copy(update={"smoothing": 0.01}) for e in arm.effect]
    again = identify_arm(arm.with_effects(*stated), log)
    assert [w.status for w in again.shapes] == ["stated", "stated"]


def test_two_recordings_tell_more_than_one(arm, clean):
    t, q, v, rigid = clean(100.0)
    logs = []
    for seed, part in enumerate((slice(0, 1000), slice(1000, 2000))):
        draw = np.random.default_rng(seed)
        torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / 0.005) + 0.2 * draw.normal(size=v.shape)
        channels = {"e.joint_position": q[part] + 1e-5 * draw.normal(size=q[part].shape)}
        channels["d.joint_torque"] = torque[part]
        logs.append(
            Recording.from_arrays(t[part], channels, labels={"joint": ("j1", "j2")}, role="estimation")
        )
    one, both = identify_arm(arm, logs[0]).estimate, identify_arm(arm, logs).estimate
    viscous = both["friction_j1.viscous"]
    assert viscous.sigma < one["friction_j1.viscous"].sigma
    assert abs(viscous.value - 2.0) < 4.0 * viscous.sigma


def test_misfit_widens_intervals(rng):
    """A parameter that differs from stretch to stretch is told no better than it differs."""
    rows = rng.normal(size=(2000, 1, 3))
    drift = np.repeat(rng.normal(size=20), 100)
    torque = np.einsum("tjn,n->tj", rows, np.array([1.0, 2.0, 3.0])) + 0.1 * rng.normal(size=(2000, 1))
    even = solve_joints(rows, torque)
    uneven = solve_joints(rows, torque + drift[:, None] * rows[:, :, 0])
    assert uneven.sigma[0] > 0.15 and even.sigma[0] < 0.01


def test_what_is_not_known_of_a_gain_is_in_the_intervals(arm, clean):
    """Currents of a joint whose gain is found from its links: friction is no better known than the gain."""
    t, q, v, rigid = (x[:1000] if hasattr(x, "shape") else x for x in clean(50.0))
    scores, shares = [], []
    for seed in range(SEEDS):
        draw = np.random.default_rng(200 + seed)
        torque = (
            rigid + 20.0 * VISCOUS * v + COULOMB * np.tanh(v / 0.05) + [2.0, 1.0] * draw.normal(size=v.shape)
        )
        channels = {"e.joint_position": q + 1e-5 * draw.normal(size=q.shape), "d.joint_torque": torque / 0.5}
        log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
        geared, logs = with_signal_gears(arm, [log], ("j1", "j2"))
        scales = torque_scales(geared, logs[0])
        known = {s.joint: s.sigma / abs(s.value) for s in scales}
        found = identify_arm(with_torque_gains(geared, scales), logs, gain_sigma=known).estimate
        for k, x in enumerate(20.0 * VISCOUS, start=1):
            own = found[f"friction_j{k}.viscous"]
            scores.append((own.value - x) / own.sigma)
            shares.append(own.sigma / x / known[f"j{k}"])
    assert min(shares) > 1.0
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.3, scores


@pytest.mark.parametrize("width", [0.01, 0.05, 0.2])
def test_gains_are_told_as_well_as_where_friction_is_described(arm, clean, width):
    """The rate at which friction changes its sign is left open, or stated: gains and intervals agree."""
    t, q, v, rigid = clean(100.0)
    gains, scores = np.array([5.0, 8.0]), []
    stated = arm.with_effects(*(e.model_copy(update={"smoothing": width}) for e in arm.effect))
    for seed in range(6):
        draw = np.random.default_rng(300 + seed)
        torque = rigid + VISCOUS * v + 10.0 * COULOMB * np.tanh(v / width)
        torque += 0.05 * draw.normal(size=v.shape)
        channels = {"e.joint_position": q + 1e-5 * draw.normal(size=q.shape)}
        channels["d.joint_torque"] = torque / gains
        log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
        found, known = torque_scales(arm, log), torque_scales(stated, log)
        scores.append([(s.value * k - 1.0) / (s.sigma * k) for s, k in zip(found, gains, strict=True)])
        for s, other in zip(found, known, strict=True):
            assert abs(s.value - other.value) < s.sigma < 1.5 * other.sigma
    assert np.sqrt(np.mean(np.square(scores))) < 1.5, scores


def test_slow_errors_widen_what_slow_columns_tell(rng):
    """Coloured errors count by the frequencies of a column: a slow one is told worse than a fast one."""
    n, draws = 800, 150
    waves = np.arange(1, 9)
    slow = np.cos(2.0 * np.pi * np.outer(np.arange(n) / n, waves) + rng.uniform(0.0, 6.0, 8))
    rows = np.concatenate([slow, rng.normal(size=(n, 8))], axis=1)[:, None, :]
    found = []
    for _ in range(draws):
        errors = np.asarray(lfilter([1.0], [1.0, -0.9], rng.normal(size=(n + 100, 1)), axis=0))[100:]
        solved = solve_joints(rows, errors)
        found.append(solved.x / solved.sigma)
    inside = np.mean(np.abs(found) < 1.96, axis=0)
    assert 0.90 < inside[:8].mean() < 0.98
    assert 0.6 < np.sqrt(np.mean(np.square(found)[:, 8:])) < 1.05  # not by what slow columns are


def test_friction_of_joints_that_turn_one_way_is_found_by_its_width(arm):
    """At the width that is expected first the sign never changes: friction is an offset."""
    model = pin.buildModelFromXML(URDF)
    t = np.arange(0.0, 18.0, 0.01)
    omega = 2.0 * np.pi * np.array([[0.3, 0.5], [0.47, 0.21]])
    v = 0.45 + 0.2 * np.sin(t[:, None] * omega[0]) + 0.2 * np.sin(t[:, None] * omega[1])
    a = 0.2 * np.sum(omega * np.cos(t[:, None, None] * omega), axis=1)
    q = 0.45 * t[:, None] - np.sum(0.2 / omega * np.cos(t[:, None, None] * omega), axis=1)
    rigid = np.array([pin.rnea(model, model.createData(), *x) for x in zip(q, v, a, strict=True)])
    draw = np.random.default_rng(0)
    torque = rigid + VISCOUS * v + COULOMB * np.tanh(v / 0.2) + 0.05 * draw.normal(size=v.shape)
    channels = {"e.joint_position": q + 1e-5 * draw.normal(size=q.shape), "d.joint_torque": torque}
    log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
    found = identify_arm(with_joint_effects(arm, ("j1", "j2"), "torque_offset"), log)
    assert [s.status for s in found.shapes] == ["found", "found"]
    for k, x in enumerate(COULOMB, start=1):
        own = found.estimate[f"friction_j{k}.coulomb"]
        assert abs(own.value - x) < 3.0 * own.sigma < 0.5 * x


@pytest.mark.parametrize("size", [0.0, 0.3, 0.5])
def test_two_stretches_of_a_misfit_agree_within_their_intervals(size):
    """What the model lacks is a function of a slow state, and noise on top hides how long it lasts."""
    n, beyond = 700, []
    for draw in range(40):
        halves = []
        for half in range(2):
            rng = np.random.default_rng((draw, half))
            s = gaussian_filter1d(rng.normal(size=(n + 400, 2)), 40.0, axis=0)[200:-200]
            v = np.gradient(s, axis=0)
            (s1, s2), (v1, v2) = (s / s.std(axis=0)).T, (v / v.std(axis=0)).T
            angles = [f(x) for f in (np.sin, np.cos) for x in (s1, s1 + s2)]
            rows = np.column_stack([np.ones(n), s1, s2, v1, v2, v1**2, v1 * v2, v2**2, *angles])
            lacking = np.sign(v1) * np.abs(s2) + np.cos(3.0 * s2)
            errors = size * lacking + rng.normal(size=n)
            halves.append(solve_joints(rows[:, None, :], errors[:, None]))
        one, two = halves
        beyond.append(np.abs(one.x - two.x) > 1.96 * np.hypot(one.sigma, two.sigma))
    assert np.mean(beyond) < 0.08
