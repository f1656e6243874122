"""What ``smsid view`` does."""

from __future__ import annotations

import os
from pathlib import Path

from smsid.description import load_description
from smsid.model.build import build_model
from smsid.recording import load_recording
from smsid.view.export import export_html
from smsid.view.live import LiveView, show
from smsid.view.look import Look
from smsid.view.replay import replay
from smsid.view.scene import build_scene


def view_main(
    description: str | os.PathLike[str],
    recording: str | os.PathLike[str] | None,
    output: str | os.PathLike[str],
    *,
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    title: str | None = None,
) -> tuple[Path, tuple[str, ...]]:
    """Write the 3-D view of a spacecraft at its home posture, or of a recording's motion, as one HTML file.

    Returns the file's path and the notes that stand in the view. Relative paths start at the working folder.

    Raises:
        MissingDependencyError: meshcat is not installed.
        DescriptionError: the description cannot be used.
        RecordingError: the recording cannot be read, or tells nothing of the motion.
    """
    model = build_model(load_description(description), visuals=True)
    if recording is None:
        scene = build_scene(model, look=look)
        return export_html(scene, output, title=title), scene.notes
    played = replay(model, load_recording(recording), look=look, fps=fps, speed=speed)
    return export_html(played, output, title=title), played.notes


def live_main(
    description: str | os.PathLike[str],
    recording: str | os.PathLike[str] | None,
    *,
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
) -> LiveView:
    """Show the same in a live meshcat view instead, and return it; its ``url`` is for a browser.

    Raises as `view_main`.
    """
    model = build_model(load_description(description), visuals=True)
    if recording is None:
        return LiveView(build_scene(model, look=look))
    return show(replay(model, load_recording(recording), look=look, fps=fps, speed=speed))
