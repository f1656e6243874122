"""The same fit with analytic derivatives and with finite differences, in one run.

    python benchmarks/likelihood_speed.py

Exp. 1 is fitted both ways from the same start, its derivatives once from the variational equations and once
by forward differences of the outputs at the samples. For Exp. 2, with the joints' motion among the
parameters, one set of normal equations is compared: analytic, and by differences in 30 columns, scaled up.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
from _common import environment, write_result
from _likelihood_cases import clean, twin

from smsid.likelihood import normal as module
from smsid.likelihood.fit import fit
from smsid.likelihood.initial_guess import candidates
from smsid.likelihood.jacobian import PieceNormal, normal
from smsid.likelihood.nuisance_parameters import Nuisance, NuisanceValues
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import SearchPoint
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, piece_of
from smsid.model import build_model

NAME = "likelihood_speed"
STEP = 1e-6


def by_differences(
    piece: RecordingTerm,
    parameters: Parameters,
    local: NuisanceValues,
    prediction: Prediction,
    residuals: list[np.ndarray] | None,
) -> PieceNormal:
    """What `normal` returns for thrust, by forward differences in all columns."""
    assert residuals is not None
    size = parameters.size
    n = size + piece.size
    white = [c.whitening for c in piece.channels]
    here = np.concatenate([(r @ w.T).ravel() for r, w in zip(residuals, white, strict=True)])
    jacobian = np.zeros((len(here), n))
    for i in range(n):
        step = STEP * np.eye(n)[i]
        at, own = parameters.moved(step[:size]), piece.moved(local, step[size:])
        there = piece.residuals(at, own, piece.predict(at, own))
        parts = [(r @ w.T).ravel() for r, w in zip(there, white, strict=True)]
        jacobian[:, i] = (here - np.concatenate(parts)) / STEP
    return PieceNormal(jacobian.T @ jacobian, jacobian.T @ here, np.arange(0), None)


def fitted(start: SearchPoint, piece: RecordingTerm, prior: Prior) -> tuple[float, dict[str, Any]]:
    """CPU seconds of a fit, and where it ended."""
    begin = time.process_time()
    found = fit([piece], start, prior)
    seconds = time.process_time() - begin
    values = {s.name: s.value for s in found.point.parameters.scalars}
    return seconds, {"iterations": found.iterations, "cost": found.cost, "values": values}


def main() -> None:
    model = build_model(twin.description())
    described = Parameters.of(model)
    prior = Prior(described)
    rng = np.random.default_rng(0)
    off = described.moved(0.02 * rng.standard_normal(described.size))
    piece, local = piece_of(model, twin.noisy(clean("exp1"), 0), Nuisance())
    start = SearchPoint(candidates(off, None)[0], (local,))
    analytic, here = fitted(start, piece, prior)
    with patch.object(module, "normal", by_differences):
        differences, there = fitted(start, piece, prior)
    worst = max(abs(here["values"][k] / there["values"][k] - 1.0) for k in here["values"])

    piece, local = piece_of(model, twin.noisy(clean("exp2"), 0), Nuisance())
    piece = piece.following()
    prediction = piece.predict(described, local)
    residuals = piece.residuals(described, local, prediction)
    normal(piece, described, local, prediction, residuals)
    begin = time.process_time()
    normal(piece, described, local, prediction, residuals)
    once = time.process_time() - begin
    n, motion = described.size + piece.size, local.motion.size
    chosen = rng.choice(n + motion, 30, replace=False)
    begin = time.process_time()
    for i in chosen:
        step = STEP * np.eye(n + motion)[i]
        moved = replace(local, motion=local.motion + step[n:].reshape(local.motion.shape))
        at, own = described.moved(step[: described.size]), piece.moved(moved, step[described.size : n])
        piece.residuals(at, own, piece.predict(at, own))
    all_ = (time.process_time() - begin) / len(chosen) * (n + motion)
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "exp1, whole fit [CPU s]": {
            "analytic": analytic,
            "differences": differences,
            "ratio": differences / analytic,
            "iterations": [here["iterations"], there["iterations"]],
            "largest relative difference of slosh and panel": worst,
        },
        "exp2, normal equations [CPU s]": {
            "columns": n + motion,
            "analytic": once,
            "differences (from 30 columns)": all_,
            "ratio": all_ / once,
        },
    }
    print(result)
    write_result(NAME, result)


if __name__ == "__main__":
    main()
