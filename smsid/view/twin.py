"""What a description says should have happened: a recording's commands, simulated from its first sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from smsid.errors import RecordingError
from smsid.estimation.input_hold import Hold, commanded
from smsid.inputs.inputs import JointMotion
from smsid.inputs.signals import Sampled
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate import Inputs, Trajectory, simulate
from smsid.view.motion import motion_of
from smsid.view.recorded import channel, measured_samples

WELL = 5  # degree of the spline through measured joint angles: their acceleration is continuous


def simulated_twin(
    model: SpacecraftModel, recording: Recording, *, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Return the motion that the model makes of a recording's commands, from its first state on.

    Between samples commands are as the recording's provenance says ("inputs": held or linear), else held.
    Joints without commanded torque follow their measured angles, wheels without are locked. The first state
    is the measured one; slosh and deflection, if not recorded, at rest.
    ``progress`` is called with the time after every step.

    Raises:
        RecordingError: nothing was commanded, or the recording tells nothing of the motion.
        SimulationError: the motion cannot be simulated.
    """
    recording = order_columns(recording, model)
    first = motion_of(model, recording, 0.05, 2)
    start, stop = float(first.time[0]), float(first.time[-1])
    inputs = _inputs(model, recording)
    assert first.v is not None
    return simulate(model, inputs, stop - start, q0=first.q[0], v0=first.v[0], start=start, progress=progress)


def _inputs(model: SpacecraftModel, recording: Recording) -> Inputs:
    names = [name for name in recording.channels if name.startswith("command.")]
    finite = recording.with_channels({name: channel(recording, name) for name in names})
    hold: Hold = "linear" if recording.provenance.get("inputs") == "linear" else "held"
    inputs = Inputs()
    if names:
        others = [name for name in recording.channels if name not in names]
        inputs = commanded(model, finite.without(*others), hold, required=False)
    angles = measured_samples(model, recording, "encoder", "joint_position")
    follow = None
    if inputs.joint_torque is None and angles is not None:
        follow = JointMotion.of(Sampled.from_samples(*angles[0], WELL))
    if inputs == Inputs() and follow is None:
        raise RecordingError(
            f"The recording '{recording.name}' says nothing of what drove the motion.",
            advice="Record command.force, command.torque, command.joint_torque or command.wheel_torque.",
            channels=recording.channels,
        )
    return replace(
        inputs,
        joint_motion=follow,
        lock_joints=inputs.joint_torque is None and follow is None and len(model.arm_joints) > 0,
        lock_wheels=inputs.wheel_torque is None and len(model.wheels) > 0,
    )
