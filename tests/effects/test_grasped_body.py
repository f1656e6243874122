"""A grasped body: ten parameters, those a description gives must be a body's, estimates are free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description, save_description
from smsid.effects import BodyError, GraspedBody, Payload, parse_effect
from smsid.errors import DescriptionError
from smsid.model import build_model

URDF = Path(__file__).resolve().parents[2] / "urdf"
CENTRAL = (5.0, 0.2, 4.0, 0.1, -0.3, 3.0)


def test_it_is_the_rigid_body_of_pinocchio():
    """Centre and central inertia given, the body on the link is Pinocchio's of the same numbers."""
    description = load_description(URDF / "paper_sms.toml")
    plain = build_model(description)
    body = GraspedBody.model_validate(
        {"name": "g", "frame": "link3", "mass": 60.0, "centre": (0.9, 0.1, -0.2), "central_inertia": CENTRAL}
    )
    grasped = build_model(description.with_effects(body))
    xx, xy, yy, xz, yz, zz = CENTRAL
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    joint = plain.pin.getJointId("joint3")
    expected = plain.pin.inertias[joint] + pin.Inertia(60.0, np.array([0.9, 0.1, -0.2]), matrix)
    np.testing.assert_allclose(
        grasped.pin.inertias[joint].toDynamicParameters(), expected.toDynamicParameters(), rtol=1e-12
    )
    np.testing.assert_allclose(body.centre, (0.9, 0.1, -0.2))


def test_a_point_mass_is_a_payload():
    description = load_description(URDF / "paper_sms.toml")
    given = {"name": "g", "frame": "tool", "mass": 7.0, "centre": (0.1, 0.2, 0.3)}
    body = GraspedBody.model_validate({**given, "central_inertia": (0.0,) * 6})
    point = Payload(name="g", frame="tool", mass=7.0, com=(0.1, 0.2, 0.3))
    found, expected = (build_model(description.with_effects(e)).pin.inertias for e in (body, point))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a.toDynamicParameters(), b.toDynamicParameters(), atol=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"mass": 5.0, "central_inertia": (1.0, 0.0, 1.0, 0.0, 0.0, 3.0)}, "no rigid body"),
        (
            {"mass": 5.0, "centre": (1.0, 0.0, 0.0), "inertia": (1, 0, 1, 0, 0, 1)},
            "no rigid body",
        ),
        ({"mass": 0.0, "first_moment": (1.0, 0.0, 0.0)}, "no rigid body"),
        ({"mass": 5.0, "centre": (1.0, 0.0)}, "`centre` takes 3 finite numbers"),
        ({"mass": 5.0, "centre": (1.0, 0.0, 0.0), "first_moment": (1.0, 0.0, 0.0)}, "not both"),
    ],
)
def test_a_description_of_no_body_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        parse_effect({"kind": "grasped_body", "name": "g", **given})


def test_an_estimate_may_be_a_little_beyond_what_can_exist():
    """A search walks through such values, and a point mass's estimate lies beyond half of the time."""
    body = parse_effect(
        {
            "kind": "grasped_body",
            "name": "g",
            "mass": 5.0,
            "centre": (1.0, 0.0, 0.0),
            "central_inertia": (0.0,) * 6,
        }
    )
    assert body.with_values({"g.inertia.xx": -1e-3}).inertia[0] == -1e-3
    with pytest.raises(DescriptionError, match="cannot take"):
        body.with_values({"g.mass": -1.0})


def test_a_file_keeps_it(tmp_path):
    description = load_description(URDF / "paper_sms.toml")
    body = parse_effect(
        {
            "kind": "grasped_body",
            "name": "g",
            "frame": "link3",
            "mass": 5.0,
            "centre": (1.0, 0.5, 0.0),
            "central_inertia": CENTRAL,
            "prior": {"mass": 2.0},
        }
    )
    save_description(description.with_effects(body), tmp_path / "craft.toml")
    assert load_description(tmp_path / "craft.toml").get_effect("g") == body


def test_what_it_adds_is_what_a_body_error_adds():
    description = load_description(URDF / "paper_sms.toml")
    given = {"mass": 5.0, "first_moment": (5.0, 1.0, 0.0), "inertia": (3.0, -1.0, 8.0, 0.0, 0.0, 9.0)}
    body = GraspedBody(name="g", frame="link2", **given)
    error = BodyError(name="g", body="link2", **given)
    found, expected = (build_model(description.with_effects(e)).pin.inertias for e in (body, error))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.toDynamicParameters(), b.toDynamicParameters())
