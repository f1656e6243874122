"""Effects on tanks, panels, gears and joints that come down to one equation with a known solution."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from smsid.description import Arm, Description, load_description
from smsid.effects import (
    Backlash,
    BeamAppendage,
    Effect,
    FrequencyDrift,
    GearCompliance,
    JointFriction,
    MotorInertia,
    Slosh,
    SloshNonlinearity,
)
from smsid.errors import DescriptionError
from smsid.model import SpacecraftModel, build_model
from smsid.sensing import Sensor
from smsid.simulate import Constant, Inputs, simulate, truth_of

INERTIA = 2.0  # [kg m^2] of the one link about its joint
ONE_JOINT = """<robot name="one"><link name="ground"/>
<joint name="hinge" type="revolute"><parent link="ground"/><child link="bar"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" velocity="9" effort="9"/></joint>
<link name="bar"><inertial><mass value="1"/><inertia ixx="1" iyy="1.5" izz="2" ixy="0" ixz="0" iyz="0"/>
</inertial></link></robot>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("one")
    (path / "one.urdf").write_text(ONE_JOINT)
    return path


def one_joint(folder: Path, *effects: Effect, home: float = 0.0) -> SpacecraftModel:
    arm = Arm(name="arm", joints=("hinge",), home={"hinge": home})
    return build_model(
        Description(name="one", urdf="one.urdf", folder=folder, root="fixed", arm=(arm,), effect=effects)
    )


def tank(urdf: Path, stiffness: float, **nonlinear: float) -> SpacecraftModel:
    slosh = Slosh(name="tank", position=(0, 0, 0), mass=5.0, stiffness=(stiffness,) * 3, damping=(0.0,) * 3)
    more = SloshNonlinearity(name="n", tank="tank", **nonlinear)
    return build_model(
        Description(name="x", urdf="bus.urdf", folder=urdf, root="fixed", effect=(slosh, more))
    )


@pytest.mark.parametrize("cubic", [2.0, -0.3])
def test_a_hardening_tank_has_duffings_period(urdf: Path, cubic: float) -> None:
    model, k, m, a = tank(urdf, 1.5, cubic=cubic), 1.5, 5.0, 1.2
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    omega = np.sqrt((k + cubic * a**2) / m)
    period = 4.0 / omega * ellipk(cubic * a**2 / (2.0 * (k + cubic * a**2)))
    s = simulate(model, Inputs(), period, q0=a * direction).states(np.array([period / 4, period]))
    np.testing.assert_allclose(s.q[0], 0.0, atol=1e-7)
    np.testing.assert_allclose(s.q[1], a * direction, atol=1e-7)


def test_quadratic_damping_slows_a_free_mass_hyperbolically(urdf: Path) -> None:
    model, v0 = tank(urdf, 0.0, quadratic_damping=0.8), np.array([1.0, 2.0, -2.0])
    s = simulate(model, Inputs(), 10.0, v0=v0).states(np.array([10.0]))
    np.testing.assert_allclose(s.v[0], v0 / (1.0 + 0.8 * 3.0 * 10.0 / 5.0), rtol=1e-8)


def test_a_drifting_mode_follows_its_scalar_equation(urdf: Path) -> None:
    panel = BeamAppendage(
        name="panel", position=(0, 0, 0), length=6.0, width=3.0, thickness=0.002, density=2700.0,
        youngs_modulus=70e9, damping=0.01, modes=2,
    )  # fmt: skip
    drift = FrequencyDrift(name="d", appendage="panel", mode=2, rate=0.02, start=5.0)
    model = build_model(
        Description(name="x", urdf="bus.urdf", folder=urdf, root="fixed", effect=(panel, drift))
    )
    omega = 2 * np.pi * panel.modal_data()[1].frequency

    def rate(t: float, y: np.ndarray) -> list[float]:
        now = omega * (1.0 + 0.02 * max(t - 5.0, 0.0))
        return [y[1], -(now**2) * y[0] - 2 * 0.01 * omega * y[1]]

    expected = solve_ivp(rate, (0, 30), [0.1, 0.0], rtol=1e-10, atol=1e-12, max_step=0.1).y[:, -1]
    s = simulate(model, Inputs(), 30.0, q0=np.array([0.0, 0.1])).states(np.array([30.0]))
    np.testing.assert_allclose([s.q[0, 1], s.v[0, 1]], expected, atol=1e-7)
    with pytest.raises(DescriptionError, match="2 modes, not 3"):
        build_model(
            Description(
                name="x", urdf="bus.urdf", folder=urdf, root="fixed",
                effect=(panel, FrequencyDrift(name="d", appendage="panel", mode=3)),
            )
        )  # fmt: skip


RATES = np.array([-2.0, -0.05, -0.004, 0.0, 0.01, 0.3])


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("torque", [-3.0, 0.0, 5.0])
def test_friction_by_rate_load_and_angle(folder: Path, rate: float, torque: float) -> None:
    friction = JointFriction(
        name="f", joint="hinge", viscous=0.3, coulomb=0.2, stribeck=0.1, stribeck_rate=0.04, load=0.05,
        stribeck_exponent=1.3, position_cos=0.07, position_sin=-0.03, smoothing=0.01, start=2.0,
    )  # fmt: skip
    model, q = one_joint(folder, friction), np.array([0.7])
    size = 0.2 + 0.1 * np.exp(-(abs(rate / 0.04) ** 1.3)) + 0.05 * abs(torque)
    size += 0.07 * np.cos(0.7) - 0.03 * np.sin(0.7)
    expected = torque - 0.3 * rate - size * np.tanh(rate / 0.01)
    found = [model.acceleration(t, q, np.array([rate]), np.array([torque]))[0] * INERTIA for t in (1.9, 2.0)]
    np.testing.assert_allclose(found, [torque, expected], rtol=1e-12, atol=1e-15)


def test_load_friction_does_not_depend_on_the_order_of_effects(folder: Path) -> None:
    load, other = (
        JointFriction(name="f", joint="hinge", load=0.1),
        JointFriction(name="g", joint="hinge", viscous=1.0, coulomb=0.5),
    )
    q, v, tau = np.zeros(1), np.array([0.2]), np.array([4.0])
    both = [
        one_joint(folder, *order).acceleration(0.0, q, v, tau) for order in ((load, other), (other, load))
    ]
    np.testing.assert_array_equal(both[0], both[1])
    assert both[0][0] * INERTIA == pytest.approx(4.0 - 0.4 - 0.2 - 0.5)


def test_an_elastic_gear_follows_spongs_equations(folder: Path) -> None:
    """Constant torque from rest: the closed form of two inertias and a spring."""
    rotor, compliance, torque = 0.5, 2e-3, 3.0
    model = one_joint(
        folder, GearCompliance(name="g", joint="hinge", compliance=compliance, motor_inertia=rotor), home=0.4
    )
    times = np.linspace(0.0, 2.0, 21)
    trajectory = simulate(model, Inputs(joint_torque=Constant(np.array([torque]))), 2.0)
    s = trajectory.states(times)
    omega = np.sqrt((1 / INERTIA + 1 / rotor) / compliance)
    mean = 0.5 * torque / (INERTIA + rotor) * times**2
    twist = torque / rotor / omega**2 * (1 - np.cos(omega * times))  # motor minus link
    motor = mean + INERTIA / (INERTIA + rotor) * twist
    np.testing.assert_allclose(s.q[:, 0] - 0.4, motor - twist, atol=1e-9)
    encoder = Sensor(name="encoder", kind="encoder", rate=100.0)
    truth = truth_of(trajectory, (encoder,))(times)
    np.testing.assert_allclose(truth["encoder.joint_position"][:, 0] - 0.4, motor, atol=1e-9)
    slope = torque / (INERTIA + rotor) * times + INERTIA / (
        INERTIA + rotor
    ) * torque / rotor / omega * np.sin(omega * times)
    np.testing.assert_allclose(truth["encoder.joint_velocity"][:, 0], slope, atol=1e-8)


def test_a_gear_that_does_not_give_is_the_rotor_at_the_joint(folder: Path) -> None:
    rotor = one_joint(folder, MotorInertia(name="r", joint="hinge", inertia=0.5))
    q, v, tau = np.zeros(1), np.array([0.1]), np.array([2.0])
    for gear in (
        GearCompliance(name="g", joint="hinge", motor_inertia=0.5),
        Backlash(name="g", joint="hinge", motor_inertia=0.5),
    ):
        model = one_joint(folder, gear)
        assert model.nv == 1
        assert model.acceleration(0, q, v, tau) == pytest.approx(rotor.acceleration(0, q, v, tau))
    with pytest.raises(ValidationError, match="positive `motor_inertia`"):
        Backlash(name="g", joint="hinge", gap=0.1)


def test_readings_are_linear_in_a_small_compliance(folder: Path) -> None:
    """What an encoder on the motor reads beyond the rigid gear's is the compliance times the torque."""
    torque, rotor, change = 3.0, 0.5, {}
    times = np.linspace(1.0, 2.0, 400)
    rigid = 0.5 * torque / (INERTIA + rotor) * times**2
    for compliance in (2e-4, 1e-4):
        gear = GearCompliance(
            name="g",
            joint="hinge",
            compliance=compliance,
            motor_inertia=rotor,
            damping=0.05 * np.sqrt(0.4 / compliance),
        )
        model = one_joint(folder, gear)
        trajectory = simulate(model, Inputs(joint_torque=Constant(np.array([torque]))), 2.0)
        s = trajectory.states(times)
        change[compliance] = np.mean(model.encoder_angles(s.q)[:, 0] - rigid) / compliance
    share = INERTIA / (INERTIA + rotor)  # of the torque goes through the spring, as of the twist to the motor
    assert change[1e-4] == pytest.approx(torque * share**2, rel=2e-2)
    assert change[2e-4] == pytest.approx(change[1e-4], rel=2e-2)


def test_backlash_follows_its_own_two_equations(folder: Path) -> None:
    rotor, gap, stiffness, damping = 0.3, 0.05, 500.0, 0.4
    gear = Backlash(
        name="g",
        joint="hinge",
        gap=gap,
        motor_inertia=rotor,
        contact_stiffness=stiffness,
        contact_damping=damping,
    )
    model = one_joint(folder, gear)

    def torque(t: float) -> float:
        return 2.0 * np.sin(5.0 * t)

    def rate(t: float, y: np.ndarray) -> list[float]:
        link, motor, link_rate, motor_rate = y
        twist = motor - link
        through = 0.0
        if abs(twist) > gap / 2:
            through = stiffness * (twist - np.sign(twist) * gap / 2) + damping * (motor_rate - link_rate)
        return [link_rate, motor_rate, through / INERTIA, (torque(t) - through) / rotor]

    expected = solve_ivp(rate, (0, 3), np.zeros(4), rtol=1e-9, atol=1e-11, max_step=1e-3).y[:, -1]
    from smsid.simulate import Fourier

    sine = Fourier(5.0 / (2 * np.pi), np.zeros((1, 1)), np.array([[2.0]]), np.zeros(1))
    s = simulate(model, Inputs(joint_torque=sine), 3.0).states(np.array([3.0]))
    np.testing.assert_allclose([s.q[0, 0], s.q[0].sum()], expected[:2], atol=1e-6)


def test_an_elastic_gear_on_a_free_spacecraft_keeps_momentum(urdf: Path) -> None:
    description = load_description(urdf / "paper_sms.toml")
    gear = GearCompliance(name="g", joint="joint2", compliance=1e-3, motor_inertia=2.0)
    model = build_model(description.with_effects(gear))
    audit = simulate(model, Inputs(joint_torque=Constant(np.array([0.5, 2.0, -1.0]))), 3.0).audit()
    assert audit.momentum_drift < 1e-9 * audit.momentum_scale
    assert audit.energy_drift < 1e-9 * audit.energy_scale


def test_a_quasistatic_gear_is_what_a_stiff_one_settles_to(folder: Path) -> None:
    """The encoder's reading beside that of the gear with a joint of its own, its ringing damped away."""
    torque, rotor, compliance, times = 3.0, 0.5, 1e-4, np.linspace(1.0, 2.0, 21)
    readings = []
    for more in ({"damping": 0.5 * np.sqrt(0.4 / compliance)}, {"quasistatic": True}, None):
        if more is None:
            effect: Effect = MotorInertia(name="g", joint="hinge", inertia=rotor)
        else:
            effect = GearCompliance(
                name="g", joint="hinge", compliance=compliance, motor_inertia=rotor, **more
            )
        trajectory = simulate(
            one_joint(folder, effect), Inputs(joint_torque=Constant(np.array([torque]))), 2.0
        )
        encoder = Sensor(name="encoder", kind="encoder", rate=100.0)
        readings.append(truth_of(trajectory, (encoder,))(times)["encoder.joint_position"][:, 0])
    stiff, at_once, rigid = readings
    # the rotor leads while the link trails behind: by its share of the inertia about their common motion
    share = INERTIA / (INERTIA + rotor)
    np.testing.assert_allclose(at_once - rigid, share**2 * compliance * torque, rtol=1e-6)
    np.testing.assert_allclose(stiff, at_once, rtol=0, atol=1e-3 * compliance * torque)


@pytest.mark.parametrize(("sharpness", "alike", "within"), [(1.5, "arctan", 0.04), (2.75, "tanh", 0.03)])
def test_quasistatic_backlash_follows_the_torque(folder: Path, sharpness: float, alike: str, within: float):
    gear = Backlash(name="g", joint="hinge", gap=0.02, quasistatic=True, turn_torque=0.4, sharpness=sharpness)
    model = one_joint(folder, gear)
    assert model.nv == 1
    tau = np.linspace(-300.0, 300.0, 601)[:, None]
    still = np.zeros_like(tau)
    twist = model.encoder_twist(np.zeros(len(tau)), still, still, tau, still)[:, 0] / 0.01
    x = tau[:, 0] / 0.4
    known = {"arctan": 2.0 / np.pi * np.arctan(0.5 * np.pi * x), "tanh": np.tanh(x)}[alike]
    np.testing.assert_allclose(twist, known, atol=within)
    np.testing.assert_allclose(twist, -twist[::-1], atol=1e-14)
    assert twist[300] == 0.0 and (np.diff(twist) >= 0.0).all()
    np.testing.assert_allclose(twist[[0, -1]], [-1.0, 1.0], atol=1.1 * 0.4 / 300.0)


def test_a_rotor_counted_in_the_link_adds_no_inertia(folder: Path) -> None:
    q, v, tau = np.zeros(1), np.zeros(1), np.array([2.0])
    gear = GearCompliance(
        name="g", joint="hinge", compliance=1e-4, motor_inertia=0.5, inertia_in_link=True, quasistatic=True
    )
    assert one_joint(folder, gear).acceleration(0, q, v, tau) == pytest.approx(tau / INERTIA)
