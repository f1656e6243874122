"""Every effect of the catalogue: parameters out and in, bounds, and effects of users."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field, ValidationError

import smsid.effects.base as base
from smsid.description import Description, load_description
from smsid.effects import Effect, JointFriction, catalogue, parse_effect, physical, register
from smsid.errors import DescriptionError
from smsid.model import build_model

EXAMPLES = {
    "slosh": {
        "name": "tank", "position": (0.1, 0.2, 0.3), "mass": 5.0,
        "stiffness": (1.0, 2.0, 3.0), "damping": (0.1, 0.2, 0.3),
    },
    "beam_appendage": {
        "name": "panel", "position": (1.0, 0.0, 0.0), "length": 2.0, "width": 1.0, "thickness": 0.002,
        "density": 2700.0, "youngs_modulus": 7e10, "damping": 0.005, "stations": (0.0, 0.5),
    },
    "modal_appendage": {
        "name": "sail", "position": (1.0, 0.0, 0.0), "mass": 5.0, "center_of_mass": (1.0, 0.0, 0.0),
        "inertia": (0.1, 0.0, 7.0, 0.0, 0.0, 7.0),
        "mode": (
            {"frequency": 0.5, "damping": 0.01, "translation": (0, 0, 1), "rotation": (0, -1, 0)},
            {"frequency": 1.5, "damping": 0.02, "translation": (0, 0, 0.5), "rotation": (0.1, 0, 0)},
        ),
    },
    "servo": {"name": "sv", "joint": "joint1", "stiffness": 40.0, "damping": 1.0, "limit": 5.0},
    "base_tilt": {"name": "bt", "x": 0.02, "y": -0.01},
    "joint_friction": {"name": "f", "joint": "joint1", "viscous": 0.1, "coulomb": 0.2},
    "joint_cable": {"name": "jc", "joint": "joint2", "stiffness": 2.0, "rest": 0.3},
    "thermal_snap": {"name": "ts", "appendage": "panel", "deflection": 0.02, "start": 10.0},
    "gear": {"name": "g", "joint": "joint2", "ratio": 50.0, "torque_gain": 0.1, "also": {"joint1": 5.0}},
    "joint_offset": {"name": "z", "joint": "joint1", "angle": 0.1},
    "torque_offset": {"name": "b", "joint": "joint1", "torque": 0.3},
    "motor_inertia": {"name": "r", "joint": "joint1", "inertia": 0.4},
    "motor_coupling": {
        "name": "w", "joints": ("joint1", "joint2"), "inertia": 0.1, "viscous": 0.2, "coulomb": 0.3,
    },
    "payload": {"name": "p", "frame": "tool", "mass": 5.0, "com": (0.1, 0.0, 0.2)},
    "grasped_body": {
        "name": "gb", "frame": "tool", "mass": 60.0, "centre": (0.4, 0.1, -0.2),
        "central_inertia": (5.0, 0.2, 4.0, 0.1, -0.3, 3.0),
    },
    "body_error": {
        "name": "e", "body": "link2", "mass": 1.0, "first_moment": (1.0, 0.0, 0.0),
        "inertia": (0.1, 0.0, 2.0, 0.0, 0.0, 2.0),
    },
    "mass_loss": {"name": "l", "position": (0.5, 0.0, -0.3), "rate": 0.1, "start": 10.0},
    "thruster_gain": {"name": "tg", "gain": (0.1, -0.1, 0.05)},
    "thruster_misalignment": {"name": "tm", "angles": (0.02, -0.01, 0.05), "start": 3.0},
    "torque_gain": {"name": "kt", "joint": "joint2", "error": -0.1},
    "actuator_delay": {"name": "late", "actuator": "wheel_y", "delay": 0.05},
    "external_wrench": {"name": "leak", "force": (0.1, 0.2, 0.3), "torque": (0.1, 0.0, -0.1), "start": 2.0},
    "gravity_gradient": {"name": "gg", "gradient": 1.2e-6},
    "sensor_bias": {"name": "sb", "sensor": "imu", "quantity": "angular_rate", "bias": (1e-4, 0.0, -1e-4)},
    "sensor_scale": {
        "name": "ss", "sensor": "encoder", "quantity": "joint_velocity", "component": "joint2", "error": 0.01,
    },
    "sensor_misalignment": {
        "name": "sm", "sensor": "imu", "quantity": "acceleration", "angles": (0.01, 0.02, -0.01),
    },
    "lever_arm": {"name": "la", "sensor": "imu", "offset": (0.01, -0.02, 0.03)},
    "sensor_delay": {"name": "sd", "sensor": "pose", "quantity": "attitude", "delay": 0.02},
    "time_offset": {"name": "to", "sensor": "imu", "offset": -0.015},
    "quantisation": {"name": "qu", "sensor": "tachometer", "quantity": "wheel_rate", "step": 0.01},
    "outliers": {"name": "ol", "sensor": "imu", "quantity": "acceleration", "share": 0.02, "size": 0.01},
    "stuck": {
        "name": "st", "sensor": "panel", "quantity": "acceleration", "station": 1, "component": "z",
        "start": 30.0,
    },
    "tank_fill": {"name": "tf", "tank": "tank", "propellant": 60.0, "consumption": 5e-4},
    "slosh_wall": {"name": "sw", "tank": "tank", "gap": 0.05, "stiffness": 20.0},
    "scale_by_rate": {
        "name": "sr", "sensor": "imu", "quantity": "angular_rate", "slope": (0.1, -0.2, 0.05),
    },
    "slosh_nonlinearity": {"name": "sn", "tank": "tank", "cubic": 0.5, "quadratic_damping": 0.1},
    "slosh_pendulum": {
        "name": "sp", "pivot": (0.1, 0.0, 0.4), "mass": 5.0, "length": 0.5, "damping": 0.02, "stiffness": 0.1,
    },
    "geometric_stiffness": {"name": "gs", "appendage": "panel", "factor": 1.0},
    "frequency_drift": {"name": "fd", "appendage": "panel", "mode": 2, "rate": 1e-3},
    "mode_error": {"name": "me", "appendage": "panel", "mode": 2, "frequency": 0.03, "damping": 1e-3},
    "wheel_imbalance": {"name": "wi", "wheel": "wheel_z", "static": 1e-3, "phase": 0.3, "dynamic": 1e-4},
    "extra_mode": {
        "name": "xm", "appendage": "panel", "mass": 1.0, "position": (3.0, 0.0, 0.0), "frequency": 0.4,
    },
    "beam_mode": {
        "name": "bm", "appendage": "panel", "mode": 4, "factor": 0.9, "frequency": 0.01, "damping": 1e-3,
    },
    "gear_compliance": {"name": "gc", "joint": "joint2", "compliance": 1e-3, "motor_inertia": 0.5},
    "backlash": {"name": "bl", "joint": "joint2", "gap": 0.01, "motor_inertia": 0.5},
}  # fmt: skip
UNIT_OF_A_COUNT = {
    "s/rad",
    "s/m",
    "kg^0.5",
    "kg^0.5 m",
    *("kg", "m", "Pa", "Hz", "1", "N/m", "N s/m", "kg/m^3", "N m s/rad", "N m", "rad", "kg m^2", "rad/s"),
    *("kg m", "kg/s", "s", "N", "1/s^2", "s/m", "m/s^2", "N/m^3", "N s^2/m^2", "1/s", "rad/(N m)", "N m/rad"),
    *("N m s^2/rad^2", "N m s^3/rad^3", "N m/K", "N m s/(rad K)"),
}


def example(kind: str) -> Effect:
    if kind not in EXAMPLES:
        pytest.fail(f"give an example of the effect '{kind}' in this file, so that it is tested")
    return parse_effect({"kind": kind, **EXAMPLES[kind]})


@pytest.fixture(params=sorted(catalogue()))
def effect(request) -> Effect:
    return example(request.param)


def test_parameters_are_named_once_with_unit_and_within_bounds(effect):
    parameters = effect.parameters()
    names = [p.name for p in parameters]
    assert parameters and len(set(names)) == len(names)
    for p in parameters:
        assert p.name.startswith(f"{effect.name}.")
        assert p.unit in UNIT_OF_A_COUNT
        assert p.lower <= p.value <= p.upper


@settings(max_examples=60, deadline=None)
@given(data=st.data(), kind=st.sampled_from(sorted(catalogue())))
def test_values_put_in_come_out(data, kind):
    effect = example(kind)
    parameters = effect.parameters()
    chosen = data.draw(st.lists(st.sampled_from(parameters), unique=True))
    factor = data.draw(st.floats(min_value=1.0, max_value=3.0))
    values = {p.name: float(np.clip(factor * p.value + 1e-3, p.lower, p.upper)) for p in chosen}
    changed = effect.with_values(values)
    expected = {p.name: values.get(p.name, p.value) for p in parameters}
    assert {p.name: p.value for p in changed.parameters()} == expected
    assert type(changed) is type(effect)
    assert changed.with_values({p.name: p.value for p in parameters}) == effect


def test_unknown_names_and_values_out_of_bounds_are_refused(effect):
    own = effect.parameters()[0].name
    for name in ("mass", f"{effect.name}.nothing", f"other{own}", f"{effect.name}.mode9.frequency"):
        with pytest.raises(DescriptionError, match="has no parameter"):
            effect.with_values({name: 1.0})
    for p in effect.parameters():
        for value in (p.lower - 1.0, float("nan")):
            with pytest.raises(DescriptionError, match=f"Effect '{effect.name}' cannot take"):
                effect.with_values({p.name: value})


def test_priors_reach_the_parameters(effect):
    key = effect.parameters()[-1].name.removeprefix(f"{effect.name}.")
    changed = type(effect).model_validate({**dict(effect), "prior": {key: 0.25}})
    assert [p.sigma for p in changed.parameters() if p.name.endswith(key)] == [0.25]
    assert sum(p.sigma is not None for p in changed.parameters()) == 1


def test_effects_are_frozen(effect):
    with pytest.raises(ValidationError):
        effect.name = "other"


@pytest.mark.parametrize("rate", [-3.0, -0.004, 0.0, 0.002, 5.0])
def test_friction_law(rate):
    urdf = Description(name="x", urdf="paper_sms.urdf", folder=_urdf())
    friction = JointFriction(name="f", joint="joint2", viscous=0.4, coulomb=0.15, smoothing=0.005)
    model = build_model(urdf.with_effects(friction))
    v = np.zeros(model.nv)
    v[7] = rate
    tau = model.passive_forces(0.0, model.home, v)
    expected = np.zeros(model.nv)
    expected[7] = -0.15 * np.tanh(rate / 0.005) - 0.4 * rate
    np.testing.assert_allclose(tau, expected, atol=1e-15)


def test_two_frictions_on_a_joint_add_up():
    urdf = Description(name="x", urdf="paper_sms.urdf", folder=_urdf())
    one = JointFriction(name="f", joint="joint2", viscous=0.4)
    model = build_model(urdf.with_effects(one, JointFriction(name="g", joint="joint2", viscous=0.1)))
    v = np.ones(model.nv)
    assert model.passive_forces(0.0, model.home, v)[7] == pytest.approx(-0.5)


class Spring(Effect):
    """A user's effect: a spring on one joint."""

    summary: ClassVar[str] = "a spring on one joint"
    kind: Literal["test_spring"] = "test_spring"
    joint: str
    stiffness: Annotated[float, Field(ge=0.0)] = physical("N m/rad", lower=0.0)

    def attach(self, assembly):
        assembly.add_springs(assembly.joint_id(self.joint), (self.stiffness,), (0.0,))


@pytest.fixture
def own_catalogue(monkeypatch):
    monkeypatch.setattr(base, "_CATALOGUE", dict(base._CATALOGUE))


def _urdf():
    from pathlib import Path

    return Path(__file__).resolve().parents[2] / "urdf"


def _with_spring(tmp_path) -> str:
    path = tmp_path / "x.toml"
    path.write_text(
        f'schema = 1\nname = "x"\nurdf = "{(_urdf() / "paper_sms.urdf").as_posix()}"\n'
        '[[effect]]\nkind = "test_spring"\nname = "s"\njoint = "joint3"\nstiffness = 7.0\n'
    )
    return str(path)


def test_a_users_effect_by_decorator_loads_acts_and_is_identified(own_catalogue, tmp_path):
    assert register(Spring) is Spring
    description = load_description(_with_spring(tmp_path))
    model = build_model(description)
    q = pin.integrate(model.pin, model.home, 0.1 * np.eye(model.nv)[8])
    assert model.passive_forces(0.0, q, np.zeros(model.nv))[8] == pytest.approx(-0.7)
    assert [p.name for p in description.effect[0].parameters()] == ["s.stiffness"]
    register(Spring)  # the same class again, as on reloading its module


class _Entry:
    def __init__(self, name, found):
        self.name, self.value, self.found = name, "elsewhere:Spring", found

    def load(self):
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


def test_a_users_effect_by_entry_point(own_catalogue, monkeypatch, tmp_path):
    with pytest.raises(DescriptionError, match="Unknown effect kind 'test_spring'"):
        load_description(_with_spring(tmp_path))
    asked = []

    def entry_points(group):
        asked.append(group)
        return [_Entry("test_spring", Spring)]

    monkeypatch.setattr(base.metadata, "entry_points", entry_points)
    assert catalogue()["test_spring"] is Spring
    assert load_description(_with_spring(tmp_path)).effect[0].parameters()[0].value == 7.0
    assert set(asked) == {"smsid.effects"}


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        (_Entry("test_spring", ImportError("no module elsewhere")), "no module elsewhere"),
        (_Entry("other_name", Spring), "offers an effect of kind 'test_spring'"),
    ],
)
def test_a_broken_entry_point_is_named(own_catalogue, monkeypatch, entry, text):
    monkeypatch.setattr(base.metadata, "entry_points", lambda group: [entry])
    with pytest.raises(DescriptionError, match=text) as caught:
        catalogue()
    assert entry.name in str(caught.value)


def test_a_kind_is_not_taken_twice(own_catalogue):
    class Other(Spring):
        kind: Literal["slosh"] = "slosh"  # type: ignore[assignment]

    with pytest.raises(DescriptionError, match=r"'slosh' of .*Other is taken by smsid.effects.slosh.Slosh"):
        register(Other)


def test_an_effect_needs_a_kind(own_catalogue):
    class Nameless(Effect):
        pass

    with pytest.raises(DescriptionError, match="Nameless has no kind"):
        register(Nameless)


@pytest.mark.parametrize("springs", [((1.0, 1.0), (0.0, 0.0)), ((1.0,), ()), ((), ())])
def test_springs_must_fit_the_joint(own_catalogue, springs):
    class Wrong(Spring):
        def attach(self, assembly):
            assembly.add_springs(assembly.joint_id(self.joint), *springs)

    effect = Wrong(name="s", joint="joint3", stiffness=1.0)
    with pytest.raises(
        DescriptionError, match=r"\[\[effect\]\] 's': Joint 'joint3' has 1 degrees of freedom"
    ):
        build_model(Description(name="x", urdf="paper_sms.urdf", folder=_urdf(), effect=(effect,)))
