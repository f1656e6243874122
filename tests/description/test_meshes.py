"""Meshes: of a bare URDF used where they are, of a TOML as it says; packages are found above the URDF."""

from __future__ import annotations

from pathlib import Path

import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError
from smsid.model import build_model
from smsid.model.review import review_description

URDF = """<robot name="r"><link name="bus">
<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://my_robot/meshes/bus.stl"/></geometry></visual>
</link></robot>"""
TRIANGLE = (
    "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid t\n"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A robot's package as ROS lays it out, without its mesh."""
    folder = tmp_path / "my_robot"
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    (folder / "urdf" / "r.urdf").write_text(URDF)
    (folder / "urdf" / "r.toml").write_text('schema = 1\nname = "r"\nurdf = "r.urdf"\n')
    return folder


def test_a_bare_urdf_does_without_a_mesh_that_is_missing(package, caplog):
    model = build_model(load_description(package / "urdf" / "r.urdf"))
    assert model.mass == 2.0 and not caplog.records
    shown = build_model(load_description(package / "urdf" / "r.urdf"), visuals=True)
    assert shown.visual is not None and len(shown.visual.geometryObjects) == 0
    assert "Drawn without meshes" in caplog.text


def test_a_description_requires_them_unless_it_says_otherwise(package):
    with pytest.raises(DescriptionError, match=r"bus\.stl' of link 'bus'"):
        build_model(load_description(package / "urdf" / "r.toml"))
    assert "bus.stl" in review_description(package / "urdf" / "r.toml").wrong[0]


def test_a_package_is_found_above_the_urdf(package):
    (package / "meshes" / "bus.stl").write_text(TRIANGLE)
    for name in ("r.urdf", "r.toml"):
        model = build_model(load_description(package / "urdf" / name), visuals=True)
        assert model.visual is not None and len(model.visual.geometryObjects) == 1
    assert not review_description(package / "urdf" / "r.toml").wrong
