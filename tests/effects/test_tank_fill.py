"""A tank emptied by thrust: against balances of momentum, closed forms, and Newton's laws in plain numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from smsid.description import Description
from smsid.effects import Slosh, TankFill
from smsid.errors import SmsidError
from smsid.export._mjcf import write_mjcf
from smsid.model import build_model
from smsid.simulate import Constant, Inputs, simulate
from smsid.tracking import Sample, Tracker
from tests.estimation.satellite import Satellite, guess

USE = 0.02  # [kg / (N s)]: far more than any thruster uses
FILL = TankFill(name="fuel", tank="tank", propellant=40.0, consumption=USE, fill=0.8, height=1.5)
TRUTH = Satellite(tank=(15.0, 0.5, 0.06), panel=(1.0, 0.1, 1e-6, -1e-6))
SECONDS = 30.0


def craft(folder, fill=FILL, **more):
    """Return the numpy satellite without its panel, its tank emptied."""
    plain = guess(folder, replace(TRUTH, panel=(1.0, 0.1, 0.0, 0.0)), off=0.0, panel=False)
    return plain.with_effects(*plain.effect, fill).model_copy(update=more)


def impulse_of(model, v):
    return v[..., model.pin.joints[model.pin.getJointId("fuel.used")].idx_v]


def test_thrust_along_a_line_gives_the_velocity_of_the_rocket_whose_fuel_leaves_at_rest(tmp_path):
    """Of one that pushes nothing by itself: dv = F dt / m(t), so v = ln(m0 / m1) / consumption."""
    stiff = Slosh(
        name="tank", position=(0.0, 0.0, 0.0), mass=15.0, stiffness=(4e3,) * 3, damping=(400.0,) * 3
    )
    d = craft(tmp_path).with_effects(stiff)
    model = build_model(d)
    mass = model.pin.inertias[1].mass + 15.0
    force = np.array([2.0, 0.0, 0.0])
    # the bus's centre of mass is at its origin
    end = simulate(model, Inputs(force=Constant(force)), SECONDS).states(np.array([SECONDS]))
    assert impulse_of(model, end.v[0]) == pytest.approx(2.0 * SECONDS, rel=1e-7)
    left = mass - USE * 2.0 * SECONDS
    assert end.v[0, 0] == pytest.approx(np.log(mass / left) / USE, rel=1e-4)


@pytest.mark.parametrize("left", (1.0, 0.6, 0.1))
def test_in_a_cylinder_slosh_has_the_frequency_and_mass_of_the_textbook(left):
    """Dodge: w^2 = 1.841 g / R tanh(1.841 h / R), m1 / m = R / (2.2 h) tanh(1.84 h / R), for a full tank."""
    used, mass, stiffness = FILL.shares((1.0 - left) * 40.0 / USE)
    assert used == pytest.approx((1.0 - left) * 40.0)
    h0, h = 0.8 * 1.5, 0.8 * 1.5 * left
    first = [m * np.tanh(1.84 * x) / (2.2 * x) for m, x in ((40.0, h0), (40.0 * left, h))]
    assert mass == pytest.approx(first[1] / first[0], rel=2e-3)
    assert stiffness / mass == pytest.approx(np.tanh(1.841 * h) / np.tanh(1.841 * h0))


def test_a_tumbling_satellite_moves_as_by_newtons_laws_with_the_mass_that_is_left(tmp_path):
    """The numpy satellite, step by step with tank, mass, first moment and inertia as they are by then."""
    d = craft(tmp_path)
    force, torque = np.array([3.0, -2.0, 1.5]), np.array([0.2, -0.1, 0.15])
    model = build_model(d)
    at = np.array(TRUTH.tank_at)
    bus = model.pin.inertias[1].toDynamicParameters()
    step, n = 0.02, round(SECONDS / 0.02)
    x = np.zeros(24)
    x[6] = 1.0

    def now(t):
        used, share, stiffness = FILL.shares(t * np.abs(force).sum())
        rest = -used + 15.0 * (1.0 - share)  # of what moves with the bus
        inertia = np.array([[bus[4], bus[5], bus[7]], [bus[5], bus[6], bus[8]], [bus[7], bus[8], bus[9]]])
        inertia = inertia + rest * (at @ at * np.eye(3) - np.outer(at, at))
        mass = bus[0] + rest
        tank = 15.0 * share, 0.5 * stiffness, 0.06 * np.sqrt(share * stiffness)
        centre = (bus[1:4] + rest * at) / mass
        return replace(TRUTH, mass=mass, centre=tuple(centre), inertia=tuple(map(tuple, inertia)), tank=tank)

    for k in range(n):
        craft_then = [now(k * step), now((k + 0.5) * step), now((k + 1) * step)]
        own = force, torque, np.zeros(3)
        k1 = craft_then[0].derivative(x, *own)[0]
        k2 = craft_then[1].derivative(x + step / 2 * k1, *own)[0]
        k3 = craft_then[1].derivative(x + step / 2 * k2, *own)[0]
        k4 = craft_then[2].derivative(x + step * k3, *own)[0]
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    inputs = Inputs(force=Constant(force), torque=Constant(torque), wheel_torque=Constant(np.zeros(3)))
    end = simulate(model, inputs, SECONDS).states(np.array([SECONDS]))
    slosh = model.pin.joints[model.pin.getJointId("tank")].idx_v
    assert np.abs(end.v[0, :6] - x[7:13]).max() < 2e-5 * np.abs(x[7:13]).max()
    assert np.abs(end.v[0, slosh : slosh + 3] - x[16:19]).max() < 1e-5


def test_single_thrusters_use_what_they_give_also_where_they_cancel(tmp_path):
    d = craft(tmp_path)
    pair = [
        {"name": f"t{i}", "position": (0, 0, 0), "direction": (s, 0, 0), "force": 2.0}
        for i, s in enumerate((1, -1))
    ]
    d = Description.model_validate({**dict(d), "thruster": pair})
    model = build_model(d)
    end = simulate(model, Inputs(thruster=Constant(np.array([1.0, 1.0]))), 10.0).states(np.array([10.0]))
    assert impulse_of(model, end.v[0]) == pytest.approx(40.0, rel=1e-7)
    assert np.abs(end.v[0, :6]).max() < 1e-9


def test_without_consumption_nothing_changes(tmp_path):
    d, inputs = craft(tmp_path), Inputs(force=Constant(np.array([3.0, 2.0, 1.0])))
    with_it, without = (
        simulate(build_model(x), inputs, 10.0).states(np.array([10.0])).v[0, :6]
        for x in (
            d.with_effects(FILL.model_copy(update={"consumption": 0.0})),
            d.model_copy(update={"effect": d.effect[:-1]}),
        )
    )
    assert np.abs(with_it - without).max() < 1e-9


def test_it_is_exported_nowhere_and_says_why(tmp_path):
    with pytest.raises(SmsidError, match="fuel"):
        write_mjcf(build_model(craft(tmp_path)))


def test_what_was_used_stays_so_where_the_motion_is_begun_anew(tmp_path):
    d = craft(tmp_path)
    tracker = Tracker(d, follow={"bus.m": 0.0})
    push = {"command.force": np.array([2.0, 0.0, 0.0]), "gyro.angular_rate": np.zeros(3)}
    push |= {"tacho.wheel_rate": np.zeros(3), "st.attitude": np.eye(4)[3], "gyro.acceleration": np.zeros(3)}
    for t in np.arange(0.0, 2.05, 0.1):
        tracker.update(Sample(float(t), push))
    model = tracker.origin.base
    assert impulse_of(model, tracker.state.v) == pytest.approx(4.0, abs=0.5)
    before = impulse_of(model, tracker.state.v)
    for t in (50.0, 50.1):
        tracker.update(Sample(t, push))
    assert tracker.log.counts["begun"] == 2
    assert impulse_of(model, tracker.state.v) == pytest.approx(before + 0.2, abs=0.05)


@pytest.mark.parametrize("wrong", ({"law": "table"}, {"start": 1.0}, {"law": "table", "fills": (1.0, 0.5)}))
def test_a_law_that_is_none_is_refused(wrong):
    with pytest.raises(ValidationError):
        TankFill.model_validate({**dict(FILL), **wrong})


def test_more_slosh_than_propellant_is_refused(tmp_path):
    with pytest.raises(SmsidError, match="More sloshes"):
        build_model(craft(tmp_path, FILL.model_copy(update={"propellant": 10.0})))
