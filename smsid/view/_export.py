"""A replay as one HTML file that needs no network, server or Python, with numbers beside the picture."""

from __future__ import annotations

import base64
import html
import json
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from smsid._files import atomic_write
from smsid.errors import require
from smsid.view import _arrows as arrows
from smsid.view._arrows import tool_positions
from smsid.view._commands import Command, scene_commands, sky_commands
from smsid.view._drivers import DEFLECTION, DrawnFrames, StripDriver
from smsid.view._look import ASPECT
from smsid.view._parts import GHOST, node_name
from smsid.view._scene import Scene
from smsid.view._shapes import Color
from smsid.view.replay import Companion, Replay

logger = logging.getLogger(__name__)

PLAIN: Color = (0.62, 0.64, 0.68)
COLORS: dict[str, Color] = {
    "thrust": arrows.THRUST,
    "torques": arrows.TORQUE,
    "momentum": arrows.LINEAR,
    "angular momentum": arrows.ANGULAR,
    "centre of mass": (0.95, 0.78, 0.10),
    "tool trail": arrows.TRAIL_COLOR,
    "sensors": (0.90, 0.22, 0.16),
}


def export_html(view: Replay | Scene, path: str | os.PathLike[str], *, title: str | None = None) -> Path:
    """Write a replay, or a scene at rest, as one self-contained HTML file and return its path.

    The file holds meshcat's viewer, so it plays from a disk without network. ``view.html#t=12.5`` opens it
    paused at 12.5 s of the motion. The page bends appendages itself, so that their scale can be changed while
    it plays. The file appears whole or not at all.

    Raises:
        MissingDependencyError: meshcat is not installed.
        SmsidError: the folder does not exist.
    """
    meshcat = Path(require("meshcat", "view").__file__).parent
    viewer = (meshcat / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")  # three.js included
    scene = view.scene if isinstance(view, Replay) else view
    name = title or scene.model.description.name
    facts: dict[str, Any] = {"title": name, "start": 0.0, "stop": 0.0, "speed": 1.0, "rate": 1.0}
    facts |= {"notes": list(scene.notes), "aspect": ASPECT, "motions": [], "layers": [], "readouts": []}
    facts |= {"bends": [], "trails": [], "factor": scene.look.panel_factor}
    if isinstance(view, Replay):
        found = [(view.scene, view.frames), *((c.scene, c.frames) for c in view.companions)]
        bent = [b for s, f in found for b in bending_parts(s, f)]
        commands = list(view.commands(play=False, leave=[p for b in bent for p in b.paths]))
        facts |= _playback_document(view, bent)
    else:
        commands = list(scene_commands(scene))
    if scene.look.background == "auto":
        facts["skies"] = {
            name: [_pack_command(c) for c in sky_commands(scene, name)] for name in ("light", "space")
        }
    folder = resources.files("smsid.view")
    page = Template(folder.joinpath("player.html").read_text(encoding="utf-8"))
    text = page.substitute(
        title=html.escape(name),
        theme="space" if scene.look.background == "space" else "light",
        style=folder.joinpath("player.css").read_text(encoding="utf-8"),
        viewer=viewer,
        player=folder.joinpath("player.js").read_text(encoding="utf-8"),
        facts=json.dumps(facts).replace("<", "\\u003c"),  # no text ends the script it stands in
        commands=json.dumps([_pack_command(c) for c in commands]),
    )
    logger.info("%s: %.1f MB", path, len(text) / 1e6)
    return atomic_write(path, text)


def _playback_document(view: Replay, bent: list[SurfaceMotion]) -> dict[str, Any]:
    """Return what the page needs to know beyond the drawing, to play it."""
    time, motions = view.motion.time, []
    if view.companions:
        ghost = view.layout == "ghost"
        color, place = _css(GHOST if ghost else PLAIN), "" if ghost else ", left"
        label = f"{view.label or 'first'}{place}"
        motions.append({"label": label, "path": view.scene.root, "color": _css(PLAIN)})
        motions += [
            {"label": c.label if ghost else f"{c.label}, right", "path": c.scene.root, "color": color}
            for c in view.companions
        ]
    trails: list[dict[str, Any]] = []
    layers: dict[str, list[str]] = {name: [] for name in COLORS}
    for scene in (view.scene, *(c.scene for c in view.companions)):
        trails += [{"path": t, "pieces": n, "indices": arrows.INDICES} for t, n in scene.trails.items()]
        for name, paths in scene.layers.items():
            layers.setdefault(name, []).extend(paths)
    notes = [n for n in view.notes if not (bent and n.startswith(DEFLECTION))]  # the page has a slider for it
    return {
        "start": float(time[0]),
        "stop": float(time[-1]),
        "speed": view.speed,
        "rate": view.frame_rate,
        "motions": motions,
        "beside": bool(view.companions) and view.layout == "beside",
        "notes": notes,
        "layers": [
            {"name": name, "color": _css(COLORS.get(name, PLAIN)), "paths": paths}
            for name, paths in layers.items()
            if paths
        ],
        "trails": trails,
        "readouts": [
            {"label": r.label, "unit": r.unit, "layer": r.layer, "values": _floats(r.values)}
            for r in readouts(view)
        ],
        "bends": [
            {
                "paths": b.paths,
                "step": b.step,
                "modes": b.delta.shape[1],
                "edges": _floats(b.edges),
                "twist": _floats(b.twist),
                "delta": _floats(b.delta),
            }
            for b in bent
        ],
    }


def _css(color: Color) -> str:
    return "#" + "".join(f"{round(255 * c):02x}" for c in color)


def _floats(values: np.ndarray) -> str:
    """Return an array as the page reads it: 32-bit floats in base 64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def _pack_command(command: Command) -> str:
    packed = require("umsgpack", "view").packb(command, force_float_precision="single")
    return base64.b64encode(packed).decode("ascii")


@dataclass(frozen=True)
class SurfaceMotion:
    """A surface of S strips with M modes over N frames, in surface axes.

    ``paths`` (S) of the strips' nodes; ``step`` [m] a strip's length; ``edges`` (S + 1, M, 3) [m] movement of
    the strips' edges per unit modal coordinate, ``twist`` (S, M) [rad] their rotation about x; ``delta``
    (N, M) modal coordinates true to scale. Twin in the page: `bendStrips` in player.js.
    """

    paths: tuple[str, ...]
    step: float
    edges: np.ndarray
    twist: np.ndarray
    delta: np.ndarray


def bending_parts(scene: Scene, frames: DrawnFrames) -> list[SurfaceMotion]:
    """Return what bends in a scene, over the frames; appendages without modes do not."""
    strips: dict[str, list[tuple[str, StripDriver]]] = {}
    for part in scene.parts:
        if isinstance(part.driver, StripDriver) and len(part.driver.q):
            strips.setdefault(part.path.rpartition("/")[0], []).append((part.path, part.driver))
    found = []
    for drawn in strips.values():
        driver = drawn[0][1]
        surface, count = driver.surface, driver.strips
        step = surface.length / count
        delta = frames.motion.q[:, driver.q] * driver.scale
        edges = surface.displacement(step * np.arange(count + 1))
        twist = surface.twist(step * (np.arange(count) + 0.5))
        found.append(SurfaceMotion(tuple(path for path, _ in drawn), step, edges, twist, delta))
    return found


@dataclass(frozen=True)
class Readout:
    """A number over the frames (N,), with its unit; ``layer`` is that of the sign that stands for it."""

    label: str
    unit: str
    values: np.ndarray
    layer: str = ""


def readouts(played: Replay) -> list[Readout]:
    """Return the numbers of a replay: forces, momentum, slosh, deflection, and how far companions are off."""
    found = [*_signs(played), *_hidden_readouts(played)]
    for other in played.companions:
        found += _differences(played, other)
    return found


def _signs(played: Replay) -> Iterator[Readout]:
    motion, layers = played.motion, played.scene.layers
    if "thrust" in layers:
        yield Readout("thrust", "N", _norm(motion.force), "thrust")
    if "torques" in layers:
        torques = [t for t in (motion.torque, motion.joint_torque, motion.wheel_torque) if t is not None]
        largest = np.max([np.abs(t).max(axis=1) for t in torques if t.shape[1]], axis=0)
        yield Readout("largest torque", "N m", largest, "torques")
    if "momentum" in layers:
        yield Readout("momentum", "N s", _norm(played.frames.momenta.linear), "momentum")
    if "angular momentum" in layers:
        yield Readout("angular momentum", "N m s", _norm(played.frames.momenta.angular), "angular momentum")


def _hidden_readouts(played: Replay) -> Iterator[Readout]:
    model, q = played.scene.model, played.motion.q
    for slosh in model.slosh:
        if np.any(q[:, slosh.q]):
            yield Readout(f"slosh of {slosh.name}", "mm", 1e3 * _norm(q[:, slosh.q]))
    for appendage in model.appendages:
        tip = _tip(played, appendage.appendage.name)
        if tip is not None and np.any(tip):
            yield Readout(f"tip of {appendage.appendage.name}", "mm", tip)


def _tip(played: Replay, name: str) -> np.ndarray | None:
    """Return how far the far edge of an appendage is from rest (N,) [mm], true to scale."""
    for part in reversed(played.scene.parts):
        driver = part.driver
        if isinstance(driver, StripDriver) and part.path.split("/")[-2] == node_name(name):
            delta = played.motion.q[:, driver.q] * driver.scale
            end = driver.surface.displacement(np.array([driver.surface.length]))[0]
            return 1e3 * _norm(delta @ end)
    return None


def _differences(played: Replay, other: Companion) -> Iterator[Readout]:
    model, a, b = played.scene.model, played.motion.q, other.motion.q
    ours, theirs = tool_positions(model, a), tool_positions(model, b)
    for name in ours:
        yield Readout(f"{other.label}: {name} tool off", "mm", 1e3 * _norm(ours[name] - theirs[name]))
    if model.free:
        turn = Rotation.from_quat(a[:, 3:7]).inv() * Rotation.from_quat(b[:, 3:7])
        yield Readout(f"{other.label}: attitude off", "deg", np.rad2deg(turn.magnitude()))
    for slosh in model.slosh:
        off = _norm(a[:, slosh.q] - b[:, slosh.q])
        if np.any(a[:, slosh.q]) and np.any(off):
            yield Readout(f"{other.label}: slosh of {slosh.name} off", "mm", 1e3 * off)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)
