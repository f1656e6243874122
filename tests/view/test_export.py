from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.errors import MissingDependencyError, SmsidError
from smsid.model.build import build_model
from smsid.view import Look, build_scene, export_html, replay
from smsid.view._look import STRIPS
from smsid.view._scene import joint_paths

from .conftest import URDF, moving

pytest.importorskip("meshcat")
from .browser import Player, commands_in, facts_in, floats


@pytest.fixture(scope="module", params=["paper_sms", "two_arm_sms"])
def exported(request, tmp_path_factory):
    """Model, replay and what its page plays."""
    model = build_model(load_description(URDF / f"{request.param}.toml"), visuals=True)
    played = replay(model, moving(model), look=Look(panel_factor=2.0), fps=10.0)
    page = export_html(played, tmp_path_factory.mktemp("view") / "view.html")
    player = Player(commands_in(page))
    player.page = page
    return model, played, player


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
    model, played, _ = exported
    player = Player(list(played.commands()))  # the page bends its strips itself
    for appendage in model.appendages:
        effect = appendage.appendage
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
                step = effect.length / STRIPS
                # a stretch below 1e-4 is not animated: half a strip times that
                index = round(station[0] / step)
                before = player.world(_strip(effect.name, index - 1), frame)
                np.testing.assert_allclose((before @ [step / 2, 0, 0, 1])[:3], expected, atol=2e-5)
                if index < STRIPS:
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


def test_page_knows_how_the_panel_bends(exported):
    model, played, player = exported
    facts = facts_in(player.page)
    assert facts["factor"] == 2.0
    assert not any("/strip" in path for path in player.tracks)
    for bend, appendage in zip(facts["bends"], model.appendages, strict=True):
        effect, count = appendage.appendage, len(bend["paths"])
        edges = floats(bend["edges"]).reshape(count + 1, bend["modes"], 3)
        delta = floats(bend["delta"]).reshape(-1, bend["modes"])
        shapes = np.array([m.shape for m in effect.modal_data()])
        frame = np.array(played.scene.part(bend["paths"][0].rpartition("/")[0]).pose)
        turn = appendage.placement.rotation.T @ frame[:3, :3]
        for k, station in enumerate(effect.station_positions()):
            index = round(station[0] / bend["step"])
            np.testing.assert_allclose(edges[index] @ turn.T, shapes[:, k], atol=1e-6)
        columns = [model.pin.joints[j].idx_q for j in appendage.joints]
        np.testing.assert_allclose(delta, played.motion.q[:, columns] * appendage.scale, atol=1e-6)


def test_page_tells_numbers_true_to_scale(exported):
    model, played, player = exported
    told = {r["label"]: (floats(r["values"]), r["unit"]) for r in facts_in(player.page)["readouts"]}
    thrust, unit = told["thrust"]
    assert unit == "N"
    np.testing.assert_allclose(thrust, np.linalg.norm(played.motion.force, axis=1), rtol=1e-6)
    slosh, unit = told[f"slosh of {model.slosh[0].name}"]
    assert unit == "mm"
    q = played.motion.q[:, model.slosh[0].q]
    np.testing.assert_allclose(slosh, 1e3 * np.linalg.norm(q, axis=1), rtol=1e-5, atol=1e-6)


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
