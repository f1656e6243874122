"""A live viewer: meshcat's server and a browser that shows what is sent to it."""

from __future__ import annotations

import atexit
import contextlib
import io
import logging
from typing import Any

from smsid.errors import require
from smsid.view._commands import Command, scene_commands
from smsid.view._scene import Scene
from smsid.view._server import LOOPBACK, start_server
from smsid.view.replay import Replay

logger = logging.getLogger(__name__)


class _Message:
    """What meshcat's window takes: something that lowers to a command."""

    def __init__(self, command: Command) -> None:
        self.command = command

    def lower(self) -> Command:
        return self.command


class LiveView:
    """A replay, or a scene at rest, in a running meshcat server; open ``url`` in a browser.

    The server is started on ``host``, by default for this machine alone, and ends with this process or with
    `close`. Raises `MissingDependencyError` when meshcat is not installed.
    """

    def __init__(self, view: Replay | Scene, *, host: str = LOOPBACK) -> None:
        visualizer = require("meshcat", "view").Visualizer
        self._process, zmq_url, _ = start_server(host)
        atexit.register(self.close)
        with contextlib.redirect_stdout(io.StringIO()):
            shown: Any = visualizer(zmq_url=zmq_url)
        self.url: str = shown.url()
        shown.delete()
        for command in view.commands() if isinstance(view, Replay) else scene_commands(view):
            shown.window.send(_Message(command))
        for note in (view.scene if isinstance(view, Replay) else view).notes:
            logger.info("view: %s", note)

    def close(self) -> None:
        """End the server."""
        self._process.kill()
        self._process.wait()


def show(view: Replay | Scene, *, host: str = LOOPBACK) -> LiveView:
    """Show a replay, or a scene at rest, in a live meshcat view; open the ``url`` of what is returned.

    ``host`` as of `LiveView`.

    Raises `MissingDependencyError` when meshcat is not installed.
    """
    return LiveView(view, host=host)
