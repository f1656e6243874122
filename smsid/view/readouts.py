"""Numbers that a page shows beside the picture as it plays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.view.arrows import tool_positions
from smsid.view.drivers import StripDriver
from smsid.view.replay import Companion, Replay


@dataclass(frozen=True)
class Readout:
    """A number over the frames (N,), with its unit; ``layer`` is that of the sign that stands for it."""

    label: str
    unit: str
    values: np.ndarray
    layer: str = ""


def readouts(played: Replay) -> list[Readout]:
    """Return the numbers of a replay: forces, momentum, slosh, deflection, and how far companions are off."""
    found = [*_signs(played), *_hidden(played)]
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


def _hidden(played: Replay) -> Iterator[Readout]:
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
        if isinstance(driver, StripDriver) and part.path.split("/")[-2] == name.replace("/", "."):
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
