"""A replay as a film."""

from __future__ import annotations

import shutil
from itertools import pairwise

import numpy as np
import pytest

from smsid.description import load_description
from smsid.errors import MissingDependencyError, SmsidError
from smsid.view import build_replay, replay, write_view
from smsid.view._video import export_video, is_film

from .browser import needs_chromium
from .conftest import URDF


@needs_chromium
@pytest.mark.parametrize("ending", [pytest.param("gif", marks=pytest.mark.slow), "mp4"])
def test_a_film_has_its_pictures_in_its_size(model, trajectory, tmp_path, ending):
    imageio = pytest.importorskip("imageio").v2
    pytest.importorskip("imageio_ffmpeg")
    played = replay(model, trajectory, speed=4.0)
    path = export_video(played, tmp_path / f"film.{ending}", fps=3.0, size=(520, 240))
    pictures = [np.asarray(p, dtype=float)[..., :3] for p in imageio.mimread(path)]
    assert len(pictures) == 5  # 6 s four times as fast, and the last moment
    assert pictures[0].shape == (240, 520, 3)
    assert pictures[0].std() > 10.0
    moved = [(np.abs(b - a).max(axis=2) > 24).mean() for a, b in pairwise(pictures)]
    assert min(moved) > 0.003


def test_without_a_browser_it_says_what_to_install(model, trajectory, tmp_path, monkeypatch):
    pytest.importorskip("imageio")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(MissingDependencyError, match="Chromium") as told:
        export_video(replay(model, trajectory), tmp_path / "film.gif")
    assert "apt-get install chromium" in str(told.value) and not (tmp_path / "film.gif").exists()


def test_only_films_are_films(model, trajectory, tmp_path):
    assert is_film("a.MP4") and not is_film("a.html")
    with pytest.raises(SmsidError, match="no film"):
        export_video(replay(model, trajectory), tmp_path / "film.avi")
    with pytest.raises(SmsidError, match="pixels"):
        export_video(replay(model, trajectory), tmp_path / "film.gif", size=(320, 240))
    with pytest.raises(SmsidError, match="A film needs a recording"):
        write_view(build_replay(load_description(URDF / "paper_sms.toml")), tmp_path / "film.gif")
