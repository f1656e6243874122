"""Servo joints identified from commanded and measured positions: no torque is measured.

With e the position error, a servo's equation is ``e = (links + rotor + friction) / stiffness``: linear, with
the noise of an encoder on its left. Known links give the scale; the errors of each joint are a torque signal
of unknown gain.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm._servo_equations import (
    COMMAND,
    is_known,
    moves_throughout,
    servo_equations,
    with_position_errors,
    with_sharp_friction,
    within_limits,
)
from smsid.arm._servo_values import physical_values, torque_limits
from smsid.arm._smooth_motion import smooth_motion
from smsid.arm.comparison import JudgedArm, TorqueComparison
from smsid.arm.identify import (
    motion_notes,
    padded_covariance,
    recorded_motion,
    rigid_arm,
    with_values_in_bounds,
)
from smsid.arm.joint_torques import JointTorques, block_length, block_means, joint_torques
from smsid.arm.regression import solve_joints
from smsid.description import Description
from smsid.effects import Servo
from smsid.effects.friction import depends_on_load
from smsid.effects.gear import servos_of
from smsid.errors import DescriptionError
from smsid.identify.estimate import Estimate
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

ROUNDS = 8
"""Rounds of leaving out what is beyond the limit of a torque."""


COARSER = 4
"""Blocks of torques in one of position errors: an encoder sees the jumps of friction too smooth."""


FIRST = 1.5
"""Medians of a position error up to which the first fit goes."""


@short_repr
@dataclass(frozen=True)
class ServoIdentification(JudgedArm):
    """Identified servo joints.

    ``description`` has the identified values; ``own`` what was fitted, position errors times the stiffness;
    ``x`` the solution of `servo_equations`, by blocks of ``length`` samples; ``stiffness`` (joints,)
    [N m/rad | N/m].
    """

    estimate: Estimate
    description: Description
    model: SpacecraftModel
    own: TorqueComparison
    x: np.ndarray
    stiffness: np.ndarray
    length: int
    step: float

    def compare(self, recording: Recording | None = None) -> TorqueComparison:
        """Return the torques that position errors stand for, and those that the motion needs.

        Of the recording identified from, or of another. Blocks in which a joint is at rest or at the limit of
        its torque say nothing of it: both are zero there.

        Raises:
            RecordingError: as `identify_servos`.
        """
        if recording is None:
            return self.own
        motion = smooth_motion(self.model, with_position_errors(self.model, recording))
        length = max(1, round(self.length * self.step / motion.step))
        torques = joint_torques(self.model, motion, length)
        whole = servo_equations(self.model, motion, torques, _servos(self.model))
        left = whole.torque - whole.rows @ self.x
        moves = moves_throughout(motion, torques)
        return _compare_torques(
            torques, left, moves & within_limits(whole.torque, left, moves), self.stiffness
        )


def _compare_torques(
    torques: JointTorques, left: np.ndarray, used: np.ndarray, stiffness: np.ndarray
) -> TorqueComparison:
    error = torques.torque * used
    return TorqueComparison(torques.time, stiffness * error, stiffness * (error - left * used))


def is_of_servos(recordings: Sequence[Recording]) -> bool:
    """Return whether recordings hold commanded and measured joint positions, and no joint torques."""
    names = {n for r in recordings for n in r.channels}
    measured = [
        n for n in names if n.endswith(".joint_position") and not n.startswith(("command.", "truth."))
    ]
    others = (".joint_torque", ".wheel_torque", ".attitude", ".thruster")
    return COMMAND in names and bool(measured) and not any(n.endswith(others) for n in names)


def identify_servos(
    description: Description,
    recording: Recording | Sequence[Recording],
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> ServoIdentification:
    """Identify gains, friction and rotors of servo joints from commands and encoders.

    The described links are taken as known: they give the scale, unless a servo's stiffness is `known`. The
    damping of a controller that damps the rate, and back-EMF, are part of ``viscous``, less what is known.

    Args:
        description: a welded arm with an effect `Servo` on every joint, and the friction, rotors and offsets
            to identify.
        recording: ``command.joint_position`` and measured joint positions; a command is held until the next.
        cutoff: up to where position errors are compared [Hz]; by default a quarter of what
            the motion is followed to.
        hold: joints that did not move and were not measured, with their positions [rad | m].

    Raises:
        DescriptionError: a joint without servo, or effects that several joints share.
        RecordingError: no command, or as `smooth_motion`.
        NotIdentifiableError: nothing gives a joint's stiffness.
    """
    begin = time.perf_counter()
    model = rigid_arm(description, hold)
    servos = _servos(model)
    recordings, motion, doubts = recorded_motion(model, recording, with_position_errors)
    model = with_sharp_friction(model, motion)
    length = block_length(motion, cutoff) * (COARSER if cutoff is None else 1)
    torques = joint_torques(model, motion, length)
    whole = servo_equations(model, motion, torques, servos)
    moves = moves_throughout(motion, torques)
    size = np.abs(whole.torque)  # the first fit keeps away from limits
    inside = moves & (size <= FIRST * np.median(size, axis=0))
    for k in range(ROUNDS):
        fitted = whole.only(inside)
        solved = solve_joints(fitted.rows, fitted.torque)
        left = whole.torque - np.einsum("bjn,n->bj", whole.rows, solved.x)
        found = within_limits(whole.torque, left, inside) & moves & (inside | (k < 4))
        if np.array_equal(found, inside):
            break
        inside = found
    parameters, covariance = physical_values(model, whole, solved, servos, inside)
    used = inside.copy()
    inside |= ~moves  # from here on: not at a limit
    values = {p.name: p.value for p in parameters}
    rates = block_means(motion.v, whole.starts)
    limits = torque_limits(model, whole, rates, solved, servos, inside, values)
    parameters = (*parameters, *limits)
    values = {p.name: p.value for p in parameters if np.isfinite(p.value)}
    estimate = Estimate(
        description=description.name,
        method="servo least squares",
        parameters=parameters,
        recordings=tuple(r.name for r in recordings),
        timing={"total": time.perf_counter() - begin},
        notes=(
            *doubts,
            *motion_notes(model, motion, torques, solved),
            *_notes(servos, inside),
        ),
        conditions={"servo regressor": solved.condition},
        covariance=padded_covariance(covariance, len(parameters)),
    )
    stiffness = np.array(
        [values.get(f"{servos[k].name}.stiffness", servos[k].stiffness) for k in sorted(servos)]
    )
    own = _compare_torques(torques, left, used, stiffness)
    return ServoIdentification(
        estimate,
        _with_values(description, values),
        model,
        own,
        solved.x,
        stiffness,
        length,
        motion.step,
    )


def _servos(model: SpacecraftModel) -> dict[int, Servo]:
    """Return servos by degree of freedom; raises as `identify_servos`."""
    effects, by_joint = model.description.effect, servos_of(model.description.effect)
    own = {s.name for s in by_joint.values()}
    for e in effects:
        alone = len(e.joint_weights()) == 1 and e.strength  # a torque on one joint
        if e.name not in own and (not alone or depends_on_load([e])):
            raise DescriptionError(
                f"'{e.name}' ({e.kind}) has no place beside servos.",
                advice="Leave it out: friction (not by load), rotor and offset of one joint are identified.",
            )
    joints = dict(zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True))
    lacking = [j for j in joints if j not in by_joint]
    if lacking:
        raise DescriptionError(
            f"{', '.join(lacking)} has no servo.", advice="Add effects of the kind 'servo'."
        )
    return {k: by_joint[j] for j, k in joints.items()}


def _with_values(description: Description, values: Mapping[str, float]) -> Description:
    """Return the description with identified values, kept within their bounds; unstated limits as found."""
    limited = [
        s.model_copy(update={"limit": values[f"{s.name}.limit"]})
        for s in servos_of(description.effect).values()
        if s.limit is None and f"{s.name}.limit" in values
    ]
    return with_values_in_bounds(description.with_effects(*limited), values)[0]


def _notes(servos: Mapping[int, Servo], inside: np.ndarray) -> list[str]:
    notes = []
    lumped = [s.joint for s in servos.values() if s.damps == "rate" and not is_known(s, "damping")]
    if lumped:
        notes.append(f"viscous holds the controller's damping and back-EMF as well: {', '.join(lumped)}")
    notes += [
        f"{s.joint} was at its torque's limit for {100 * float(np.mean(~inside[:, k])):.2g} % of the time"
        for k, s in servos.items()
        if not inside[:, k].all()
    ]
    return notes
