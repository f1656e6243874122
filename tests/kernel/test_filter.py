"""The compiled pass of the filter gives what the plain one over Pinocchio does, on every craft and sensor."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import (
    Backlash,
    ExternalWrench,
    FrequencyDrift,
    GearCompliance,
    GeometricStiffness,
    GravityGradient,
    JointCable,
    JointFriction,
    MassLoss,
    MotorCoupling,
    SensorScale,
    SloshNonlinearity,
    SloshWall,
    TorqueOffset,
)
from smsid.effects.force_laws import BacklashForce
from smsid.estimation.compiled_filter import compiled_model
from smsid.estimation.filter_pass import AppliedForces, Instance, filter_samples
from smsid.estimation.measurements import matrix
from smsid.estimation.problem import UnknownForces
from smsid.kernel._forces import add_forces
from smsid.kernel._motion import start_of_chart
from smsid.kernel._tree import workspace
from smsid.kernel.arrays import arrays_of
from smsid.kernel.derivatives import derivatives, inverse_dynamics
from smsid.kernel.filter_arrays import Samples, State
from smsid.kernel.jit import SWITCH, numba
from smsid.model import build_model
from smsid.sensing import Sensor
from smsid.tracking import Tracker
from smsid.tracking._setting import Setting

N, STEP = 4, 0.05  # samples, [s] between them
UNKNOWN = np.array([0.1, -0.2, 0.7])  # two unknown inputs, and the rate of the second
SENSED = {
    "plain": {},
    "late": {"delay": 7e-3, "time_offset": 1e-3},
    "early": {"time_offset": -4e-3},
    "wrong": {"scale_error": 0.02, "bias": 0.01},
}
pytestmark = pytest.mark.skipif(numba is None, reason="numba is not installed")


@pytest.fixture(autouse=True)
def compiled_at_once(monkeypatch):
    """Else the plain pass would stand for the compiled one as long as that is not in the cache."""
    monkeypatch.setenv(SWITCH, "1")


FOLLOW = {
    name: None
    for name in ("link3.m", "link2.mx", "bus.Ixy", "tank.mass", "tank.stiffness.*", "panel.mode1.*", "gain.*")
} | {"imu.acceleration.bias.*": None}


def with_errors(description, errors):
    """Return the craft with errors of all quantities but attitudes, whose clocks alone may be off."""
    sensors = []
    kinds = ("pose", "imu", "encoder", "tachometer")
    usual = [Sensor(name=k, kind=k, position=(0.5, 0.2, 0.1), rate=1.0 / STEP) for k in kinds]
    for s in description.effective_sensors() or usual:
        own = {
            q: s.error(q).model_copy(
                update={"noise_sigma": 1e-3}
                | {k: v for k, v in errors.items() if q != "attitude" or k in ("delay", "time_offset")}
            )
            for q in s.quantities
        }
        sensors.append(s.model_copy(update={"errors": own, "rate": 1.0 / STEP}))
    return description.model_copy(update={"sensor": tuple(sensors)})


def moving(model, rng):
    """Return a state q (nq,), v (nv,) in which everything moves."""
    q = pin.integrate(model.pin, model.home, 0.2 * rng.standard_normal(model.nv))
    return q, 0.1 * rng.standard_normal(model.nv)


def forces(model, moves, rng):
    """Return applied forces over some moves, and the arguments of a drive with unknown inputs."""
    own = AppliedForces(
        0.3 * rng.standard_normal((moves, 2, model.nv)),
        0.3 * rng.standard_normal((moves, model.nv)),
        0.3 * rng.standard_normal((moves + 1, model.nv)),
        0.1 * rng.standard_normal((moves, 2, model.nv)),
        0.3 * rng.standard_normal(model.nv),
    )
    walk = np.array([[1e-3, 2e-3, 5e-4], [4e-4, 0.0, 5e-4], [3e-4, 2e-3, 5e-4]])
    return own, (
        UnknownForces(np.array([0, model.nv - 1]), np.array([1]), walk),
        np.full(model.nv, 1e-4),
    )


def read(outputs, q, v, a, rng):
    """Return a sample (rows,) of what is read, with its attitudes (a, 4)."""
    h = outputs.predict(q, v, a)[0]
    turned = [b for b in outputs.data.blocks if b.quantity == "attitude"]
    for block in turned:
        h[block.rows] = 0.0
    nothing = np.zeros((0, 4))
    own = np.array([pin.Quaternion(matrix(q[3:7])).coeffs() for _ in turned]) if turned else nothing
    return h + 1e-3 * rng.standard_normal(len(h)) * (h != 0.0), own


def covariance(width, rng):
    root = rng.standard_normal((width, width))
    return 1e-4 * (np.eye(width) + 0.1 * root @ root.T / width)


def assert_same(ours, plain, *, within):
    """Compare records, and the states they ended in."""
    for name in plain._fields:
        a, b = getattr(ours, name), getattr(plain, name)
        for x, y in zip(a, b, strict=True) if isinstance(b, tuple) else [(a, b)]:
            size = np.nanmax(np.abs(y), initial=0.0)
            np.testing.assert_allclose(x, y, rtol=0.0, atol=within * max(size, 1e-12), err_msg=name)


def test_derivatives_of_inverse_dynamics_are_those_of_pinocchio(craft):
    model, rng = craft, np.random.default_rng(0)
    kernel, (q, v), a = arrays_of(craft), moving(craft, rng), rng.standard_normal(craft.nv)
    n, nv = len(kernel.tree), craft.nv
    angles, mass, by_q, by_v, tau = np.empty(n), *np.empty((3, nv, nv)), np.empty(nv)
    gravity = start_of_chart(kernel.tree, kernel.root, q, angles)
    scratch = workspace(n), np.empty((n, 6)), np.empty((n, 6)), np.empty((n + 1, 12))
    derivatives(*kernel.arrays, angles, v, a, gravity, scratch, mass, by_q, by_v)
    inverse_dynamics(*kernel.arrays, angles, v, a, gravity, np.zeros(nv), workspace(n), tau)
    known_q, known_v, _ = pin.computeRNEADerivatives(model.pin, model.data, q, v, a)
    known_q, known_v = known_q.copy(), known_v.copy()
    known_q[model.spring_v, model.spring_v] += model.stiffness
    known_v[model.spring_v, model.spring_v] += model.damping
    upper = np.triu(pin.crba(model.pin, model.data, q))
    found = pin.rnea(model.pin, model.data, q, v, a) - model.passive_forces(0.0, q, v)
    for x, y in ((mass, upper + np.triu(upper, 1).T), (by_q, known_q), (by_v, known_v), (tau, found)):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("sensed", SENSED)
def test_a_pass_without_parameters_is_the_plain_one(craft, sensed):
    assert_passes_are_the_same(craft, with_errors(craft.description, SENSED[sensed]))


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.3, -1.0, -9.0)])
@pytest.mark.parametrize("frame", ["bus", "link3"])
def test_a_pass_with_beams_that_shorten_is_the_plain_one(crafts, frame, gravity):
    described = crafts["paper"].description
    panel, tank = (described.get_effect(n).model_copy(update={"frame": frame}) for n in ("panel", "tank"))
    softening = GeometricStiffness(name="softening", appendage="panel", factor=0.9)
    description = described.model_copy(update={"gravity": gravity, "effect": (tank, panel, softening)})
    assert_passes_are_the_same(build_model(description), with_errors(description, SENSED["late"]))


RUB = JointFriction(name="rub", joint="joint2", viscous=0.2, coulomb=0.3, smoothing=0.05)
SOFT = GeometricStiffness(name="soft", appendage="panel", factor=0.9)
LAWS = {
    "coulomb": {"coulomb": 0.3},
    "stribeck": {"coulomb": 0.2, "stribeck": 0.1, "stribeck_exponent": 1.5},
    "by direction": {"viscous_direction": 0.2, "coulomb_direction": 0.1},
    "drags": {"quadratic": 0.4, "cubic": 0.2},
    "warm": {"viscous_temperature": 0.02, "coulomb_temperature": 0.01, "temperature": 30.0},
    "by angle": {"position_cos": 0.1, "position_sin": -0.2},
    "by load": {"load": 0.3},
    "later": {"coulomb": 0.3, "viscous": 0.2, "start": 1.6 * STEP},
}


@pytest.mark.parametrize("laws", LAWS)
def test_a_pass_with_friction_is_the_plain_one(crafts, laws):
    craft = crafts["paper"]
    rub = JointFriction(name="rub", joint=craft.arm_joints.names[1], smoothing=0.05, **LAWS[laws])
    description = craft.description.with_effects(rub)
    # derivatives are differences, whose rounding is that of forces over their step
    assert_passes_are_the_same(craft, with_errors(description, SENSED["late"]), within=1e-8)


FORCES = {
    "wrench": ExternalWrench(
        name="x", force=(1.0, -2.0, 0.5), torque=(0.3, 0.1, -0.2), point=(0.4, 0.1, -0.2)
    ),
    "wrench, later": ExternalWrench(name="x", torque=(0.3, 0.1, -0.2), start=1.6 * STEP),
    "inertial wrench": ExternalWrench(
        name="x", force=(1.0, -2.0, 0.5), torque=(0.3, 0.1, -0.2), point=(0.4, 0.1, -0.2), frame="inertial"
    ),
    "offset": TorqueOffset(name="x", joint="joint2", torque=0.4),
    "cable": JointCable(name="x", joint="joint2", stiffness=3.0, rest=0.2, start=1.6 * STEP),
    "drift": FrequencyDrift(name="x", appendage="panel", mode=1, rate=0.3, start=0.02),
    "radial slosh": SloshNonlinearity(name="x", tank="tank", cubic=40.0, quadratic_damping=30.0),
    "slosh per axis": SloshNonlinearity(
        name="x", tank="tank", cubic=40.0, quadratic_damping=30.0, law="per_axis"
    ),
    "wall": SloshWall(name="x", tank="tank", gap=0.05, stiffness=200.0),
    "shared friction": MotorCoupling(
        name="x", joints=("joint2", "joint3"), ratios=(1.0, -0.5), viscous=0.4, coulomb=0.3, smoothing=0.05
    ),
    "tide": GravityGradient(name="x", gradient=0.2, nadir=(0.6, 0.0, -0.8), turn=(0.1, -0.3, 0.2)),
}


@pytest.mark.parametrize("law", FORCES)
def test_a_pass_with_other_forces_is_the_plain_one(crafts, law):
    craft = crafts["paper"]
    description = with_errors(craft.description.with_effects(FORCES[law]), SENSED["late"])
    force = build_model(description).forces[0]
    assert_passes_are_the_same(craft, description, within=1e-8)
    # the force is there, and moves something
    q, v = moving(craft, np.random.default_rng(1))
    tau = np.zeros(craft.nv)
    force(3.0 * STEP, q, v, tau)
    assert np.abs(tau).max() > 1e-3


@pytest.mark.parametrize("frame", (None, "link2", "tool"))
@pytest.mark.parametrize("start", (None, 1.6 * STEP))
def test_a_pass_with_a_mass_that_falls_is_the_plain_one(crafts, frame, start):
    craft = crafts["paper"]
    leak = MassLoss(name="x", frame=frame, position=(0.3, -0.1, 0.2), rate=2.0, start=start)
    description = with_errors(craft.description.with_effects(leak), SENSED["late"])
    assert_passes_are_the_same(craft, description)


GEARS = {
    "gives": GearCompliance(
        name="x", joint="joint2", compliance=2e-3, motor_inertia=0.6, inertia_in_link=True, quasistatic=True
    ),
    "gives, seen from the link": GearCompliance(
        name="x", joint="joint2", compliance=2e-3, motor_inertia=0.6, encoder="link", quasistatic=True
    ),
    "gap": Backlash(name="x", joint="joint3", gap=0.02, motor_inertia=0.3, turn_torque=0.2, quasistatic=True),
}


@pytest.mark.parametrize("gear", GEARS)
@pytest.mark.parametrize("sensed", SENSED)
def test_a_pass_with_gears_that_give_at_once_is_the_plain_one(crafts, gear, sensed):
    craft = crafts["paper"]
    description = with_errors(craft.description.with_effects(GEARS[gear]), SENSED[sensed])
    assert build_model(description).twists
    assert_passes_are_the_same(craft, description)


SWINGING = {"name": "x", "compliance": 2e-3, "damping": 0.4, "motor_inertia": 0.6}
ROTORS = {
    "beside its link": {"joint": "joint2"},
    "in its link": {"joint": "joint2", "inertia_in_link": True, "encoder": "link"},
    "carried round": {"joint": "joint3", "carried": 0.7},
    "carried round, in its link": {"joint": "joint3", "carried": -0.4, "inertia_in_link": True},
    "on the bus": {"joint": "joint1", "carried": 0.3},
}


@pytest.mark.parametrize("rotor", ROTORS)
def test_a_pass_with_a_rotor_that_swings_is_the_plain_one(crafts, rotor):
    craft = crafts["paper"]
    gear = GearCompliance(**SWINGING, **ROTORS[rotor])
    rub = JointFriction(name="rub", joint=gear.joint, coulomb=0.3, load=0.1, smoothing=0.1)
    panel = GeometricStiffness(name="soft", appendage="panel", factor=0.8)
    for more in ((), (rub,), (panel,)):
        description = with_errors(craft.description.with_effects(gear, *more), SENSED["late"])
        # the plain one takes differences of the rotor's forces
        assert_passes_are_the_same(craft, description, within=1e-7 if more or gear.carried else 1e-10)


def test_teeth_of_a_gear_are_the_plain_ones(crafts):
    """The gear's own joint is not for the filter: the forces themselves are compared."""
    play, angles = BacklashForce(7, 7, 0.1, 50.0, 2.0), np.zeros(crafts["paper"].nv - 6)
    kernel = arrays_of(crafts["paper"], terms=[play])
    for x in (-0.3, -0.05, 0.08, 0.25):
        q, v = np.zeros(40), np.zeros(crafts["paper"].nv)
        angles[1], q[7], v[7] = x, x, 0.7
        ours, plain = np.zeros((2, len(v)))
        add_forces(kernel.root, angles, v, np.zeros(len(v)), 1.0, ours)
        play(0.0, q, v, plain)
        np.testing.assert_allclose(ours, plain, rtol=1e-14)
        assert (plain[7] != 0.0) == (abs(x) > 0.1)


def assert_passes_are_the_same(craft, description, within=1e-10):
    channels = None if craft.free else ("encoder.joint_position", "encoder.joint_velocity")
    model, rng = build_model(description), np.random.default_rng(1)
    layout = Setting.of(description, model, channels=channels).layout(model, description)
    base = Instance.of(model, layout, np.zeros(0, dtype=int))
    compiled = compiled_model(base)
    assert compiled is not None
    q, v = moving(model, rng)
    own, inputs = forces(model, N, rng)
    values, attitudes = read(base.outputs, q, v, np.zeros(model.nv), rng)
    values, attitudes = np.tile(values, (N, 1)), np.tile(attitudes, (N, 1, 1))
    values[1, ::3], values[2] = np.nan, np.nan
    size = values.shape[1]
    order = rng.permutation(size)
    samples = Samples(
        STEP * np.arange(N + 1), values, attitudes, np.isfinite(values), np.full(size, 1.0), N - 1, order
    )
    p, found = covariance(2 * model.nv + len(UNKNOWN), rng), []
    for way in (compiled, None):
        state = State(q.copy(), v.copy(), UNKNOWN.copy(), np.zeros(0), p.copy())
        found.append((filter_samples(base, None, way, own.drive(*inputs), state, samples), state))
    assert_same(*(record for record, _ in found), within=within)
    assert_same(*(state for _, state in found), within=within)


BEGINNING = (  # what they add is in no table of the craft itself
    RUB.model_copy(update={"viscous": 0.0, "coulomb": 0.0}),
    SOFT.model_copy(update={"factor": 0.0}),
)


ROTOR = GearCompliance(**SWINGING | ROTORS["carried round"] | {"name": "gear"})


@pytest.mark.parametrize(
    "more",
    [(), (RUB, SOFT), BEGINNING, (RUB, SOFT, ROTOR)],
    ids=["rigid", "friction and a softer panel", "both from nothing", "and a rotor"],
)
@pytest.mark.parametrize("sensed", ("plain", "late"))
def test_a_pass_with_parameters_is_the_plain_one(crafts, sensed, more):
    craft = crafts["paper"]
    description = with_errors(craft.description, SENSED[sensed])
    gain = SensorScale(name="gain", sensor="imu", quantity="angular_rate", error=(0.01, 0.0, -0.02))
    description = description.with_effects(gain, *more)
    names = [n for n in FOLLOW if not (more and n.startswith("panel"))]  # a beam is followed by its density
    names += ["rub.viscous", "rub.coulomb", "soft.factor", "panel.density"] if more else []
    names += ["gear.compliance", "gear.motor_inertia", "gear.carried"] if ROTOR in more else []
    follow = dict.fromkeys(names) | {names[0]: (None, 0.1), "gain.error.x": (0.0, 0.01)}
    tracker, rng = Tracker(description, follow=follow), np.random.default_rng(2)
    f = tracker.filter
    assert len(f.at.trends[0]) >= 2
    q, v = moving(f.at.base.model, rng)
    own, inputs = forces(f.at.base.model, N - 1, rng)
    f.q, f.v, f.time, f.unknown = q, v, 0.0, UNKNOWN.copy()
    f.forces, f.input_noise = inputs
    m = len(f.values)
    f.covariance = covariance(2 * len(v) + len(UNKNOWN) + m, rng)
    f.values = f.at.values + 1e-3 * f.scales * rng.standard_normal(m)
    values, attitudes = read(f.at.base.outputs, q, v, np.zeros(len(v)), rng)
    values, attitudes = np.tile(values, (N, 1)), np.tile(attitudes, (N, 1, 1))
    values[1, ::3] = np.nan
    f._variance = np.full(values.shape[1], 1.0)
    begun, found = (f.q, f.v, f.unknown, f.values, f.covariance), []
    assert f.at.compiled_tables is not None and len(f.at.compiled_tables.parameters.read_terms)
    for way in (f.at.compiled_tables, None):
        f.q, f.v, f.unknown, f.values, f.covariance = begun
        f.at.compiled_tables = way
        record = f.go_on(STEP * np.arange(N), own.drive(*inputs), values, attitudes)
        found.append((record, State(f.q, f.v, f.unknown, f.values, f.covariance)))
    # the plain way differences accelerations by parameters of effects, the compiled one forces
    within = 1e-7 if more else 1e-9
    assert_same(*(record for record, _ in found), within=within)
    assert_same(*(state for _, state in found), within=within)
