from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description, load_description
from smsid.description.schema import Arm, Mount
from smsid.effects.appendage import ModalAppendage, Mode
from smsid.errors import SmsidError
from smsid.model.build import build_model
from smsid.view import Look, build_scene
from smsid.view._look import ASPECT, FIELD_OF_VIEW, HULL_OPACITY, fitted_camera
from smsid.view._shapes import Mesh
from smsid.view._surface import inertia_box, surface_of
from smsid.view._visuals import visuals_of

from .conftest import URDF


def plate(mass: float, length: float, width: float) -> tuple[float, ...]:
    """Inertia (xx, xy, yy, xz, yz, zz) about the middle of the short edge at x = 0."""
    return (mass * width**2 / 12, 0, mass * length**2 / 3, 0, 0, mass * (length**2 / 3 + width**2 / 12))


STATIONS = tuple((x, y, 0.0) for x in (1.0, 2.5, 4.0) for y in (-0.8, 0.8))
BEND = tuple((0.0, 0.0, 0.02 * x**2) for x, _, _ in STATIONS)
TWIST = tuple((0.0, 0.0, 0.05 * x * y) for x, y, _ in STATIONS)


@pytest.fixture()
def modal() -> ModalAppendage:
    common = {"frequency": 0.2, "damping": 0.005}
    return ModalAppendage(
        name="wing",
        position=(1.0, 0.0, 0.0),
        mass=40.0,
        center_of_mass=(2.0, 0.0, 0.0),
        inertia=plate(40.0, 4.0, 2.0),
        mode=(
            Mode(translation=(0, 0, 4.0), rotation=(0, -11.0, 0), shape=BEND, **common),
            Mode(translation=(0, 0, 0), rotation=(1.5, 0, 0), shape=TWIST, **common),
        ),
        stations=STATIONS,
    )


@pytest.mark.parametrize("name", ["paper_sms", "two_arm_sms"])
def test_every_part_has_its_parent_and_a_name_of_its_own(name):
    scene = build_scene(build_model(load_description(URDF / f"{name}.toml")))
    paths = [p.path for p in scene.parts]
    assert len(set(paths)) == len(paths)
    for path in paths[1:]:
        assert path.rpartition("/")[0] in paths


def test_hull_is_see_through_only_where_it_hides_something(model):
    scene = build_scene(model)
    clear = [p.path for p in scene.parts if p.material.opacity == HULL_OPACITY]
    assert clear == ["spacecraft/root_joint/bus_0"]


def test_plate_of_modal_data_has_the_size_of_its_inertia(modal):
    surface = surface_of(modal)
    assert (surface.length, surface.width) == pytest.approx((4.0, 2.0))
    np.testing.assert_allclose(surface.frame, np.eye(4), atol=1e-12)


def test_modal_shapes_are_met_at_the_stations(modal):
    surface = surface_of(modal)
    delta = np.array([[0.7, -0.4]])
    strips = 8
    poses = surface.strip_poses(delta, strips)[0]
    for k, (x, _, _) in enumerate(STATIONS[::2]):
        edge = round(x / 0.5) - 1
        end = (poses[edge] @ [0.25, 0.0, 0.0, 1.0])[:3]
        np.testing.assert_allclose(end, [x, 0.0, 0.7 * BEND[2 * k][2]], atol=1e-12)
    rolled = surface.twist(np.array([1.0, 2.5, 4.0]))
    np.testing.assert_allclose(rolled, [[0, 0.05], [0, 0.125], [0, 0.2]], atol=1e-12)
    np.testing.assert_allclose(surface.strip_poses(0 * delta, strips)[0, :, :3, 3][:, 2], 0.0)


def test_appendage_without_shapes_is_rigid_and_said_to_be(modal, description: Description):
    bare = modal.model_copy(
        update={"mode": tuple(m.model_copy(update={"shape": ()}) for m in modal.mode), "stations": ()}
    )
    scene = build_scene(build_model(description.with_effects(bare)))
    assert "'wing' has no mode shapes: drawn rigid" in scene.notes


@pytest.mark.parametrize("sizes", [(4.0, 2.0, 0.5), (1.0, 1.0, 1.0)])
def test_inertia_box_has_the_inertia(sizes):
    squares = np.square(sizes)
    inertia = pin.Inertia(7.0, np.array([1.0, 0, 0]), np.diag(7.0 / 12 * (squares.sum() - squares)))
    size, pose = inertia_box(inertia)
    np.testing.assert_allclose(size, sizes, rtol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(pose[:3, 3], [1.0, 0, 0])


def test_body_without_visuals_is_drawn_as_the_box_of_its_inertia(tmp_path):
    (tmp_path / "bus.urdf").write_text(
        '<robot name="b"><link name="bus"><inertial><mass value="900"/>'
        '<inertia ixx="400" iyy="300" izz="350" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    scene = build_scene(build_model(Description(name="bare", urdf="bus.urdf", folder=tmp_path)))
    assert "spacecraft/root_joint/inertia" in [p.path for p in scene.parts]


def test_meshes_of_a_mounted_robot_show_in_their_colours(description: Description):
    from importlib import metadata

    try:
        metadata.version("example-robot-data")
    except metadata.PackageNotFoundError:
        pytest.skip("needs example-robot-data")
    arm = Arm(name="panda", robot="panda", mount=Mount(frame="bus", xyz=(0.0, 0.0, 1.0)))
    model = build_model(description.model_copy(update={"arm": (*description.arm, arm)}))
    scene = build_scene(model)
    meshes = {
        p.path.rpartition("/")[2]: p for p in scene.parts if isinstance(p.shape, Mesh) and "panda" in p.path
    }
    assert len(meshes) >= 10
    hand = meshes["panda.panda_hand_0"].shape
    assert isinstance(hand, Mesh) and hand.colors is not None
    assert len(np.unique(hand.colors, axis=0)) > 1
    for geometry in visuals_of(model).geometryObjects:
        if geometry.name.startswith("panda/"):
            drawn = meshes[geometry.name.replace("/", ".")].shape
            assert isinstance(drawn, Mesh)
            loaded = np.array(geometry.geometry.vertices())
            np.testing.assert_allclose(drawn.vertices.min(axis=0), loaded.min(axis=0), atol=2e-3)
            np.testing.assert_allclose(drawn.vertices.max(axis=0), loaded.max(axis=0), atol=2e-3)


@pytest.mark.parametrize("wrong", [{"slosh_factor": 0.0}, {"panel_factor": -1.0}])
def test_senseless_looks_are_refused(wrong):
    with pytest.raises(SmsidError):
        Look(**wrong)


def test_camera_has_everything_in_view(model):
    scene = build_scene(model)
    target, offset = fitted_camera(scene.corners)
    back = offset / np.linalg.norm(offset)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    seen = scene.corners - target - offset
    across, along = seen @ right / -(seen @ back), seen @ np.cross(back, right) / -(seen @ back)
    limit = np.tan(np.deg2rad(FIELD_OF_VIEW / 2))
    assert np.abs(along).max() < limit and np.abs(across).max() < ASPECT * limit
    assert np.abs(along).max() > 0.7 * limit or np.abs(across).max() > 0.7 * ASPECT * limit
