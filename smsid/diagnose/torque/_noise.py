"""The noise of measured torques, learnt beside all that a model may lack.

What a model lacks is no noise and must not hide in it. What a fit leaves has less of the noise than there
was: of slow noise, which looks like what is fitted, least. Whitening makes up for that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from smsid.diagnose.torque._equations import TorqueEquations
from smsid.diagnose.torque._fit import FLOOR, rough_load
from smsid.diagnose.torque.candidates import SIMPLE, TorqueCandidate
from smsid.diagnose.torque.whitening import Whitening, share_taken

MOST_TAKEN = 1 / 3  # of a joint's instants, that parameters may take of what its noise is learnt from
FEW_TAKEN = 1 / 6  # the same of parameters common to all joints: beside fewer, noise is told better
ROUNDS = 3  # of weights by what joints leave
RANK = 1e-6
ROUNDED = 1e-9  # share of its largest at any joint below which a column does nothing at one

Fitted = tuple[np.ndarray, list[np.ndarray]]
"""What is left of torques (n, joints), and of every joint the directions (n, k) that were taken."""


def learn_noise(equations: TorqueEquations, candidates: Sequence[TorqueCandidate]) -> Whitening:
    """Return the whitening of what no candidate explains, each joint fitted by itself where that can be.

    In a recording too short for that, parameters are common to all joints, beside all candidates, those of
    one parameter and a joint's own, or a joint's own friction, rotor and offset.
    """
    few = [c for c in candidates if len(c.joints) == 1 and len(c.names) == 1]
    simple = [c for c in few if c.shape in SIMPLE]
    # columns that depend on the torque take the predicted one: the measured one would explain its own noise
    load = rough_load(equations)

    def beside(
        chosen: Sequence[TorqueCandidate], fitted: Callable[[np.ndarray, np.ndarray], Fitted]
    ) -> Fitted:
        columns = [c.columns(equations, load) for c in chosen]
        design = np.concatenate([equations.rows, *(equations.filtered(c) for c in columns)], axis=2)
        return fitted(design, equations.torque)

    residual, taken = beside(candidates, fit_each_joint)
    if max(map(share_taken, taken)) > MOST_TAKEN:
        for chosen in (candidates, few, simple):
            residual, taken = beside(chosen, fit_all_joints)
            if max(map(share_taken, taken)) < FEW_TAKEN:
                break
    if max(map(share_taken, taken)) > MOST_TAKEN:
        residual, taken = beside((), fit_all_joints)
    scale = FLOOR * np.sqrt(np.mean(equations.torque**2, axis=0))
    return Whitening.of(residual, taken, scale, equations.near_rest)


def fit_each_joint(design: np.ndarray, torque: np.ndarray) -> Fitted:
    """Return what columns leave of torques, each joint fitted by itself.

    Args:
        design: (n, joints, k) columns.
        torque: (n, joints) [N m | N].
    """
    size = np.linalg.norm(design, axis=0)
    acts = size > ROUNDED * size.max(axis=0)  # at other joints a column may be what rounding leaves
    taken = [_spanned(design[:, j][:, acts[j]]) for j in range(torque.shape[1])]
    left = [torque[:, j] - u @ (u.T @ torque[:, j]) for j, u in enumerate(taken)]
    return np.column_stack(left), taken


def fit_all_joints(design: np.ndarray, torque: np.ndarray) -> Fitted:
    """Return the same with parameters common to all joints, which weigh by what each leaves of torques.

    Args:
        design: (n, joints, k) columns.
        torque: (n, joints) [N m | N].
    """
    n, joints = torque.shape
    sigma, residual, taken = np.sqrt(np.mean(torque**2, axis=0)) + FLOOR, torque, np.zeros((n, joints, 0))
    for _ in range(ROUNDS):
        u = _spanned((design / sigma[:, None]).reshape(n * joints, -1))
        left = (torque / sigma).ravel()
        residual, taken = (left - u @ (u.T @ left)).reshape(n, joints) * sigma, u.reshape(n, joints, -1)
        freedom = np.maximum(n - (taken**2).sum(axis=(0, 2)), n / 4)
        sigma = np.sqrt((residual**2).sum(axis=0) / freedom) + FLOOR * sigma
    return residual, [taken[:, j] for j in range(joints)]


def _spanned(columns: np.ndarray) -> np.ndarray:
    """Return orthonormal directions that columns span but for rounding."""
    size = np.linalg.norm(columns, axis=0)
    u, singular, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return u[:, singular > RANK * singular.max(initial=0.0)]
