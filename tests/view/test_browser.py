"""An exported page in a real browser."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest

from smsid.view import Look, export_html, replay
from smsid.view._scene import joint_paths

from .browser import Player, needs_chromium, run_page

pytest.importorskip("meshcat")
Image = pytest.importorskip("PIL.Image")
pytestmark = needs_chromium

# without a screen a browser draws when it likes: time passes, then one turn of meshcat's own loop is taken
FRAMES = """
    const frames = async n => {
      while (n-- > 0) {
        await new Promise(done => setTimeout(done, 100));
        viewer.animator.update();
      }
    };
    const set = (id, value, event) => { find(id).value = value; find(id).dispatchEvent(new Event(event)); };
"""
SHOOT = "const shoot = () => viewer.capture_image();"


@pytest.fixture(scope="module")
def page(model, trajectory, tmp_path_factory):
    """A replay with a ghost that lags half a second behind, bent twice as far, and what it plays."""
    late = trajectory.states(np.linspace(0.0, 5.5, 111))
    shifted = type(late)(late.time + 0.5, late.q, late.v, late.a, late.tau, late.reaction)
    played = replay(
        model, trajectory, beside=[("late", shifted)], label="first", look=Look(panel_factor=2.0), fps=10.0
    )
    return export_html(played, tmp_path_factory.mktemp("page") / "view.html"), played


def picture(url: str) -> np.ndarray:
    data = base64.b64decode(url.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)


def changed(a: np.ndarray, b: np.ndarray) -> float:
    """Share of the pixels that differ visibly."""
    return float(np.mean(np.abs(a - b).max(axis=2) > 24))


def test_canvas_is_drawn_and_moves_and_obeys(page, tmp_path):
    html, _ = page
    script = f"""{FRAMES}{SHOOT}
        const shots = {{start: shoot()}};
        find("play").click(); await frames(4); shots.later = shoot(); const playing = viewer.animator.time;
        find("play").click(); await frames(2); const paused = viewer.animator.time;
        await frames(2); const still = viewer.animator.time;
        set("speed", "5", "change"); const scale = viewer.animator.mixer.timeScale;
        set("seek", 3, "input"); await frames(2); shots.sought = shoot(); const sought = viewer.animator.time;
        set("factor", 1.5, "input"); await frames(2); shots.bent = shoot();
        document.querySelectorAll("#panel input")[1].click(); shots.alone = shoot();
        const texts = where => [...document.querySelectorAll(where)].map(x => x.textContent.trim());
        const labels = texts("#panel label"), told = texts("#rows tr");
        return {{shots, playing, paused, still, scale, sought, labels, told}};"""
    found = run_page(html, script, tmp_path, where="#t=0.5")
    shots = {name: picture(url) for name, url in found["shots"].items()}
    first = shots["start"].reshape(-1, 3)
    assert first.std(axis=0).min() > 5.0  # not one colour
    assert len(np.unique(first, axis=0)) > 500
    assert found["playing"] != pytest.approx(0.5)
    assert changed(shots["start"], shots["later"]) > 0.005
    assert found["still"] == found["paused"]
    assert found["scale"] == 5.0
    assert found["sought"] == pytest.approx(3.0)
    assert changed(shots["sought"], shots["bent"]) > 0.005
    assert changed(shots["bent"], shots["alone"]) > 0.002
    assert found["labels"][:2] == ["first", "late"]
    assert {"thrust", "torques", "momentum", "centre of mass", "tool trail"} <= set(found["labels"])
    assert any(line.startswith("thrust") and line.endswith("N") for line in found["told"])


def test_nodes_are_where_they_are_played_to(page, model, tmp_path):
    """three.js's own world matrices, of nodes that meshcat moves and of strips that the page bends."""
    html, played = page
    player = Player(list(played.commands()))
    arm = joint_paths(model)[int(model.arm_joints.joints[-1])]
    panel = model.appendages[0].appendage.name
    strips = [f"/meshcat/{root}/root_joint/{panel}/strip23" for root in ("spacecraft", "spacecraft_1")]
    paths = ["/meshcat/spacecraft/root_joint", f"/meshcat/{arm}", *strips]
    script = (
        FRAMES + "await frames(2); viewer.scene.updateMatrixWorld(true);"
        f"return {json.dumps(paths)}.map(p => {{"
        " const top = viewer.scene_tree.find(['meshcat']).object.matrixWorld.clone().invert();"
        " const node = viewer.scene_tree.find(p.split('/').filter(x => x)).object;"
        " return top.multiply(node.matrixWorld).toArray(); });"
    )
    frame = 31
    found = run_page(html, script, tmp_path, where=f"#t={played.motion.time[frame]}")
    for path, matrix in zip(paths, found, strict=True):
        np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, player.world(path, frame), atol=1e-4)


def test_narrow_window_shows_the_whole_spacecraft(page, tmp_path):
    html, _ = page
    script = (
        SHOOT + "const { left, right } = find('bar').getBoundingClientRect();"
        "return {shot: shoot(), open: find('panel').open, left, right, width: innerWidth};"
    )
    found = run_page(html, script, tmp_path, where="#t=2", size="500,860")
    assert not found["open"]
    assert found["left"] >= 0 and found["right"] <= found["width"]
    shot = picture(found["shot"])
    sky = shot[:, :1]  # the background only changes from top to bottom
    drawn = np.abs(shot - sky).max(axis=2) > 24
    assert drawn.any() and not drawn[:, :4].any() and not drawn[:, -4:].any()


@pytest.mark.parametrize("dark", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_dark_scheme_is_honoured(page, tmp_path, dark):
    html, _ = page
    script = SHOOT + "return {theme: document.body.className, shot: shoot()};"
    found = run_page(html, script, tmp_path, where="#t=1", dark=dark)
    assert found["theme"] == ("space" if dark else "light")
    corner = picture(found["shot"])[:10, :10].mean()
    assert corner < 60 if dark else corner > 200
