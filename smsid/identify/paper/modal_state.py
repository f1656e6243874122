"""Estimating the modal states of Exp. 2 from panel accelerometers: as printed in (31)-(32), and with modes.

A station at r_j on the panel moves with
``y_j = a(r_j) + S_j dd + 2 w x S_j d' + wd x S_j d + w x (w x S_j d)``, delta = d the mass-normalised modal
coordinates, S_j (3, modes) the shapes there and a(r_j) the rigid acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from smsid._short_repr import short_repr
from smsid.effects.assembly import AppendageJoints
from smsid.errors import NotIdentifiableError
from smsid.identify.paper.motion import MeasuredMotion


@short_repr
@dataclass(frozen=True)
class ModalState:
    """Estimated modal coordinates delta and delta' of one appendage, (N, modes) [kg^.5 m, kg^.5 m/s].

    ``forward``: the filter's state (N, 2 modes) and its covariance, where a motion goes on after this one.
    """

    position: np.ndarray
    velocity: np.ndarray
    forward: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True)
class _Panel:
    """An appendage's modal data in bus axes."""

    stations: np.ndarray  # (stations, 3) undeformed, bus frame
    shapes: np.ndarray  # (stations, 3, modes)
    translation: np.ndarray  # (modes, 3)
    centre: np.ndarray  # (modes, 3) where the modal mass sits
    root: np.ndarray
    rotation_part: np.ndarray  # (modes, 3) L_r about the root
    omega: np.ndarray
    damping: np.ndarray

    @classmethod
    def of(cls, joints: AppendageJoints, chosen: np.ndarray) -> _Panel:
        part, place = joints.appendage, joints.placement
        modes = part.modal_data()
        r = place.rotation
        lt = np.array([m.translation for m in modes])
        lr = np.array([m.rotation for m in modes])
        size = np.maximum(np.sum(lt * lt, axis=1), 1e-30)[:, None]
        return cls(
            stations=np.array([place.act(x) for x in part.station_positions()[chosen]]),
            shapes=np.einsum("ij,kmj->kim", r, np.array([[m.shape[k] for m in modes] for k in chosen]))
            if len(chosen)
            else np.zeros((0, 3, len(modes))),
            translation=lt @ r.T,
            centre=(np.cross(lt, lr) / size) @ r.T,
            root=place.translation,
            rotation_part=lr @ r.T,
            omega=2 * np.pi * np.array([m.frequency for m in modes]),
            damping=np.array([m.damping for m in modes]),
        )

    def drive(self, motion: MeasuredMotion) -> np.ndarray:
        """L_t . a(root) + L_r . wd + L_t . (w x (w x x_k)): modal force of rigid motion, (N, modes)."""
        w = motion.rate
        force = motion.rigid_acceleration(self.root) @ self.translation.T
        force += motion.rate_derivative @ self.rotation_part.T
        for k, x in enumerate(self.centre):
            # rigid_acceleration(root) has the swing of the root; this is that of the modal mass about it
            force[:, k] += np.cross(w, np.cross(w, x)) @ self.translation[k]
        return force

    def excess(self, motion: MeasuredMotion, measured: np.ndarray) -> np.ndarray:
        """Measured less rigid acceleration, (N, stations, 3)."""
        return np.stack(
            [measured[:, j] - motion.rigid_acceleration(r) for j, r in enumerate(self.stations)], axis=1
        )


def integrate_accelerometers(motion: MeasuredMotion, joints: AppendageJoints) -> ModalState:
    """Return the modal state by (31)-(32) as printed: accelerometers solved for delta'' and integrated twice.

    Drifts with bias and noise, and errs by the step: (32) is the rectangle rule. Raises
    `NotIdentifiableError` when fewer accelerometer axes see the panel than it has modes.
    """
    name = joints.appendage.name
    panel = _Panel.of(joints, motion.stations[name])
    seen = np.linalg.matrix_rank(panel.shapes.reshape(-1, panel.shapes.shape[2]))
    if seen < panel.shapes.shape[2]:
        raise NotIdentifiableError(
            f"{seen} accelerometer axes see the {panel.shapes.shape[2]} modes of '{name}': too few for (31).",
            advice="Add stations, describe fewer modes, or use the smoother.",
        )
    inverse = np.linalg.pinv(panel.shapes.reshape(-1, panel.shapes.shape[2]))
    excess = panel.excess(motion, motion.panels[name])
    n, m = len(motion), panel.shapes.shape[2]
    z1, z2 = np.zeros((n, m)), np.zeros((n, m))
    t_s = motion.step
    for i in range(1, n):
        w, wd = motion.rate[i - 1], motion.rate_derivative[i - 1]
        moved, moving = panel.shapes @ z1[i - 1], panel.shapes @ z2[i - 1]
        carried = 2 * np.cross(w, moving) + np.cross(wd, moved) + np.cross(w, np.cross(w, moved))
        acceleration = inverse @ (excess[i - 1] - carried).ravel()
        z1[i] = z1[i - 1] + t_s * z2[i - 1]
        z2[i] = z2[i - 1] + t_s * acceleration
    return ModalState(z1, z2)


def smooth_modes(
    motion: MeasuredMotion,
    joints: AppendageJoints,
    *,
    accelerometer: float,
    imu: float,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    going_on: bool = False,
) -> ModalState:
    """Return the modal state by a Kalman filter and Rauch-Tung-Striebel smoother with the identified modes.

    The modes obey ``dd + 2 zeta w d' + w^2 d = -drive(rigid motion)``; the accelerometers see ``S dd`` and
    more. ``accelerometer``, ``imu``: noise of the prepared samples, one sigma [m/s^2]; only their ratio to
    the signal decides how far each is trusted. The panel starts at rest, or with ``start``: the filter's
    state (2 modes,) and covariance at the first sample. ``going_on`` keeps what that takes (`forward`).
    """
    name = joints.appendage.name
    chosen = motion.stations.get(name, np.zeros(0, dtype=int))
    panel = _Panel.of(joints, chosen)
    m = len(panel.omega)
    drive = panel.drive(motion)
    a = np.block(
        [[np.zeros((m, m)), np.eye(m)], [-np.diag(panel.omega**2), -np.diag(2 * panel.damping * panel.omega)]]
    )
    h = motion.step
    # drive interpolated linearly between samples (first-order hold), exact discretisation
    big = np.zeros((4 * m, 4 * m))
    big[: 2 * m, : 2 * m] = a
    big[m : 2 * m, 2 * m : 3 * m] = -np.eye(m)
    big[2 * m : 3 * m, 3 * m :] = np.eye(m)
    phi = expm(big * h)
    f, g0, g1 = phi[: 2 * m, : 2 * m], phi[: 2 * m, 2 * m : 3 * m], phi[: 2 * m, 3 * m :]
    gamma0, gamma1 = g0 - g1 / h, g1 / h
    # the spring softens by rotation: + (|w|^2 - (n.w)^2) delta for bending along n
    n_hat = panel.translation / np.maximum(np.linalg.norm(panel.translation, axis=1), 1e-30)[:, None]
    soft = np.sum(motion.rate**2, axis=1)[:, None] - (motion.rate @ n_hat.T) ** 2
    noise_in = (panel.translation @ panel.translation.T) * imu**2
    q = np.zeros((2 * m, 2 * m))
    q[m:, m:] = noise_in * h * h
    q += 1e-16 * np.trace(q) * np.eye(2 * m)
    n = len(motion)
    x, p = (np.zeros(2 * m), np.zeros((2 * m, 2 * m))) if start is None else start
    seen = bool(len(chosen))
    if seen:
        s = panel.shapes.reshape(-1, m)
        use = np.linalg.norm(s, axis=1) > 1e-6 * np.linalg.norm(s)
        s = s[use]
        c = s @ a[m:]
        y = panel.excess(motion, motion.panels[name]).reshape(n, -1)[:, use] + drive @ s.T
        r = np.eye(len(s)) * (accelerometer**2 + imu**2)
        information = c.T @ np.linalg.inv(r)
        told = information @ c
    little = 1e-18 * np.eye(2 * m)
    xs, ps, xf, pf = (
        np.empty((n, 2 * m)),
        np.empty((n, 2 * m, 2 * m)),
        np.empty((n, 2 * m)),
        np.empty((n, 2 * m, 2 * m)),
    )
    for i in range(n):
        if i:
            force = drive[i - 1 : i + 1] - soft[i - 1 : i + 1] * x[:m]
            x = f @ x + gamma0 @ force[0] + gamma1 @ force[1]
            p = f @ p @ f.T + q
        xs[i], ps[i] = x, p
        if seen and i:  # the start is known, or has had its measurement
            innovation = y[i] - c @ x  # the softening cancels against the points' own centripetal part
            p = np.linalg.inv(np.linalg.inv(p + little) + told)
            x = x + p @ information @ innovation
        xf[i], pf[i] = x, p
    forward = (xf.copy(), pf) if going_on else None
    gains = np.linalg.solve(ps[1:] + little, f @ pf[:-1])
    for i in range(n - 2, -1, -1):
        xf[i] += (xf[i + 1] - xs[i + 1]) @ gains[i]
    return ModalState(xf[:, :m], xf[:, m:], forward)
