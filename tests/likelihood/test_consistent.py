"""Inertias handed out can exist, and are the nearest that can."""

from __future__ import annotations

import numpy as np

from smsid.likelihood.consistent import consistent_inertias
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.pseudo_inertia import is_body

from . import twin


def test_possible_bodies_do_not_move():
    at = Parameters.of(twin.model())
    found = consistent_inertias(at, at, np.eye(at.inertias.size))
    np.testing.assert_array_equal(found, at.inertias)


def test_impossible_bodies_move_by_as_little_as_they_must():
    """A rod whose largest moment exceeds the sum of the others: only its moments move, to the boundary."""
    described = Parameters.of(twin.model())
    inertias = described.inertias.copy()
    excess = 0.5
    inertias[3, 4] -= inertias[3, 4] + excess  # Ixx of link 3 below zero by 0.5
    covariance = 1e-8 * np.eye(described.inertias.size)  # known to 1e-4 of the body's size
    found = consistent_inertias(described.with_inertias(inertias), described, covariance)
    assert all(is_body(theta) for theta in found)
    moved = np.abs(found - inertias) / described.sizes
    assert moved[:3].max() < 1e-5
    # the distance to what can exist is at least that to Ixx = 0 and at most that to the described body
    least, most = excess / described.sizes[3, 4], (excess + 0.05) / described.sizes[3, 4]
    assert least <= np.linalg.norm(moved[3]) <= most


def test_random_estimates_always_come_out_physical():
    described = Parameters.of(twin.model())
    rng = np.random.default_rng(5)
    for _ in range(5):
        off = described.moved(
            np.concatenate(
                [0.3 * rng.standard_normal(described.inertias.size), np.zeros(len(described.scalars))]
            )
        )
        root = rng.standard_normal((described.inertias.size, described.inertias.size))
        covariance = root @ root.T / described.inertias.size + 0.01 * np.eye(described.inertias.size)
        assert all(is_body(theta) for theta in consistent_inertias(off, described, covariance))


def test_covariance_that_rounding_has_made_indefinite():
    """Some combinations known 1e9 times better than others: still bodies, and still the nearest."""
    described = Parameters.of(twin.model())
    n = described.inertias.size
    rng = np.random.default_rng(6)
    basis = np.linalg.qr(rng.standard_normal((n, n)))[0]
    covariance = basis @ np.diag(np.logspace(-19, 0, n)) @ basis.T
    assert np.linalg.eigvalsh(covariance)[0] < 0.0
    inertias = described.inertias.copy()
    inertias[3, 4] = -0.5
    found = consistent_inertias(described.with_inertias(inertias), described, covariance)
    assert all(is_body(theta) for theta in found)
