"""A replay as one HTML file that needs nothing else: no network, no server, no Python."""

from __future__ import annotations

import base64
import html
import json
import logging
import os
from importlib import resources
from pathlib import Path
from string import Template

from smsid._files import atomic_write
from smsid.errors import require
from smsid.view.commands import Command, scene_commands
from smsid.view.replay import Replay
from smsid.view.scene import Scene

logger = logging.getLogger(__name__)


def export_html(view: Replay | Scene, path: str | os.PathLike[str], *, title: str | None = None) -> Path:
    """Write a replay, or a scene at rest, as one self-contained HTML file and return its path.

    The file holds meshcat's viewer, so it plays from a disk without network. ``view.html#t=12.5`` opens it
    paused at 12.5 s of the motion. The file appears whole or not at all.

    Raises:
        MissingDependencyError: meshcat is not installed.
        SmsidError: the folder does not exist.
    """
    viewer = _viewer()
    scene = view.scene if isinstance(view, Replay) else view
    commands = list(view.commands(play=False) if isinstance(view, Replay) else scene_commands(scene))
    start, speed, stop = 0.0, 1.0, 0.0
    if isinstance(view, Replay):
        start, stop, speed = float(view.motion.time[0]), float(view.motion.time[-1]), view.speed
    page = Template(resources.files("smsid.view").joinpath("player.html").read_text(encoding="utf-8"))
    name = title or scene.model.description.name
    facts = {"start": start, "stop": stop, "speed": speed, "notes": list(scene.notes), "title": name}
    text = page.substitute(
        title=html.escape(name),
        theme=scene.look.background,
        viewer=viewer,
        facts=_script_safe(json.dumps(facts)),
        commands=json.dumps([_packed(c) for c in commands]),
    )
    logger.info("%s: %.1f MB", path, len(text) / 1e6)
    return atomic_write(path, text)


def _viewer() -> str:
    """Return the JavaScript of meshcat's viewer, three.js included."""
    folder = Path(require("meshcat", "view").__file__).parent
    return (folder / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")


def _packed(command: Command) -> str:
    packed = require("umsgpack", "view").packb(command, force_float_precision="single")
    return base64.b64encode(packed).decode("ascii")


def _script_safe(text: str) -> str:
    """Keep a text from ending the script element it stands in."""
    return text.replace("<", "\\u003c")
