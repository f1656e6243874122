"""Recordings as they should not be, made fit for filters and integrals: what is unusable is bridged.

Missing samples, samples that are not finite, at a sensor's limit, or spikes are replaced by a cubic through
their neighbours. Where they are single that costs nothing: the linear method low-passes far below the
sampling rate. A long bridge is a guess; what is identified across it is not to be believed to its interval,
which the caller has to say (`Mended.longest`). The likelihood leaves such samples out instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.errors import RecordingError
from smsid.identify.robust import white_sigma
from smsid.identify.usable import spikes, usable
from smsid.recording import Recording
from smsid.sensing import Sensor

LONGEST = 0.1  # [s] of a bridge that a low-pass of a few hertz does not notice
FEWEST = 0.5  # share of the samples of a channel that must be usable
PASSES = 3  # of looking for spikes: large ones hide smaller ones beside them
NEIGHBOURS = 6  # samples on each side of a short bridge that its cubic goes through
MEDIAN = 5  # samples: a step is no spike
CHAIN = 3  # rows from one hole to the next for them to be two bridges
REGULAR = 0.25  # steps that a sample may be off an even clock for the clock to count as even


@dataclass(frozen=True)
class Mended:
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


def mended(recording: Recording, sensors: Sequence[Sensor]) -> Mended:
    """Return a recording with what is unusable bridged; one without fault comes out as it went in.

    Raises `RecordingError` for a channel of which less than half is usable, for commands that are not
    finite, and what `Recording.check` raises of the result: clocks out of order, wrong units.
    """
    known = {c: (s, q) for s in sensors for q, c in zip(s.quantities, s.channels, strict=True)}
    kept = [n for n in recording.channels if n in known or n.startswith("command.")]
    clocks: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    channels, bridged = {}, {}
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
        full, bad = _full(values, clock, place, quantity, sensor, name)
        if bad.any():
            full = bridge(full, bad)
            if quantity == "attitude":
                full = full / np.linalg.norm(full, axis=1, keepdims=True)
            step = float(np.median(np.diff(clock)))
            bridged[name] = (_longest(bad) * step, float(np.mean(bad)))
        channels[name] = (clock, full)
    if not bridged and len(kept) == len(recording.channels):
        return Mended(recording.check(), {})
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
    return Mended(built.check(), bridged)


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


def bridge(values: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Return values (N, ...) with bad rows (N,) replaced by cubics through usable rows on both sides.

    A bridge goes by what lies within half its length of it, six rows at least; at the ends of the record the
    first or last usable row is repeated.
    """
    flat = np.array(values, dtype=float).reshape(len(values), -1)
    good = np.flatnonzero(~bad)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    for first, stop in edges.reshape(-1, 2):
        if first == 0 or stop == len(flat):
            flat[first:stop] = flat[good[0] if first == 0 else good[-1]]
            continue
        reach = max((stop - first) // 2, NEIGHBOURS)
        at = int(np.searchsorted(good, first))
        near = good[max(at - reach, 0) : at + reach]
        middle, width = 0.5 * (first + stop - 1), float(stop - first + 2 * reach)
        columns = np.vander((near - middle) / width, 4, increasing=True)
        fit = np.linalg.lstsq(columns, flat[near], rcond=None)[0]
        flat[first:stop] = np.vander((np.arange(first, stop) - middle) / width, 4, increasing=True) @ fit
    return flat.reshape(values.shape)


def _full(
    values: np.ndarray, clock: np.ndarray, place: np.ndarray, quantity: str, sensor: Sensor, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """The channel on the clock without holes, and which rows are to be bridged."""
    good = usable(values, quantity, sensor.error(quantity).saturation)
    if np.mean(good) < FEWEST:
        raise RecordingError(
            f"Only {100 * np.mean(good):.2g} % of the samples of '{name}' are finite and within the sensor's "
            "limits.",
            advice="Leave the sensor out of the description, or record again.",
            channel=name,
        )
    full = np.full((len(clock), *values.shape[1:]), np.nan)
    full[place] = values
    if quantity == "attitude" and good.any():
        kept = np.flatnonzero(good)
        rows = values[kept]
        signs = np.where(np.sum(rows[1:] * rows[:-1], axis=1) < 0.0, -1.0, 1.0)
        full[place[kept]] = rows * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
    bad = np.ones(len(clock), dtype=bool)
    bad[place[good]] = False
    if bad.all() or len(clock) < 2 * NEIGHBOURS:
        return full, bad
    sigma = white_sigma(full[~bad].reshape(np.count_nonzero(~bad), -1))
    if quantity == "attitude":
        sigma = np.full_like(sigma, sigma.max())  # of a component near one it is of second order
    # a channel that stands still, or was rounded, has a noise of zero and no spikes
    sigma = np.where(sigma > 0.0, sigma, np.inf)
    for _ in range(PASSES):
        flat = bridge(full, bad).reshape(len(full), -1)
        more = spikes(flat, sigma) & _off_median(flat, sigma) & ~bad
        if not more.any():
            break
        bad |= more
    return full, bad


def _off_median(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Which rows are far from the median of their neighbours in a component: spikes are, steps are not."""
    half = MEDIAN // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN, axis=0)
    return (np.abs(values - np.median(windows, axis=-1)) > 6.0 * sigma).any(axis=1)


def _longest(bad: np.ndarray) -> int:
    """Rows of the longest bridge; one or two usable rows do not end one."""
    at = np.flatnonzero(bad)
    if not len(at):
        return 0
    runs = np.split(at, np.flatnonzero(np.diff(at) > CHAIN) + 1)
    return max(int(run[-1] - run[0] + 1) for run in runs)
