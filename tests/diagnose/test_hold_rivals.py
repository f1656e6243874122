"""Half a period between what is held and what is a straight line is no clock's fault."""

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.effects import ActuatorDelay, ThrusterGain
from smsid.inputs.signals import Sampled
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import add_noise
from smsid.simulate import Inputs, simulate
from smsid.simulate.truth import truth_of
from tests.estimation.test_thrusters import PLACES, _write_truth, described

PERIOD = 0.1  # [s]
WEAK = ThrusterGain(name="weak", thruster="a", gain=-0.1)


def late(delay):
    return ActuatorDelay(name="late", actuator="rw1", delay=delay)


def flown(folder, held, *hidden, stated=lambda description: description, seed=1, seconds=40.0):
    """Return a description and a recording of it with hidden effects: thrusters that switch, and waves of
    wheel torque that are held between samples or not. Sensors have the errors that ``stated`` adds.
    """
    _write_truth(folder)
    description = stated(described(folder))
    rng, times = np.random.default_rng(seed), np.arange(0.0, seconds + PERIOD / 2, PERIOD)
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 3))
    waves = np.sin(2.0 * np.pi * np.array([0.05, 0.08, 0.13]) * times[:, None, None] + phase)
    torque = 0.03 * waves.sum(axis=2)
    on = (rng.uniform(size=(len(times) // 10 + 1, len(PLACES))) < 0.3).repeat(10, axis=0)[: len(times)]
    model = build_model(description.with_effects(*hidden))
    inputs = Inputs(
        thruster=Sampled.from_samples(times, on.astype(float), 0),
        wheel_torque=Sampled.from_samples(times, torque, 0 if held else 1),
    )
    trajectory = simulate(model, inputs, times[-1])
    channels = truth_of(trajectory, description.effective_sensors())(times)
    channels |= {"command.thruster": on.astype(float), "command.wheel_torque": torque}
    labels = {"wheel": ("rw1", "rw2", "rw3"), "thruster": tuple(PLACES)}
    exact = Recording.from_arrays(times, channels, labels=labels, name="pulses")
    return description, add_noise(exact, description.sensor, rng)


@pytest.mark.parametrize(
    ("held", "hidden", "named"),
    [
        (True, [WEAK], {"thruster_gain_a.gain": -0.1}),  # a tachometer that is late by 0.0505 s beside it
        pytest.param(True, [late(0.03)], {"actuator_delay_rw1.delay": 0.03}, marks=pytest.mark.slow),
        pytest.param(False, [late(0.03)], {"actuator_delay_rw1.delay": 0.03}, marks=pytest.mark.slow),
        (False, [late(PERIOD / 2)], {"actuator_delay_rw1.delay": PERIOD / 2}),  # of one wheel alone
    ],
)
def test_commands_that_are_held_are_no_clock_that_is_off(tmp_path, held, hidden, named):
    description, recording = flown(tmp_path, held, *hidden)
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "explained", found.sentence
    values = {p.name: p for c in found.causes for p in c.parameters}
    assert set(values) == set(named), found.sentence
    for name, true in named.items():
        assert abs(values[name].value - true) < 4.0 * values[name].sigma, found.sentence
    assert any(f"taken as {'held' if held else 'jumps'}" in note for note in found.notes), found.notes
