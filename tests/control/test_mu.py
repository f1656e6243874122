"""The upper bound on mu: known answers, SLICOT's ab13md, and perturbations that would break it."""

from __future__ import annotations

import ctrlsys
import numpy as np
import pytest

from smsid.control._mu import UncertainBlock, mu_upper_bound
from smsid.errors import ControlError


def random(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n)) + 1j * rng.standard_normal((n, n))


def reals(n):
    return [UncertainBlock(str(k), 1, True) for k in range(n)]


def complexes(n):
    return [UncertainBlock(str(k), 1, False) for k in range(n)]


def test_one_full_block_is_the_largest_singular_value():
    m = random(5)
    bound, _ = mu_upper_bound(m, [UncertainBlock("all", 5, False)])
    np.testing.assert_allclose(bound, np.linalg.norm(m, 2), rtol=1e-9)


def test_a_diagonal_matrix():
    m = np.diag([0.3 + 0.4j, -0.2, 0.1j])
    np.testing.assert_allclose(mu_upper_bound(m, complexes(3))[0], 0.5, rtol=1e-6)
    # a real scalar only meets what is real: 1 - d m = 0 has no real d for a complex m
    np.testing.assert_allclose(mu_upper_bound(m, reals(3))[0], 0.2, rtol=1e-3)


def test_rank_one_complex_is_known_in_closed_form():
    """mu of u v^H with complex scalars: sum |u_i v_i|."""
    rng = np.random.default_rng(4)
    u, v = rng.standard_normal((2, 4)) + 1j * rng.standard_normal((2, 4))
    bound, _ = mu_upper_bound(np.outer(u, v.conj()), complexes(4))
    np.testing.assert_allclose(bound, np.abs(u * v).sum(), rtol=1e-4)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["real", "complex", "mixed"])
def test_near_slicot_s_ab13md(seed, kind):
    m = random(8, seed)
    blocks = {
        "real": reals(8),
        "complex": complexes(8),
        "mixed": [UncertainBlock("full", 3, False), *reals(3), *complexes(2)],
    }[kind]
    ours, _ = mu_upper_bound(m, blocks)
    theirs, *_, info = ctrlsys.ab13md(
        np.asfortranarray(m),
        np.array([b.size for b in blocks], dtype=np.int32),
        np.array([1 if b.real else 2 for b in blocks], dtype=np.int32),
    )
    assert info == 0
    assert theirs * (1.0 - 1e-6) <= ours <= 1.02 * theirs


@pytest.mark.parametrize("seed", range(3))
def test_no_perturbation_within_the_bound_is_singular(seed):
    """Real and complex scalars of size below 1 / mu: I - M Delta keeps away from singular."""
    m = random(6, seed)
    blocks = [*reals(3), *complexes(3)]
    bound, _ = mu_upper_bound(m, blocks)
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(-1.0, 1.0, (20000, 6)).astype(complex)
    sizes[:, 3:] *= np.exp(2j * np.pi * rng.uniform(size=(20000, 3)))
    delta = 0.999 / bound * sizes / np.abs(sizes).max(axis=1, keepdims=True)
    smallest = np.linalg.svd(np.eye(6) - m * delta[:, None, :], compute_uv=False)[:, -1]
    assert smallest.min() > 0.0
    # a rank-deficient one exists not far beyond: the bound means something
    worst = np.abs(np.linalg.eigvals(m * sizes[:, None, :] / np.abs(sizes).max(axis=1)[:, None, None]))
    assert bound < 4.0 * worst.max()


def test_scalings_of_a_neighbour_are_a_start_and_any_bound_is_valid():
    m = random(6, 1)
    bound, scalings = mu_upper_bound(m, reals(6))
    again, _ = mu_upper_bound(m * (1.0 + 1e-9), reals(6), scalings)
    assert again <= bound * (1.0 + 1e-6)
    assert bound <= np.linalg.norm(m, 2) * (1.0 + 1e-9)


def test_bad_input_is_refused():
    with pytest.raises(ControlError, match="neither a real scalar nor a full block"):
        UncertainBlock("x", 2, True)
    with pytest.raises(ControlError, match="does not fit blocks of 3"):
        mu_upper_bound(np.eye(2), reals(3))
    with pytest.raises(ControlError, match="not finite"):
        mu_upper_bound(np.full((2, 2), np.nan), reals(2))
