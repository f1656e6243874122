"""A replay as a film: MP4 or GIF, drawn by a browser without a window."""

from __future__ import annotations

import base64
import json
import logging
import math
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from smsid._files import atomic_path
from smsid.errors import MissingDependencyError, SmsidError, require
from smsid.view._export import export_html
from smsid.view.replay import Replay

logger = logging.getLogger(__name__)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FORMATS = (".mp4", ".gif")
BATCH = 60  # frames a browser draws at one go: they pass through its output as text
MOST = 3000  # frames of a film
SIZE = (960, 540)
LEAST = 500  # width [pixels] that a browser makes a window of
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)
SCRIPT = """<script>
setTimeout(() => {
  const shots = [];
  const player = viewer.animator;
  player.pause();
  for (const t of TIMES) {
    player.seek((t - facts.start) / facts.speed);
    player.update();
    shots.push(viewer.capture_image());
  }
  const told = document.createElement("pre");
  told.id = "shots";
  told.textContent = JSON.stringify(shots);
  document.body.appendChild(told);
}, 200);
</script></body>"""


def is_film(path: str | os.PathLike[str]) -> bool:
    """Return whether a file's ending says that it is a film."""
    return Path(path).suffix.lower() in FORMATS


def export_video(
    view: Replay, path: str | os.PathLike[str], *, fps: float = 20.0, size: tuple[int, int] = SIZE
) -> Path:
    """Write a replay as ``.mp4`` or ``.gif`` and return its path; the file appears whole or not at all.

    The pictures are drawn by Chromium (or Chrome) without a window, put together by imageio.

    Args:
        view: what is played.
        path: of the film; its ending says which kind.
        fps: pictures a second [Hz].
        size: width and height [pixels], even numbers, `LEAST` wide or more.

    Raises:
        MissingDependencyError: imageio (extra ``video``), meshcat (extra ``view``) or a browser is missing.
        SmsidError: another ending, a size too small, more than `MOST` frames, or the browser fails.
    """
    target = Path(path)
    if not is_film(target):
        raise SmsidError(f"'{target.name}' is no film.", advice="Call it .mp4 or .gif.", path=str(path))
    if size[0] < LEAST or size[1] < 2 or size[0] % 2 or size[1] % 2:
        raise SmsidError(
            f"A film cannot be {size[0]} by {size[1]} pixels.", advice="Use even numbers, 500 wide."
        )
    imageio = require("imageio", "video").v2
    kind = target.suffix.lower()
    if kind == ".mp4":
        require("imageio_ffmpeg", "video")
    browser = found_browser()
    start, stop = float(view.motion.time[0]), float(view.motion.time[-1])
    count = max(2, math.floor((stop - start) / view.speed * fps) + 1)
    if count > MOST:
        raise SmsidError(
            f"The film would have {count} pictures; {MOST} are the most.",
            advice="Play it faster (--speed), or keep fewer a second (--fps).",
        )
    times = np.linspace(start, stop, count)
    with tempfile.TemporaryDirectory() as place, atomic_path(target) as temporary:
        page = export_html(view, Path(place) / "page.html").read_text(encoding="utf-8")
        # imageio chooses by the ending, which the temporary file need not have
        options: dict[str, Any] = {"format": "GIF", "loop": 0, "duration": 1000.0 / fps}
        if kind == ".mp4":
            options = {"format": "FFMPEG", "macro_block_size": 2, "fps": fps}
        made = Path(place) / f"film{kind}"
        # a window has a frame even where nobody sees it, and browsers differ in how much of it that takes
        probe = imageio.imread(_draw_frames(browser, page, times[:1], size, Path(place))[0])
        window = (2 * size[0] - probe.shape[1], 2 * size[1] - probe.shape[0])
        with imageio.get_writer(made, **options) as film:
            for first in range(0, count, BATCH):
                for picture in _draw_frames(browser, page, times[first : first + BATCH], window, Path(place)):
                    film.append_data(imageio.imread(picture)[..., :3])
                logger.info("%d of %d pictures", min(first + BATCH, count), count)
        shutil.copyfile(made, temporary)
    return target


def found_browser() -> str:
    """Return the browser that draws; raises `MissingDependencyError` where there is none."""
    for name in BROWSERS:
        place = shutil.which(name)
        if place is not None:
            return place
    raise MissingDependencyError(
        "A film is drawn by Chromium or Chrome, and neither is there.",
        advice="Install it (on Debian: apt-get install chromium), or write an .html, which needs neither.",
        looked_for=BROWSERS,
    )


def _draw_frames(
    browser: str, page: str, times: np.ndarray, size: tuple[int, int], folder: Path
) -> list[bytes]:
    """Return the pictures (PNG) of a page at times [s]."""
    script = SCRIPT.replace("TIMES", json.dumps([float(t) for t in times]))
    watched = folder / "film.html"
    watched.write_text(page.replace("</body>", script), encoding="utf-8")
    options = [*OPTIONS, f"--user-data-dir={folder / 'profile'}", f"--window-size={size[0]},{size[1]}"]
    try:
        done = subprocess.run(
            [browser, *options, "--virtual-time-budget=3000", "--dump-dom", watched.as_uri()],
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SmsidError(f"The browser did not draw the film: {error}.") from error
    told = re.search(r'<pre id="shots">([^<]+)</pre>', done.stdout)
    shots = json.loads(told.group(1)) if told else []
    if len(shots) != len(times):
        raise SmsidError(
            f"The browser drew {len(shots)} of {len(times)} pictures.",
            advice="Does the .html play in it?",
            said=done.stderr[-500:],
        )
    return [base64.b64decode(shot.partition(",")[2]) for shot in shots]
