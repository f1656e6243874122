"""Traction, torsion and bending sideways against the Lagrangian of the particles they are modes of."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description, load_description
from smsid.effects.appendage import ModalAppendage
from smsid.model import SpacecraftModel, build_model
from smsid.paths import urdf_folder
from smsid.sensing import Sensor
from smsid.simulate import Constant, Inputs, simulate
from smsid.simulate.truth import truth_of

LENGTH, WIDTH, MASS = 6.0, 3.0, 97.2
ROOT = np.array([1.5, 0.2, -0.1])  # of the appendage, bus frame
HERTZ = (0.9, 0.4, 0.15)
POINTS = np.array([[0.5, 1.5, 0.6], [-1.0, 0.3, 0.2], [0.0, 0.0, -0.8]])  # tracked, bus frame
FORCE, TORQUE = np.array([20.0, -7.0, 11.0]), np.array([3.0, -2.0, 5.0])

x, y = (g.ravel() for g in np.meshgrid((np.arange(12) + 0.5) / 12 * LENGTH, (np.arange(4) - 1.5) / 4 * WIDTH))
PARTICLES = np.column_stack([x, y, np.zeros_like(x)])
EACH = MASS / len(PARTICLES)
NONE = np.zeros_like(x)
SHAPES = np.array(
    [
        np.column_stack([np.sin(np.pi * x / (2 * LENGTH)), NONE, NONE]),  # traction
        np.column_stack([NONE, NONE, y * np.sin(np.pi * x / (2 * LENGTH))]),  # torsion
        np.column_stack([NONE, x**2 * (3 * LENGTH - x), NONE]),  # bending in the plate's plane
    ]
)
SHAPES /= np.sqrt(EACH * np.sum(SHAPES**2, axis=(1, 2)))[:, None, None]
STATIONS = (5, 20, 46)


def paper(*effects: ModalAppendage) -> Description:
    """Return the paper's spacecraft without wheels and sensors, with these effects alone."""
    given = load_description(urdf_folder() / "paper_sms.toml")
    return given.model_copy(update={"wheel": (), "effect": effects, "sensor": ()})


@pytest.fixture(scope="module")
def model() -> SpacecraftModel:
    """The paper's bus with the particles' modes for a panel, as a finite-element program would give them."""
    lever = EACH * np.sum(np.cross(PARTICLES, SHAPES), axis=1)
    about = EACH * sum((r @ r) * np.eye(3) - np.outer(r, r) for r in PARTICLES)
    modes = [
        {
            "frequency": f,
            "damping": 0.0,
            "translation": tuple(EACH * s.sum(axis=0)),
            "rotation": tuple(r),
            "shape": tuple(map(tuple, s[list(STATIONS)])),
        }
        for f, s, r in zip(HERTZ, SHAPES, lever, strict=True)
    ]
    panel = ModalAppendage(
        name="panel",
        position=tuple(ROOT),
        mass=MASS,
        center_of_mass=tuple(PARTICLES.mean(axis=0)),
        inertia=tuple(about[np.triu_indices(3)][[0, 1, 3, 2, 4, 5]]),
        mode=modes,
        stations=tuple(map(tuple, PARTICLES[list(STATIONS)])),
    )
    bare = paper(panel)
    sensors = [
        Sensor(name=f"imu{k}", kind="imu", rate=100.0, position=tuple(p)) for k, p in enumerate(POINTS)
    ]
    stations = Sensor(name="stations", kind="accelerometers", rate=100.0, appendage="panel")
    return build_model(bare.model_copy(update={"sensor": (*sensors, stations)}))


def lagrangian(amplitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the twist's rate (6,) at the bus origin and amplitudes'' (3,) from rest."""
    # bus and arm as one: what is under test is what bends on them
    rigid = build_model(paper())
    mass = pin.crba(rigid.pin, rigid.pin.createData(), rigid.home)
    mass = np.triu(mass) + np.triu(mass, 1).T
    n = rigid.nv
    full = np.zeros((n + 3, n + 3))
    full[:n, :n] = mass
    for i, r in enumerate(PARTICLES + ROOT):
        cross = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
        jacobian = np.hstack([np.eye(3), -cross, np.zeros((3, n - 6)), SHAPES[:, i].T])
        full += EACH * jacobian.T @ jacobian
    stiffness = (2 * np.pi * np.array(HERTZ)) ** 2
    push = np.concatenate([FORCE, TORQUE, np.zeros(n - 6), -stiffness * amplitudes])
    return np.split(np.linalg.solve(full, push), [6, n])[::2]


@pytest.mark.parametrize("amplitudes", [(0.0, 0.0, 0.0), (2e-5, -3e-5, 5e-5)], ids=["at rest", "bent"])
def test_accelerations_of_bus_modes_and_points(model: SpacecraftModel, amplitudes):
    twist, bending = lagrangian(np.array(amplitudes))
    q = model.home.copy()
    (panel,) = model.appendages
    for joint, scale, value in zip(panel.joints, panel.scale, amplitudes, strict=True):
        q[model.pin.joints[int(joint)].idx_q] = value / scale
    inputs = Inputs(force=Constant(FORCE), torque=Constant(TORQUE))
    truth = truth_of(simulate(model, inputs, 0.02, q0=q), model.description.effective_sensors())
    first = truth(np.array([0.0]))
    loose = 1e-9 if not any(amplitudes) else 2e-4  # bent: centre of mass and inertia have moved a little
    size = np.abs(twist).max()
    for k, point in enumerate(POINTS):
        wanted = twist[:3] + np.cross(twist[3:], point)
        np.testing.assert_allclose(first[f"imu{k}.acceleration"][0], wanted, atol=loose * size)
    own = np.array([SHAPES[:, s].T @ bending for s in STATIONS])
    places = PARTICLES[list(STATIONS)] + ROOT
    wanted = twist[:3] + np.cross(twist[3:], places) + own
    np.testing.assert_allclose(first["stations.acceleration"][0], wanted, atol=loose * np.abs(wanted).max())
