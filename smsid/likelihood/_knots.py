"""Whether the spline of the joints' motion has knots enough, and a finer one where it has not.

Akaike's criterion chooses the knots by what encoders see. Outputs may see more: a gyro feels the motion a
hundred times better than a coarse encoder, and a panel rings where the spline cannot follow. What the spline
leaves out is then taken for the panel's own motion, and as nothing in the model but the parameters may move
the panel at that frequency, their standard deviations come out too small: ten times, on a light bus with a
heavy arm.

So a search begins with knots enough to follow whatever the craft rings at. Where Akaike's are enough, or
nothing rings, a maximum is compared with one step towards the maximum of a finer spline that contains the
first, with twice as many knots at least. Where estimates or standard deviations differ, the finer spline it
is, and where nothing rings the comparison is made again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import eigvalsh

from smsid.likelihood.fit import Fit, fit
from smsid.likelihood.normal import Normal, normal_at
from smsid.likelihood.nuisance_parameters import NuisanceValues
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prediction import symmetric
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm
from smsid.model.spacecraft import SpacecraftModel

logger = logging.getLogger(__name__)

KNOTS_PER_PERIOD = 2.5
CLOSEST = 0.1  # [s] between knots
GROWTH = 1.05  # factor of a standard deviation that counts as none
SHIFT = 0.3  # standard deviations of an estimate that count as none

Gradients = Callable[[Evaluation, Sequence[RecordingTerm]], np.ndarray]
"""Rows (k, size) by which what is reported depends on the common parameters."""


@dataclass(frozen=True)
class Resolution:
    """What a finer spline changes: ``growth`` of a standard deviation [1], ``shift`` [standard deviations].

    The largest of all that is reported.
    """

    growth: float
    shift: float

    @property
    def is_enough(self) -> bool:
        """Whether the coarser one does."""
        return self.growth < GROWTH and self.shift < SHIFT


def resolve_motion(found: Fit, prior: Prior, gradients: Gradients, changed: bool) -> tuple[Fit, bool]:
    """Return the maximum with knots enough; and whether they are: not where there may be no more of them.

    As in a record with gaps between the readings of its joints: what a spline does there, no reading says.
    ``changed``: there are more of them already than Akaike's.

    Raises `NotIdentifiableError` when a search does not come to rest.
    """
    model = found.point.parameters.layout.model
    while True:
        if changed and all(resolves_ringing(p, model) for p in found.pieces):
            return found, True
        pieces, locals_ = refined_motion(found.pieces, found.point)
        if all(new is old for new, old in zip(pieces, found.pieces, strict=True)):
            limited = any(_has_gaps(p) and not resolves_ringing(p, model) for p in found.pieces)
            return found, not (changed or limited)
        seen = Evaluation.at(pieces, SearchPoint(found.point.parameters, locals_), found.seen)
        finer = normal_at(pieces, seen, prior)
        change = resolution(found.normal, finer, gradients(found.seen, found.pieces))
        logger.info("finer joint motion: sigma x %.3g, shift %.2g sigma", change.growth, change.shift)
        if change.is_enough:
            return found, True
        again, changed = fit(pieces, seen.point, prior, seen=seen, known=finer), True
        steps = found.iterations + again.iterations
        found = replace(again, iterations=steps, visits=(*found.visits, *again.visits))


def resolved_information(
    pieces: Sequence[RecordingTerm], point: SearchPoint, prior: Prior, rows: np.ndarray
) -> Normal:
    """Return the information at a point, the joints' motion on knots enough for ``rows`` (k, size).

    Without data: a bound of the standard deviations.
    """
    pieces, found = tuple(pieces), normal_at(pieces, Evaluation.at(pieces, point), prior, with_data=False)
    while True:
        more, locals_ = refined_motion(pieces, point)
        if all(new is old for new, old in zip(more, pieces, strict=True)):
            return found
        point = SearchPoint(point.parameters, locals_)
        after = normal_at(more, Evaluation.at(more, point), prior, with_data=False)
        enough = resolution(found, after, rows).is_enough
        pieces, found = more, after
        if enough or all(resolves_ringing(p, point.parameters.layout.model) for p in pieces):
            return found


def resolution(before: Normal, after: Normal, rows: np.ndarray) -> Resolution:
    """Return what another spline changes of what is reported, ``rows`` (k, size) by common parameters."""
    shift = rows @ (after.covariance() @ after.gradient)[: rows.shape[1]]
    sigma = [np.sqrt(np.diag(x.covariance_of(rows))) for x in (before, after)]
    return Resolution(float(np.max(sigma[1] / sigma[0])), float(np.max(np.abs(shift) / sigma[1])))


def refined_motion(
    pieces: Sequence[RecordingTerm], point: SearchPoint, most: Sequence[float] | None = None
) -> tuple[tuple[RecordingTerm, ...], tuple[NuisanceValues, ...]]:
    """Return the recordings and their local values with more knots for the same motion.

    Knots are ``most`` of the distance apart that they are, by recording, half of it by default; or as close
    as what rings asks for. A recording that may have no more is returned as it is.
    """
    model = point.parameters.layout.model
    shares = [0.5] * len(pieces) if most is None else most
    pairs = [_refine_knots(p, x, model, m) for p, x, m in zip(pieces, point.locals, shares, strict=True)]
    return tuple(p for p, _ in pairs), tuple(x for _, x in pairs)


def motion_ratio(whole: RecordingTerm, part: RecordingTerm) -> float:
    """Return by how much knots of a recording must be denser to lie as close as in a part of it."""
    joints, own = whole.drive.joints, part.drive.joints
    return 1.0 if joints is None or own is None else max(1.0, np.ceil(joints.spacing / own.spacing - 0.1))


def resolves_ringing(piece: RecordingTerm, model: SpacecraftModel) -> bool:
    """Return whether the spline follows whatever moves the craft as fast as it rings."""
    joints = piece.drive.joints
    return joints is None or joints.spacing < _period(piece, model) / KNOTS_PER_PERIOD < np.inf


def _refine_knots(
    piece: RecordingTerm, local: NuisanceValues, model: SpacecraftModel, most: float
) -> tuple[RecordingTerm, NuisanceValues]:
    joints = piece.drive.joints
    if joints is None or _has_gaps(piece):
        return piece, local
    wanted = min(most * joints.spacing, _period(piece, model) / KNOTS_PER_PERIOD)
    factor = min(int(np.ceil(joints.spacing / wanted)), int(joints.spacing / CLOSEST))
    if factor < 2:
        return piece, local
    finer = joints.with_coefficients(local.motion).divided(factor)
    piece = piece.with_joints(joints.refitted(factor * joints.intervals))
    return piece, replace(local, motion=finer.coefficients)


def _has_gaps(piece: RecordingTerm) -> bool:
    """Return whether the joints' readings leave out as much as lies between two knots."""
    joints = piece.drive.joints
    if joints is None:
        return False
    longest = [float(np.diff(s.times).max(initial=0.0)) for s in joints.samples if s.derivative == 0]
    return max(longest, default=0.0) > joints.spacing


def _period(piece: RecordingTerm, model: SpacecraftModel) -> float:
    """Shortest period [s] at which the craft rings with its joints held; infinite where nothing does."""
    springs = model.spring_v
    if not len(springs):
        return np.inf
    mass = symmetric(pin.crba(model.pin, model.pin.createData(), model.home))
    base = piece.drive.free[piece.drive.free < 6]
    own = mass[np.ix_(springs, springs)]
    if len(base):
        across = mass[np.ix_(base, springs)]
        own = own - across.T @ np.linalg.solve(mass[np.ix_(base, base)], across)
    return float(2.0 * np.pi / np.sqrt(eigvalsh(np.diag(model.stiffness), own)[-1]))
