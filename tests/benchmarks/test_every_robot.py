"""A sample of the robots that the benchmark flies and exports."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from smsid.description.robots import robots_folder
from smsid.errors import MissingDependencyError


@pytest.mark.parametrize("name", ["ur5", "panda", "solo12"])
def test_a_robot_flies_and_its_exports_move_alike(name):
    try:
        robots_folder()
    except MissingDependencyError as error:
        pytest.skip(str(error))
    from every_robot import judged

    found = judged(name)
    assert found["steps"] > 0 and found["joints"] > 5
    assert found["mass_difference"] < 1e-9
    assert found["acceleration_difference"] < 1e-9
