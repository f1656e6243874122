"""Whether a recording starts at rest, as both experiments of the paper do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from smsid.errors import NotIdentifiableError
from smsid.identify.robust import white_sigma
from smsid.recording import Recording

WINDOW = 1.0  # [s] from which the start is extrapolated, where a cubic describes what happens in it
FEWEST = 8  # samples of the shortest window
DEGREE = 3
SHORTER = 0.75  # the next window tried
HIGHER = 2  # degrees above the cubic whose terms show what it does not describe
REFUSED = 0.1  # probability with which a window that a cubic does describe is not taken for these terms
REFUSED_AT_ALL = 1e-3  # and for what is left in all
SIGMAS = 6.0
SHARE = 0.01  # of the later motion: what a start may have without mattering


@dataclass(frozen=True)
class StartingValue:
    """What a rate is at the first sample: ``value`` and one ``sigma`` of it, from the first ``samples``."""

    value: float
    sigma: float
    samples: int


def starting_value(time: np.ndarray, samples: np.ndarray) -> StartingValue:
    """Return the first value of a rate, extrapolated from as much of the beginning as a cubic describes.

    The window is the longest, up to a second, in which terms above the cubic are not significant and what is
    left is no larger than the samples' white noise (chi-squared tests): something that moves fast has a short
    one. If there is none, the shortest is taken and what the cubic leaves counts as noise.

    ``time`` (N,) [s], ``samples`` (N,) in the unit of the result, N at least `FEWEST`.
    """
    t = time - time[0]
    noise = float(white_sigma(samples))
    count = min(max(int(np.searchsorted(t, WINDOW)), FEWEST), len(t))
    while True:
        powers = np.vander(2.0 * t[:count] / t[count - 1] - 1.0, DEGREE + HIGHER + 1, increasing=True)
        q, _ = np.linalg.qr(powers)
        along = q.T @ samples[:count]
        left = float(np.sum((samples[:count] - q[:, : DEGREE + 1] @ along[: DEGREE + 1]) ** 2))
        free = count - DEGREE - 1
        higher = float(np.sum(along[DEGREE + 1 :] ** 2))
        allowed = noise**2 * chdtri([HIGHER, free], [REFUSED, REFUSED_AT_ALL])
        described = higher <= allowed[0] and left <= allowed[1]
        if described or count == FEWEST:
            break
        count = max(int(SHORTER * count), FEWEST)
    spread = noise if described else float(np.sqrt(left / free))
    # with the terms that were tested: what is not significant may still be there
    return StartingValue(float(q[0] @ along), spread * float(np.linalg.norm(q[0])), count)


def check_at_rest(name: str, rates: Mapping[str, tuple[np.ndarray, np.ndarray, str]]) -> None:
    """Raise `NotIdentifiableError` if something moves at the first sample.

    ``name`` of the recording; ``rates``: by what it is, times (N,) [s], raw samples (N, k) and their unit.
    The start is `starting_value`; it counts as rest within six of its standard deviations or 1 % of the later
    change, whichever is more.
    """
    for label, (time, samples, unit) in rates.items():
        if len(time) < FEWEST or not samples.size:
            continue
        found = [starting_value(time, x) for x in samples.T]
        start = np.array([s.value for s in found])
        later = np.abs(samples - start).max(axis=0)
        allowed = np.maximum(SIGMAS * np.array([s.sigma for s in found]), SHARE * later.max())
        over = np.abs(start) / np.maximum(allowed, 1e-300)
        worst = int(np.argmax(over))
        if over[worst] > 1.0:
            raise NotIdentifiableError(
                f"'{name}' does not start at rest: {label} is {start[worst]:.3g} {unit} at its first sample "
                f"(allowed: {allowed[worst]:.2g}).",
                advice="The method needs slosh, panels and momentum at rest at the start: give the recording "
                "from before the motion began, wheels standing still.",
                quantity=label,
                start=start,
                allowed=allowed,
                other_flight=True,
                samples=tuple(s.samples for s in found),
            )


def with_rest_before(recording: Recording, sources: Sequence[str], duration: float) -> Recording:
    """Return a recording that starts at rest with that rest before it: ``duration`` [s] of zeros of sources.

    A filter that has to guess what came before takes the first sample for it, noise and all: integrated, that
    one sample's noise would be an offset of the whole record. What jumps at the first sample is half there: a
    trapezoid then has its step where it is.
    """
    longer = {}
    for name in (c for c in recording.channels if c.rpartition(".")[0] in sources):
        time, values = recording.time(name), np.asarray(recording[name], dtype=float)
        step = float(np.median(np.diff(time)))
        count = math.ceil(duration / step)
        values = np.concatenate([0.5 * values[:1], values[1:]])
        early = time[0] - step * np.arange(count, 0, -1)
        longer[name] = (
            np.concatenate([early, time]),
            np.concatenate([np.zeros((count, *values.shape[1:])), values]),
        )
    return recording.with_channels(longer)
