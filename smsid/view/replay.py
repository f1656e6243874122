"""A replay: a scene, the motion it plays, and the poses of every part at every frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import SmsidError
from smsid.model.spacecraft import SpacecraftModel
from smsid.view._commands import PREFIX, Command, animation_command, part_commands, scene_commands
from smsid.view._drivers import DrawnFrames
from smsid.view._look import Look, across, fitted_camera
from smsid.view._motion import DrawnMotion, Source, motion_of
from smsid.view._scene import ROOT, Scene, build_scene, fitting_scale

MAX_FRAMES = 4000
APART = 1.12  # distance of spacecraft side by side, in their extents

Layout = Literal["ghost", "beside"]


@short_repr
@dataclass(frozen=True)
class Companion:
    """Another motion of the same spacecraft, played with the first: over it as a ghost, or beside it."""

    scene: Scene
    motion: DrawnMotion
    frames: DrawnFrames
    label: str


@short_repr
@dataclass(frozen=True)
class Replay:
    """What is played: scene, motion, frames as drawn, frame rate [Hz] and speed (1 is real time).

    ``frame_rate`` is that of the keys; the browser interpolates between them. ``companions`` are other
    motions that are played with it, ``label`` names the first one where there are any.
    """

    scene: Scene
    motion: DrawnMotion
    frames: DrawnFrames
    frame_rate: float
    speed: float
    companions: tuple[Companion, ...] = ()
    label: str = ""
    layout: Layout = "ghost"

    @property
    def notes(self) -> tuple[str, ...]:
        """What is exaggerated, slowed down, or missing and therefore at rest."""
        return self.scene.notes

    @cached_property
    def tracks(self) -> dict[str, np.ndarray]:
        """Poses (N, 4, 4) in the parent node of every moving part, by path, and of the world if followed."""
        poses = self.scene.poses(self.frames)
        for other in self.companions:
            poses |= other.scene.poses(other.frames)
        if self.scene.model.free:
            # the world moves past the camera, which cannot leave its place
            world = np.tile(np.eye(4), (len(self.motion.time), 1, 1))
            travel = self.motion.q[:, :3] - self.scene.model.home[:3]
            world[:, :3, 3] = -(fitted_camera(self.scene.corners)[0] + travel)
            poses[PREFIX] = world
        return poses

    def commands(self, *, play: bool = True, leave: Sequence[str] = ()) -> Iterator[Command]:
        """Yield the meshcat commands that draw the first frame and play the rest, again and again.

        The parts whose paths are in ``leave`` are drawn and not played.
        """
        first = {path: poses[0] for path, poses in self.tracks.items()}
        yield from scene_commands(self.scene, first)
        for other in self.companions:
            yield from part_commands(other.scene, first)
        if len(self.motion.time) > 1:
            left = set(leave)
            played = {path: poses for path, poses in self.tracks.items() if path not in left}
            # a node that always moves, so that time goes on in the browser
            played["clock"] = np.tile(np.eye(4), (len(self.motion.time), 1, 1))
            played["clock"][:, 0, 3] = np.linspace(0.0, 1.0, len(self.motion.time))
            yield animation_command(played, self.frame_rate, play=play)


def replay(
    model: SpacecraftModel,
    source: Source,
    *,
    beside: Sequence[tuple[str, Source]] = (),
    label: str = "",
    layout: Layout = "ghost",
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    max_frames: int = MAX_FRAMES,
) -> Replay:
    """Return the replay of a simulation (`Trajectory`, `States`) or of a `Recording`.

    A recording gives pose (of the point P where the sensor sits), joint angles, wheel rates (integrated),
    thrust and torques, and slosh and modal coordinates if it holds them; what it lacks stays at rest and is
    named in ``notes``. Needs no meshcat; give the result to `export_html` or `show`.

    Args:
        model: the spacecraft, with or without visuals.
        source: what is played.
        beside: other motions of the same spacecraft, with their names, played at the same times.
        label: name of the first where there are others.
        layout: ``ghost`` lays the others over the first, ``beside`` puts them next to it.
        look: factors and colours.
        fps: frames per second on screen [Hz].
        speed: seconds of the motion per second on screen.
        max_frames: with more, frames are spaced wider and the browser interpolates.

    Raises:
        RecordingError: the recording tells nothing of the motion, or its clocks do not overlap.
        SmsidError: states of another spacecraft, a layout that does not exist, or a rate or speed that is not
            positive.
        DescriptionError: a mesh of the URDFs is missing.
    """
    if layout not in ("ghost", "beside"):
        raise SmsidError(f"There is no layout '{layout}'.", advice="Choose ghost or beside.")
    look = look or Look()
    step = speed / fps if fps > 0.0 else 0.0
    motion = motion_of(model, source, step, max_frames)
    others = [motion_of(model, other, step, max_frames, times=motion.time) for _, other in beside]
    scale = fitting_scale(model, (motion, *others), look)
    scene = build_scene(model, motion, look, scale=scale)
    companions, corners, notes = [], [scene.corners], list(scene.notes)
    aside = APART * across(scene.corners)
    for k, ((name, _), other) in enumerate(zip(beside, others, strict=True), start=1):
        drawn = build_scene(model, other, look, scale=scale, root=f"{ROOT}_{k}", ghost=layout == "ghost")
        shift = k * aside if layout == "beside" else np.zeros(3)
        drawn = _move_root(drawn, shift)
        companions.append(Companion(drawn, other, DrawnFrames.of(model, other, scale), name))
        corners.append(drawn.corners)
        notes += [f"{name}: {note}" for note in other.notes]
    scene = replace(scene, corners=np.concatenate(corners), notes=tuple(notes))
    frames = DrawnFrames.of(model, motion, scale)
    rate = speed / float(motion.time[1] - motion.time[0]) if len(motion.time) > 1 else speed
    return Replay(scene, motion, frames, rate, speed, tuple(companions), label, layout)


def _move_root(scene: Scene, shift: np.ndarray) -> Scene:
    """Return a scene whose root stands elsewhere (3,) [m]."""
    pose = scene.parts[0].pose.copy()
    pose[:3, 3] += shift
    parts = (replace(scene.parts[0], pose=pose), *scene.parts[1:])
    return replace(scene, parts=parts, corners=scene.corners + shift)
