"""Bending modes of a flexible panel on a spacecraft: clamped and coupled, from accelerometers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from smsid.errors import NotIdentifiableError, RecordingError, SmsidError
from smsid.identify.modes import IdentifiedMode, Poles, mac
from smsid.identify.ssi import signal_matrix, ssi_cov
from smsid.identify.ssi_decimate import decimate, filter_length
from smsid.identify.ssi_input import ssi_cov_input
from smsid.identify.stabilisation import stable_modes

FEWEST_ROWS = 30
MOST_ROWS = 60
MODE_SHARE = 0.2
ORDERS = tuple(range(2, 22, 2))
BELOW = 0.005  # share of its frequency by which a coupled mode may be found below its clamped one


@dataclass(frozen=True)
class PanelModes:
    """Modes of a panel, ascending in frequency.

    Attributes:
        clamped: modes of the panel with its root held: properties of the panel alone, those of a modal model.
        coupled: modes of the whole spacecraft as its panel accelerometers see them, rigid-body coupling and
            fuel slosh included.
        status: how each was found.
    """

    clamped: tuple[IdentifiedMode, ...]
    coupled: tuple[IdentifiedMode, ...]
    status: str

    def partners(self) -> dict[int, int]:
        """Return which coupled mode (value) is which clamped one (key) with its root free.

        Letting the root go raises a mode's frequency, but not to that of the next (Rayleigh's interlacing
        theorem); of several in between, fuel slosh among them, it is that which bends the panel most.
        """
        found = {}
        for k, mode in enumerate(self.clamped):
            low = (1.0 - BELOW) * mode.frequency
            high = self.clamped[k + 1].frequency if k + 1 < len(self.clamped) else np.inf
            between = [i for i, m in enumerate(self.coupled) if low <= m.frequency < (1.0 - BELOW) * high]
            if between:
                found[k] = max(between, key=lambda i: _bends(self.coupled[i], mode))
        return found


def _bends(coupled: IdentifiedMode, clamped: IdentifiedMode) -> float:
    """Return the share of a coupled shape that is a clamped one's bending, the rest moving as the root."""
    basis = np.column_stack([clamped.shape / np.linalg.norm(clamped.shape), np.ones(len(clamped.shape))])
    bending, rigid = np.abs(np.linalg.lstsq(basis, coupled.shape, rcond=None)[0])
    return float(bending / (bending + rigid * np.sqrt(len(clamped.shape))))


def panel_modes(
    time: np.ndarray,
    panel_acceleration: np.ndarray,
    base_acceleration: np.ndarray,
    *,
    free_from: float | None = None,
    highest_frequency: float | None = None,
    most_rows: int = MOST_ROWS,
) -> PanelModes:
    """Clamped and coupled modes of a panel from accelerometers along its bending direction.

    Clamped: `ssi_cov_input` from the base acceleration to the panel's acceleration relative to rigid motion.
    Coupled: `ssi_cov` on the panel's raw acceleration, output-only. Both run at a ladder of sampling rates,
    each half the one above; a mode is read at the lowest rate of which its frequency is within a fifth (or
    the nearest to it, if it was found at several others only). Each rate uses as many block rows as the
    record allows, up to 60; the lowest rate is the last with 30. None of this depends on the modes sought.

    At a step of thrust a sample should be the mean of both sides, as an anti-aliased accelerometer gives. A
    simulator's right limit puts the step half a sample early: no matter for frequencies, but damping ratios
    come out high (0.0050 becomes 0.00504 at 100 Hz and 0.0052 at 20 Hz for the paper's Exp. 1).

    Args:
        time: (N,) instants, evenly spaced [s].
        panel_acceleration: (N, stations) acceleration of the stations along the bending direction, base axes
            [m/s^2].
        base_acceleration: (N,) acceleration of the base, which only translates, along the same direction
            [m/s^2].
        free_from: instant after which no known force acts [s]. Output-only identification takes every
            excitation for white noise, which a thrust profile is not: with ``free_from`` the coupled modes
            come from the free response after it, without it from the whole record.
        highest_frequency: modes above it are not sought [Hz]; default: up to a fifth of the sampling rate.
        most_rows: block rows at most; a first guess needs 30, at a quarter of the time.

    Raises:
        RecordingError: time is not evenly spaced.
        NotIdentifiableError: not finite, or too short for 30 block rows (evidence ``samples``).
        SmsidError: shapes do not fit.

    Source: paper, section III-A (SSI-COV in Exp. 1). Clamped modes are those of its Table 2; output-only
    identification cannot give them.
    """
    panel = signal_matrix(panel_acceleration, "panel_acceleration")
    base = signal_matrix(base_acceleration, "base_acceleration")
    instants, rate = _sampling_rate(np.asarray(time, float))
    if base.shape[1] != 1:
        raise SmsidError(f"base_acceleration {base.shape} must be that of one direction, (N,).")
    if not len(panel) == len(base) == len(instants):
        raise SmsidError(f"Lengths differ: time {len(instants)}, panel {len(panel)}, base {len(base)}.")
    stations = panel.shape[1]
    top = MODE_SHARE * rate if highest_frequency is None else highest_frequency

    def clamped(x: np.ndarray, band_rate: float, rows: int) -> tuple[Poles, ...]:
        most = min(rows, most_rows)
        return ssi_cov_input(x[:, :stations], x[:, stations:], band_rate, block_rows=most, orders=ORDERS)

    def coupled(x: np.ndarray, band_rate: float, rows: int) -> tuple[Poles, ...]:
        return ssi_cov(x, band_rate, block_rows=min(rows, most_rows), orders=ORDERS)

    free = panel if free_from is None else panel[instants > free_from]
    found = _over_rates(np.hstack([panel - base, base]), rate, stations + 1, top, clamped)
    seen = _over_rates(free, rate, stations, top, coupled)
    source = (
        "the whole record, its excitation taken for white"
        if free_from is None
        else (f"the free response after {free_from:g} s")
    )
    return PanelModes(
        clamped=found,
        coupled=seen,
        status=f"{len(found)} clamped modes with the base acceleration as known input; "
        f"{len(seen)} coupled modes, output-only, from {source}.",
    )


def _sampling_rate(time: np.ndarray) -> tuple[np.ndarray, float]:
    """``time`` (N,) and its sampling rate [Hz]."""
    steps = np.diff(time)
    if time.ndim != 1 or time.size < 2 or not np.all(np.isfinite(time)):
        raise RecordingError(f"time {time.shape} must be (N,), finite and have at least two instants.")
    step = (time[-1] - time[0]) / (time.size - 1)
    worst = int(np.argmax(np.abs(steps - step)))
    if step <= 0 or abs(steps[worst] - step) > 1e-3 * step:
        raise RecordingError(
            f"time is not evenly spaced: {steps[worst]:g} s after {time[worst]:g} s, {step:g} s on average.",
            advice="Resample the recording to a constant rate.",
            index=worst,
        )
    return time, float(1.0 / step)


def _block_rows(samples: int, channels: int) -> int:
    """Most block rows for which past and future of all channels do not outnumber the columns."""
    return min((samples + 1) // (2 * (channels + 1)), MOST_ROWS)


def _over_rates(
    x: np.ndarray,
    rate: float,
    channels: int,
    top: float,
    identify: Callable[[np.ndarray, float, int], tuple[Poles, ...]],
) -> tuple[IdentifiedMode, ...]:
    """Modes of ``x`` (N, channels) read each at the sampling rate that suits it."""
    samples = len(x)
    if _block_rows(samples, channels) < FEWEST_ROWS:
        raise NotIdentifiableError(
            f"{samples} samples of {channels} channels are too few for modes ({FEWEST_ROWS} block rows).",
            advice=f"Record at least {2 * FEWEST_ROWS * (channels + 1)} samples.",
            samples=samples,
        )
    rates: list[float] = []
    groups: list[list[IdentifiedMode]] = []
    factors = [1]
    while (
        _block_rows((samples - filter_length(2 * factors[-1])) // (2 * factors[-1]) + 1, channels)
        >= FEWEST_ROWS
    ):
        factors.append(2 * factors[-1])
    for factor in factors:
        if factor != factors[-1] and MODE_SHARE * rate / (2 * factor) >= top:
            continue
        slow, slow_rate = decimate(x, rate, factor)
        poles = identify(slow, slow_rate, _block_rows(len(slow), channels))
        rates.append(slow_rate)
        for mode in stable_modes(poles, slow_rate):
            _join(groups, mode)
    chosen = [_best(group, rates) for group in groups]
    within = [mode for mode in chosen if mode is not None and mode.frequency <= top]
    return tuple(sorted(within, key=lambda mode: mode.frequency))


def _join(groups: list[list[IdentifiedMode]], mode: IdentifiedMode) -> None:
    """Put a mode with the same one found at other rates."""
    for group in groups:
        same = abs(group[-1].frequency - mode.frequency) <= 0.02 * mode.frequency
        if same and mac(group[-1].shape, mode.shape)[0, 0] > 0.9 and group[-1].rate != mode.rate:
            group.append(mode)
            return
    groups.append([mode])


def _best(group: list[IdentifiedMode], rates: Sequence[float]) -> IdentifiedMode | None:
    """The mode at the lowest rate of which its frequency is within a fifth, or the nearest rate to that.

    None if it was found at one rate only and that is not the one it belongs to.
    """
    frequency = float(np.median([mode.frequency for mode in group]))
    suited = min((r for r in rates if frequency <= MODE_SHARE * r), default=max(rates))
    nearest = min(group, key=lambda mode: abs(np.log(mode.rate / suited)))
    return nearest if len(group) > 1 or nearest.rate == suited else None
