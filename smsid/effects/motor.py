"""Motors of an arm: rotors seen through gears, motors that turn with several joints, gears that give.

Of a gear that gives, the motor's angle, as seen at the joint, is the joint's plus the twist phi of the gear;
phi is a joint of its own that moves no link. With rotor inertia I at the joint the kinetic energy gains
``1/2 I (qd + phid)^2``, and a motor torque works on ``q + phi``. Friction of the joint stays on the link's
side. Source: Spong, J. Dyn. Syst. Meas. Control 109 (1987) 310.

A gear too stiff to ring within a sample is ``quasistatic``: its twist follows the torque it hands on at once,
which is the motor's less what the rotor takes, ``tau - I qdd``. It adds no joint then: encoders read by how
much a rotor that gets ahead leaves all joints behind, and one on the motor's side reads the twist as well.
The rate of the twist is left out.

A rotor also turns with the link that carries the motor: by the share ``carried`` c of that link's rate about
the joint's axis, one over the gear's ratio, the rotor's rate is ``qd + phid + c omega``. Geared arms neglect
it, as Spong does; in a direct drive c is 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import Assembly, Twist
from smsid.effects.base import Effect, JointEffect, physical, register
from smsid.effects.force_laws import BacklashForce, SharedFriction, TransmittedForce
from smsid.effects.friction_law import SMOOTHING
from smsid.effects.joint_state import Counterpart, JointStateOf, TorqueColumns
from smsid.effects.spatial import ConstantInertia, Rotor

SWINGS = (0.01, 0.03)  # [s] of a rotor on its spring, over 2 pi; quicker, it follows the torque
QUICK_SWING = 0.003  # [s] where a rotor that the prior allows swings no slower


@register
class MotorInertia(JointEffect):
    """The rotor's spin inertia seen at the joint, ratio squared times its own: torque ``inertia * qdd``.

    Gyroscopic torques of the spinning rotor are left out, as usual for geared arms.
    """

    summary = "inertia of a motor's rotor, seen at its joint"
    aliases = ("body_error", "joint_friction")
    strength = ("inertia",)
    strong = {"inertia": (0.3, 3.0)}  # [kg m^2]
    in_words = "the motor of {place} adds inertia that the description lacks"
    kind: Literal["motor_inertia"] = "motor_inertia"
    inertia: float = physical(
        "kg m^2", lower=0.0, may_vanish=True, description="at the joint: ratio squared times the rotor's"
    )

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return the joint's acceleration."""
        return {"inertia": {self.joint: of(self.joint).acceleration}}

    def attach(self, assembly: Assembly) -> None:
        """Add the inertia to the joint's armature."""
        assembly.model.armature[assembly.joint(self.joint).idx_v] += self.inertia


@register
class MotorCoupling(Effect):
    """A motor that turns with a sum of joints, ``s = ratios . q``, as that of the last joint of many wrists.

    Its rotor and friction act on s: every joint takes part in the torque
    ``inertia sdd + viscous sd + coulomb tanh(sd / smoothing)``, times its ratio. `JointFriction` and
    `MotorInertia` of the single joints stay beside it.
    """

    summary = "a motor that turns with a sum of joints: its inertia and friction"
    family = "drivetrain"
    aliases = ("joint_friction", "motor_inertia")
    strength = ("inertia", "viscous", "coulomb")
    in_words = "the motors of {place} are coupled"
    kind: Literal["motor_coupling"] = "motor_coupling"
    joints: tuple[str, ...] = Field(min_length=2, description="joints that turn the motor")
    ratios: tuple[float, ...] = Field(
        default=(), description="weight of each joint in s; all 1 when not given"
    )
    inertia: float = physical(
        "kg m^2", lower=0.0, may_vanish=True, default=0.0, description="of the motor, for s"
    )
    viscous: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="torque on s per rate of s"
    )
    coulomb: float = physical(
        "N m", lower=0.0, may_vanish=True, default=0.0, description="torque on s at speed"
    )
    smoothing: float = Field(
        default=SMOOTHING, gt=0.0, description="rate of s at which the Coulomb torque reaches 76 % [rad/s]"
    )

    @model_validator(mode="after")
    def _one_ratio_per_joint(self) -> MotorCoupling:
        if self.ratios and len(self.ratios) != len(self.joints):
            raise ValueError(f"{len(self.joints)} `joints` but {len(self.ratios)} `ratios`")
        if len(set(self.joints)) != len(self.joints):
            raise ValueError("a joint is named twice")
        return self

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each joint in s."""
        return self.ratios or (1.0,) * len(self.joints)

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joints whose motor torque it has to do with."""
        return self.joints

    def joint_weights(self) -> dict[str, float]:
        """Return the weight of each joint in s."""
        return dict(zip(self.joints, self.weights, strict=True))

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return what s needs, times the weights."""
        weights, states = self.joint_weights(), {j: of(j) for j in self.joints}
        rate = sum(w * states[j].rate for j, w in weights.items())
        acceleration = sum(w * states[j].acceleration for j, w in weights.items())
        parts = {"inertia": acceleration, "viscous": rate, "coulomb": np.tanh(rate / self.smoothing)}
        return {f: {j: w * x for j, w in weights.items()} for f, x in parts.items()}

    def torque_shapes(self) -> tuple[str, ...]:
        """Return the width of the sign."""
        return ("smoothing",)

    def attach(self, assembly: Assembly) -> None:
        """Add the friction of s as a generalised force, and the rotor's inertia ``inertia w w'`` on the
        joints' rates.
        """
        index = np.array([assembly.joint(name).idx_v for name in self.joints])
        weights = np.asarray(self.weights)
        if self.viscous or self.coulomb:
            own = self.viscous, self.coulomb, self.smoothing
            assembly.add_force(SharedFriction(index.tolist(), weights, *own))
        if self.inertia > 0.0:
            shared = np.outer(weights, weights) * self.inertia
            assembly.model.armature[index] += np.diag(shared)  # what each joint feels of it by itself
            shared[np.diag_indices(index.size)] = 0.0

            def rotor(mass: np.ndarray) -> None:
                mass[np.ix_(index, index)] = shared

            assembly.add_inertia_term(ConstantInertia(rotor))

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart:
        """Return its damper, dry friction and rotor."""
        weights = dict(zip(self.joints, self.weights, strict=True))
        return Counterpart(weights, damping=self.viscous, dry=self.coulomb, inertia=self.inertia)


class ElasticGear(JointEffect):
    """What compliance and backlash share."""

    motor_inertia: float = physical(
        "kg m^2", lower=0.0, default=0.0, description="of the rotor at the joint: ratio squared times its own"
    )
    encoder: Literal["motor", "link"] = Field(
        default="motor", description="side of the gear on which the joint's encoder sits"
    )
    inertia_in_link: bool = Field(
        default=False, description="whether the link's inertia about the joint counts the rotor already"
    )
    carried: float = physical(
        "1",
        lower=-1.0,
        upper=1.0,
        default=0.0,
        description="share of its carrying link's turning that the rotor takes part in: one over the ratio",
    )
    quasistatic: bool = Field(
        default=False, description="whether the twist follows the torque at once, without a joint of its own"
    )

    def rigid(self) -> bool:
        """Whether the gear does not give."""
        raise NotImplementedError

    def has_fast_dynamics(self) -> bool:
        """Whether the rotor swings on its gear."""
        return not (self.quasistatic or self.rigid())

    def bent(self, torque: np.ndarray) -> np.ndarray:
        """Return the twist [rad] at rest under torques [N m] of any shape."""
        raise NotImplementedError

    @property
    def law(self) -> tuple[float, float, float, float]:
        """Number of the law of `bent`, and its numbers, as `smsid.kernel.readings.bent` has them."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _rotor_has_inertia(self) -> ElasticGear:
        if not (self.quasistatic or self.rigid()) and self.motor_inertia <= 0.0:
            raise ValueError("a gear that gives needs a positive `motor_inertia`, or to be `quasistatic`")
        return self

    def twist(self, assembly: Assembly) -> int | None:
        """Add the rotor; return the joint of the twist, or ``None`` for a rigid or quasistatic gear.

        Raises `DescriptionError` for a rotor that turns with the carrying link of a joint that does not turn.
        """
        number, model, inertia = assembly.joint_id(self.joint), assembly.model, self.motor_inertia
        link, counted = model.joints[number].idx_v, 0.0 if self.inertia_in_link else inertia
        if self.rigid() or self.quasistatic:
            rotor = self._rotor(assembly, number, None) if self.carried else None
            if rotor is None:
                model.armature[link] += counted
            elif counted:
                assembly.add_inertia_term(rotor)
            if not self.rigid():
                turning, read = rotor.turning if rotor else None, self.encoder == "motor"
                assembly.twists[number] = Twist(self, self.bent, self.law, inertia, turning, read)
            return None
        joint = assembly.add_joint(None, pin.JointModelRZ(), pin.SE3.Identity(), f"{self.name}.twist")
        gear = model.joints[joint].idx_v
        model.armature[gear] = inertia

        assembly.add_inertia_term(self._rotor(assembly, number, gear))
        assembly.add_load_force(TransmittedForce(gear, link), first=True)
        if self.encoder == "motor":
            assembly.motors[number] = joint
        return joint

    def _rotor(self, assembly: Assembly, joint: int, gear: int | None) -> Rotor:
        return Rotor(
            assembly.model, joint, self.motor_inertia, self.carried, gear=gear, in_link=self.inertia_in_link
        )


@register
class GearCompliance(ElasticGear):
    """A spring and damper between motor and link; at zero compliance the gear is rigid."""

    summary = "elastic gear of a joint"
    aliases = ("backlash", "motor_inertia", "actuator_delay")
    strength = ("compliance", "motor_inertia")
    strong = {"compliance": (3e-5, 1e-4, 3e-4, 1e-3), "motor_inertia": (0.3,)}
    in_words = "the gear of {place} is elastic"
    kind: Literal["gear_compliance"] = "gear_compliance"
    compliance: float = physical("rad/(N m)", lower=0.0, default=0.0, description="twist per torque")
    damping: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="torque per rate of twist"
    )

    def rigid(self) -> bool:
        """Whether the gear does not give."""
        return self.compliance == 0.0

    def with_dynamics(self) -> tuple[tuple[Effect, float], ...]:
        """Return it with the rotor swinging on its spring, half damped, in `SWINGS` that a rotor lighter than
        the prior's can have: at rest, it tells little of its inertia.
        """
        if self.rigid() or not self.quasistatic:
            return ()
        largest = self.prior.get("motor_inertia", np.inf)
        rotors = [(swing**2 / self.compliance, swing) for swing in SWINGS]
        if all(i >= largest for i, _ in rotors):
            rotors = [(QUICK_SWING**2 / self.compliance, QUICK_SWING)]
        return tuple(
            (
                self.model_copy(update={"motor_inertia": i, "damping": i / swing, "quasistatic": False}),
                swing / 4.0,
            )
            for i, swing in rotors
            if i < largest
        )

    def bent(self, torque: np.ndarray) -> np.ndarray:
        """Return compliance times torque."""
        return self.compliance * torque

    @property
    def law(self) -> tuple[float, float, float, float]:
        """The compliance."""
        return 0.0, self.compliance, 0.0, 0.0

    def attach(self, assembly: Assembly) -> None:
        """Add rotor, spring and damper."""
        joint = self.twist(assembly)
        if joint is not None:
            assembly.add_springs(joint, (1.0 / self.compliance,), (self.damping,))


@register
class Backlash(ElasticGear):
    """A gap in which the motor turns without the link; beyond it, teeth with stiffness and damping.

    ``gap`` is the whole play. At zero gap the gear is rigid.
    """

    summary = "play in the gear of a joint"
    aliases = ("gear_compliance", "joint_friction")
    strength = ("gap", "motor_inertia")
    in_words = "the gear of {place} has play"
    kind: Literal["backlash"] = "backlash"
    gap: float = physical("rad", lower=0.0, default=0.0, description="play, from one side to the other")
    contact_stiffness: float = physical(
        "N m/rad", lower=1e-9, default=1e4, description="of the teeth when they touch"
    )
    contact_damping: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="of the teeth when they touch"
    )
    turn_torque: float = physical(
        "N m", lower=1e-6, default=0.3, description="torque that takes the motor across, when quasistatic"
    )
    sharpness: float = physical(
        "1", lower=1.0, upper=8.0, default=2.0, description="how suddenly that torque takes it to the teeth"
    )

    def rigid(self) -> bool:
        """Whether the gear does not give."""
        return self.gap == 0.0

    def bent(self, torque: np.ndarray) -> np.ndarray:
        """Return half the gap, to the side the motor pushes; the teeth do not give.

        With x the torque over ``turn_torque`` and n the ``sharpness``: ``x / (1 + |x|^n)^(1/n)`` of it.
        """
        n, x = self.sharpness, torque / self.turn_torque
        return 0.5 * self.gap * x / (1.0 + np.abs(x) ** n) ** (1.0 / n)

    @property
    def law(self) -> tuple[float, float, float, float]:
        """Half the gap, the torque that crosses it, and how suddenly."""
        return 1.0, 0.5 * self.gap, self.turn_torque, self.sharpness

    def attach(self, assembly: Assembly) -> None:
        """Add rotor and teeth."""
        joint = self.twist(assembly)
        if joint is None:
            return
        place, index = assembly.model.joints[joint].idx_q, assembly.model.joints[joint].idx_v
        touching = self.contact_stiffness, self.contact_damping
        assembly.add_force(BacklashForce(index, place, self.gap / 2.0, *touching))
