"""Exp. 2: momentum of the free-floating spacecraft, linear in inertial parameters.

Step A, (33)-(37): the inertial position of the system CM and the first moments of the links, from the velocity of
P. Step B, (38)-(39): inertias from the conserved angular momentum. Here the slosh state is put back in, so both
are linear in ordinary inertial parameters; ``momentum_printed.py`` has Step B as printed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.modal_state import ModalState
from smsid.identify.motion import Motion
from smsid.identify.recursive_tls import RecursiveTls
from smsid.identify.tls import TlsSolution, total_least_squares
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel


@dataclass(frozen=True)
class HiddenStates:
    """What Exp. 2 does not measure, estimated: slosh by tank, modes by appendage.

    ``slosh`` holds (rho, rho') each (N, 3) bus axes, ``modes`` a `ModalState` each.
    """

    slosh: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, ModalState]


@dataclass(frozen=True)
class Regression:
    """Base parameters of a linear regression and their total-least-squares estimate."""

    base: BaseParameters
    solution: TlsSolution
    theta_names: tuple[str, ...]

    @property
    def values(self) -> np.ndarray:
        """Estimated base parameters (b,)."""
        return self.solution.x

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (b,)."""
        return self.solution.standard_deviation


@dataclass(frozen=True)
class StepA:
    """Result of Step A.

    ``velocity`` (3,) and ``position`` (3,) of the system CM, inertial axes, from the inertial origin [m/s, m];
    ``moments``: identifiable first moments of the links [kg m].
    """

    velocity: np.ndarray
    position: np.ndarray
    position_sigma: np.ndarray
    moments: Regression


def full_states(
    model: SpacecraftModel, motion: Motion, hidden: HiddenStates
) -> tuple[np.ndarray, np.ndarray]:
    """Return q (N, nq), v (N, nv) of the model with measured motion and estimated hidden states."""
    q, v = motion.states(model)
    for joint in model.slosh:
        if joint.name in hidden.slosh:
            q[:, joint.q], v[:, joint.v] = hidden.slosh[joint.name]
    for panel in model.appendages:
        state = hidden.modes.get(panel.appendage.name)
        if state is None:
            continue
        for k, j in enumerate(panel.joints):
            q[:, model.pin.joints[j].idx_q] = state.position[:, k] / panel.scale[k]
            v[:, model.pin.joints[j].idx_v] = state.velocity[:, k] / panel.scale[k]
    return q, v


def step_a(model: SpacecraftModel, motion: Motion, hidden: HiddenStates, mass: float) -> StepA:
    """Estimate the CM's position and the links' first moments from (34)-(37), total mass ``mass`` [kg] given.

    Without slosh in ``hidden`` this is (34) as printed, which neglects m_s rho' / M. Raises
    `NotIdentifiableError` when joints or bus do not move enough.
    """
    regressor = Regressor(model)
    n = len(motion)
    q, v = full_states(model, motion, hidden)
    # velocity of first moments relative to the bus: linear momentum with the bus at rest
    still = v.copy()
    still[:, :6] = 0.0
    q[:, 0:3] = 0.0
    y = regressor.momentum(q, still)[:, :3]
    theta = regressor.parameters
    links = set(regressor.bodies[1 : 1 + len(model.arm_joints)])
    body = [name.rsplit(".", 1)[0] for name in regressor.names]
    first = [i for i, name in enumerate(regressor.names) if name.rsplit(".", 1)[1] in ("m", "mx", "my", "mz")]
    unknown = [i for i in first if body[i] in links]
    known = [i for i in first if body[i] not in links and body[i] != regressor.bodies[0]]
    names = tuple(regressor.names[i] for i in unknown)
    base = base_parameters(y[:, :, unknown].reshape(3 * n, -1), names, [regressor.units[i] for i in unknown])
    hidden_momentum = y[:, :, known] @ theta[known]

    to_body = motion.rotation.transpose(0, 2, 1)
    columns = np.concatenate(
        [to_body, -np.einsum("nij,njk->nik", _skew(motion.rate), to_body), -y[:, :, unknown][:, :, base.independent] / mass],
        axis=2,
    ).reshape(3 * n, -1)
    rhs = (motion.velocity - np.cross(motion.rate, _in_body(motion, motion.position)) + hidden_momentum / mass).reshape(-1)
    labels = ["v_cm.x", "v_cm.y", "v_cm.z", "r_cm.x", "r_cm.y", "r_cm.z", *base.names]
    solution = _scaled_tls(columns, rhs, labels)
    split = TlsSolution(
        solution.x[6:],
        solution.covariance[6:, 6:],
        solution.sigma,
        solution.singular_values,
        solution.condition,
        solution.rows,
        solution.status,
    )
    return StepA(
        velocity=solution.x[:3],
        position=solution.x[3:6],
        position_sigma=solution.standard_deviation[3:6],
        moments=Regression(base, split, names),
    )


def step_b(
    model: SpacecraftModel,
    motion: Motion,
    hidden: HiddenStates,
    *,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
) -> Regression:
    """Estimate the inertial parameters of bus and links from (38)-(39) with the slosh state put back in.

    With zero momentum the angular momentum about the bus origin is zero too, so (39) reads Y theta = 0; wheels,
    slosh and modes are known from Exp. 1 and go to the right-hand side. ``prior`` (mean (b,), covariance (b, b))
    of the base parameters enters through recursive TLS.
    """
    regressor = Regressor(model)
    q, v = full_states(model, motion, hidden)
    y = regressor.momentum(q, v)[:, 3:]
    rigid = set(regressor.bodies[: 1 + len(model.arm_joints)])
    body = [name.rsplit(".", 1)[0] for name in regressor.names]
    unknown = [i for i in range(len(body)) if body[i] in rigid]
    known = [i for i in range(len(body)) if body[i] not in rigid]
    names = tuple(regressor.names[i] for i in unknown)
    rows = y[:, :, unknown].reshape(-1, len(unknown))
    base = base_parameters(rows, names, [regressor.units[i] for i in unknown])
    rhs = -(y[:, :, known] @ regressor.parameters[known]).reshape(-1)
    if np.linalg.norm(rhs) < 1e-9:
        raise NotIdentifiableError(
            "No known momentum is exchanged: wheels, slosh and panel stay still, so inertias are known only up to "
            "a common factor.",
            advice="Spin a wheel of known inertia during Exp. 2.",
        )
    solution = _scaled_tls(rows[:, base.independent], rhs, base.names, prior)
    return Regression(base, solution, names)


def _scaled_tls(
    rows: np.ndarray,
    rhs: np.ndarray,
    names: tuple[str, ...] | list[str],
    prior: tuple[np.ndarray, np.ndarray] | None = None,
) -> TlsSolution:
    """Recursive TLS with columns brought to the length of the right-hand side, results in physical units."""
    scale = np.linalg.norm(rows, axis=0) / np.linalg.norm(rhs)
    if prior is None:
        found = total_least_squares(rows / scale, rhs, names=names)
    else:
        recursive = RecursiveTls(
            len(scale), prior_mean=prior[0] * scale, prior_covariance=prior[1] * np.outer(scale, scale), names=names
        )
        recursive.update(rows / scale, rhs)
        found = recursive.solution()
    return TlsSolution(
        found.x / scale,
        found.covariance / np.outer(scale, scale),
        found.sigma,
        found.singular_values,
        found.condition,
        found.rows,
        found.status,
    )


def _skew(w: np.ndarray) -> np.ndarray:
    out = np.zeros((len(w), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    return out - out.transpose(0, 2, 1)


def _in_body(motion: Motion, x: np.ndarray) -> np.ndarray:
    return np.einsum("nji,nj->ni", motion.rotation, x)
