"""What ``smsid view`` does."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from smsid.description import load_description
from smsid.errors import SmsidError
from smsid.model.build import build_model
from smsid.recording import load_recording
from smsid.view.export import export_html
from smsid.view.live import LiveView, show
from smsid.view.look import Look
from smsid.view.replay import Layout, Replay, replay
from smsid.view.scene import Scene, build_scene
from smsid.view.server import LOOPBACK
from smsid.view.twin import simulated_twin
from smsid.view.video import export_video, is_film

PathLike = str | os.PathLike[str]


def view_main(
    description: PathLike,
    recordings: PathLike | Sequence[PathLike] | None,
    output: PathLike,
    *,
    simulated: bool = False,
    layout: Layout = "ghost",
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    title: str | None = None,
) -> tuple[Path, tuple[str, ...]]:
    """Write the 3-D view of a spacecraft at its home posture, or of motions recorded, as one HTML file.

    With an ``output`` called ``.mp4`` or ``.gif`` it is a film (extra ``video``, and a browser).
    Returns the file's path and the notes that stand in the view. Relative paths start at the working folder.
    The rest as `played`.

    Raises:
        MissingDependencyError: meshcat is not installed; for a film also imageio or a browser.
        SmsidError: a film of nothing that moves, or too long a one.
        DescriptionError: the description cannot be used.
        RecordingError: a recording cannot be read, or tells nothing of the motion or of what drove it.
        SimulationError: what it was driven by cannot be simulated.
    """
    view = played(
        description, recordings, simulated=simulated, layout=layout, look=look, fps=fps, speed=speed
    )
    if is_film(output):
        if not isinstance(view, Replay):
            raise SmsidError(
                "A film needs a recording.", advice="Give one, or write an .html of the craft at rest."
            )
        return export_video(view, output, fps=fps), view.notes
    return export_html(view, output, title=title), view.notes


def live_main(
    description: PathLike,
    recordings: PathLike | Sequence[PathLike] | None,
    *,
    simulated: bool = False,
    layout: Layout = "ghost",
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    host: str = LOOPBACK,
) -> LiveView:
    """Show the same in a live meshcat view instead, and return it; its ``url`` is for a browser.

    ``host``: address to listen on; by default of this machine alone.

    Raises as `view_main`.
    """
    view = played(
        description, recordings, simulated=simulated, layout=layout, look=look, fps=fps, speed=speed
    )
    return show(view, host=host) if isinstance(view, Replay) else LiveView(view, host=host)


def played(
    description: PathLike,
    recordings: PathLike | Sequence[PathLike] | None,
    *,
    simulated: bool = False,
    layout: Layout = "ghost",
    look: Look | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
) -> Replay | Scene:
    """Return the replay of recordings, or the scene at rest where there is none.

    Args:
        description: the spacecraft's TOML, or a bare URDF.
        recordings: the first is drawn as it is, the others with it, by ``layout``.
        simulated: also what the description makes of the first recording's commands.
        layout: ``ghost`` lays the others over the first, ``beside`` puts them next to it.
        look: factors and colours.
        fps: frames per second on screen [Hz].
        speed: seconds of the motion per second on screen.

    Raises as `view_main`.
    """
    model = build_model(load_description(description), visuals=True)
    paths = [recordings] if isinstance(recordings, str | os.PathLike) else list(recordings or ())
    if not paths:
        return build_scene(model, look=look)
    loaded = [load_recording(path) for path in paths]
    names = _names(paths)
    beside: list = list(zip(names[1:], loaded[1:], strict=True))
    if simulated:
        beside.append(("simulated", simulated_twin(model, loaded[0])))
    label = f"measured: {names[0]}" if simulated else names[0]
    return replay(
        model, loaded[0], beside=beside, label=label, layout=layout, look=look, fps=fps, speed=speed
    )


def _names(paths: Sequence[PathLike]) -> list[str]:
    """Return short names of files: their stems, or their paths where stems coincide."""
    stems = [Path(p).stem for p in paths]
    return stems if len(set(stems)) == len(stems) else [str(p) for p in paths]
