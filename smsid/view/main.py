"""What is shown of a spacecraft: at rest, or recordings replayed; and where it is written."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from smsid.description import Description
from smsid.errors import SmsidError
from smsid.model.build import build_model
from smsid.recording import Recording
from smsid.view.export import export_html
from smsid.view.look import Look
from smsid.view.replay import Layout, Replay, replay
from smsid.view.scene import Scene, build_scene
from smsid.view.twin import simulated_twin
from smsid.view.video import export_video, is_film


def played(
    description: Description,
    recordings: Sequence[Recording] = (),
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
        recordings: the first is drawn as it is, the others with it, by ``layout``.
        names: of the recordings; their own if left out.
        simulated: also what the description makes of the first recording's commands.
        layout: ``ghost`` lays the others over the first, ``beside`` puts them next to it.
        look: factors and colours.
        fps: frames per second on screen [Hz].
        speed: seconds of the motion per second on screen.

    Raises:
        DescriptionError: the description cannot be used.
        RecordingError: a recording tells nothing of the motion or of what drove it.
        SimulationError: what it was driven by cannot be simulated.
        SmsidError: ``simulated`` without a recording.
    """
    model = build_model(description, visuals=True)
    if not recordings:
        if simulated:
            raise SmsidError("There is no recording whose commands to fly.", advice="Give one.")
        return build_scene(model, look=look)
    names = names or [r.name or f"recording {k}" for k, r in enumerate(recordings, start=1)]
    beside: list = list(zip(names[1:], recordings[1:], strict=True))
    if simulated:
        beside.append(("simulated", simulated_twin(model, recordings[0])))
    label = f"measured: {names[0]}" if simulated else names[0]
    return replay(
        model, recordings[0], beside=beside, label=label, layout=layout, look=look, fps=fps, speed=speed
    )


def write_view(
    view: Replay | Scene, path: str | os.PathLike[str], *, fps: float = 20.0, title: str | None = None
) -> Path:
    """Write a view as one HTML file, or as a film if the path ends in ``.mp4`` or ``.gif``; return it.

    Raises:
        MissingDependencyError: meshcat is not installed; for a film also imageio or a browser.
        SmsidError: a film of nothing that moves, or too long a one.
    """
    if not is_film(path):
        return export_html(view, path, title=title)
    if not isinstance(view, Replay):
        raise SmsidError(
            "A film needs a recording.", advice="Give one, or write an .html of the craft at rest."
        )
    return export_video(view, path, fps=fps)
