"""Read a scene back from its commands, as a browser would, and run a real browser."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import umsgpack
from scipy.spatial.transform import Rotation

TYPES = {0x12: np.uint8, 0x14: np.uint16, 0x16: np.uint32, 0x17: np.float32}


def commands_in(page: Path) -> list[dict[str, Any]]:
    """The commands an exported page carries."""
    text = page.read_text(encoding="utf-8")
    found = re.search(r'^const commands = (\[".*"\]);$', text, re.MULTILINE)
    assert found is not None
    return [umsgpack.unpackb(base64.b64decode(item)) for item in json.loads(found.group(1))]


def facts_in(page: Path) -> dict[str, Any]:
    """What an exported page knows beyond its commands."""
    found = re.search(r"^const facts = (\{.*\});$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None
    return json.loads(found.group(1))


def floats(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(float)


def array(value: umsgpack.Ext, columns: int) -> np.ndarray:
    return np.frombuffer(value.data, dtype=TYPES[value.type]).reshape(-1, columns).astype(float)


class Player:
    """The tree of nodes with their poses, at any frame of the animation."""

    page: Path

    def __init__(self, commands: list[dict[str, Any]]) -> None:
        self.rest = {
            c["path"]: np.reshape(c["matrix"], (4, 4)).T for c in commands if c["type"] == "set_transform"
        }
        self.objects = {c["path"]: c["object"] for c in commands if c["type"] == "set_object"}
        self.tracks: dict[str, dict[str, np.ndarray]] = {}
        self.fps = float("nan")
        for command in commands:
            if command["type"] != "set_animation":
                continue
            for animation in command["animations"]:
                self.fps = animation["clip"]["fps"]
                self.tracks[animation["path"]] = {
                    t["name"]: array(t["values"], 4 if t["type"] == "quaternion" else 3)
                    for t in animation["clip"]["tracks"]
                }

    def local(self, path: str, frame: int) -> np.ndarray:
        """Pose (4, 4) of a node in its parent at a key frame."""
        rest = self.rest.get(path, np.eye(4))
        scale = np.linalg.norm(rest[:3, :3], axis=0)
        position, quaternion = rest[:3, 3], Rotation.from_matrix(rest[:3, :3] / scale).as_quat()
        keys = self.tracks.get(path, {})
        position = keys[".position"][frame] if ".position" in keys else position
        quaternion = keys[".quaternion"][frame] if ".quaternion" in keys else quaternion
        scale = keys[".scale"][frame] if ".scale" in keys else scale
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix() * scale
        pose[:3, 3] = position
        return pose

    def world(self, path: str, frame: int) -> np.ndarray:
        """Pose (4, 4) in inertial axes: below the node 'meshcat', which follows the camera."""
        pose = np.eye(4)
        steps = path.strip("/").split("/")
        for k in range(2, len(steps) + 1):
            pose = pose @ self.local("/" + "/".join(steps[:k]), frame)
        return pose


needs_chromium = pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser chromium")

WATCH = """<script>
const faults = [];
addEventListener("error", e => faults.push("error: " + e.message));
addEventListener("unhandledrejection", e => faults.push("rejected: " + e.reason));
console.error = (...told) => faults.push("console: " + told.join(" "));
</script>"""
SETTLE = 200  # [ms] of the page's time before a script runs


def run_page(
    page: Path, script: str, folder: Path, *, where: str = "", size: str = "480,320", dark: bool = False
) -> Any:
    """Open a page from disk without network, run the body of an async function in it, return its result.

    The test fails where the page reports any error, to its console or otherwise.
    """
    watched = folder / "watched.html"
    probe = f"""<script>
    viewer.renderer.shadowMap.enabled = false; // slow without a graphics card
    setTimeout(async () => {{
      let found = null;
      try {{ found = await (async () => {{{script}}})(); }} catch (e) {{ faults.push(String(e)); }}
      const told = document.createElement("pre");
      told.id = "probe";
      told.textContent = btoa(JSON.stringify({{ found, faults }}));
      document.body.appendChild(told);
    }}, {SETTLE});</script></body>"""
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{WATCH}", 1)
    watched.write_text(text.replace("</body>", probe), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader"]
    options += ["--enable-unsafe-swiftshader", "--no-first-run", "--disable-background-networking"]
    options += ["--disable-quic", "--disable-component-update", "--disable-sync"]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}"]
    options += [f"--window-size={size}", "--virtual-time-budget=3500", "--dump-dom"]
    options += ["--blink-settings=preferredColorScheme=0"] if dark else []
    url = f"{watched.as_uri()}{where}"
    done = subprocess.run(["chromium", *options, url], capture_output=True, text=True, timeout=300)
    told = re.search(r'<pre id="probe">([^<]+)</pre>', done.stdout)
    assert told is not None, done.stderr[-2000:]
    result = json.loads(base64.b64decode(told.group(1)))
    assert result["faults"] == []
    return result["found"]
