"""What is shown of a spacecraft: at rest, or recordings replayed; and where it is written."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.description import Description
from smsid.errors import RecordingError, SmsidError
from smsid.estimation.input_hold import Hold, commanded_inputs
from smsid.inputs.inputs import JointMotion
from smsid.inputs.signals import Sampled
from smsid.model.build import build_model
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate import Inputs, Trajectory, simulate
from smsid.view._export import export_html
from smsid.view._look import Look
from smsid.view._motion import motion_of
from smsid.view._recorded import channel, measured_samples
from smsid.view._scene import Scene, build_scene
from smsid.view._tracked import tracked_states
from smsid.view._video import export_video, is_film
from smsid.view.replay import Layout, Replay, replay

if TYPE_CHECKING:
    from smsid.tracking.history import TrackHistory


def build_replay(
    description: Description,
    recordings: Sequence[Recording | TrackHistory] = (),
    names: Sequence[str] = (),
    *,
    simulated: bool = False,
    layout: Layout = "ghost",
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
) -> Replay | Scene:
    """Return the replay of recordings, or the scene at rest where there is none.

    Args:
        description: of the spacecraft.
        recordings: the first is drawn as it is, the others with it, by ``layout``; of a track the motion that
            was believed, with slosh and bending.
        names: of the recordings; their own if left out.
        simulated: also what the description makes of the first recording's commands.
        layout: ``ghost`` lays the others over the first, ``beside`` puts them next to it.
        look: factors and colours.
        fps: frames per second on screen [Hz].
        speed: seconds of the motion per second on screen.

    Raises:
        DescriptionError: the description cannot be used.
        RecordingError: a recording tells nothing of the motion or of what drove it; a track is of another
            spacecraft.
        SimulationError: what it was driven by cannot be simulated.
        SmsidError: ``simulated`` without a recording.
    """
    model = build_model(description, visuals=True)
    if not recordings:
        if simulated:
            raise SmsidError("There is no recording whose commands to fly.", advice="Give one.")
        return build_scene(model, look=look)
    first = recordings[0]
    named = [(r.name if isinstance(r, Recording) else "tracked") for r in recordings]
    names = names or [n or f"recording {k}" for k, n in enumerate(named, start=1)]
    motions = [r if isinstance(r, Recording) else tracked_states(model, r) for r in recordings]
    beside: list = list(zip(names[1:], motions[1:], strict=True))
    if simulated:
        if not isinstance(first, Recording):
            raise SmsidError("A track has no commands to fly.", advice="Give a recording first.")
        beside.append(("simulated", simulated_twin(model, first)))
    label = f"measured: {names[0]}" if simulated else names[0]
    return replay(
        model, motions[0], beside=beside, label=label, layout=layout, look=look, fps=fps, speed=speed
    )


def write_view(view: Replay | Scene, path: str | os.PathLike[str], *, fps: float = 20.0) -> Path:
    """Write a view as one HTML file, or as a film if the path ends in ``.mp4`` or ``.gif``; return it.

    Raises:
        MissingDependencyError: meshcat is not installed; for a film also imageio or a browser.
        SmsidError: a film of nothing that moves, or too long a one.
    """
    if not is_film(path):
        return export_html(view, path)
    if not isinstance(view, Replay):
        raise SmsidError(
            "A film needs a recording.", advice="Give one, or write an .html of the craft at rest."
        )
    return export_video(view, path, fps=fps)


WELL = 5  # degree of the spline through measured joint angles: their acceleration is continuous


def simulated_twin(model: SpacecraftModel, recording: Recording) -> Trajectory:
    """Return the motion that the model makes of a recording's commands, from its first state on.

    Between samples commands are as the recording's provenance says ("inputs": held or linear), else held.
    Joints without commanded torque follow their measured angles, wheels without are locked. The first state
    is the measured one; slosh and deflection, if not recorded, at rest.

    Raises:
        RecordingError: nothing was commanded, or the recording tells nothing of the motion.
        SimulationError: the motion cannot be simulated.
    """
    recording = order_columns(recording, model)
    first = motion_of(model, recording, 0.05, 2)
    start, stop = float(first.time[0]), float(first.time[-1])
    inputs = _inputs(model, recording)
    assert first.v is not None
    return simulate(model, inputs, stop - start, q0=first.q[0], v0=first.v[0], start=start)


def _inputs(model: SpacecraftModel, recording: Recording) -> Inputs:
    names = [name for name in recording.channels if name.startswith("command.")]
    finite = recording.with_channels({name: channel(recording, name) for name in names})
    hold: Hold = "linear" if recording.provenance.get("inputs") == "linear" else "held"
    inputs = Inputs()
    if names:
        others = [name for name in recording.channels if name not in names]
        inputs = commanded_inputs(model, finite.without(*others), hold, required=False)
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
