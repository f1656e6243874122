"""Single thrusters by their on-times: simulated as plain mechanics has it, and their errors identified."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import Thruster, load_description, save_description
from smsid.effects import ActuatorDelay, Effect, ThrusterGain, ThrusterMisalignment, parse_effect
from smsid.errors import DescriptionError, ExperimentError, RecordingError
from smsid.estimation.flight import _without_switching_times
from smsid.estimation.identify import identify_spacecraft
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.input_hold import commanded_inputs, means
from smsid.experiments import Experiment, fly
from smsid.inputs.signals import Constant
from smsid.model import build_model
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.simulate import Inputs
from smsid.tracking._drive import CommandMemory
from tests.estimation.satellite import Satellite, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
PLACES = {"a": (0.5, 0.4, 0.0), "b": (-0.5, 0.4, 0.1), "c": (0.0, -0.6, 0.5), "d": (0.3, 0.0, -0.5)}
DIRECTIONS = {"a": (1.0, 0.0, 0.0), "b": (0.0, -2.0, 0.0), "c": (0.0, 0.6, 0.8), "d": (-1.0, 0.0, 1.0)}
FULL = 2.0  # [N]


def described(folder):
    thrusters = tuple(
        Thruster(name=n, position=PLACES[n], direction=DIRECTIONS[n], force=FULL) for n in PLACES
    )
    plain = guess(folder, RIGID, off=0.0, tank=False, panel=False)
    return plain.model_copy(update={"thruster": thrusters})


def wrench(shares, gain=(), turn=()):
    """Return force and torque about O in plain mechanics; ``gain`` and ``turn`` by thruster."""
    force, torque = np.zeros(3), np.zeros(3)
    for share, name in zip(shares, PLACES, strict=True):
        d = np.array(DIRECTIONS[name]) / np.linalg.norm(DIRECTIONS[name])
        f = FULL * share * (1.0 + dict(gain).get(name, 0.0)) * d
        f = f + np.cross(dict(turn).get(name, (0.0, 0.0, 0.0)), f)
        force, torque = force + f, torque + np.cross(PLACES[name], f)
    return force, torque


def test_forces_and_moments_are_those_of_plain_mechanics(tmp_path):
    shares = np.array([0.3, 1.0, 0.0, 0.5])
    model = build_model(described(tmp_path))
    inputs = Inputs(thruster=Constant(shares))
    inputs.check(model)
    expected = np.concatenate(wrench(shares))
    np.testing.assert_allclose(inputs.applied(model)(0.0)[:6], expected, atol=1e-14)
    np.testing.assert_allclose(inputs.driven(model).applied(model)(0.0)[:6], expected, atol=1e-14)
    with pytest.raises(ExperimentError, match="'thruster' has 3 components, the spacecraft has 4"):
        Inputs(thruster=Constant(shares[:3])).check(model)


def test_errors_of_one_thruster_are_its_own_in_any_order(tmp_path):
    shares = np.array([0.3, 1.0, 0.2, 0.5])
    errors = (
        ThrusterGain(name="weak", thruster="c", gain=-0.1),
        ThrusterMisalignment(name="bent", thruster="c", angles=(1e-4, 2e-4, -1e-4)),
    )
    for order in (errors, errors[::-1]):
        model = build_model(described(tmp_path).with_effects(*order))
        found = Inputs(thruster=Constant(shares)).driven(model).applied(model)(0.0)[:6]
        expected = wrench(shares, {"c": -0.1}, {"c": (1e-4, 2e-4, -1e-4)})
        np.testing.assert_allclose(found, np.concatenate(expected), atol=1e-7)
    late = build_model(described(tmp_path).with_effects(ActuatorDelay(name="late", actuator="b", delay=0.5)))
    found = Inputs(thruster=Constant(shares)).driven(late).applied(late)
    np.testing.assert_allclose(found(0.2)[:3], wrench(shares * [1, 0, 1, 1])[0], atol=1e-14)


def test_a_thruster_that_there_is_not_is_refused(tmp_path):
    gain = ThrusterGain(name="weak", thruster="e", gain=-0.1)
    with pytest.raises(DescriptionError, match="There is no thruster 'e'") as refused:
        build_model(described(tmp_path).with_effects(gain))
    assert "a, b, c, d" in refused.value.advice
    for given in ({"thruster": "a", "gain": (0.1, 0.0, 0.0)}, {"gain": 0.1}):
        with pytest.raises(ValueError, match="`gain` takes"):
            parse_effect({"kind": "thruster_gain", "name": "g", **given})


def test_a_file_keeps_thrusters(tmp_path):
    description = described(tmp_path)
    save_description(description, tmp_path / "craft.toml")
    assert load_description(tmp_path / "craft.toml").thruster == description.thruster


def test_labels_decide_columns_and_forces_are_shares_of_full_thrust(tmp_path):
    model = build_model(described(tmp_path))
    shares = np.tile([0.1, 0.2, 0.3, 0.4], (5, 1))
    swapped = Recording.from_arrays(
        np.arange(5) * 0.1,
        {"command.thruster_force": FULL * shares[:, ::-1]},
        labels={"thruster": ("d", "c", "b", "a")},
    )
    inputs = commanded_inputs(model, order_columns(swapped, model), "held")
    assert inputs.thruster is not None
    np.testing.assert_allclose(inputs.thruster(0.2), shares[0])
    wrong = Recording.from_arrays(
        np.arange(5) * 0.1, {"command.thruster": shares}, labels={"thruster": ("a", "b", "c", "x")}
    )
    with pytest.raises(RecordingError, match="unknown 'x'; missing 'd'"):
        order_columns(wrong, model)


def firing(t):
    """Thrusters pulse in turn, each now and then with another."""
    return np.array([((t // 3.0) % 7 in own) * 1.0 for own in ((0, 4), (1, 5), (2, 4), (3, 5))])


@pytest.fixture(scope="module")
def flown():
    gain, turn = {"a": 0.05, "c": -0.08}, {"b": (0.02, 0.0, -0.01)}
    flight = RIGID.fly(42.0, lambda t: (*wrench(firing(t), gain, turn), np.zeros(3)))
    plain = recorded(RIGID, flight, np.random.default_rng(7), without=("command.force", "command.torque"))
    shares = np.array([firing(t) for t in plain.time()])
    return Recording.from_arrays(
        plain.time(),
        {**{c: plain[c] for c in plain.channels}, "command.thruster": shares},
        labels={"wheel": ("rw1", "rw2", "rw3"), "thruster": tuple(PLACES)},
        name="pulses",
    )


def test_gains_and_directions_of_single_thrusters_are_found(flown, tmp_path):
    effects: list[Effect] = [ThrusterGain(name=f"gain_{n}", thruster=n, prior={"gain": 0.1}) for n in "ac"]
    prior = {f"angles.{x}": 0.05 for x in "xyz"}
    effects.append(ThrusterMisalignment(name="bent", thruster="b", prior=prior))
    description = described(tmp_path).with_effects(*effects)
    _write_truth(tmp_path)
    found = identify_flights(description, [flown], bodies=False)
    truth = {"gain_a.gain": 0.05, "gain_c.gain": -0.08, "bent.angles.x": 0.02, "bent.angles.z": -0.01}
    for name, x in truth.items():
        p = found.estimate[name]
        assert abs(p.value - x) < 4.0 * p.sigma + 3e-4 * abs(x), name
        assert p.sigma < 0.005, name
    # along its own direction a thruster cannot be turned: the data do not see it, and that is said
    assert found.estimate["bent.angles.y"].status == "not_identifiable"
    assert found.estimate["bent.angles.y"].sigma == pytest.approx(0.05, rel=0.01)


@pytest.mark.parametrize(("field", "full"), [("thruster", 1.0), ("thruster_force", FULL)])
def test_shares_that_do_not_say_when_a_valve_opens_are_noted(tmp_path, field, full):
    """Said of full thrust or in newtons."""
    model, times, shares = build_model(described(tmp_path)), np.arange(40) * 0.1, np.zeros((40, 4))
    shares[:10, 0] = full
    channel, labels = f"command.{field}", {"thruster": tuple(PLACES)}
    whole = Recording.from_arrays(times, {channel: shares}, labels=labels)
    shares = shares.copy()
    shares[:20, 1] = 0.3 * full
    part = Recording.from_arrays(times, {channel: shares}, labels=labels)
    assert _without_switching_times(model, whole, {field: channel}) == []
    assert _without_switching_times(model, part, {}) == []
    (note,) = _without_switching_times(model, part, {field: channel})
    assert note.startswith(f"12 % of '{channel}' are between no and full thrust")
    pulsed = build_model(with_pulses(described(tmp_path), "begin"))
    assert _without_switching_times(pulsed, part, {field: channel}) == []


def with_pulses(description, pulse):
    thrusters = tuple(t.model_copy(update={"pulse": pulse}) for t in description.thruster)
    return description.model_copy(update={"thruster": thrusters})


@pytest.mark.parametrize(("pulse", "first"), [("begin", 0.0), ("middle", 0.04), ("end", 0.08)])
@pytest.mark.parametrize("hold", ["held", "linear", "jumps"])
def test_pulses_lie_where_they_are_said_to_whatever_other_commands_do(tmp_path, pulse, first, hold):
    """20 ms of every sample of 0.1 s, a train that looks like no steps, beside a sine of a torque."""
    times, shares = np.arange(60) * 0.1, np.zeros((60, 4))
    shares[:, 0] = 0.2
    torque = np.column_stack([np.sin(times), np.zeros((60, 2))])
    channels = {"command.thruster": shares, "command.torque": torque}
    recording = Recording.from_arrays(times, channels, labels={"thruster": tuple(PLACES)})
    description = described(tmp_path)
    model = build_model(with_pulses(description, pulse))

    def open_for(inputs):
        return means(inputs.thruster, edges)

    edges = np.arange(0.0, 1.0005, 0.01)
    open_ = np.isclose((edges[:-1] - first + 1e-9) % 0.1, 0.0, atol=0.0115)
    found = open_for(commanded_inputs(model, recording, hold))
    np.testing.assert_allclose(found[:, 0], open_, atol=1e-6)
    memory = CommandMemory(model, "linear")
    for t, row in zip(times, shares, strict=True):
        memory.add(t, {"command.thruster": row})
    np.testing.assert_allclose(open_for(memory.inputs()), found, atol=1e-12)
    spread = commanded_inputs(build_model(description), recording, "held")
    np.testing.assert_allclose(open_for(spread)[:, 0], 0.2)


def test_a_pulse_longer_than_its_sample_is_refused(tmp_path):
    times, shares = np.arange(10) * 0.1, np.full((10, 4), 20.0)
    recording = Recording.from_arrays(times, {"command.thruster": shares}, labels={"thruster": tuple(PLACES)})
    model = build_model(with_pulses(described(tmp_path), "begin"))
    with pytest.raises(RecordingError, match=r"is open for 20 of the sample at index 0"):
        commanded_inputs(model, recording, "held")


def test_pulses_by_their_switching_times_have_the_impulse_and_its_place(tmp_path):
    """A valve open from 0.1 to 0.13 s on a clock of its own: the impulse is FULL 0.03 s, at 0.115 s."""
    times = np.array([0.0, 0.1, 0.13, 0.2, 0.3])
    shares = np.zeros((5, 4))
    shares[1, 0] = 1.0
    labels = {"thruster": tuple(PLACES)}
    recording = Recording.from_arrays(times, {"command.thruster": shares}, labels=labels)
    model = build_model(described(tmp_path))
    inputs = commanded_inputs(model, order_columns(recording, model), "held")
    assert inputs.thruster is not None
    t = np.linspace(0.0, 0.3, 3001)[:-1] + 5e-5
    force = FULL * np.array([inputs.thruster(x)[0] for x in t])
    impulse = force.sum() * 1e-4
    assert impulse == pytest.approx(FULL * 0.03, rel=1e-6)
    assert (force * t).sum() * 1e-4 / impulse == pytest.approx(0.115, abs=1e-6)


def test_the_papers_method_refuses_single_thrusters(flown, tmp_path):
    with pytest.raises(RecordingError, match="single thrusters"):
        identify_spacecraft(described(tmp_path), [flown], method="paper")


def _write_truth(folder):
    j, c = np.array(RIGID.inertia), np.array(RIGID.centre)
    j = j - RIGID.mass * ((c @ c) * np.eye(3) - np.outer(c, c))
    (folder / "satellite.urdf").write_text(
        f'<robot name="satellite"><link name="bus"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}"/>'
        f'<mass value="{RIGID.mass}"/><inertia ixx="{j[0, 0]}" iyy="{j[1, 1]}" izz="{j[2, 2]}" '
        f'ixy="{j[0, 1]}" ixz="{j[0, 2]}" iyz="{j[1, 2]}"/></inertial></link></robot>',
        encoding="utf-8",
    )


@pytest.mark.parametrize(("share", "refused"), [(1.0, False), (0.3, True)])
def test_what_fires_in_pulses_is_not_simulated_at_a_part_of_its_thrust(tmp_path, share, refused):
    """What `simulate` writes is read by `identify` as it was flown, or not written."""
    model = build_model(with_pulses(described(tmp_path), "begin"))
    steps = {"kind": "steps", "times": [0.0, 1.0], "values": [[share, 0.0, 0.0, 0.0], [0.0] * 4]}
    tree = {"schema": 1, "name": "burn", "duration": 2.0, "thruster": steps}
    experiment = Experiment.model_validate(tree)
    if refused:
        with pytest.raises(ExperimentError, match=r"'a' fires in pulses, .* asks for 0\.3 of its thrust"):
            fly(model, experiment, np.random.default_rng(1))
    else:
        found = fly(model, experiment, np.random.default_rng(1)).recording
        thrust = commanded_inputs(model, found, "held").thruster
        assert thrust is not None
        impulse = means(thrust, np.array([0.0, 2.0]))[0, 0] * 2.0
        assert impulse == pytest.approx(1.0, abs=1e-6)
