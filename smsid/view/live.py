"""A live viewer: meshcat's server and a browser that shows what is sent to it."""

from __future__ import annotations

import atexit
import contextlib
import io
import logging
import subprocess
from collections.abc import Iterable
from typing import Any

import numpy as np

from smsid.errors import require
from smsid.view.commands import PREFIX, Command, scene_commands, transform
from smsid.view.drivers import Frames
from smsid.view.motion import Motion
from smsid.view.replay import Replay
from smsid.view.scene import Scene
from smsid.view.server import LOOPBACK, start_server

logger = logging.getLogger(__name__)


class _Message:
    """What meshcat's window takes: something that lowers to a command."""

    def __init__(self, command: Command) -> None:
        self.command = command

    def lower(self) -> Command:
        return self.command


class LiveView:
    """A scene in a running meshcat server; open ``url`` in a browser.

    Raises `MissingDependencyError` when meshcat is not installed. ``zmq_url`` connects to a server that runs
    already; without it one is started on ``host``, by default for this machine alone, and ends with this
    process or with `close`.
    """

    def __init__(self, scene: Scene, *, zmq_url: str | None = None, host: str = LOOPBACK) -> None:
        visualizer = require("meshcat", "view").Visualizer
        self._process: subprocess.Popen[str] | None = None
        if zmq_url is None:
            self._process, zmq_url, _ = start_server(host)
            atexit.register(self.close)
        with contextlib.redirect_stdout(io.StringIO()):
            self._visualizer: Any = visualizer(zmq_url=zmq_url)
        self.scene = scene
        self._visualizer.delete()
        self._send(scene_commands(scene))
        for note in scene.notes:
            logger.info("view: %s", note)

    @property
    def url(self) -> str:
        """Where a browser finds the view."""
        return self._visualizer.url()

    def display(self, q: np.ndarray, force: np.ndarray | None = None) -> None:
        """Show one configuration q (nq,), with a thrust ``force`` (3,) in body axes [N]."""
        acting = np.zeros((1, 3)) if force is None else np.asarray(force, dtype=float)[None]
        motion = Motion(np.zeros(1), np.asarray(q, dtype=float)[None], acting)
        frames = Frames.of(self.scene.model, motion, self.scene.scale)
        self._send(transform(f"{PREFIX}/{path}", pose[0]) for path, pose in self.scene.poses(frames).items())

    def play(self, replay: Replay, *, loop: bool = True) -> None:
        """Draw a replay's scene instead and let the browser play it."""
        self.scene = replay.scene
        self._visualizer.delete()
        self._send(replay.commands(loop=loop))

    def close(self) -> None:
        """End the server if this view started it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _send(self, commands: Iterable[Command]) -> None:
        for command in commands:
            self._visualizer.window.send(_Message(command))


def show(
    view: Replay | Scene, *, zmq_url: str | None = None, loop: bool = True, host: str = LOOPBACK
) -> LiveView:
    """Show a replay, or a scene at rest, in a live meshcat view; open the ``url`` of what is returned.

    ``host`` as of `LiveView`.

    Raises `MissingDependencyError` when meshcat is not installed.
    """
    if not isinstance(view, Replay):
        return LiveView(view, zmq_url=zmq_url, host=host)
    live = LiveView(view.scene, zmq_url=zmq_url, host=host)
    live.play(view, loop=loop)
    return live
