"""Exp. 2 from a recording to parameters: what it needs, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from twins.mujoco_twin import Drive, MujocoTwin
from twins.recordings import Q0_ARM
from twins.state import State

from smsid.effects.slosh import Slosh
from smsid.errors import NotIdentifiableError, RecordingError, SmsidError
from smsid.identify.paper._exp2 import identify_momentum
from smsid.identify.paper.exp2_result import references
from smsid.model import build_model
from smsid.recording import Recording
from smsid.simulate import Fourier, Inputs, JointMotion, simulate, truth_of

from ..support import M, from_twin, noisy, paper


@pytest.fixture(scope="module")
def result(model, twin_flight):
    return identify_momentum(model, noisy(twin_flight, paper(), 0), M)


def test_parameters_within_their_intervals(result):
    """40 s in MuJoCo, reference noise, Exp. 1's results exact: within four sigmas."""
    found = [p for p in result.parameters if p.status == "identifiable" and p.group == "exp2.step_b"]
    assert len(found) > 20
    for p in found:
        assert abs(p.value - p.nominal) < 4 * p.sigma, p


def test_intervals_are_honest(model, twin_flight):
    """Three seeds: errors in predicted sigmas have a root mean square of about one over all of Step B."""
    z = []
    for seed in range(1, 4):
        found = identify_momentum(model, noisy(twin_flight, paper(), seed), M)
        z += [(p.value - p.nominal) / p.sigma for p in found.parameters if p.group == "exp2.step_b"]
    assert len(z) == 90
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.3
    assert np.abs(z).max() < 5.0


def test_as_printed(result):
    """Products of noisy columns bias total least squares: 1 to 20 % on pi_m, and every sigma holds it."""
    printed = [p for p in result.parameters if p.group == "exp2.step_b_printed"]
    off = [abs(p.value / p.nominal - 1.0) for p in printed if abs(p.nominal) > 50.0]
    assert len(off) > 15
    assert np.median(off) < 0.05
    assert max(off) < 0.3
    assert all(abs(p.value - p.nominal) < 4 * p.sigma for p in printed if p.status == "identifiable")
    assert all("includes the bias" in p.note for p in printed)


def test_system_cm(result):
    """Of the whole at the start, seen from the base's CM, which sits in the inertial origin."""
    true = [0.2157532, -0.02001622, 0.10408559]
    for p, value in zip((p for p in result.parameters if p.name.startswith("system_cm")), true, strict=True):
        assert abs(p.value - value) < 4 * p.sigma < 0.04 * np.linalg.norm(true)


def test_what_is_told(result):
    """Every group, its condition number and its time."""
    assert {p.group for p in result.parameters} == {"exp2.step_a", "exp2.step_b", "exp2.step_b_printed"}
    assert set(result.conditions) == {
        "Exp. 2, Step A",
        "Exp. 2, Step B",
        "Exp. 2, Step B as printed",
    }
    assert all(np.isfinite(c) and c >= 1.0 for c in result.conditions.values())
    assert {"Exp. 2: filtering", "Exp. 2: Step A", "Exp. 2: Step B"} <= set(result.timing)
    assert result.notes == ()
    names = [p.name for p in result.parameters if p.group == "exp2.step_b"]
    assert len(names) == len(set(names)) == 30


def test_small_parameters_are_judged_against_their_kind(result):
    """link2.mz is zero in truth: its size is that of the largest first moment of link 2."""
    small = {p.name: p for p in result.parameters if p.small and p.group == "exp2.step_b"}
    by_name = {p.name: p for p in result.parameters if p.group == "exp2.step_b"}
    assert small["link2.mz"].reference == abs(by_name["link2.mx + 2 link3.m"].value)
    assert not by_name["link2.mx + 2 link3.m"].small
    assert len(references(result.b)) == len(result.b.base)


def test_errors_of_exp1_widen_the_intervals(model, twin_flight, result):
    """M known to 1 %: Step A's first moments, which go with M, cannot be known better."""
    recording = noisy(twin_flight, paper(), 0)
    wide = identify_momentum(model, recording, M, perturbed=[(model, 1.01 * M)])
    mine, before = ({(p.group, p.name): p for p in x.parameters} for x in (wide, result))
    assert mine.keys() == before.keys()
    assert all(mine[k].value == before[k].value and mine[k].sigma >= before[k].sigma for k in mine)
    assert mine["exp2.step_a", "step A: link3.mx"].relative_sigma > 0.0099
    assert before["exp2.step_a", "step A: link3.mx"].relative_sigma < 0.0099


def test_tracked_point_as_a_parameter(twin_flight):
    """Described 3 cm off in x, it comes back with an interval that holds it."""
    d = paper()
    off = [
        s.model_copy(update={"position": (0.53, 1.5, 0.6)}) if s.name in ("pose", "imu") else s
        for s in d.sensor
    ]
    wrong = build_model(d.with_sensors(*off))
    found = identify_momentum(wrong, noisy(twin_flight, d, 0), M, refine=True)
    assert found.pose_point is not None
    for p, true in zip(found.parameters[:3], (0.5, 1.5, 0.6), strict=True):
        assert p.name.startswith("pose_point.") and p.unit == "m"
        assert abs(p.value - true) < 4 * p.sigma
    assert found.parameters[0].nominal == 0.53
    assert found.parameters[0].sigma < 0.01
    np.testing.assert_array_equal(found.motion.pose_point, found.pose_point.position)


def test_without_accelerometers_it_says_so(model, twin_flight):
    found = identify_momentum(model, twin_flight.without("panel.acceleration"), M)
    assert any("panel has no accelerometers" in n for n in found.notes)


def fly(**torque) -> Recording:
    """30 s in MuJoCo with constant-amplitude torques on what is named."""

    def wave(size: float):
        return lambda t: size * np.sin(0.5 * t) * np.array([1.0, 0.7, -0.8])

    drive = Drive(**{name: wave(size) for name, size in torque.items()})
    return from_twin(MujocoTwin().simulate(drive, 30.0, initial=State(q=Q0_ARM.copy()), dt=2e-2, rate=50.0))


def test_still_wheels_are_refused(model):
    moving_arm = fly(joint_torque=5.0)
    quiet = moving_arm.with_channels({"tachometer.wheel_rate": 0.0 * moving_arm["tachometer.wheel_rate"]})
    with pytest.raises(NotIdentifiableError, match=r"No wheel turns in 'twin' by 'tachometer\.wheel_rate':"):
        identify_momentum(model, quiet, M)
    driven = quiet.with_channels({"command.wheel_torque": np.ones_like(quiet["tachometer.wheel_rate"])})
    with pytest.raises(NotIdentifiableError, match=r"though 'command\.wheel_torque' drives them"):
        identify_momentum(model, driven, M)


def test_still_joints_are_refused(model):
    recording = fly(wheel_torque=1.0)
    still = recording.with_channels(
        {
            "encoder.joint_velocity": 0.0 * recording["encoder.joint_velocity"],
            "encoder.joint_position": np.tile(Q0_ARM, (len(recording.time()), 1)),
        }
    )
    with pytest.raises(NotIdentifiableError, match="No joint moves in 'twin'"):
        identify_momentum(model, still, M)


def test_one_still_joint_leaves_the_others(model):
    """Joint 3 locked by its motor in a self-made flight: links 2 and 3 are one body."""
    zero = np.zeros((3, 1))
    position = Fourier(1 / 40, np.array([[-0.3], [0.25], [0.0]]), zero, Q0_ARM + np.array([0.3, -0.25, 0.0]))
    velocity = position.derivative()
    wheels = Fourier(1 / 30, zero, np.ones((3, 1)), np.zeros(3))
    inputs = Inputs(joint_motion=JointMotion(position, velocity, velocity.derivative()), wheel_torque=wheels)
    t = np.arange(0, 40.0, 0.05)
    truth = truth_of(simulate(model, inputs, 40.0), model.description.sensor)(t)
    recording = Recording.from_arrays(t, {k: v for k, v in truth.items() if not k.startswith("command")})
    found = identify_momentum(model, recording, M)
    names = [n for n in found.b.base.names]
    assert not any(n.startswith("link3") for n in names)
    described = {p.name: p for p in found.parameters if p.group == "exp2.step_b"}
    p = next(p for n, p in described.items() if n.startswith("link2.mx"))
    assert p.value == pytest.approx(p.nominal, rel=0.01)


def test_thrust_is_refused(model, twin_flight):
    pushed = twin_flight.with_channels({"command.force": np.full((4001, 3), 1.0)})
    with pytest.raises(NotIdentifiableError, match=r"'twin' has thrust, so its momentum is not conserved"):
        identify_momentum(model, pushed, M)


def test_too_short_is_refused(model, twin_flight):
    with pytest.raises(NotIdentifiableError, match=r"lasts 15 s: too short") as caught:
        identify_momentum(model, twin_flight.window(0.0, 15.0), M)
    assert caught.value.evidence["length"] == pytest.approx(15.0)


@pytest.mark.parametrize("start", [4.0, 12.0])
def test_a_start_in_motion_is_refused(model, twin_flight, start: float):
    cut = noisy(twin_flight, paper(), 0).window(start, 40.0)
    with pytest.raises(NotIdentifiableError, match="does not start at rest") as caught:
        identify_momentum(model, cut, M)
    assert caught.value.evidence["quantity"]


@pytest.mark.parametrize("channel", ["pose.velocity", "encoder.joint_position", "tachometer.wheel_rate"])
def test_missing_channels_are_named(model, twin_flight, channel: str):
    with pytest.raises(RecordingError, match=channel):
        identify_momentum(model, twin_flight.without(channel), M)


def test_unknown_modal_estimator_is_told(model, twin_flight):
    with pytest.raises(SmsidError, match="no modal estimator 'magic'"):
        identify_momentum(model, twin_flight, M, modal="magic")  # type: ignore[arg-type]


def test_printed_modes_need_accelerometers(model, twin_flight):
    with pytest.raises(NotIdentifiableError, match="need accelerometers on 'panel'"):
        identify_momentum(model, twin_flight.without("panel.acceleration"), M, modal="printed")


def test_printed_modes(model, twin_flight, result):
    """(31)-(32) without noise: the diagonal of the inertia within 0.5 %, and not the smoother's."""
    found = identify_momentum(model, twin_flight, M, modal="printed")
    smooth = identify_momentum(model, twin_flight, M)
    diagonal = ("bus.Ixx", "bus.Iyy", "bus.Izz")
    own = [p for p in found.parameters if p.group == "exp2.step_b" and p.name.startswith(diagonal)]
    assert len(own) == 3
    assert max(abs(p.value / p.nominal - 1.0) for p in own) < 5e-3
    assert np.abs(found.b.values / smooth.b.values - 1.0).max() > 1e-3


def test_a_tank_on_a_moving_link_is_refused(twin_flight):
    d = paper()
    moved = Slosh(
        name="tank", frame="link2", position=(0, 0, 0), mass=49.6, stiffness=(0.41,) * 3, damping=(0.02,) * 3
    )
    with pytest.raises(NotIdentifiableError, match="Tank 'tank' sits on a moving link") as refused:
        identify_momentum(build_model(d.with_effects(moved)), twin_flight, M)
    assert refused.value.evidence["other_flight"]  # `identify` takes the filter


def test_an_appendage_on_a_moving_link_is_refused(twin_flight):
    d = paper()
    panel = d.get_effect("panel").model_copy(update={"frame": "link2", "thickness": 1e-4})
    with pytest.raises(NotIdentifiableError, match="Appendage 'panel' sits on a moving link") as refused:
        identify_momentum(build_model(d.with_effects(panel)), twin_flight, M)
    assert refused.value.evidence["other_flight"]
