"""Steps of the filter are halved where that moves what is estimated, and only there."""

import numpy as np
import pytest

from smsid.effects import JointFriction
from smsid.estimation._maximum import maximise
from smsid.estimation.flight import flight_of
from smsid.estimation.parameter_vector import Point
from smsid.estimation.step_size import finely_stepped
from smsid.estimation.unknowns import unknowns_of
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))


@pytest.mark.parametrize(("smoothing", "halved"), [(1e-3, True), (50.0, False)])
def test_friction_that_turns_within_a_step_asks_for_shorter_ones(tmp_path, smoothing, halved):
    """A wheel is driven through standstill by a known torque, under friction of two widths of its sign."""
    recording = recorded(RIGID, RIGID.fly(40.0, burns_and_wheels), np.random.default_rng(1))
    rub = JointFriction(name="rub", joint="rw1", coulomb=0.02, smoothing=smoothing, prior={"coulomb": 0.02})
    described = guess(tmp_path, RIGID, tank=False, panel=False).with_effects(rub)
    point = Point.of(described)
    flight = flight_of(point, recording, "flight")
    unknowns = unknowns_of(point).unknowns
    found = maximise(point, unknowns, [flight])[0]
    _, (finer,), _ = finely_stepped(found, [flight])
    assert (finer.problem.substep < 0.6 * flight.problem.substep) == halved
