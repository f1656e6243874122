"""A replay: a scene, the motion it plays, and the poses of every part at every frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from smsid.model.spacecraft import SpacecraftModel
from smsid.view.camera import fitted_camera
from smsid.view.commands import PREFIX, Command, animation_command, scene_commands
from smsid.view.drivers import Frames
from smsid.view.look import Look
from smsid.view.motion import Motion, Source, motion_of
from smsid.view.scene import Scene, build_scene

MAX_FRAMES = 4000


@dataclass(frozen=True)
class Replay:
    """What is played: scene, motion, frames as drawn, frame rate [Hz] and speed (1 is real time).

    ``frame_rate`` is that of the keys; the browser interpolates between them.
    """

    scene: Scene
    motion: Motion
    frames: Frames
    frame_rate: float
    speed: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What is exaggerated, slowed down, or missing and therefore at rest."""
        return self.scene.notes

    @cached_property
    def tracks(self) -> dict[str, np.ndarray]:
        """Poses (N, 4, 4) in the parent node of every moving part, by path, and of the world if followed."""
        poses = self.scene.poses(self.frames)
        if self.scene.look.follow and self.scene.model.free:
            # the world moves past the camera, which cannot leave its place
            world = np.tile(np.eye(4), (len(self.motion.time), 1, 1))
            travel = self.motion.q[:, :3] - self.scene.model.home[:3]
            world[:, :3, 3] = -(fitted_camera(self.scene.corners).target + travel)
            poses[PREFIX] = world
        return poses

    def commands(self, *, play: bool = True, loop: bool = True) -> Iterator[Command]:
        """Yield the meshcat commands that draw the first frame and play the rest."""
        first = {path: poses[0] for path, poses in self.tracks.items()}
        yield from scene_commands(self.scene, first)
        if len(self.motion.time) > 1:
            yield animation_command(self.tracks, self.frame_rate, play=play, loop=loop)


def replay(
    model: SpacecraftModel,
    source: Source,
    *,
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    max_frames: int = MAX_FRAMES,
) -> Replay:
    """Return the replay of a simulation (`Trajectory`, `States`) or of a `Recording`.

    A recording gives pose (of the point P where the sensor sits), joint angles, wheel rates (integrated),
    thrust, and slosh and modal coordinates if it holds them; what it lacks stays at rest and is named in
    ``notes``.
    Needs no meshcat; give the result to `export_html` or `show`.

    Args:
        model: the spacecraft, with or without visuals.
        source: what is played.
        look: factors and colours.
        fps: frames per second on screen [Hz].
        speed: seconds of the motion per second on screen.
        max_frames: with more, frames are spaced wider and the browser interpolates.

    Raises:
        RecordingError: the recording tells nothing of the motion, or its clocks do not overlap.
        SmsidError: states of another spacecraft, or a rate or speed that is not positive.
        DescriptionError: a mesh of the URDFs is missing.
    """
    motion = motion_of(model, source, speed / fps if fps > 0.0 else 0.0, max_frames)
    scene = build_scene(model, motion, look)
    frames = Frames.of(model, motion, scene.scale)
    step = float(motion.time[1] - motion.time[0]) if len(motion.time) > 1 else 1.0
    return Replay(scene, motion, frames, speed / step, speed)
