"""Where to linearise a filter that begins far from the truth: the maximum of a recording's beginning.

What the filter believes after the same samples ought to be that, too. A filter averages over torques that
nobody recorded, and noise of measured motion pulls its parameters as noise in a regressor does; the maximum,
at the likeliest motion, is not pulled. How far they are apart is Hausman's test, Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from smsid._statistics import NORMAL95, squared_length
from smsid.errors import SmsidError
from smsid.estimation.fit_quality import fit_quality
from smsid.estimation.flight import Flight
from smsid.estimation.flight_search import search_flights
from smsid.estimation.loosening import thin_flight
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import CommandTiming
from smsid.tracking._parameter_filter import ParameterFilter
from smsid.tracking._tracker import Tracker
from smsid.tracking.followed_parameters import Followed

LOGGER = logging.getLogger(__name__)
SHORTEST = 8.0  # [s] of a warm-up: less tells little
CHANCE = 1e-4  # with which a filter that is right is found apart from the maximum


@dataclass(frozen=True)
class WarmStart:
    """The most likely ``values`` (k,) of parameters ``index`` (k,) of a filter by the samples until ``until``
    [s], and their ``covariance`` (k, k); ``seconds`` [s] they are of.
    """

    index: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    until: float
    seconds: float

    def disagreement(self, f: ParameterFilter) -> float:
        """Return how many times wider the bands of a filter have to be to reach there; one where chance would
        have it so far away, or less.

        As the root mean square of the difference in its own standard deviations, and so that those of every
        single parameter (95 %) do.

        The difference of an estimate from a better one of the same data varies less than either; both are
        taken, and how far parameters may have wandered. Those with a trend are not asked.
        """
        trending = {x.of for x in f.followed if x.of >= 0}
        keep = np.array([i not in trending for i in self.index])
        if not keep.any():
            return 1.0
        index, covariance = self.index[keep], self.covariance[np.ix_(keep, keep)]
        away = f.values[index] - self.values[keep]
        own = f.parameter_covariance()[np.ix_(index, index)]
        wandered = np.diag([f.followed[i].rate ** 2 * self.seconds for i in index])
        if chi2.sf(squared_length(away, own + covariance + wandered), len(away)) > CHANCE:
            return 1.0
        most = float(np.max(np.abs(away) / np.sqrt(np.diag(own)))) / NORMAL95
        return max(1.0, most, float(np.sqrt(squared_length(away, own) / len(away))))


def linearise_by_search(
    tracker: Tracker, described: Point, flight: Flight, seconds: float
) -> tuple[tuple[CommandTiming, float], list[str], WarmStart | None]:
    """Linearise a tracker about the most likely parameters of a flight's first seconds.

    Returns how commands act by that and the steps that it takes [s], notes, and what was found. Only the
    point of linearisation changes: means and covariances stay what they are.
    """
    f = tracker.filter
    sought = [i for i, x in enumerate(f.followed) if x.of < 0]
    unknowns = []
    for i in sought:
        x, mean, sigma = f.followed[i], f.values[i], f.sigmas()[i]
        name = f"{flight.label}: {x.name}" if x.unknown.of_recording else x.name
        unknowns.append(replace(x.unknown, name=name, nominal=float(mean), sigma=float(sigma)))
    try:
        point, covariance, begun = _search_beginning(described, unknowns, flight, seconds, f.followed)
    except SmsidError as error:
        LOGGER.info("no warm-up: %s", error)
        said = (
            f"the search over the first {seconds:.4g} s did not come to rest: models begin at the "
            "description's values, and bands may be too narrow at first"
        )
        return (flight.problem.timing, flight.problem.substep), [said], None
    values, sigmas = f.values.copy(), f.sigmas()
    values[sought] = [point.value(u) for u in unknowns]
    sigmas[sought] = np.sqrt(np.diag(covariance))
    f.linearise_at(values, sigmas)
    times = begun.problem.data.times
    start = WarmStart(
        np.array(sought), values[sought], covariance, float(times[-1]), float(times[-1] - times[0])
    )
    return (begun.problem.timing, begun.problem.substep), [], start


def _search_beginning(
    described: Point,
    unknowns: Sequence[Unknown],
    flight: Flight,
    seconds: float,
    followed: Sequence[Followed],
) -> tuple[Point, np.ndarray, Flight]:
    """Return the most likely parameters of the first seconds of a flight with their covariance (k, k), and
    these as they were taken.

    Where one value each does not explain them, something may have changed: of half as many, and so on; of
    all of them where no beginning is explained. Raises `SmsidError` where the search does not come to rest.
    """
    seconds = min(seconds, float(np.ptp(flight.problem.data.times)))
    first: tuple[Point, np.ndarray, Flight] | None = None
    while True:
        begun = thin_flight(_first_seconds(flight, seconds, followed))  # where to be linear takes no more
        try:
            found, taken, _ = search_flights(described, unknowns, [begun])
        except SmsidError as error:
            LOGGER.info("%s", error)
            if first is None and 0.5 * seconds < SHORTEST:
                raise
        else:
            covariance = np.linalg.inv(found.gram) * np.outer(found.scales, found.scales)
            first = first or (found.point, covariance, taken[0])
            if fit_quality(found).judgement != "not explained":
                return found.point, covariance, taken[0]
        seconds *= 0.5
        if seconds < SHORTEST and first is not None:
            return first
        LOGGER.info("one value each does not explain it: a warm-up of %.3g s", seconds)


def _first_seconds(flight: Flight, seconds: float, followed: Sequence[Followed]) -> Flight:
    """Return the first seconds of a flight; to a search for one value, a bias that wanders is noise."""
    data = flight.problem.data
    n = int(np.searchsorted(data.times, data.times[0] + seconds, side="right"))
    attitude = {name: q[:n] for name, q in data.attitude.items()}
    sigma, duration = data.sigma.copy(), float(np.ptp(data.times[:n]))
    for block in data.blocks:
        own = [x.rate for x in followed if x.name.startswith(f"{block.channel}.bias.")]
        about_its_mean = max(own, default=0.0) * np.sqrt(duration / 6.0)  # rms of a walk
        sigma[block.rows] = np.hypot(sigma[block.rows], about_its_mean)
    cut = replace(data, times=data.times[:n], values=data.values[:n], attitude=attitude, sigma=sigma)
    return replace(flight, problem=replace(flight.problem, data=cut))
