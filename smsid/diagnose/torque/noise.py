"""The noise of measured torques, learnt beside all that a model may lack, by its restricted likelihood.

What a model lacks is no noise and must not hide in it. What a fit leaves has less of the noise than there
was: of slow noise, which looks like what is fitted, least. Its spectrum is therefore the likeliest of what no
column can explain (Patterson and Thompson, Biometrika 58, 1971), found by expectation and maximisation:
errors are as large as what is left and what the fit may have taken, together.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from smsid.diagnose.torque.candidates import SIMPLE, TorqueCandidate
from smsid.diagnose.torque.equations import TorqueEquations
from smsid.diagnose.torque.fit import FLOOR, rough_load
from smsid.diagnose.torque.whitening import Whitening

LOGGER = logging.getLogger(__name__)
MOST_TAKEN = 1 / 3  # of a joint's instants, that parameters may take of what its noise is learnt from
FEW_TAKEN = 1 / 6  # the same of parameters common to all joints: beside fewer, noise is told better
ROUNDS = 3  # of weights by what joints leave, before the noise has a spectrum
MOST_ROUNDS, SETTLED = 60, 0.003  # of expectation and maximisation, and the change that ends them
RANK = 1e-6
ROUNDED = 1e-9  # share of its largest at any joint below which a column does nothing at one


@dataclass(frozen=True)
class Block:
    """Equations of joints ``j`` that have parameters of their own: orthonormal columns (n, joints, k) that
    span what is fitted to their torques (n, joints).
    """

    j: slice
    span: np.ndarray
    torque: np.ndarray

    def fitted(self, whitening: Whitening, near: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what is left of the torques (n, joints), the independent errors of what is fitted (n,
        joints, k), both [N m | N], and how many parameters each joint's equations take (joints,).
        """
        own = whitening.only(self.j)
        white = own.apply_throughout(self.span, near[:, self.j])
        flat = white.reshape(-1, self.span.shape[2])
        root = cholesky(flat.T @ flat)
        target = own.apply_throughout(self.torque, near[:, self.j]).ravel()
        x = solve_triangular(root, solve_triangular(root, flat.T @ target, trans=1))
        inverse = solve_triangular(root, np.eye(len(root)))
        taken = ((flat @ inverse) ** 2).sum(axis=1).reshape(len(white), -1).sum(axis=0)
        return self.torque - self.span @ x, self.span @ inverse, taken


def learn_noise(equations: TorqueEquations, candidates: Sequence[TorqueCandidate]) -> Whitening:
    """Return the whitening of what no candidate explains, each joint fitted by itself where that can be.

    In a recording too short for that, parameters are common to all joints, beside all candidates, those of
    one parameter and a joint's own, or a joint's own friction, rotor and offset.
    """
    few = [c for c in candidates if len(c.joints) == 1 and len(c.names) == 1]
    simple = [c for c in few if c.shape in SIMPLE]
    # columns that depend on the torque take the predicted one: the measured one would explain its own noise
    load, count = rough_load(equations), len(equations.torque)

    def beside(chosen: Sequence[TorqueCandidate], *, shared: bool) -> list[Block]:
        columns = [c.columns(equations, load) for c in chosen]
        design = np.concatenate([equations.rows, *(equations.filtered(c) for c in columns)], axis=2)
        return blocks_of(design, equations.torque, shared=shared)

    blocks = beside(candidates, shared=False)
    taken = max(b.span.shape[2] for b in blocks)
    if taken > MOST_TAKEN * count:
        for chosen in (candidates, few, simple):
            blocks = beside(chosen, shared=True)
            taken = _weighed(blocks)[1].max()
            if taken < FEW_TAKEN * count:
                break
    if taken > MOST_TAKEN * count:
        blocks = beside((), shared=True)
    scale = FLOOR * np.sqrt(np.mean(equations.torque**2, axis=0))
    return likeliest_noise(blocks, scale, equations.near_rest)


def blocks_of(design: np.ndarray, torque: np.ndarray, *, shared: bool) -> list[Block]:
    """Return the equations of all joints, whose parameters are ``shared``, or of each joint by itself.

    Args:
        design: (n, joints, k) columns.
        torque: (n, joints) [N m | N].
        shared: whether parameters are common to all joints.
    """
    if shared:
        size = np.sqrt(np.mean(torque**2, axis=0)) + FLOOR
        flat = (design / size[:, None]).reshape(torque.size, -1)
        return [
            Block(
                slice(0, torque.shape[1]), _spanned(flat).reshape(*torque.shape, -1) * size[:, None], torque
            )
        ]
    size = np.linalg.norm(design, axis=0)
    acts = size > ROUNDED * size.max(axis=0)  # at other joints a column may be what rounding leaves
    own = [slice(j, j + 1) for j in range(torque.shape[1])]
    return [Block(j, _spanned(design[:, j.start][:, acts[j.start]])[:, None], torque[:, j]) for j in own]


def likeliest_noise(blocks: Sequence[Block], floor: np.ndarray, near: np.ndarray) -> Whitening:
    """Return the whitening whose restricted likelihood is largest.

    Args:
        blocks: equations, of all joints.
        floor: (joints,) least standard deviations of innovations [N m | N].
        near: (n, joints) whether joints are near rest.
    """
    found, _ = _weighed(blocks)
    for k in range(MOST_ROUNDS):
        parts = [b.fitted(found, near) for b in blocks]
        left = np.concatenate([residual for residual, *_ in parts], axis=1)
        spread = [spread[:, j] for _, spread, _ in parts for j in range(spread.shape[1])]
        before, found = found, Whitening.of(left, spread, floor, near)
        if np.abs(np.log(found.slow / before.slow)).max() < SETTLED:
            LOGGER.debug("noise settled after %d rounds", k + 1)
            break
    return found


def _weighed(blocks: Sequence[Block]) -> tuple[Whitening, np.ndarray]:
    """Return white noise as large as what is left, and how many parameters each joint takes (joints,)."""
    torque = np.concatenate([b.torque for b in blocks], axis=1)
    n, joints = torque.shape
    found = Whitening(np.zeros((joints, 0)), np.sqrt(np.mean(torque**2, axis=0)) + FLOOR)
    nowhere, taken = np.zeros(torque.shape, dtype=bool), np.zeros(joints)
    for _ in range(ROUNDS):
        parts = [b.fitted(found, nowhere) for b in blocks]
        left = np.concatenate([p[0] for p in parts], axis=1)
        taken = np.concatenate([p[2] for p in parts])
        sigma = np.sqrt((left**2).sum(axis=0) / np.maximum(n - taken, n / 4))
        found = replace(found, sigma=sigma + FLOOR * found.sigma)
    return found, taken


def _spanned(columns: np.ndarray) -> np.ndarray:
    """Return orthonormal directions that columns span but for rounding."""
    size = np.linalg.norm(columns, axis=0)
    u, singular, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return u[:, singular > RANK * singular.max(initial=0.0)]
