"""Find where to linearise a filter that begins far from the truth: the maximum of a recording's beginning."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import SmsidError
from smsid.estimation.flight import Flight
from smsid.estimation.flight_search import search_flights
from smsid.estimation.loosening import thin_flight
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming
from smsid.tracking._tracker import Tracker
from smsid.tracking.followed_parameters import Followed

LOGGER = logging.getLogger(__name__)


def linearise_by_search(
    tracker: Tracker, described: Point, flight: Flight, seconds: float
) -> tuple[tuple[CommandTiming, float], list[str]]:
    """Linearise a tracker about the most likely parameters of a flight's first seconds.

    Returns how commands act by that and the steps that it takes [s], and notes. Only the point of
    linearisation changes: means and covariances stay what they are.
    """
    f = tracker.filter
    begun = thin_flight(_first_seconds(flight, seconds, f.followed))  # where to be linear takes no more
    unknowns = []
    sought = [i for i, x in enumerate(f.followed) if x.of < 0]
    for i in sought:
        x, mean, sigma = f.followed[i], f.values[i], f.sigmas()[i]
        name = f"{flight.label}: {x.name}" if x.unknown.of_recording else x.name
        unknowns.append(replace(x.unknown, name=name, nominal=float(mean), sigma=float(sigma)))
    try:
        found, taken, _ = search_flights(described, unknowns, [begun])
    except SmsidError as error:
        LOGGER.info("no warm-up: %s", error)
        return (flight.problem.timing, flight.problem.substep), [
            f"the search over the first {seconds:.4g} s did not come to rest: models begin at the "
            "description's values, and bands may be too narrow at first"
        ]
    values, sigmas = f.values.copy(), f.sigmas()
    values[sought] = [found.point.value(u) for u in unknowns]
    sigmas[sought] = np.sqrt(np.diag(np.linalg.inv(found.gram))) * found.scales
    f.linearise_at(values, sigmas)
    return (taken[0].problem.timing, taken[0].problem.substep), []


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
