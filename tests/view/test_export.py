from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.errors import MissingDependencyError, SmsidError
from smsid.model.build import build_model
from smsid.view import Look, build_scene, export_html, replay
from smsid.view.scene import joint_paths

from .conftest import URDF, moving

pytest.importorskip("meshcat")
from .browser import Player, commands_in


@pytest.fixture(scope="module", params=["paper_sms", "two_arm_sms"])
def exported(request, tmp_path_factory):
    """Model, replay and what its page plays."""
    model = build_model(load_description(URDF / f"{request.param}.toml"), visuals=True)
    played = replay(model, moving(model), look=Look(panel_factor=2.0), fps=10.0)
    page = export_html(played, tmp_path_factory.mktemp("view") / "view.html")
    return model, played, Player(commands_in(page))


def test_links_follow_forward_kinematics(exported):
    model, played, player = exported
    data = model.pin.createData()
    for frame in (0, 17, len(played.motion.time) - 1):
        pin.forwardKinematics(model.pin, data, played.motion.q[frame])
        for joint, path in joint_paths(model).items():
            if joint in model.wheels.joints or joint in [s.joint for s in model.slosh]:
                continue
            np.testing.assert_allclose(
                player.world(f"/meshcat/{path}", frame), data.oMi[joint].homogeneous, atol=2e-6
            )


def test_slosh_ball_is_where_the_slosh_mass_is(exported):
    model, played, player = exported
    assert played.scene.scale.slosh == 1.0
    for slosh in model.slosh:
        path = f"/meshcat/{joint_paths(model)[slosh.joint]}/ball"
        radius = (3 * model.description.get_effect(slosh.name).mass / (4000 * np.pi)) ** (1 / 3)
        assert player.objects[path]["geometries"][0]["radius"] == pytest.approx(radius, rel=1e-6)
        for frame, q in enumerate(played.motion.q):
            rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
            expected = q[:3] + rotation @ (slosh.position + q[slosh.q])
            np.testing.assert_allclose(player.world(path, frame)[:3, 3], expected, atol=2e-6)


def test_strips_meet_where_the_modes_put_the_stations(exported):
    model, played, player = exported
    for appendage in model.appendages:
        effect = appendage.appendage
        strips = played.scene.look.strips
        stations = effect.station_positions()
        shapes = np.array([m.shape for m in effect.modal_data()])
        columns = [model.pin.joints[j].idx_q for j in appendage.joints]
        for frame in (5, 30, 55):
            q = played.motion.q[frame]
            bus = pin.SE3(pin.Quaternion(q[3:7]).toRotationMatrix(), q[:3])
            delta = q[columns] * appendage.scale
            assert np.abs(delta).max() > 1e-4
            for k, station in enumerate(stations):
                point = station + 2.0 * delta @ shapes[:, k]
                expected = bus.act(appendage.placement.act(point))
                step = effect.length / strips
                # a stretch below 1e-4 is not animated: half a strip times that
                index = round(station[0] / step)
                before = player.world(_strip(effect.name, index - 1), frame)
                np.testing.assert_allclose((before @ [step / 2, 0, 0, 1])[:3], expected, atol=2e-5)
                if index < strips:
                    after = player.world(_strip(effect.name, index), frame)
                    np.testing.assert_allclose((after @ [-step / 2, 0, 0, 1])[:3], expected, atol=2e-5)


def _strip(name: str, index: int) -> str:
    return f"/meshcat/spacecraft/root_joint/{name}/strip{index:02d}"


def test_wheels_turn_by_their_angle_times_the_stated_factor(exported):
    model, played, player = exported
    factor = played.scene.scale.wheel
    for name, joint, k in zip(model.wheels.names, model.wheels.joints, model.wheels.q, strict=True):
        path = f"/meshcat/{joint_paths(model)[joint]}"
        for frame in (0, 20, 50):
            turned = pin.log3(player.local(path, frame)[:3, :3])
            wheel = next(w for w in model.description.wheel if w.name == name)
            angle = factor * played.motion.q[frame, k]
            wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
            np.testing.assert_allclose(turned, wrapped * np.asarray(wheel.axis), atol=2e-5)


def test_arrow_points_along_the_thrust(exported):
    _, played, player = exported
    largest = np.linalg.norm(played.motion.force, axis=1).max()
    for frame in (3, 25, 40):
        arrow = player.local("/meshcat/spacecraft/root_joint/thrust", frame)[:3, 0]
        expected = played.motion.force[frame] / largest * 0.75 * played.scene.radius
        np.testing.assert_allclose(arrow, expected, atol=1e-4)


def test_page_needs_no_network(model, trajectory, tmp_path):
    text = export_html(replay(model, trajectory), tmp_path / "view.html", title="a <b> & c").read_text()
    assert set(re.findall(r"https?://[^\s\"'`)]+", text)) <= {"http://www.w3.org/1999/xhtml"}
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"\b(src|href)\s*=|@import|url\(", markup)
    assert "<title>a &lt;b&gt; &amp; c</title>" in text
    assert len(text) < 10e6


def test_scene_at_rest_has_no_animation(model, tmp_path):
    player = Player(commands_in(export_html(build_scene(model), tmp_path / "home.html")))
    assert not player.tracks
    assert "/meshcat/spacecraft/root_joint/tank/ball" in player.objects


def test_export_to_a_missing_folder_says_so(model, tmp_path):
    with pytest.raises(SmsidError, match="does not exist"):
        export_html(build_scene(model), tmp_path / "nowhere" / "home.html")


def test_meshcat_missing_gives_the_pip_line(model, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshcat", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'smsid\[view\]'"):
        export_html(build_scene(model), tmp_path / "view.html")
    assert not list(tmp_path.iterdir())


def test_import_starts_nothing():
    servers = ("meshcat", "zmq", "tornado", "umsgpack")
    code = f"import sys, smsid.view; print([m for m in {servers} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium")
def test_browser_puts_the_nodes_there(exported, tmp_path):
    """The page opened from disk without network: three.js's own world matrices at a time between keys."""
    model, played, player = exported
    page = export_html(played, tmp_path / "view.html")
    paths = [
        "/meshcat/spacecraft/root_joint",
        f"/meshcat/{joint_paths(model)[int(model.arm_joints.joints[-1])]}",
        _strip(model.appendages[0].appendage.name, 23),
    ]
    probe = (
        "<script>setTimeout(() => { const s = viewer.scene; s.updateMatrixWorld(true);"
        f" const found = {json.dumps(paths)}.map(p => {{"
        " const top = viewer.scene_tree.find(['meshcat']).object.matrixWorld.clone().invert();"
        " const node = viewer.scene_tree.find(p.split('/').filter(x => x)).object;"
        " return top.multiply(node.matrixWorld).toArray(); });"
        " document.title = JSON.stringify(found); }, 500);</script></body>"
    )
    page.write_text(page.read_text().replace("</body>", probe))
    frame = 31
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader"]
    options += ["--enable-unsafe-swiftshader", "--no-first-run", "--disable-background-networking"]
    options += ["--disable-quic", "--disable-component-update", "--disable-sync"]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}"]
    options += ["--window-size=320,200", "--virtual-time-budget=1500", "--dump-dom"]
    url = f"{Path(page).as_uri()}#t={played.motion.time[frame]}"
    done = subprocess.run(["chromium", *options, url], capture_output=True, text=True, timeout=240)
    title = re.search(r"<title>(\[\[.*?\]\])</title>", done.stdout)
    assert title is not None, done.stderr[-2000:]
    for path, matrix in zip(paths, json.loads(title.group(1)), strict=True):
        np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, player.world(path, frame), atol=1e-4)
