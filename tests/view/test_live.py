from __future__ import annotations

import pytest

from smsid.view import LiveView, build_scene, replay, show


def test_live_view_shows_and_plays(model, trajectory, capfd):
    pytest.importorskip("meshcat")
    view = LiveView(build_scene(model))
    try:
        assert view.url.startswith("http")
        view.display(model.home, force=[10.0, 0.0, 0.0])
        view.play(replay(model, trajectory, fps=5.0))
        assert view.scene.notes
    finally:
        view.close()
    assert capfd.readouterr().out == ""


def test_show_without_meshcat_gives_the_pip_line(model, trajectory, monkeypatch):
    import sys

    from smsid.errors import MissingDependencyError

    monkeypatch.setitem(sys.modules, "meshcat", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[view\]"):
        show(replay(model, trajectory, fps=5.0))
