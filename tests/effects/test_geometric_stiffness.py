"""A beam that shortens as it bends: tables, conservation laws, and a chain of segments in another engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from scipy.signal import butter, sosfiltfilt

from smsid.description import Description, load_description
from smsid.effects import BeamAppendage, BodyError, GeometricStiffness, ModalAppendage
from smsid.effects.mode import Cantilever
from smsid.errors import DescriptionError
from smsid.experiments import thrust_experiment
from smsid.model import SpacecraftModel, build_model, rebuild
from smsid.recording import import_recording
from smsid.simulate import Constant, Inputs, simulate, truth_of

LENGTH, WIDTH, THICKNESS, DENSITY, YOUNG = 6.0, 3.0, 0.002, 2700.0, 70e9
BENDING = YOUNG * WIDTH * THICKNESS**3 / 12.0  # E I [N m^2]
LINEAR = DENSITY * WIDTH * THICKNESS  # [kg/m]
# Wright, Smith, Thresher, Wang, J. Appl. Mech. 49 (1982) 197: first out-of-plane frequency of a uniform
# cantilever turning about its root, in units of sqrt(EI / (rho L^4)), by rate in the same units
ROTATING = {0.0: 3.5160, 1.0: 3.6817, 2.0: 4.1373, 3.0: 4.7973, 6.0: 7.3604}
GREENHILL = 7.8373  # rho a L^3 / EI at which a column buckles under its own weight


def heavy(urdf: Path, modes: int = 6) -> SpacecraftModel:
    """Return a beam at the origin of a bus that nothing moves."""
    panel = BeamAppendage(
        name="panel", position=(0, 0, 0), length=LENGTH, width=WIDTH, thickness=THICKNESS, density=DENSITY,
        youngs_modulus=YOUNG, damping=0.0, modes=modes,
    )  # fmt: skip
    bus = BodyError(name="heavy", mass=1e12, inertia=(1e12, 0.0, 1e12, 0.0, 0.0, 1e12))
    effects = (bus, panel, GeometricStiffness(name="g", appendage="panel"))
    return build_model(Description(name="x", urdf="bus.urdf", folder=urdf, effect=effects))


def stiffness(model: SpacecraftModel, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return minus the derivative of modal accelerations by coordinates (modes, modes), by differences."""
    h, columns = 1e-4, []
    rest = model.acceleration(0.0, model.home, v, tau)[model.modes.v]
    for k, scale in zip(model.modes.q, model.mode_scale, strict=True):
        q = model.home.copy()
        q[k] += h / scale
        moved = model.acceleration(0.0, q, v, tau)[model.modes.v]
        columns.append(-(moved - rest) * model.mode_scale / h)
    return np.array(columns).T


@pytest.mark.parametrize("rate", list(ROTATING))
def test_a_rotating_beam_has_the_tabulated_frequency(urdf: Path, rate: float) -> None:
    model, unit = heavy(urdf), np.sqrt(BENDING / (LINEAR * LENGTH**4))
    v = np.zeros(model.nv)
    v[5] = rate * unit  # about z, along which it deflects
    values = np.linalg.eigvals(stiffness(model, v, np.zeros(model.nv)))
    assert np.sqrt(values.real.min()) / unit == pytest.approx(ROTATING[rate], abs=2e-4)


def test_a_beam_pushed_along_its_axis_buckles_where_a_column_does(urdf: Path) -> None:
    model = heavy(urdf)

    def softest(acceleration: float) -> float:
        tau = np.zeros(model.nv)
        tau[0] = acceleration * model.mass
        return float(np.linalg.eigvals(stiffness(model, np.zeros(model.nv), tau)).real.min())

    scale = BENDING / (LINEAR * LENGTH**3)
    found = brentq(softest, 5.0 * scale, 10.0 * scale) / scale
    assert found == pytest.approx(GREENHILL, rel=2e-3)  # six modes, from above
    assert softest(-5.0 * scale) > softest(0.0) > softest(5.0 * scale)


def energy_of_shortening(model: SpacecraftModel, q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray]:
    """Energy and momentum (p, h about the inertial origin) of the points' moving in, by quadrature.

    The velocity of a point at x is that of one of the model's beam, which moves across only, plus
    ``u' e + omega x u e``; the curvature along it is the second derivative of u.
    """
    panel = model.appendages[0]
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x, w = 3.0 * (nodes + 1.0), 3.0 * weights * LINEAR
    beam = Cantilever.with_modes(LENGTH, 3)
    eta, rate = model.mode_scale * q[model.modes.q], model.mode_scale * v[model.modes.v]
    slope = np.array([[beam.shape(a + 1e-5)[k] - beam.shape(a - 1e-5)[k] for k in range(3)] for a in x])
    slope /= 2e-5 * np.sqrt(LINEAR * LENGTH)
    fine = np.linspace(0.0, LENGTH, 4001)
    table = np.gradient(np.array([beam.shape(a) for a in fine]), fine, axis=0, edge_order=2)
    table /= np.sqrt(LINEAR * LENGTH)
    step = fine[1] - fine[0]
    drawn = (table @ eta) * (np.gradient(table, fine, axis=0, edge_order=2) @ eta)

    def inwards(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        product = (table @ a) * (table @ b)
        summed = np.concatenate([[0.0], np.cumsum(0.5 * (product[1:] + product[:-1])) * step])
        return np.interp(x, fine, summed)

    u, du = -0.5 * inwards(eta, eta), -inwards(eta, rate)
    shapes = np.array([beam.shape(a) for a in x]) / np.sqrt(LINEAR * LENGTH)
    bent, bending = shapes @ eta, shapes @ rate
    turn, root, e = pin.Quaternion(q[3:7]).toRotationMatrix(), panel.placement.translation, np.eye(3)[0]
    energy, p, h = 0.5 * BENDING * np.trapezoid(drawn**2, fine), np.zeros(3), np.zeros(3)
    for k in range(len(x)):
        place = root + x[k] * e + bent[k] * np.eye(3)[2]
        along = v[:3] + np.cross(v[3:6], place) + bending[k] * np.eye(3)[2]
        more = du[k] * e + np.cross(v[3:6], u[k] * e)
        energy += w[k] * (along + 0.5 * more) @ more
        p += w[k] * turn @ more
        drawn_in = turn @ (u[k] * e)
        h += w[k] * (np.cross(q[:3] + turn @ place, turn @ more) + np.cross(drawn_in, turn @ (along + more)))
    return energy, np.concatenate([p, h])


def test_energy_and_momentum_with_the_shortening_are_conserved(urdf: Path) -> None:
    description = load_description(urdf / "paper_sms.toml")
    panel = description.get_effect("panel").with_values({"panel.damping": 0.0})
    tank = description.get_effect("tank").with_values({f"tank.damping.{a}": 0.0 for a in "xyz"})
    model = build_model(
        description.with_effects(panel, tank, GeometricStiffness(name="g", appendage="panel"))
    )
    rng = np.random.default_rng(2)
    v0 = 0.05 * rng.normal(size=model.nv)
    v0[model.modes.v] = [0.3, 0.02, 0.0]
    trajectory = simulate(model, Inputs(), 30.0, v0=v0)
    s = trajectory.states(np.linspace(0.0, 30.0, 25))
    more = [energy_of_shortening(model, q, v) for q, v in zip(s.q, s.v, strict=True)]
    energy = np.array([model.energy(q, v) for q, v in zip(s.q, s.v, strict=True)])
    momentum = np.array([model.momentum(q, v) for q, v in zip(s.q, s.v, strict=True)])
    lacking = np.ptp(energy), np.ptp(momentum, axis=0).max()
    energy += [e for e, _ in more]
    momentum += [p for _, p in more]
    # the quadrature here is good to 1e-6 of what the shortening holds
    assert np.ptp(energy) < 1e-5 * lacking[0] and lacking[0] > 1e-3
    assert np.ptp(momentum, axis=0).max() < 1e-5 * lacking[1] and lacking[1] > 1e-2


@pytest.mark.parametrize("prescribed", [False, True])
def test_the_audit_knows_it(urdf: Path, prescribed: bool) -> None:
    description = load_description(urdf / "paper_sms.toml")
    model = build_model(description.with_effects(GeometricStiffness(name="g", appendage="panel")))
    inputs = Inputs(
        force=Constant(np.array([30.0, 10.0, 20.0])), hold_attitude=prescribed, lock_joints=prescribed
    )
    audit = simulate(model, inputs, 10.0).audit()
    assert audit.momentum_drift < 1e-9 * audit.momentum_scale
    assert audit.energy_drift < 1e-9 * audit.energy_scale


def test_exp_1_of_the_chain_recordings(urdf: Path, oracle: Path) -> None:
    """A chain of 16 segments, geometrically exact, in another engine: mode 1, and the panel below 0.15 Hz."""
    description = load_description(urdf / "paper_sms.toml")
    linear = build_model(description)
    recording = import_recording(oracle / "exp1_xyz.npz", "oracle_exp1")
    time = recording.time()[::5]
    low = butter(4, 0.15, fs=1.0 / (time[1] - time[0]), output="sos")
    errors = {}
    for factor in (0.0, 1.0):
        effect = GeometricStiffness(name="g", appendage="panel", factor=factor)
        model = rebuild(linear, description.with_effects(effect))
        trajectory = simulate(model, thrust_experiment("xyz").inputs(), float(time[-1]))
        truth = truth_of(trajectory, description.sensor)(time)
        off = {
            name: truth[name] - recording[name][::5]
            for name in ("truth.modal_position", "panel.acceleration")
        }
        mode = np.sqrt(np.mean(off["truth.modal_position"][:, 0] ** 2))
        panel = sosfiltfilt(low, off["panel.acceleration"], axis=0)
        errors[factor] = (
            mode / np.sqrt(np.mean(recording["truth.modal_position"][::5, 0] ** 2)),
            np.sqrt(np.mean(panel**2)),
        )
    assert errors[0.0][0] == pytest.approx(0.27, abs=0.01)
    assert errors[1.0][0] < 0.03
    assert errors[1.0][1] < errors[0.0][1] / 9.0


def test_it_needs_a_beam(urdf: Path) -> None:
    sail = ModalAppendage(
        name="sail", position=(1, 0, 0), mass=5.0, center_of_mass=(1, 0, 0), inertia=(0.1, 0, 7, 0, 0, 7)
    )
    effect = GeometricStiffness(name="g", appendage="sail")
    with pytest.raises(DescriptionError, match="'sail' is no beam_appendage"):
        build_model(Description(name="x", urdf="bus.urdf", folder=urdf, effect=(sail, effect)))
    with pytest.raises(DescriptionError, match="no appendage 'sail' before this effect"):
        build_model(Description(name="x", urdf="bus.urdf", folder=urdf, effect=(effect, sail)))


def test_shares_of_two_effects_on_one_beam_add_with_their_product(urdf: Path) -> None:
    """What is drawn in enters its energy squared: two terms of 0.4 and 0.6 left 0.48 of it out."""
    whole = heavy(urdf, modes=3)
    first, second = (
        GeometricStiffness(name=n, appendage="panel", factor=f) for n, f in (("g", 0.4), ("h", 0.6))
    )
    both = rebuild(whole, whole.description.with_effects(first, second))
    rng = np.random.default_rng(0)
    q, v, tau = whole.home.copy(), rng.normal(size=whole.nv), rng.normal(size=whole.nv)
    q[whole.modes.q] = rng.normal(size=3)
    expected = whole.acceleration(0.0, q, v, tau)
    np.testing.assert_allclose(both.acceleration(0.0, q, v, tau), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(both.appendages[0].drawn, whole.appendages[0].drawn)
