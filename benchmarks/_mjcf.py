"""Any Pinocchio model as MJCF, and states and forces in MuJoCo's conventions.

MuJoCo's free joint has linear velocity and force in inertial axes, the angular ones in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from smsid.errors import DescriptionError
from smsid.export._mjcf import inertial, joint_axes, numbers, with_lent_inertia


class UnsupportedError(Exception):
    """The model cannot be written as MJCF; the message says why."""


@dataclass(frozen=True)
class Twin:
    """A Pinocchio model in MuJoCo: maps of q and v, as indices into MuJoCo's qpos and qvel."""

    pin: pin.Model
    model: mujoco.MjModel
    data: mujoco.MjData
    dof: np.ndarray  # (nv,)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return qpos of q (nq,)."""
        out = np.zeros(self.model.nq)
        for j in range(1, self.pin.njoints):
            joint, at = self.pin.joints[j], q[self.pin.joints[j].idx_q :]
            k = self.model.jnt_qposadr[self._first(j)]
            if joint.nq == 7:
                out[k : k + 7] = *at[:3], at[6], *at[3:6]
            elif joint.nq == 2:
                out[k] = np.arctan2(at[1], at[0])
            else:
                out[k : k + joint.nq] = at[: joint.nq]
        return out

    def velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return qvel of v (nv,)."""
        out = np.zeros(self.model.nv)
        out[self.dof] = v
        if self.pin.joints[1].nq == 7:
            out[:3] = _rotation(q) @ v[:3]
        return out

    def acceleration(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return qacc of a = vdot (nv,)."""
        if self.pin.joints[1].nq == 7:
            a = np.concatenate([a[:3] + np.cross(v[3:6], v[:3]), a[3:]])
        return self.velocity(q, a)

    def force(self, q: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return generalised forces (nv,) in Pinocchio's order and axes from MuJoCo's."""
        out = force[self.dof]
        if self.pin.joints[1].nq == 7:
            out[:3] = _rotation(q).T @ force[:3]
        return out

    def state(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return (q, v) in Pinocchio's order and axes; for joints whose coordinates are the same in both."""
        q = np.empty(self.pin.nq)
        for j in range(1, self.pin.njoints):
            joint, k = self.pin.joints[j], self.model.jnt_qposadr[self._first(j)]
            at = qpos[k : k + joint.nq]
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                np.concatenate([at[:3], at[4:7], at[3:4]]) if joint.nq == 7 else at
            )
        return np.concatenate([q, self.force(q, qvel)])

    def _first(self, joint: int) -> int:
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, f"{joint}.0")


def mujoco_twin(
    model: pin.Model, stiffness: np.ndarray | None = None, damping: np.ndarray | None = None
) -> Twin:
    """Return the model in MuJoCo, with springs and dampers (nv,) per degree of freedom.

    Raises `UnsupportedError` for joints without a counterpart or inertia that MuJoCo refuses.
    """
    try:
        mj = mujoco.MjModel.from_xml_string(write_mjcf(model, stiffness, damping))
    except (DescriptionError, ValueError) as error:
        raise UnsupportedError(f"The model cannot be one of MuJoCo's: {error}") from error
    dof = np.empty(model.nv, dtype=int)
    for j in range(1, model.njoints):
        first = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_JOINT, f"{j}.0")
        k = model.joints[j].idx_v
        dof[k : k + model.joints[j].nv] = mj.jnt_dofadr[first] + np.arange(model.joints[j].nv)
    return Twin(model, mj, mujoco.MjData(mj), dof)


def write_mjcf(
    model: pin.Model, stiffness: np.ndarray | None = None, damping: np.ndarray | None = None
) -> str:
    """Return the model as MJCF text; joint ``j`` of Pinocchio becomes ``j.0`` (``j.1``, ``j.2``)."""
    stiffness = np.zeros(model.nv) if stiffness is None else stiffness
    damping = np.zeros(model.nv) if damping is None else damping
    axes = joint_axes(model)
    theta = with_lent_inertia(model, axes)
    children: dict[int, list[int]] = {j: [] for j in range(model.njoints)}
    for j in range(1, model.njoints):
        children[model.parents[j]].append(j)

    def body(j: int) -> str:
        place = model.jointPlacements[j]
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        text = f'<body name="b{j}" pos="{numbers(place.translation)}" quat="{numbers([w, x, y, z])}">'
        k = model.joints[j].idx_v
        if model.joints[j].nq == 7:
            if not place.isIdentity(1e-15):
                raise UnsupportedError("A free joint away from the origin.")
            text += f'<freejoint name="{j}.0"/>'
        else:
            for i, column in enumerate(axes[j].T):
                kind, axis = ("slide", column[:3]) if column[:3].any() else ("hinge", column[3:])
                text += (
                    f'<joint name="{j}.{i}" type="{kind}" axis="{numbers(axis)}" '
                    f'stiffness="{float(stiffness[k + i])!r}" damping="{float(damping[k + i])!r}"/>'
                )
        return text + inertial(theta[j]) + "".join(body(c) for c in children[j]) + "</body>\n"

    return (
        '<mujoco><compiler angle="radian" autolimits="false" inertiafromgeom="false" balanceinertia="false"/>'
        f'<option gravity="{numbers(model.gravity.linear)}" integrator="RK4">'
        '<flag contact="disable" constraint="disable"/></option><worldbody>'
        + "".join(body(c) for c in children[0])
        + "</worldbody></mujoco>"
    )


def _rotation(q: np.ndarray) -> np.ndarray:
    return pin.Quaternion(*q[[6, 3, 4, 5]]).toRotationMatrix()
