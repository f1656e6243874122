"""Recordings as they should not be, made fit for filters and integrals: what is unusable is bridged.

Missing samples, samples that are not finite, at a sensor's limit, or spikes are replaced by a cubic through
their neighbours. Where they are single that costs nothing: the linear method low-passes far below the
sampling rate. A long bridge is a guess; what is identified across it is not to be believed to its interval,
which the caller has to say (`Mended.longest`). The likelihood leaves such samples out instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from smsid.errors import RecordingError
from smsid.identify.commanded import FEW
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_correction import on_event_clocks
from smsid.identify.valid_samples import enough_usable, isolated_outliers, largest_neighbour, spikes
from smsid.recording import Recording
from smsid.recording.attitude import continuous
from smsid.sensing import Sensor

LONGEST = 0.1  # [s] of a bridge that a low-pass of a few hertz does not notice
FEWEST = 0.5  # share of the samples of a channel that must be usable
PASSES = 3  # of looking for spikes: large ones hide smaller ones beside them
NEIGHBOURS = 6  # samples on each side of a short bridge that its cubic goes through
FAR = 6.0  # standard deviations
MEDIAN = 5  # samples: where several look like spikes, those far from their median are
EDGE = 2  # rows at an end, or beside a jump, that a parabola is followed to
CHAIN = 3  # rows from one hole to the next for them to be two bridges
TINY = 1e-6  # [s] by which rounding may move a clock
NO_CUTS = np.zeros(0, dtype=int)
REGULAR = 0.25  # steps that a sample may be off an even clock for the clock to count as even


@dataclass(frozen=True)
class FilledRecording:
    """A recording with every sample there and finite, channels of sensors and commands only.

    ``bridged`` holds, by channel, the longest bridge [s] and the share of samples that are bridged.
    """

    recording: Recording
    bridged: dict[str, tuple[float, float]]

    def longest(self, quantities: Sequence[str] | None = None) -> tuple[str, float]:
        """Return the channel with the longest bridge and its length [s], of some quantities or all."""
        own = {
            n: x[0]
            for n, x in self.bridged.items()
            if quantities is None or n.rsplit(".", 1)[1] in quantities
        }
        return max(own.items(), key=lambda x: x[1], default=("", 0.0))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was bridged, in words."""
        return tuple(
            f"'{self.recording.name}': {100 * share:.2g} % of {name} bridged (missing, not finite, at the "
            f"sensor's limit, or spikes), the longest for {longest:.3g} s"
            for name, (longest, share) in self.bridged.items()
        )


def fill_gaps(recording: Recording, sensors: Sequence[Sensor]) -> FilledRecording:
    """Return a recording with what is unusable bridged; one without fault comes out as it went in.

    Raises `RecordingError` for a channel of which less than half is usable, for commands that are not
    finite, and what `Recording.check` raises: clocks out of order, wrong units.
    """
    on_event_clocks(recording, sensors).check_consistency()
    known = {c: (s, q) for s in sensors for q, c in zip(s.quantities, s.channels, strict=True)}
    kept = [n for n in recording.channels if n in known or n.startswith("command.")]
    clocks: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    channels, bridged = {}, {}
    jumps = thrust_jumps(recording)
    for name in kept:
        times, values = recording.time(name), recording[name]
        if name not in known:
            if not np.isfinite(values).all():
                raise RecordingError(
                    f"'{name}' is not finite everywhere.", advice="Log what was commanded.", channel=name
                )
            channels[name] = (times, values)
            continue
        sensor, quantity = known[name]
        if times.tobytes() not in clocks:
            clocks[times.tobytes()] = even_clock(times)
        clock, place = clocks[times.tobytes()]
        happened = clock - sensor.error(quantity).lag
        cuts = np.searchsorted(happened, jumps - TINY) if quantity == "acceleration" else NO_CUTS
        full, bad = _full(values, clock, place, quantity, sensor, cuts)
        if bad.any():
            full = bridge(full, bad, cuts)
            if quantity == "attitude":
                full = full / np.linalg.norm(full, axis=1, keepdims=True)
            step = float(np.median(np.diff(clock)))
            bridged[name] = (_longest(bad) * step, float(np.mean(bad)))
        channels[name] = (clock, full)
    if not bridged and len(kept) == len(recording.channels):
        return FilledRecording(recording.check(), {})
    built = Recording.from_arrays(
        None,
        channels,
        labels={
            k: v
            for k, v in recording.labels.items()
            if "." not in k or any(n.startswith(f"{k.split('.')[0]}.") for n in kept)
        },
        provenance=recording.provenance,
        role=recording.role,
        name=recording.name,
    )
    return FilledRecording(built.check(consistency=bool(bridged)), bridged)  # again where it may differ


def even_clock(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an even clock (M,) without holes [s] and where the samples (N,) stand in it.

    A clock that is not even for other reasons than holes comes out as it is.
    """
    if len(times) < 3 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0):
        return times, np.arange(len(times))
    step = float(np.median(np.diff(times)))
    count = round((times[-1] - times[0]) / step)
    step = (times[-1] - times[0]) / count
    place = np.round((times - times[0]) / step).astype(int)
    off = np.abs(times - times[0] - place * step)
    if count + 1 == len(times) or off.max() > REGULAR * step or np.any(np.diff(place) < 1):
        return times, np.arange(len(times))
    clock = times[0] + step * np.arange(count + 1)
    clock[place] = times
    return clock, place


def thrust_jumps(recording: Recording) -> np.ndarray:
    """Return when the commanded force jumps (k,) [s]; nothing if it changes too often to be made of steps."""
    if "command.force" not in recording:
        return np.zeros(0)
    changes = np.any(np.diff(recording["command.force"], axis=0) != 0.0, axis=1)
    if np.count_nonzero(changes) > FEW * len(changes):
        return np.zeros(0)
    return recording.time("command.force")[1:][changes]


def bridge(values: np.ndarray, bad: np.ndarray, cuts: np.ndarray = NO_CUTS) -> np.ndarray:
    """Return values (N, ...) with bad rows (N,) replaced by cubics through usable rows on both sides.

    A bridge goes by what lies within half its length of it, six rows at least; at the ends of the record a
    parabola goes on for two rows, more are the first or last usable row again. ``cuts`` (k,) are rows at
    which the values jump: there one record ends and another begins.
    """
    flat = np.array(values, dtype=float).reshape(len(values), -1)
    for start, stop in _pieces(len(flat), cuts):
        if bad[start:stop].all() and stop > start:
            kept = np.flatnonzero(~bad)
            flat[start:stop] = flat[kept[np.argmin(np.abs(kept - start))]]
        elif stop > start:
            flat[start:stop] = _bridge_gaps(flat[start:stop], bad[start:stop])
    return flat.reshape(values.shape)


def _pieces(count: int, cuts: np.ndarray) -> list[tuple[int, int]]:
    edges = [0, *(int(c) for c in cuts if 0 < c < count), count]
    return list(pairwise(edges))


def _bridge_gaps(flat: np.ndarray, bad: np.ndarray) -> np.ndarray:
    good = np.flatnonzero(~bad)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    for first, stop in edges.reshape(-1, 2):
        if first == 0 or stop == len(flat):
            near = good[: 2 * NEIGHBOURS] if first == 0 else good[-2 * NEIGHBOURS :]
            if stop - first <= EDGE and len(near) == 2 * NEIGHBOURS:
                flat[first:stop] = _beyond(near, np.arange(first, stop)) @ flat[near]
            else:
                flat[first:stop] = flat[good[0] if first == 0 else good[-1]]
            continue
        reach = max((stop - first) // 2, NEIGHBOURS)
        at = int(np.searchsorted(good, first))
        near = good[max(at - reach, 0) : at + reach]
        middle, width = 0.5 * (first + stop - 1), float(stop - first + 2 * reach)
        columns = np.vander((near - middle) / width, 4, increasing=True)
        fit = np.linalg.lstsq(columns, flat[near], rcond=None)[0]
        flat[first:stop] = np.vander((np.arange(first, stop) - middle) / width, 4, increasing=True) @ fit
    return flat


def _full(
    values: np.ndarray,
    clock: np.ndarray,
    place: np.ndarray,
    quantity: str,
    sensor: Sensor,
    cuts: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The channel on the clock without holes, and which rows are to be bridged."""
    good = enough_usable(values, sensor, quantity, share=FEWEST)
    full = np.full((len(clock), *values.shape[1:]), np.nan)
    full[place] = values
    if quantity == "attitude" and good.any():
        kept = np.flatnonzero(good)
        full[place[kept]] = continuous(values[kept])
    bad = np.ones(len(clock), dtype=bool)
    bad[place[good]] = False
    if bad.all() or len(clock) < 2 * NEIGHBOURS:
        return full, bad
    sigma = white_sigma(full[~bad].reshape(np.count_nonzero(~bad), -1))
    if quantity == "attitude":
        sigma = np.full_like(sigma, sigma.max())  # of a component near one it is of second order
    # a channel that stands still, or was rounded, has a noise of zero and no spikes
    sigma = np.where(sigma > 0.0, sigma, np.inf)
    return full, with_spikes(full, bad, sigma, cuts)


def with_spikes(
    values: np.ndarray, bad: np.ndarray, sigma: np.ndarray, cuts: np.ndarray = NO_CUTS
) -> np.ndarray:
    """Return which rows (N,) of values (N, ...) are bad, or spikes of a motion smooth between ``cuts`` (k,).

    ``sigma`` is the noise of the components, ``bad`` (N,) are rows to look past.
    """
    bad = bad.copy()
    for _ in range(PASSES):
        flat = bridge(values, bad, cuts).reshape(len(values), -1)
        parts = [flat[a:b] for a, b in _pieces(len(flat), cuts)]
        found = [_off_median(x, sigma) | _at_ends(x, sigma) for x in parts]
        more = np.concatenate(found) & ~bad
        if not more.any():
            break
        bad |= more
    return bad


def _off_median(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Which rows are spikes: off the cubic through their neighbours, and far from their median.

    Those beside a spike are off the cubic too. Of neighbours it is the one most off the cubic, or the one
    farthest from the median: two spikes alike make the cubic miss the good ones beside them more.
    """
    if len(values) < MEDIAN:
        return np.zeros(len(values), dtype=bool)
    half = MEDIAN // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    a, b, c, d, e = (padded[k : k + len(values)] for k in range(MEDIAN))
    # of four the two in the middle; the median of five is that of these and the fifth
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    low, high = np.minimum(low, high), np.maximum(low, high)
    far = np.abs(values - np.clip(e, low, high)) / sigma
    farthest = (isolated_outliers(values, sigma) > FAR) & (far >= largest_neighbour(far)) & (far > FAR)
    return (spikes(values, sigma) & (far > FAR).any(axis=1)) | farthest.any(axis=1)


def _at_ends(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Which of the first and last rows are far from a parabola through those next to them.

    Far by the noise, and by how far those are from it: at a low rate the motion is no parabola.
    """
    out, n = np.zeros(len(values), dtype=bool), 2 * NEIGHBOURS
    if len(values) < n + EDGE:
        return out
    inner, outer = np.arange(EDGE, EDGE + n), np.arange(EDGE)
    weights = _beyond(inner, outer)
    size = np.sqrt(1.0 + np.sum(weights**2, axis=1))[:, None]
    through = _beyond(inner, inner)
    for rows in (slice(None), slice(None, None, -1)):
        x = values[rows]
        left = np.sqrt(np.sum((x[inner] - through @ x[inner]) ** 2, axis=0) / (n - 3))
        allowed = FAR * size * np.maximum(sigma, left)
        out[rows][outer] |= (np.abs(x[outer] - weights @ x[inner]) > allowed).any(axis=1)
    return out


def _beyond(near: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (at, near) of the parabola through rows ``near`` at rows ``at``."""
    scaled = np.vander((near - near[0]) / len(near), 3, increasing=True)
    return np.vander((at - near[0]) / len(near), 3, increasing=True) @ np.linalg.pinv(scaled)


def _longest(bad: np.ndarray) -> int:
    """Rows of the longest bridge; one or two usable rows do not end one."""
    at = np.flatnonzero(bad)
    if not len(at):
        return 0
    runs = np.split(at, np.flatnonzero(np.diff(at) > CHAIN) + 1)
    return max(int(run[-1] - run[0] + 1) for run in runs)
