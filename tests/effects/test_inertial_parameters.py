"""Inertias of bodies with and without mass."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import smsid
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import DescriptionError


def test_a_body_of_random_parameters_is_pinocchios():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(6, 3))  # a body of six equal masses
    inertia = sum(x @ x * np.eye(3) - np.outer(x, x) for x in points - points.mean(axis=0))
    theta = pin.Inertia(6.0, points.mean(axis=0), inertia).toDynamicParameters()
    assert np.allclose(theta[1:4], points.sum(axis=0))
    assert np.allclose(pinocchio_inertia(theta).toDynamicParameters(), theta, atol=1e-12)
    assert np.allclose(pinocchio_inertia(-theta).toDynamicParameters(), -theta, atol=1e-12)


def test_a_rotor_without_mass_has_its_moments():
    """A wheel that a description gives a spin inertia only; its link in the URDF has none."""
    theta = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.002])
    assert (pinocchio_inertia(theta).toDynamicParameters() == theta).all()
    theta[1] = 0.1
    with pytest.raises(DescriptionError, match="without mass"):
        pinocchio_inertia(theta)


def test_pinocchios_own_which_divides_by_the_mass_is_called_in_one_place():
    folder = Path(smsid.__file__).parent
    own = [
        p for p in folder.rglob("*.py") if "Inertia.FromDynamicParameters" in p.read_text(encoding="utf-8")
    ]
    assert [p.name for p in own] == ["inertial_parameters.py"]
