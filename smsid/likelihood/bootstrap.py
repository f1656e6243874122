"""Parametric bootstrap: the estimate's spread over noise drawn anew around its own prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from smsid._short_repr import short_repr
from smsid.likelihood.channels import Channel
from smsid.likelihood.combinations import effects_and_mass
from smsid.likelihood.fit import fit
from smsid.likelihood.nuisance_parameters import NuisanceValues
from smsid.likelihood.readings import draw_readings
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.refine import Refinement


@short_repr
@dataclass(frozen=True)
class Bootstrap:
    """Estimates (draws, k) of total mass, slosh and panels by ``names``, over noise drawn anew."""

    names: tuple[str, ...]
    values: np.ndarray

    @property
    def sigma(self) -> dict[str, float]:
        """Their standard deviations by name."""
        return dict(zip(self.names, np.std(self.values, axis=0, ddof=1).tolist(), strict=True))


def bootstrap(refinement: Refinement, draws: int, rng: np.random.Generator) -> Bootstrap:
    """Fit again ``draws`` times, to the refinement's own prediction with its own noise levels.

    Everything that the covariance linearises is done in full: what the two disagree in is curvature, or a
    search that does not find the maximum. Source: Efron and Tibshirani, *An Introduction to the Bootstrap*
    (1993), chapter 6.

    Raises what the fit raises.
    """
    found = refinement.fit
    prior, described = refinement.prior, refinement.described
    rows, names = [], ()
    with threadpool_limits(limits=1, user_api="blas"):
        for _ in range(draws):
            pieces = [
                _drawn(piece, residuals, local, rng)
                for piece, residuals, local in zip(
                    found.pieces, found.seen.residuals, found.point.locals, strict=True
                )
            ]
            again = fit(pieces, found.point, prior).point.parameters
            combinations = effects_and_mass(again, described)
            names = tuple(c.name for c in combinations)
            rows.append([c.value for c in combinations])
    return Bootstrap(names, np.array(rows))


def _drawn(
    piece: RecordingTerm, residuals: list[np.ndarray], local: NuisanceValues, rng: np.random.Generator
) -> RecordingTerm:
    """The piece with measurements drawn around its own prediction."""
    channels = tuple(
        replace(c, values=_around(c, r, rng)) for c, r in zip(piece.channels, residuals, strict=True)
    )
    drive = piece.drive
    if drive.joints is not None and piece.follows:
        clock = local.clock.get(drive.joints.sensor, np.zeros(2))
        drive = replace(drive, joints=draw_readings(drive.joints, local.motion, clock, rng))
    return replace(piece, channels=channels, drive=drive)


def _around(c: Channel, residual: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    noise = rng.standard_normal(residual.shape) @ np.linalg.cholesky(c.covariance).T
    if c.quantity == "attitude":
        return (Rotation.from_quat(c.values) * Rotation.from_rotvec(noise - residual)).as_quat()
    return c.values - residual + noise
