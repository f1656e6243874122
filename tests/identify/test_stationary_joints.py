"""Joints and wheels that stand still: their noise is no excitation, what they hide is said."""

from __future__ import annotations

import math

import numpy as np
import pytest
from likelihood import twin

from smsid.identify.estimate import ParameterEstimate
from smsid.identify.paper.pipeline import identify
from smsid.identify.stationary_joints import StationaryJoints, is_constant
from smsid.likelihood import refine

LOCKED = 1e12  # [kg m^2]
FAR = 4.0  # standard deviations
OF_LINK3 = ["mx", "mz", "Ixx - link3.Izz", "Ixy", "Iyy", "Ixz", "Iyz"]


def inside(parameters: list[ParameterEstimate], least: int) -> None:
    """At least so many are identifiable, and all within their interval: the description is the truth."""
    assert sum(p.status == "identifiable" for p in parameters) >= least
    for p in parameters:
        assert p.nominal is not None
        assert abs(p.value - p.nominal) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"


def test_a_still_joint_makes_one_body_of_two():
    recording = twin.noisy(twin.exp2(40.0, (("joint3", LOCKED),)), 0, biased=False)
    estimate = identify(twin.description(), [recording]).estimate
    found = list(estimate.group("exp2.step_b"))
    seen = [p for p in found if math.isfinite(p.sigma)]
    inside(seen, 20)
    assert not any(p.name.startswith("link3.") for p in seen)
    assert any(p.name.startswith("link2.Iyy") and "link3.Iyy" in p.name for p in seen)
    lost = [p for p in found if p not in seen]
    assert [p.name for p in lost] == [f"link3.{x}" for x in OF_LINK3]
    assert all(p.status == "not_identifiable" and "joint3 stands still" in p.note for p in lost)
    assert any(
        "joint3 stands still" in n and "link3 is seen only together with link2" in n for n in estimate.notes
    )


def test_a_still_wheel():
    recording = twin.noisy(twin.exp2(40.0, (("wheel_y", LOCKED),)), 0, biased=False)
    estimate = identify(twin.description(), [recording]).estimate
    inside(list(estimate.group("exp2.step_b")), 25)
    assert any("wheel_y does not speed up" in n for n in estimate.notes)


def test_maximum_likelihood_with_a_still_joint_and_a_still_wheel():
    """Both experiments, biases and all; joint 2 in the middle of the arm."""
    stiff = (("joint2", LOCKED), ("wheel_x", LOCKED))
    recordings = [twin.noisy(twin.exp1((1, 1, 1), 60.0), 0), twin.noisy(twin.exp2(40.0, stiff), 0)]
    estimate = refine(twin.description(), recordings, identify(twin.description(), recordings)).estimate
    found = list(estimate.group("maximum_likelihood"))
    inside(found, 30)
    seen = {p.name.split(" ")[0]: p for p in found if p.status == "identifiable"}
    assert {"link1.mx", "link1.Izz", "link3.mx", "link3.Iyy"} <= set(seen)
    assert "link2.mx" in seen["link1.mx"].name
    lost = [p for p in found if p.name.startswith("link2.")]
    assert len(lost) == 7
    assert all(p.status == "not_identifiable" and "the prior's" in p.note for p in lost)
    assert any("joint2 stands still" in n for n in estimate.notes)
    assert any("wheel_x does not speed up" in n for n in estimate.notes)


def test_a_joint_that_hardly_moves():
    """0.15 mrad, 20 urad/s: more than noise, too little to tell anything of a link from."""
    recording = twin.noisy(twin.exp2(40.0, (("joint3", 1e6),)), 0, biased=False)
    assert not StationaryJoints.of(twin.model(), recording)
    estimate = identify(twin.description(), [recording]).estimate
    found = list(estimate.group("exp2.step_b"))
    inside(found, 0)
    assert not [p for p in found if p.name.startswith("link3.") and p.status == "identifiable"]
    assert any("joint3 hardly moves" in n for n in estimate.notes)


NOISE = 1e-4 * np.random.default_rng(0).standard_normal(4001)
TIME = np.linspace(0.0, 40.0, 4001)


def with_error(values: np.ndarray) -> np.ndarray:
    out = np.array(values)
    out[::97] += 0.1
    out[1000:1200] = np.nan
    return out


@pytest.mark.parametrize(
    ("values", "still"),
    [
        (0.9 + NOISE, True),
        (with_error(0.9 + NOISE), True),
        (np.full(4001, 0.9), True),
        (np.round(0.90005 + NOISE, 3), True),
        (0.9 + 1e-9 * TIME, True),
        (0.9 + NOISE + 1e-4 * TIME, False),
        (with_error(0.9 + NOISE + 1e-4 * TIME), False),
        (0.9 + NOISE + 1e-3 * (np.abs(TIME - 30.0) < 0.5), False),
        (0.9 + np.round(NOISE + 1e-4 * TIME, 3), False),
    ],
)
def test_what_stands_still(values: np.ndarray, still: bool):
    assert is_constant(values) is still


def test_what_is_held_has_no_noise_left():
    recording = twin.noisy(twin.exp2(40.0, (("joint3", LOCKED),)), 0)
    found = StationaryJoints.of(twin.model(), recording)
    assert found == StationaryJoints((2,), ())
    held = found.held(twin.model(), recording)
    assert np.ptp(held["encoder.joint_position"][:, 2]) == 0.0
    assert held["encoder.joint_position"][0, 2] == pytest.approx(0.9, abs=1e-5)
    assert not held["encoder.joint_velocity"][:, 2].any()
    np.testing.assert_array_equal(
        held["encoder.joint_position"][:, :2], recording["encoder.joint_position"][:, :2]
    )
