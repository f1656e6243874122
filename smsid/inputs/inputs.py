"""What drives a simulation: thrust, wheel and joint torque, or prescribed motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from smsid.errors import ExperimentError
from smsid.inputs.signals import Constant, Fourier, Sampled, Signal, merge
from smsid.model.spacecraft import SpacecraftModel


@dataclass(frozen=True)
class JointMotion:
    """Prescribed angles, rates and accelerations of all arm joints (joints,) [rad, rad/s, rad/s^2]."""

    position: Signal
    velocity: Signal
    acceleration: Signal

    @classmethod
    def of(cls, position: Fourier | Sampled) -> JointMotion:
        """Return the motion along a position signal, with its derivatives."""
        velocity = position.derivative()
        return cls(position, velocity, velocity.derivative())


@dataclass(frozen=True)
class Inputs:
    """Inputs of a simulation; what is ``None`` is zero.

    ``force`` [N] acts at the thrust point, ``torque`` [N m] on the bus, both in body axes; ``wheel_torque``
    and ``joint_torque`` [N m] act on the child, their reaction on the parent. ``joint_motion`` prescribes
    the joints instead of torque; ``lock_joints``, ``lock_wheels`` hold them; ``hold_attitude`` keeps the bus
    from rotating (the torque that takes is an output). ``thruster`` (thrusters,) is the share of its full
    thrust that each single thruster of the description gives; ``thrusts`` (3 thrusters,) [N], body axes, one
    after the other, is what `driven` makes of it. ``further`` are generalised forces (nv,) of effects.
    """

    force: Signal | None = None
    torque: Signal | None = None
    thruster: Signal | None = None
    wheel_torque: Signal | None = None
    joint_torque: Signal | None = None
    joint_motion: JointMotion | None = None
    lock_joints: bool = False
    lock_wheels: bool = False
    hold_attitude: bool = False
    thrusts: Signal | None = None
    further: tuple[Signal, ...] = ()

    def check(self, model: SpacecraftModel) -> None:
        """Raise `ExperimentError` when sizes do not fit the spacecraft or inputs contradict each other."""
        n, w = len(model.arm_joints), len(model.wheels)
        thrusters = len(model.description.thruster)
        sizes = {"force": 3, "torque": 3, "wheel_torque": w, "joint_torque": n}
        sizes |= {"thruster": thrusters, "thrusts": 3 * thrusters}
        for name, size in sizes.items():
            signal = getattr(self, name)
            if signal is not None and signal.size != size:
                raise ExperimentError(
                    f"Input '{name}' has {signal.size} components, the spacecraft has {size}.",
                    advice="Check the description's wheels and arms against the experiment.",
                )
        motion = self.joint_motion
        if motion is not None:
            for part in (motion.position, motion.velocity, motion.acceleration):
                if part.size != n:
                    raise ExperimentError(f"`joint_motion` prescribes {part.size} joints of {n}.")
        contradictions = (
            (self.joint_torque is not None and (motion is not None or self.lock_joints), "driven by torque"),
            (motion is not None and self.lock_joints, "moved along `joint_motion`"),
        )
        for contradicted, what in contradictions:
            if contradicted:
                raise ExperimentError(
                    f"Joints cannot be {what} and held or prescribed at the same time.",
                    advice="Leave one out.",
                )
        if self.wheel_torque is not None and self.lock_wheels:
            raise ExperimentError(
                "Wheels cannot be driven by torque and locked at the same time.", advice="Leave one out."
            )
        if not model.free and (
            self.hold_attitude or any(s is not None for s in (self.force, self.torque, self.thruster))
        ):
            raise ExperimentError(
                "A welded base takes no force or torque and holds its attitude by itself.",
                advice="Leave out `force`, `torque`, `hold_attitude`.",
            )

    def driven(self, model: SpacecraftModel) -> Inputs:
        """Return what the plant gets when this is commanded: after every effect's `drive`."""
        driven = self
        if self.thruster is not None and self.thrusts is None:
            driven = replace(self, thruster=None, thrusts=self.thruster.mapped(_full_thrusts(model)))
        for effect in model.description.effect:
            driven = effect.drive(driven, model)
        return driven

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which an input jumps [s]."""
        signals = [self.force, self.torque, self.thruster, self.thrusts, self.wheel_torque, self.joint_torque]
        motion = self.joint_motion
        if motion is not None:
            signals += [motion.position, motion.velocity, motion.acceleration]
        return tuple(sorted({b for s in signals if s is not None for b in s.breakpoints}))

    def applied(self, model: SpacecraftModel) -> Signal:
        """Return the applied generalised force as one signal (nv,)."""
        nv = model.nv
        parts: list[Signal] = [Constant(np.zeros(nv))]
        force, torque = np.zeros((nv, 3)), np.zeros((nv, 3))
        if model.free:
            x, y, z = model.thrust_point
            force[0:3] = np.eye(3)
            force[3:6] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
            torque[3:6] = np.eye(3)
        maps = [(self.force, force), (self.torque, torque)]
        if self.thruster is not None or self.thrusts is not None:
            places = [np.asarray(t.position) for t in model.description.thruster]
            single = np.zeros((nv, 3 * len(places)))
            single[:6] = np.hstack([np.vstack([np.eye(3), pin.skew(p)]) for p in places])
            maps.append((self.thrusts, single))
            maps.append((self.thruster, single @ _full_thrusts(model)))
        for signal, group in ((self.wheel_torque, model.wheels), (self.joint_torque, model.arm_joints)):
            matrix = np.zeros((nv, len(group)))
            matrix[group.v, np.arange(len(group))] = 1.0
            maps.append((signal, matrix))
        parts += self.further
        parts += [signal.mapped(matrix) for signal, matrix in maps if signal is not None]
        return merge(parts)


def _full_thrusts(model: SpacecraftModel) -> np.ndarray:
    """Return the forces of single thrusters (3 k, k) at full thrust [N], body axes."""
    full = [np.asarray(t.full()) for t in model.description.thruster]
    out = np.zeros((3 * len(full), len(full)))
    for i, force in enumerate(full):
        out[3 * i : 3 * i + 3, i] = force
    return out


@dataclass(frozen=True)
class PrescribedMotion:
    """The degrees of freedom that follow a given motion: indices in v, and their motion over time."""

    index: np.ndarray
    free: np.ndarray
    joints: np.ndarray  # of `index`, those that are arm joints with motion, as positions in the arm group
    motion: JointMotion | None
    home: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, model: SpacecraftModel, inputs: Inputs) -> PrescribedMotion:
        """Return what the inputs prescribe; what is said of joints that follow another does not count."""
        index: list[int] = []
        if inputs.hold_attitude:
            index += [3, 4, 5]
        if inputs.lock_wheels:
            index += [int(i) for i in model.wheels.v]
        if inputs.lock_joints or inputs.joint_motion is not None:
            index += [int(i) for i in model.arm_joints.v]
        chosen = np.array(sorted(index), dtype=int)
        free = np.setdiff1d(np.arange(model.nv), chosen)
        motion = inputs.joint_motion
        if motion is not None and model.followers is not None:
            turn, shift = model.followers.among(model.arm_joints.joints)
            motion = JointMotion(
                merge([motion.position.mapped(turn), Constant(shift)]),
                motion.velocity.mapped(turn),
                motion.acceleration.mapped(turn),
            )
        return cls(chosen, free, model.arm_joints.v, motion, model.home)

    def __bool__(self) -> bool:
        return len(self.index) > 0

    def velocity(self, t: float, nv: int) -> np.ndarray:
        """Return prescribed rates in an (nv,) array, zero elsewhere."""
        v = np.zeros(nv)
        if self.motion is not None:
            v[self.joints] = self.motion.velocity(t)
        return v

    def acceleration(self, t: float, nv: int) -> np.ndarray:
        """Return prescribed accelerations in an (nv,) array, zero elsewhere."""
        a = np.zeros(nv)
        if self.motion is not None:
            a[self.joints] = self.motion.acceleration(t)
        return a
