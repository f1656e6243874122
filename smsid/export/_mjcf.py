"""The whole spacecraft as MuJoCo XML: rigid bodies, wheels, slosh and bending masses, motors and thrust.

What Pinocchio calls a joint becomes one or three MuJoCo joints of the same name (``tank.x``, ``tank.y``,
``tank.z`` for a slosh mass); a mode's coordinate is delta / L_t, as in the model. MuJoCo wants mass and a
proper inertia on every moving body. Where a body lacks them, some are lent from its parent in a way that
leaves the motion as it was: rotational inertia to a body that only slides, mass on the axis and inertia
across it to a body that only turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from smsid.effects.gear import servos_of
from smsid.effects.inertial_parameters import move_parameters, parameters_to_matrix, pseudo_inertia
from smsid.effects.joint_state import Counterpart
from smsid.errors import DescriptionError
from smsid.likelihood.pseudo_inertia import inertial_parameters
from smsid.model.regressor import body_names
from smsid.model.spacecraft import SpacecraftModel, motion_columns

GROUND = "world"  # the name that MuJoCo keeps for what nothing moves


def write_mjcf(model: SpacecraftModel) -> str:
    """Return the model as MJCF text.

    Springs, dampers and rotor inertias are exact; Coulomb friction becomes MuJoCo's dry friction, which has
    no smoothing, and other laws what comes closest to them, as comments in the text say (`counterparts`); a
    motor of several joints is a tendon, a servo that damps the rate a position actuator, a joint that follows
    another an equality constraint, a torque offset an actuator of constant torque.
    Limits of wheels, joints and thrust bound the controls. MuJoCo's free joint has linear velocity in
    inertial and angular velocity in body axes. A keyframe ``home`` holds the description's arm angles.

    Raises:
        DescriptionError: a joint MuJoCo does not have (one that twists and slides, as a mode of a skew
            panel), or an effect with forces that have no counterpart there.
    """
    p = model.pin
    axes = joint_axes(p)
    theta = with_lent_inertia(p, axes)
    forces = counterparts(model)
    dry, stiffness, damping, armature = _single_joints(model, forces)
    links = body_names(p)
    names = links if len(set(links)) == len(links) else tuple(list(p.names)[1:])
    own = "world_link"
    while own in names:
        own += "_"
    names = tuple(own if n == GROUND else n for n in names)
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
            axis = seen.rotation.T @ axis
            at = seen.inverse().translation
            extra = f' pos="{numbers(at)}"' if at.any() else ""
            extra += f' armature="{numbers(armature[k])}"' if armature[k] > 0.0 else ""
            extra += f' frictionloss="{numbers(dry[k])}"' if dry[k] > 0.0 else ""
            lines.append(
                f'{indent}<joint name={quoteattr(joint_name(p, j, i))} type="{kind}" axis="{numbers(axis)}" '
                f'stiffness="{numbers(stiffness[k])}" damping="{numbers(damping[k])}"{extra}{_range(p, j)}/>'
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
        for c in p.children[j]:
            lines += body_lines(c, depth + 1)
        return [*lines, f"{indent}</body>"]

    body = [line for c in p.children[0] for line in body_lines(c, 2)]
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
            f'    <key name="home" qpos="{numbers(_home(model))}"/>',
            "  </keyframe>",
            "</mujoco>",
            "",
        ]
    )


def joint_name(p: pin.Model, j: int, i: int) -> str:
    """Return what MuJoCo's joint of coordinate i of joint j is called."""
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
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return dry friction, stiffness, damping and rotor inertia (nv,) of joints by themselves.

    The rotor of a sum of joints goes with its tendon.
    """
    p = model.pin
    dry, stiffness, damping = np.zeros((3, p.nv))
    armature = np.array(p.armature)
    for force in forces.values():
        for joint, weight in force.weights.items():
            k = p.joints[p.getJointId(joint)].idx_v
            if len(force.weights) == 1:
                dry[k] += force.dry
                stiffness[k] += force.stiffness
                damping[k] += force.damping
            else:
                armature[k] -= weight**2 * force.inertia
    stiffness[model.spring_v] += model.stiffness
    damping[model.spring_v] += model.damping
    return dry, stiffness, damping, armature


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
    servos = {joint: s for joint, s in servos_of(d.effect).items() if s.damps == "rate"}
    for group in (model.wheels, model.arm_joints):
        for name, v in zip(group.names, group.v.tolist(), strict=True):
            effort = float(p.upperEffortLimit[v])
            limit = own.get(name, effort if 0.0 < effort < 1e6 else None)
            kind, more = "motor", _bound(limit)
            if servo := servos.get(name):
                limit = limit if servo.limit is None else servo.limit
                kind, more = "position", f' kp="{numbers(servo.stiffness)}" kv="{numbers(servo.damping)}"'
                more += _bound(limit).replace("ctrl", "force")
            lines.append(f"    <{kind} name={quoteattr(name)} joint={quoteattr(name)}{more}/>")
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


def _home(model: SpacecraftModel) -> list[float]:
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
        for c in p.children[j]:
            visit(c)

    for c in p.children[0]:
        visit(c)
    return out


LENT = 1e-6
"""[kg], [kg m^2] lent to bodies that lack it."""
POINT = 3e-14
"""Inertia [kg m^2] of a mass without extent across the axis it turns about: the least that MuJoCo takes."""


def joint_axes(p: pin.Model) -> dict[int, np.ndarray]:
    """Return the motion subspace (6, nv) of every joint, linear parts first, in the joint's axes.

    Raises:
        DescriptionError: a joint that is not free, a hinge, a slide or three slides.
    """
    found = {}
    for j in range(1, p.njoints):
        s = motion_columns(p, j)
        simple = s.shape[1] == 1 and not (s[:3].any() and s[3:].any())
        if not (simple or p.joints[j].nq == 7 or p.joints[j].shortname() == "JointModelTranslation"):
            raise DescriptionError(
                f"Joint '{p.names[j]}' is a {p.joints[j].shortname()}, which MuJoCo does not have.",
                advice="Export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
        found[j] = s
    return found


def stacked_joints(p: pin.Model) -> dict[int, int]:
    """Return the joints whose body has no inertia and carries one other, by number, with that other.

    The other body has both joints in MuJoCo, as those of a hip or a wrist that turns about a point.
    """
    return {
        j: int(p.children[j][0])
        for j in range(1, p.njoints)
        if len(p.children[j]) == 1 and p.joints[j].nv == 1 and not p.inertias[j].toDynamicParameters().any()
    }


def with_lent_inertia(p: pin.Model, axes: dict[int, np.ndarray]) -> list[np.ndarray]:
    """Return every joint's inertia, parameters (10,) in Pinocchio's order, with what lacks it lent.

    ``axes``: as from `joint_axes`. The motion of the whole is the same, but for `POINT` where a mass has no
    extent across the axis that it turns about, which nothing can lend.

    Raises:
        DescriptionError: a body's inertia is none that a body can have, nor can its parent lend what lacks.
    """
    theta = [np.asarray(i.toDynamicParameters()) for i in p.inertias]
    stacked = stacked_joints(p)
    for j in range(p.njoints - 1, 0, -1):
        if j in stacked or _is_body(theta[j]):
            continue
        free = _lendable(axes[j])
        others = np.linalg.eigh(free @ free.T)[1][:, : 4 - free.shape[1]]
        own = pseudo_inertia(theta[j])
        across = np.linalg.eigvalsh(others.T @ own @ others)[0]
        if abs(across) < POINT and others.shape[1] == 2:
            theta[j] = theta[j] + POINT * np.array([0.0, 0, 0, 0, 1, 0, 1, 0, 0, 1])
            own = pseudo_inertia(theta[j])
            if np.linalg.eigvalsh(own)[0] > 0.0:
                continue
        elif across <= 0.0:
            raise DescriptionError(
                f"The body of joint '{p.names[j]}' has no mass, or an inertia that no rigid body can have; "
                "MuJoCo refuses it.",
                advice="Mend mass and inertia of its link, or export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
        # The least that makes the body one (Schur's complement) leaves the parent the most.
        coupling = free.T @ own @ others
        least = coupling @ np.linalg.solve(others.T @ own @ others, coupling.T) - free.T @ own @ free
        sizes, directions = np.linalg.eigh(least)
        lent = inertial_parameters(free @ directions * np.maximum(sizes + LENT, 0.0) @ (free @ directions).T)
        theta[j] = theta[j] + lent
        if p.parents[j]:
            theta[p.parents[j]] = theta[p.parents[j]] - move_parameters(p.jointPlacements[j], lent)
    return theta


def _lendable(axes: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (4, n) of the pseudo-inertia that a joint (6, nv) does not set in motion.

    Of a body that turns: mass on its axis; of one that slides: extent without mass; of a free one: nothing.
    """
    if axes.shape[1] == 6:
        return np.zeros((4, 0))
    if axes[:3].any():
        return np.eye(4)[:, :3]
    return np.column_stack([np.append(axes[3:, 0] / np.linalg.norm(axes[3:, 0]), 0.0), np.eye(4)[3]])


def _is_body(theta: np.ndarray) -> bool:
    """Whether MuJoCo takes the parameters: a mass, moments above zero, none above the others' sum."""
    if theta[0] <= 0.0:
        return False
    moments = np.linalg.eigvalsh(parameters_to_matrix(_about_centre(theta)))
    return bool(moments[0] > 1e-9 and moments[0] + moments[1] >= moments[2] * (1.0 - 1e-12))


def inertial(theta: np.ndarray) -> str:
    """Return the tag of a body with the ten parameters theta (10,), about its joint's origin."""
    own = _about_centre(theta)
    xx, xy, yy, xz, yz, zz = own[4:]
    return (
        f'<inertial mass="{numbers(theta[0])}" pos="{numbers(theta[1:4] / theta[0])}" '
        f'fullinertia="{numbers([xx, yy, zz, xy, xz, yz])}"/>'
    )


def numbers(values: object) -> str:
    """Return numbers, of any shape, as the text of an attribute, to the last bit."""
    return " ".join(repr(float(v)) for v in np.ravel(np.asarray(values, dtype=float)))


def _about_centre(theta: np.ndarray) -> np.ndarray:
    centre = theta[1:4] / theta[0]
    return move_parameters(pin.SE3(np.eye(3), -centre), theta)
