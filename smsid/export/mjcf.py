"""The whole spacecraft as MuJoCo XML: rigid bodies, wheels, slosh and bending masses, motors and thrust.

What Pinocchio calls a joint becomes one or three MuJoCo joints of the same name (``tank.x``, ``tank.y``,
``tank.z`` for a slosh mass); a mode's coordinate is delta / L_t, as in the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from smsid.effects.joint_state import Counterpart
from smsid.errors import DescriptionError
from smsid.export.mjcf_bodies import inertial, joint_axes, numbers, stacked_joints, with_lent_inertia
from smsid.model.regressor import body_names
from smsid.model.spacecraft import SpacecraftModel

GROUND = "world"  # the name that MuJoCo keeps for what nothing moves


def write_mjcf(model: SpacecraftModel) -> str:
    """Return the model as MJCF text.

    Springs, dampers and rotor inertias are exact; Coulomb friction becomes MuJoCo's dry friction, which has
    no smoothing, and other laws what comes closest to them, as comments in the text say (`counterparts`); a
    motor of several joints is a tendon, a joint that follows another an equality constraint, a torque offset
    an actuator of constant torque.
    Limits of wheels, joints and thrust bound the controls. MuJoCo's free joint has linear velocity in
    inertial and angular velocity in body axes. A keyframe ``home`` holds the description's arm angles.

    Raises:
        DescriptionError: a joint MuJoCo does not have (one that twists and slides, as a mode of a skew
            panel), or an effect with forces that have no counterpart there.
    """
    p = model.pin
    axes = joint_axes(p)
    theta = with_lent_inertia(p, axes)
    springs = dict(
        zip(model.spring_v.tolist(), zip(model.stiffness, model.damping, strict=True), strict=True)
    )
    forces = counterparts(model)
    dry, damping_of, armature = _single_joints(model, forces)
    links = body_names(p)
    names = links if len(set(links)) == len(links) else tuple(list(p.names)[1:])
    own = "world_link"
    while own in names:
        own += "_"
    names = tuple(own if n == GROUND else n for n in names)
    children: dict[int, list[int]] = {j: [] for j in range(p.njoints)}
    for j in range(1, p.njoints):
        children[p.parents[j]].append(j)
    sites = _sites(model)
    stacked = stacked_joints(p)

    def joint_lines(j: int, indent: str, seen: pin.SE3) -> list[str]:
        """Write joint j of a body whose frame is ``seen`` in the joint's."""
        if p.joints[j].nq == 7:
            return [f"{indent}<freejoint name={quoteattr(p.names[j])}/>"]
        lines = []
        for i, column in enumerate(axes[j].T):
            k = p.joints[j].idx_v + i
            kind, axis = ("slide", column[:3]) if column[:3].any() else ("hinge", column[3:])
            stiffness, damping = springs.get(k, (0.0, 0.0))
            axis = seen.rotation.T @ axis
            at = seen.inverse().translation
            extra = f' pos="{numbers(at)}"' if at.any() else ""
            extra += f' armature="{numbers(armature[k])}"' if armature[k] > 0.0 else ""
            extra += f' frictionloss="{numbers(dry[k])}"' if dry[k] > 0.0 else ""
            damping += damping_of[k]
            lines.append(
                f'{indent}<joint name={quoteattr(_joint_name(p, j, i))} type="{kind}" axis="{numbers(axis)}" '
                f'stiffness="{numbers(stiffness)}" damping="{numbers(damping)}"{extra}{_range(p, j)}/>'
            )
        return lines

    def body_lines(j: int, depth: int, before: tuple[int, ...] = ()) -> list[str]:
        if j in stacked:
            return body_lines(stacked[j], depth, (*before, j))
        place, indent = p.jointPlacements[j], "  " * depth
        joints = [(j, pin.SE3.Identity())]
        for k in reversed(before):
            joints.insert(0, (k, place))
            place = p.jointPlacements[k] * place
        if p.joints[j].nq == 7 and not place.isIdentity(1e-12):
            raise DescriptionError("A free joint away from the origin.", advice="Put the root there.")
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        lines = [
            f"{indent}<body name={quoteattr(names[j - 1])} "
            f'pos="{numbers(place.translation)}" quat="{numbers([w, x, y, z])}">'
        ]
        for k, seen in joints:
            lines += joint_lines(k, indent + "  ", seen)
        lines.append(f"{indent}  {inertial(theta[j])}")
        lines += [f"{indent}  {site}" for site in sites.get(j, [])]
        for c in children[j]:
            lines += body_lines(c, depth + 1)
        return [*lines, f"{indent}</body>"]

    body = [line for c in children[0] for line in body_lines(c, 2)]
    scales = [
        f"{p.names[j]}: delta = {s:.9g} x coordinate"
        for a in model.appendages
        for j, s in zip(a.joints, a.scale, strict=True)
    ]
    return "\n".join(
        [
            f"<mujoco model={quoteattr(model.description.name)}>",
            *(["  <!-- modal amplitudes [kg^.5 m]: " + "; ".join(scales) + " -->"] if scales else []),
            *(f"  <!-- {f.note} -->" for f in forces.values() if f.note),
            '  <compiler angle="radian" autolimits="false" inertiafromgeom="false" balanceinertia="false"/>',
            f'  <option gravity="{numbers(p.gravity.linear)}" integrator="RK4" timestep="0.005"/>',
            "  <worldbody>",
            *(f"    {site}" for site in sites.get(0, [])),
            *body,
            "  </worldbody>",
            *_tendons(forces),
            *_followers(model),
            "  <actuator>",
            *_actuators(model, forces),
            "  </actuator>",
            "  <keyframe>",
            f'    <key name="home" qpos="{numbers(_home(model, children))}"/>',
            "  </keyframe>",
            "</mujoco>",
            "",
        ]
    )


def _joint_name(p: pin.Model, j: int, i: int) -> str:
    return str(p.names[j]) if p.joints[j].nv == 1 else f"{p.names[j]}.{'xyz'[i]}"


def _range(p: pin.Model, j: int) -> str:
    joint = p.joints[j]
    if joint.nq != 1:
        return ""
    low, high = p.lowerPositionLimit[joint.idx_q], p.upperPositionLimit[joint.idx_q]
    if not (np.isfinite(low) and np.isfinite(high) and low < high) or max(-low, high) > 1e6:
        return ""
    return f' limited="true" range="{numbers([low, high])}"'


def counterparts(model: SpacecraftModel) -> dict[str, Counterpart]:
    """Return what MuJoCo has of every effect's forces, by the effect's name.

    Raises:
        DescriptionError: an effect with forces that have no counterpart there, with the reason.
    """
    p = model.pin
    limits = {p.names[k]: float(p.velocityLimit[p.joints[k].idx_v]) for k in range(1, p.njoints)}
    acting = {name for name, _ in model.owned}
    found, refused = {}, {}
    for effect in model.description.effect:
        own = effect.counterpart(limits)
        if isinstance(own, Counterpart):
            found[effect.name] = own
        elif effect.name in acting:
            refused[f"'{effect.name}' ({effect.kind}): {own}"] = effect.kind
    if refused:
        raise DescriptionError(
            f"MuJoCo has no counterpart for forces of '{model.description.name}': {'; '.join(refused)}.",
            advice="Export without the MuJoCo XML (--no-mujoco), or a description without these effects.",
            kinds=sorted(set(refused.values())),
        )
    return found


def _single_joints(
    model: SpacecraftModel, forces: Mapping[str, Counterpart]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return dry friction, further damping and rotor inertia (nv,) that joints have by themselves.

    The rotor of a sum of joints goes with its tendon.
    """
    p = model.pin
    dry, damping, armature = np.zeros(p.nv), np.zeros(p.nv), np.array(p.armature)
    for force in forces.values():
        for joint, weight in force.weights.items():
            k = p.joints[p.getJointId(joint)].idx_v
            if len(force.weights) == 1:
                dry[k] += force.dry
                damping[k] += force.damping
            else:
                armature[k] -= weight**2 * force.inertia
    return dry, damping, armature


def _tendons(forces: Mapping[str, Counterpart]) -> list[str]:
    """Motors that turn with a sum of joints, as fixed tendons with damping, dry friction and inertia."""
    lines = []
    for effect, force in forces.items():
        if len(force.weights) > 1:
            lines.append(
                f'    <fixed name={quoteattr(effect)} damping="{numbers(force.damping)}" '
                f'frictionloss="{numbers(force.dry)}" armature="{numbers(force.inertia)}">'
            )
            lines += [
                f'      <joint joint={quoteattr(j)} coef="{numbers(w)}"/>' for j, w in force.weights.items()
            ]
            lines.append("    </fixed>")
    return ["  <tendon>", *lines, "  </tendon>"] if lines else []


def _followers(model: SpacecraftModel) -> list[str]:
    """Joints that follow another, as equality constraints: MuJoCo's are soft, these as stiff as it takes."""
    if model.followers is None:
        return []
    f = model.followers
    lines = [
        f"    <joint joint1={quoteattr(name)} joint2={quoteattr(leader)} "
        f'polycoef="{numbers([offset, ratio, 0.0, 0.0, 0.0])}" solref="0.01 1" solimp="0.9999 0.9999 0.001"/>'
        for name, leader, ratio, offset in zip(f.names, f.leaders, f.ratio, f.offset, strict=True)
    ]
    return ["  <equality>", *lines, "  </equality>"]


def _sites(model: SpacecraftModel) -> dict[int, list[str]]:
    """Thrust point and sensors on the bus, by joint."""
    if not model.free:
        return {}
    found = [f'<site name="thrust" pos="{numbers(model.thrust_point)}"/>']
    for sensor in model.description.sensor:
        if sensor.appendage is None and sensor.kind in ("pose", "imu"):
            found.append(
                f'<site name={quoteattr(f"sensor/{sensor.name}")} pos="{numbers(sensor.position)}"/>'
            )
    return {1: found}


def _actuators(model: SpacecraftModel, forces: Mapping[str, Counterpart]) -> list[str]:
    d, p = model.description, model.pin
    lines = []
    if model.free:
        limit = d.thrust.max_force
        for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            bound = _bound(limit) if k < 3 else ""
            gear = numbers(np.eye(6)[k])
            lines.append(f'    <motor name="thrust.{axis}" site="thrust" gear="{gear}"{bound}/>')
    own = {w.joint or w.name: w.max_torque for w in d.wheel}
    for group in (model.wheels, model.arm_joints):
        for name, v in zip(group.names, group.v.tolist(), strict=True):
            effort = float(p.upperEffortLimit[v])
            limit = own.get(name, effort if 0.0 < effort < 1e6 else None)
            lines.append(f"    <motor name={quoteattr(name)} joint={quoteattr(name)}{_bound(limit)}/>")
    for effect, force in forces.items():
        if force.torque != 0.0:
            joint, *others = force.weights
            on = f"tendon={quoteattr(effect)}" if others else f"joint={quoteattr(joint)}"
            lines.append(
                f"    <general name={quoteattr(effect)} {on} "
                f'biastype="affine" gainprm="0" biasprm="{numbers(force.torque)} 0 0"/>'
            )
    return lines


def _bound(limit: float | None) -> str:
    return "" if limit is None else f' ctrllimited="true" ctrlrange="{numbers([-limit, limit])}"'


def _home(model: SpacecraftModel, children: dict[int, list[int]]) -> list[float]:
    """qpos at home, in MuJoCo's order: depth first."""
    p, q = model.pin, model.home
    out: list[float] = []

    def visit(j: int) -> None:
        joint = p.joints[j]
        at = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nq == 7:
            out.extend([*at[:3], at[6], *at[3:6]])
        elif joint.nq == 2:
            out.append(float(np.arctan2(at[1], at[0])))
        else:
            out.extend(at.tolist())
        for c in children[j]:
            visit(c)

    for c in children[0]:
        visit(c)
    return out
