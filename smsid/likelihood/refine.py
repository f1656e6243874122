"""Maximum-likelihood refinement: one recording or several jointly, started from the linear method."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from smsid._short_repr import short_repr
from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.errors import DescriptionError
from smsid.identify.estimate import Estimate, distinct
from smsid.identify.momentum_rows import carried_matrix
from smsid.identify.paper.pipeline import Identification
from smsid.identify.sensor_correction import without_known_errors
from smsid.identify.stationary_joints import StationaryJoints, taken_away
from smsid.likelihood._knots import motion_ratio, refined_motion, resolve_motion
from smsid.likelihood._null_space import UnseenDirection, unseen_directions
from smsid.likelihood._null_space import notes as unseen_notes
from smsid.likelihood.combinations import Combination, effects_and_mass, inertial
from smsid.likelihood.consistent import consistent_inertias
from smsid.likelihood.fit import Fit, history_of
from smsid.likelihood.initial_guess import best_start, candidates
from smsid.likelihood.normal import Normal
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.prior import Cad, Prior
from smsid.likelihood.recording_term import RecordingTerm, piece_of
from smsid.likelihood.report import (
    METHOD,
    clock_notes,
    fit_notes,
    judged_by_share,
    nuisances,
    prior_notes,
    with_profiles,
)
from smsid.likelihood.search import search
from smsid.model import build_model
from smsid.model.identifiable import BaseParameters
from smsid.model.regressor import Regressor
from smsid.recording import Recording
from smsid.recording.checks import check_roles

UNRESOLVED = (
    "the joints' motion cannot be told as fast as the craft may ring: standard deviations may be too small; "
    "record the encoders faster and without gaps, or a shorter flight"
)
SWITCHED = (
    "thrust switches between samples of its command: when, as the sensors have it, is estimated too "
    "(switch_time, in order). Record on-times, or the command faster, and masses come out better"
)
OF_PARTS = "the search began with a first part, by which knots were judged; it ended with every sample"


@short_repr
@dataclass(frozen=True)
class Refinement:
    """A maximum-likelihood estimate and what it was made from.

    ``estimate`` holds every parameter with status and Gaussian interval; ``covariance`` (n, n) is that of its
    parameters, in order. ``description`` carries slosh and appendages as found; ``inertias`` are the rigid
    bodies' parameters (10,) by name, physically consistent (wheels included, appendages not; see
    `consistent`), of which only the combinations in the estimate are determined by the data; ``unseen`` names
    the directions that are not. ``described``, ``fit`` and ``prior`` are what profiles need.
    """

    estimate: Estimate
    covariance: np.ndarray
    description: Description
    unseen: tuple[UnseenDirection, ...]
    described: Parameters
    fit: Fit
    prior: Prior

    @cached_property
    def inertias(self) -> dict[str, np.ndarray]:
        """Inertial parameters (10,) of the rigid bodies by name, physically consistent."""
        at = self.fit.point.parameters
        n = at.inertias.size
        bodies = consistent_inertias(at, self.described, self.fit.normal.covariance()[:n, :n])
        return dict(zip(at.layout.names, bodies, strict=True))

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of two parameters of the estimate."""
        return self.estimate.correlation(first, second)


@single_threaded
def refine(
    description: Description,
    recordings: Sequence[Recording],
    start: Identification | Refinement | None = None,
    *,
    nuisance: Nuisance | None = None,
    cad: Cad | None = None,
    of_parts: bool = False,
) -> Refinement:
    """Refine an identification to the maximum of the likelihood of all channels of all recordings.

    Output error: the motion is predicted by the model from thrust (Exp. 1, attitude held) or from measured
    joint and wheel motion (Exp. 2, free floating, zero momentum), and compared with pose, velocity, gyro and
    accelerometers, whitened by noise levels estimated from the data. Joint torques and friction do not enter.
    Both experiments start at rest. Sources: design, section 4; Ljung, *System Identification*, chapter 7.

    ``start``: the linear method's result, or an earlier refinement of the same spacecraft. Without it the
    search begins at the description's values: good for modes within about 5 %.
    ``nuisance``: what is estimated beside biases and initial pose. ``cad``: what is known of the rigid
    bodies: one standard deviation of all described values, relative to the body's size, or (value, sigma) by
    name, as in `Prior`; what is known of effects stands in the description. ``of_parts``: the start is a
    refinement of a part of each recording. The measured motion then has knots as close at least as those
    parts needed; whether it needs more is not asked again of the whole.

    Raises `RecordingError` for unusable recordings, `NotIdentifiableError` when the search does not come to
    rest, `DescriptionError` for a spacecraft it cannot predict.
    """
    began = time.perf_counter()
    check_roles(recordings)
    for recording in recordings:
        without_known_errors(recording, description.effective_sensors()).check_consistency()
    model = build_model(description)
    described = Parameters.of(model)
    pairs = [piece_of(model, r, nuisance or Nuisance()) for r in recordings]
    names = distinct(p.name for p, _ in pairs)  # two flights of one experiment may be called the same
    pieces = [replace(p, name=n) for (p, _), n in zip(pairs, names, strict=True)]
    locals_ = tuple(local for _, local in pairs)
    most = [1.0] * len(pieces)
    if of_parts and isinstance(start, Refinement):  # as close as the part needed
        most = [1.0 / motion_ratio(whole, part) for whole, part in zip(pieces, start.fit.pieces, strict=True)]
    fine, locals_ = refined_motion(pieces, SearchPoint(described, locals_), most)
    finer = any(a is not b for a, b in zip(fine, pieces, strict=True))
    pieces, prior = fine, Prior(described, cad)
    if isinstance(start, Refinement):
        points = [SearchPoint(_restart_parameters(described, start), locals_)]
    else:
        points = [SearchPoint(p, locals_) for p in candidates(described, start)]
    first = best_start(pieces, points, prior)
    prepared = time.perf_counter()
    sought = search(pieces, first, prior)

    def gradients(seen: Evaluation, own: Sequence[RecordingTerm]) -> np.ndarray:
        return np.array([c.gradient for c in seen_in(own, seen, described)[0]])

    found, enough = sought.found, True
    if not of_parts:
        found, enough = resolve_motion(found, prior, gradients, finer)
    visits = (*sought.visits, *found.visits[len(sought.found.visits) :])
    searched = time.perf_counter()
    at = found.point.parameters
    combinations, notes = seen_in(found.pieces, found.seen, described)
    if not enough:
        notes.append(UNRESOLVED)
    if of_parts:
        notes.append(OF_PARTS)
    if sought.clocks:
        off = ", ".join(sorted(sought.clocks))
        notes.append(f"clocks that do not agree with the rest, estimated too: {off}")
    for piece, local in zip(found.pieces, found.point.locals, strict=True):
        if len(local.switch):
            notes.append(f"{piece.name}: {SWITCHED}")
    covariance = found.normal.covariance()
    jacobian = gradient_matrix(combinations, covariance.shape[0], at.size, found.pieces)
    reported_covariance = found.normal.covariance_of(jacobian)
    held = prior_shares(found.normal, jacobian, covariance)
    parameters = [
        judged_by_share(c, float(np.sqrt(v)), share)
        for c, v, share in zip(combinations, np.diag(reported_covariance), held, strict=False)
    ]
    parameters = with_profiles(parameters, found, prior, covariance)
    parameters += nuisances(found, np.sqrt(np.diag(reported_covariance))[len(combinations) :])
    notes += clock_notes(parameters)
    wide = np.sum(Prior(described).residual(at)[1] ** 2, axis=0)
    unseen = unseen_directions(at, found.normal, wide)
    if cad is not None:
        notes += prior_notes(parameters)
    done = time.perf_counter()
    estimate = Estimate(
        description=description.name,
        method=METHOD,
        parameters=tuple(parameters),
        recordings=tuple(names),
        timing={
            "preparation": prepared - began,
            "search": searched - prepared,
            "report": done - searched,
            "total": done - began,
        },
        notes=tuple(notes + unseen_notes(unseen) + fit_notes(found)),
        conditions={
            "iterations": float(found.iterations),
            "sum of squares / samples": found.cost / found.samples,
        },
        history=history_of(visits, found.pieces, found.samples, np.sqrt(np.diag(covariance))[: at.size]),
        covariance=reported_covariance,
    )
    return Refinement(estimate, reported_covariance, at.description(), unseen, described, found, prior)


def _restart_parameters(described: Parameters, start: Refinement) -> Parameters:
    """The described parameters with the values of an earlier refinement."""
    at = start.fit.point.parameters
    if at.names != described.names:
        raise DescriptionError(
            "The refinement to start from is of a spacecraft with other parameters.",
            advice="Start from a refinement of the same description.",
        )
    return described.with_inertias(at.inertias).with_scalars({s.name: s.value for s in at.scalars})


def seen_in(
    pieces: Sequence[RecordingTerm], seen: Evaluation, described: Parameters
) -> tuple[list[Combination], list[str]]:
    """Return what is reported (`reported_parameters`) of the motions that recordings show."""
    pairs = zip(pieces, seen.predictions, strict=True)
    return reported_parameters(seen.point.parameters, described, [x for p, x in pairs if not p.drive.held])


def reported_parameters(
    at: Parameters, described: Parameters, predictions: Sequence[Prediction]
) -> tuple[list[Combination], list[str]]:
    """Return what is reported at a point, and notes about what is not."""
    combinations = effects_and_mass(at, described)
    found, base, _ = inertial(at, described, predictions)
    notes = []
    if base is None:
        notes.append("no free-floating recording: inertias are not seen and stay as described")
    elif base.unseen:
        notes.append(f"do not enter the motion, and stay as described: {', '.join(base.unseen)}")
    if at.layout.unseen:
        notes.append(f"without extent in three directions, taken as known: {', '.join(at.layout.unseen)}")
    still = held_joints(at, predictions)
    if base is not None and still.joints:
        found += not_seen(at, described, still, base)
    notes += still.notes(at.layout.model)
    return combinations + found, notes


def gradient_matrix(
    combinations: Sequence[Combination], n: int, size: int, pieces: Sequence[RecordingTerm]
) -> np.ndarray:
    """Return the gradients (rows, n) of what is reported, nuisance parameters last."""
    rows = []
    for c in combinations:
        row = np.zeros(n)
        row[:size] = c.gradient
        rows.append(row)
    first = size
    for piece in pieces:
        for s in piece.slots:
            rows += list(np.eye(n)[first + s.start : first + s.start + s.size])
        first += piece.size
    return np.array(rows)


def prior_shares(normal: Normal, jacobian: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return which part of each variance the prior accounts for (rows,): 0 seen by the data, 1 not at all.

    ``jacobian`` (rows, n) of what is reported, ``covariance`` (n, n) of the parameters.
    """
    spread = jacobian @ covariance
    variance = np.diag(normal.covariance_of(jacobian))
    return np.einsum("ij,jk,ik->i", spread, normal.prior, spread) / variance


RESTING = 1e-7  # [rad/s] by which a held rate may vary: little of its noise was left (`measured_drive`)


def held_joints(at: Parameters, predictions: Sequence[Prediction]) -> StationaryJoints:
    """Return the joints and wheels that are held in all of the motions."""
    if not predictions:
        return StationaryJoints()
    model = at.layout.model

    def constant(columns: np.ndarray) -> tuple[int, ...]:
        spread = [np.ptp(p.v[:, columns], axis=0) for p in predictions]
        return tuple(np.flatnonzero(np.max(spread, axis=0) < RESTING).tolist())

    return StationaryJoints(constant(model.arm_joints.v), constant(model.wheels.v))


def not_seen(
    at: Parameters, described: Parameters, still: StationaryJoints, base: BaseParameters
) -> list[Combination]:
    """Return what is not among the ``base`` because joints stand still: the prior alone knows it."""
    model, theta, jacobian = at.layout.model, at.theta(), at.theta_jacobian()
    full = np.eye(len(theta)) + carried_matrix(at.layout.model, Regressor(model))
    out = []
    for c in taken_away(model, still.joints, base):
        row = c.row @ full
        value, nominal = float(row @ theta), float(row @ described.theta())
        out.append(Combination(c.name, c.unit, value, row @ jacobian, nominal))
    return out
