"""Memory in a joint's torque: whether it depends on the way since the joint last turned back (hysteresis).

No law of rate and angle has it. Causes that are not there stand in for it piece by piece: Coulomb friction
for most of it, a small delay or a bias of the encoder for the rest.

Source: Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1 (1968).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smsid.diagnose.specification_tests import SpecificationTest, force_on
from smsid.estimation.map_estimate import Fit
from smsid.estimation.sensitivities import propagate

WAY = "the way since it turned"
WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)  # ways over which the torque turns round, over the joint's travel
SEEN = 1e-6  # share of a column's information that the fitted parameters leave of one that is tested
REST = 1e-9  # [rad] travel of a joint that does not move


def memory(found: Fit, locations: Iterable[str]) -> list[SpecificationTest]:
    """Return the test of every arm joint at ``locations`` (joints, or channels with the joint in brackets).

    Its column is a torque that follows the angle as Dahl's friction does, over the width that explains most.
    """
    model, run = found.changes.model, found.run
    places = set(locations)
    tests: list[tuple[str, list[np.ndarray], list[np.ndarray], int]] = []
    for name, kq, kv in zip(model.arm_joints.names, model.arm_joints.q, model.arm_joints.v, strict=True):
        here = any(p == name or p.endswith(f"[{name}]") for p in places)
        if not here or int(kv) in found.problem.locked:
            continue
        angle, middle = run.states.q[:, kq], run.middle.q[:, kq]
        travel = float(np.ptp(angle))
        if travel > REST:
            laws = [hysteresis(angle, middle, w * travel) for w in WIDTHS]
            tests.append((name, [a for a, _ in laws], [m for _, m in laws], int(kv)))
    if not tests:
        return []
    changes = [c for _, at, middle, kv in tests for c in force_on(found, kv, at, middle)]
    whitened = propagate(run, changes).reshape(-1, len(changes))
    left = found.left(whitened)
    raw = np.einsum("ij,ij->j", whitened, whitened)
    own = np.einsum("ij,ij->j", left, left)
    seen = own > SEEN * raw
    ratios = np.where(seen, (left.T @ found.residual) ** 2 / np.where(seen, own, 1.0), 0.0)
    best = ratios.reshape(len(tests), len(WIDTHS)).max(axis=1)
    return [
        SpecificationTest(f"torque of {n}", WAY, float(r), 1, len(WIDTHS), n)
        for (n, *_), r in zip(tests, best, strict=True)
    ]


def hysteresis(angle: np.ndarray, middle: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Dahl's friction of size 1 at ``angle`` (N,) and at ``middle`` (N - 1,) between them [rad].

    ``dz / dangle = (1 - z sign(rate)) / width``, from rest with nothing held.
    """
    way = np.empty(2 * len(angle) - 1)
    way[::2], way[1::2] = angle, middle
    z = np.zeros_like(way)
    for k, step in enumerate(np.diff(way)):
        towards = np.sign(step)
        z[k + 1] = towards + (z[k] - towards) * np.exp(-abs(step) / width)
    return z[::2], z[1::2]
