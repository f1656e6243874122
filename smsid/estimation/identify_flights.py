"""Identify a spacecraft from any flights: all its description lists, at the maximum of the posterior."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from smsid._statistics import NORMAL95
from smsid.description.schema import Description
from smsid.errors import NotIdentifiableError
from smsid.estimation._confirmed import confirmed
from smsid.estimation._contradictions import Contradiction, contradictions
from smsid.estimation._exchange import distinct, likely_exchanges, with_exchanges
from smsid.estimation._maximum import maximise
from smsid.estimation._normal_equations import NormalEquations
from smsid.estimation._profile_interval import bound_intervals
from smsid.estimation._scale_conflict import scale_conflict
from smsid.estimation._unread_start import with_unread_start
from smsid.estimation.clock_shift import clock_shift, on_shifted_clock
from smsid.estimation.commands_between_samples import notes_on_commands, undecided_covariance
from smsid.estimation.fit_quality import FitQuality, fit_quality
from smsid.estimation.flight import Flight, FlightOptions, flight_of
from smsid.estimation.flight_search import convergence_error, search_flights, settled_maximum
from smsid.estimation.gaps import pieces_of
from smsid.estimation.inertial_combinations import reported_parameters, terms_of_total
from smsid.estimation.likelihood_profile import (
    BentInterval,
    BetterMaximum,
    PosteriorOfFlights,
    bent_intervals,
    loosely_told,
    poorly_known,
)
from smsid.estimation.loosening import with_likeliest_error
from smsid.estimation.panels import modal_panels, plain_panels
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.unknowns import sensor_unknowns, unknowns_of
from smsid.identify.estimate import Estimate, Iteration, ParameterEstimate, classify
from smsid.identify.parameter_estimate import SECOND_VIEW, parse_combination
from smsid.likelihood.combinations import Combination
from smsid.likelihood.prior import Cad
from smsid.likelihood.report import HELD, METHOD, judged_by_share
from smsid.recording import Recording
from smsid.recording.checks import check_roles

LOGGER = logging.getLogger(__name__)
RESTARTS = 3  # times that a more likely point may be met where intervals are sought


@dataclass(frozen=True)
class FlightEstimate:
    """An estimate from any flights, and what it was made from.

    ``covariance`` (n, n) is that of the estimate's parameters, in order. ``description`` has the effects as
    found, ``quality`` and ``contradictions`` say whether to believe them. ``found`` are the normal equations
    at the maximum, ``flights`` the recordings as they were taken.
    """

    estimate: Estimate
    covariance: np.ndarray
    description: Description
    quality: FitQuality
    contradictions: tuple[Contradiction, ...]
    found: NormalEquations
    flights: tuple[Flight, ...]


def identify_flights(
    description: Description,
    recordings: Sequence[Recording],
    *,
    cad: Cad | None = None,
    bodies: bool = True,
    options: FlightOptions | None = None,
    tell: Callable[[str], None] | None = None,
) -> FlightEstimate:
    """Estimate every parameter of bodies and listed effects from flights of any kind, jointly.

    The motion may begin anyhow; joints and wheels follow their measured motion, or the torques recorded
    (`FlightOptions`). Sensor biases and the state at the start of each recording are estimated beside.

    Args:
        description: its values are the first guess, its priors what is known beforehand.
        recordings: in the role estimation; sensors of the description are read from them by name.
        cad: what is known of rigid bodies, as in `smsid.likelihood.refine`.
        bodies: whether the rigid bodies are estimated; as described if not.
        options: how a recording is taken.
        tell: hears a line of progress at each step.

    Raises:
        RecordingError: no recording, or one that cannot be used.
        NotIdentifiableError: nothing is unknown, or the search does not come to rest.
        SimulationError: the description's motion loses the recording from the start.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only get in the way
        return _identify(description, recordings, cad, bodies, options or FlightOptions(), tell)


def _identify(
    description: Description,
    recordings: Sequence[Recording],
    cad: Cad | None,
    bodies: bool,
    options: FlightOptions,
    tell: Callable[[str], None] | None,
) -> FlightEstimate:
    began = time.perf_counter()
    check_roles(recordings)
    modal, densities = modal_panels(description)
    shift = clock_shift(recordings)
    described = Point.of(on_shifted_clock(modal, shift))
    asked = unknowns_of(described, cad=cad, bodies=bodies, components=True)
    labels = labels_of(recordings)
    whole = [
        flight_of(described, r, label, options, shift=shift)
        for r, label in zip(recordings, labels, strict=True)
    ]
    unknowns = [*asked.unknowns]
    flights: list[Flight] = []
    for flight in whole:
        pieces = pieces_of(described, flight)
        if len(pieces) == 1:  # what begins after a gap has no name of its own
            pieces[0], own = with_unread_start(pieces[0])
            unknowns += own
        flights += pieces
    taken = {c for e in modal.effect if e.unknowns() for c in e.biased_channels()}
    for flight in whole:
        present = set(flight.problem.recording.channels)
        sensors = description.effective_sensors()
        unknowns += sensor_unknowns(described.base, sensors, present, flight.label, taken)
    if not unknowns:
        raise NotIdentifiableError(
            "Nothing is unknown: all effects are marked `known`, and bodies are.", advice="Free something."
        )
    prepared = time.perf_counter()
    found, flights, visited = search_flights(described, unknowns, flights, tell)
    error = 0.0
    if fit_quality(found).quiet:
        flights, error = with_likeliest_error(found.point, flights)
        if error:
            found, more = settled_maximum(*maximise(found.point, unknowns, flights, tell=tell), flights, tell)
            visited += more
    found, others = with_exchanges(found, flights, tell)
    doubt, doubts = undecided_covariance(found, flights)
    searched = time.perf_counter()
    for _ in range(RESTARTS):
        quality = replace(fit_quality(found), model_error=error)
        rows = [_as_density(r, densities) for r in reported_parameters(found, described)]
        own = len(rows)
        rows += [_bias(u, i, found) for i, u in enumerate(unknowns) if u.of_recording]
        covariance = np.linalg.inv(found.gram) + doubt
        gradient = np.array([r.gradient for r in rows])
        spread = gradient @ covariance @ gradient.T * quality.widening**2
        spread = 0.5 * (spread + spread.T)  # rounding of what nothing tells is more than what is told
        sigma, shares = np.sqrt(np.diag(spread)), _prior_shares(found, gradient, covariance)
        size = np.array([abs(r.value if r.reference is None else r.reference) for r in rows])
        told = (shares <= HELD) & (np.arange(len(rows)) < own) & (size > 0.0)
        doubtful = poorly_known(found, covariance)
        doubtful += loosely_told(covariance, gradient[told], sigma[told] / size[told])
        posterior, wider = PosteriorOfFlights(found, flights), quality.widening
        try:
            bent = bent_intervals(found, posterior, doubtful, gradient, covariance, widening=wider)
            break
        except BetterMaximum as better:
            found, more = maximise(better.point, unknowns, flights, tell=tell)
            visited += more
    else:
        raise convergence_error(flights, fit_quality(found))
    disagree = contradictions(found, rows[:own], quality.widening)
    disagree = confirmed(disagree, found, flights, quality.widening)
    scale, untold = scale_conflict(found, flights, quality.widening)
    conflicts = [c.sentence for c in (quality.conflict, scale) if c is not None]
    quality = replace(quality, conflict=quality.conflict or scale)
    limits = bound_intervals(found, quality.widening)
    judgements = zip(rows, sigma, shares, strict=True)
    parameters = [
        _with_status(r, float(s), float(share), bent.get(k), quality)
        for k, (r, s, share) in enumerate(judgements)
    ]
    exchanges = likely_exchanges(found, distinct(found, others), quality.widening)
    for x in exchanges:
        otherwise = [_as_density(r, densities) for r in reported_parameters(x.found, described)]
        there, inverse = {r.name: r for r in otherwise}, np.linalg.inv(x.found.gram) * quality.widening**2
        parameters = [_either_way(p, there[p.name], inverse) if p.name in there else p for p in parameters]
        spread = spread + gradient @ x.covariance(found) @ gradient.T
    if exchanges:
        sigmas = zip(parameters, np.sqrt(np.diag(spread)), strict=True)
        parameters = [replace(p, sigma=float(s)) for p, s in sigmas]
    doubts += [x.note for x in exchanges]
    parameters = [_within_bounds(p, unknowns, limits) for p in parameters]
    terms = terms_of_total(rows[:own])
    parameters = [_with_terms(p, terms) if p.name == "total.mass" else p for p in parameters]
    told = [quality.sentence, *conflicts, *(c.sentence for c in disagree), *doubts]
    notes = list(dict.fromkeys(told))
    notes += [f"nothing tells the scale of '{c}': masses and inertias go with it" for c in untold]
    notes += [f"{f.label}: {n}" for f in flights for n in (*f.notes, *notes_on_commands(f))]
    notes += asked.notes()
    if quality.widening > 1.0:
        notes.append(
            f"standard deviations are {quality.widening:.3g} times those of the stated noise: "
            "what is left is larger, or slower, than noise"
        )
    done = time.perf_counter()
    estimate = Estimate(
        description=description.name,
        method=METHOD,
        parameters=tuple(parameters),
        recordings=tuple(labels),
        timing={
            "preparation": prepared - began,
            "search": searched - prepared,
            "report": done - searched,
            "total": done - began,
        },
        notes=tuple(notes),
        conditions={
            "iterations": float(len(visited) - 1),
            "dispersion": quality.dispersion,
            "widening": quality.widening,
        }
        | ({"model_error": error} if error else {}),
        history=_history(visited),
        covariance=spread,
    )
    description = on_shifted_clock(plain_panels(found.point.description), -shift)
    return FlightEstimate(estimate, spread, description, quality, disagree, found, tuple(flights))


def _as_density(row: Combination, densities: Mapping[str, tuple[str, float]]) -> Combination:
    """Return a beam's participation factor as the linear density it stands for; anything else as it is."""
    if row.name not in densities:
        return row
    name, size = densities[row.name]
    return replace(
        row,
        name=name,
        unit="kg/m",
        value=row.value * size,
        nominal=row.nominal * size,
        gradient=row.gradient * size,
    )


def labels_of(recordings: Sequence[Recording]) -> list[str]:
    """Return a name for every recording, unique: its own, or ``recording1``, ..."""
    names = [r.name or f"recording{k}" for k, r in enumerate(recordings, start=1)]
    repeated = {n for n in names if names.count(n) > 1}
    return [f"{n}#{k}" if n in repeated else n for k, n in enumerate(names, start=1)]


def _bias(unknown: Unknown, i: int, found: NormalEquations) -> Combination:
    row = np.zeros(len(found.unknowns))
    row[i] = unknown.scale
    return Combination(unknown.name, unknown.unit, found.point.value(unknown), row, 0.0)


def _prior_shares(found: NormalEquations, gradient: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return which part of each variance the prior accounts for (rows,): 0 seen by the data, 1 not at all."""
    spread = gradient @ covariance
    prior = (found.scales / [u.sigma for u in found.unknowns]) ** 2
    variance = np.einsum("ij,ij->i", spread, gradient)
    return np.einsum("ij,j,ij->i", spread, prior, spread) / np.maximum(variance, 1e-300)


def _with_status(
    row: Combination, sigma: float, share: float, bent: BentInterval | None, quality: FitQuality
) -> ParameterEstimate:
    """Return a parameter with its status; ``share`` of its variance is the prior's, ``bent`` its profile."""
    if ": " in row.name:
        return ParameterEstimate(row.name, row.value, row.unit, sigma, "by_product", "nuisance")
    found = judged_by_share(row, sigma, share)
    if share > HELD:
        return found
    if bent is not None:
        found = _with_profile_interval(found, bent)
    if quality.judgement == "not explained" and found.status == "identifiable":
        return replace(found, status="not_identifiable", note=quality.reason)
    return found


def _with_terms(total: ParameterEstimate, terms: Sequence[str]) -> ParameterEstimate:
    """Return the total mass as the sum of ``terms``: of a single body's mass it is a second view."""
    if not terms:
        return total
    if len(terms) == 1 and parse_combination(terms[0]) == {terms[0]: 1.0}:
        return replace(total, note=f"{SECOND_VIEW}{terms[0]}; {total.note}".rstrip("; "))
    return replace(total, note=f"{total.note}; the sum of {', '.join(terms)}".lstrip("; "))


def _with_profile_interval(p: ParameterEstimate, bent: BentInterval) -> ParameterEstimate:
    """Return a parameter with the interval of its profile, which may have no end, and the status it has."""
    along = "" if bent.goes_with == p.name else f" along {bent.goes_with}"
    low, high = bent.ends
    half = 0.5 * (high - low) / NORMAL95
    if not bent.followed:
        note = f"the likelihood is not Gaussian{along}, and could not be followed: no interval is known"
        return replace(p, status="not_identifiable", profile=(-np.inf, np.inf), note=note)
    note = f"the likelihood is not Gaussian: interval from its profile{along}"
    told = classify(p.name, p.value, p.unit, half, METHOD, nominal=p.nominal, reference=p.reference)
    if not np.isfinite(half):
        note += ", which has no end"
    note = f"{told.note}; {note}".lstrip("; ")
    return replace(told, sigma=p.sigma, profile=(p.value + low, p.value + high), note=note)


def _either_way(p: ParameterEstimate, other: Combination, covariance: np.ndarray) -> ParameterEstimate:
    """Return a parameter with an interval that includes that of another maximum, and the status it has.

    ``covariance`` (m, m) is that of the unknowns there, in scales.
    """
    reach = NORMAL95 * float(np.sqrt(other.gradient @ covariance @ other.gradient))
    low, high = p.interval
    low, high = min(low, other.value - reach), max(high, other.value + reach)
    told, half = p, 0.5 * (high - low) / NORMAL95
    if p.status == "identifiable":
        told = classify(p.name, p.value, p.unit, half, METHOD, nominal=p.nominal, reference=p.reference)
    note = "; ".join(dict.fromkeys(x for x in (told.note, p.note) if x))
    return replace(told, sigma=p.sigma, profile=(low, high), note=note)


def _within_bounds(
    p: ParameterEstimate, unknowns: Sequence[Unknown], limits: Mapping[str, tuple[float, float]]
) -> ParameterEstimate:
    """Return a parameter with an interval that its bounds allow; at one of them, that of its profile."""
    if p.name in limits:
        low, high = limits[p.name]
        other = f"at most {high:.4g}" if p.value == low else f"at least {low:.4g}"
        note = f"at its bound: {other} {p.unit} (95 %)"
        return replace(p, profile=(low, high), note=f"{note}; {p.note}" if p.note else note)
    own = next((u for u in unknowns if u.name == p.name), None)
    if own is None:
        return p
    lower, upper = (0.0, np.inf) if own.polar and own.polar.amplitude == p.name else (own.lower, own.upper)
    low, high = p.interval
    if low >= lower and high <= upper:
        return p
    return replace(p, profile=(float(max(low, lower)), float(min(high, upper))))


def _history(visited: Sequence[NormalEquations]) -> tuple[Iteration, ...]:
    """Return the course of the last search: cost per sample, and steps in standard deviations."""
    last = visited[-1]
    sigma = np.sqrt(np.diag(np.linalg.inv(last.gram))) * last.scales
    out: list[Iteration] = []
    before: np.ndarray | None = None
    for at in visited:
        here = np.array([at.point.value(u) for u in at.unknowns])
        step = None if before is None else float(np.abs((here - before) / sigma).max())
        out.append(Iteration(2.0 * at.objective / max(at.samples, 1), step))
        before = here
    return tuple(out)
