"""Steps of a fit: what bodies are together goes straight, and what rotation tells of a mass somewhere."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects.appendage_effect import ExtraMode
from smsid.effects.payload import MassLoss
from smsid.estimation._retraction import retract
from smsid.estimation.parameter_vector import Unknown


def test_a_mass_on_springs_that_moves_leaves_the_whole_as_it_is(known):
    """What one more mode has of the panel's mass is no other mass: the spacecraft at rest weighs and turns as
    before, wherever along the panel it sits.
    """
    place = (2.0, 0.3, 0.0)
    mode = ExtraMode(name="more", appendage="panel", mass=0.4, position=place, frequency=0.5)
    point = known.point.with_effect(mode)
    free = [p for p in mode.parameters() if p.name in ("more.mass", "more.position.x", "more.position.y")]
    own = tuple(Unknown(p.name, "effect", p.unit, p.value, np.inf, 1.0) for p in free)
    inertial = tuple(u for u in known.unknowns if u.kind == "inertial")
    step = np.concatenate([np.zeros(len(inertial)), [-0.2, 0.8, -0.5]])
    moved = retract(point, (*inertial, *own), step)
    assert moved.description.get_effect("more").position == pytest.approx((2.8, -0.2, 0.0))
    whole = [composite(p) for p in (point, moved)]
    assert whole[1] == pytest.approx(whole[0], abs=1e-6 * np.abs(whole[0]).max())


def composite(point) -> np.ndarray:
    """Inertia (6, 6) of the whole spacecraft at home, about the bus."""
    model = point.model()
    return pin.crba(model.pin, model.pin.createData(), model.home)[:6, :6]


def test_mass_lost_at_a_place_goes_straight_in_what_rotation_tells(known):
    """Along the ridge of mass and place the moments of inertia do not change, however long the step."""
    rate, place = 0.004, np.array([1.2, -0.7, 0.5])
    leak = MassLoss(name="leak", rate=rate, position=tuple(place))
    point = known.point.with_effect(leak)
    parameters = {p.name: p for p in leak.parameters()}
    names = ["leak.rate", *(f"leak.position.{axis}" for axis in "xyz")]
    own = tuple(Unknown(n, "effect", parameters[n].unit, parameters[n].value, np.inf, 1.0) for n in names)
    step = np.r_[2.0 * rate, -place]  # to first order, rate * place * place' stays
    end = retract(point, own, step).description.get_effect("leak")
    assert end.rate == pytest.approx(4.0 * rate)
    assert end.position == pytest.approx(0.5 * place)
    # and to first order the step is the one that was meant
    near = retract(point, own, 1e-6 * step).description.get_effect("leak")
    assert near.rate - rate == pytest.approx(2e-6 * rate, rel=1e-4)
    assert near.position - place == pytest.approx(-1e-6 * place, rel=1e-4)
