"""A structure under ambient vibration: modes without a hand-picked order, with intervals; harmonics
flagged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import detrend

from smsid._short_repr import short_repr
from smsid._statistics import NORMAL95
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.estimate import Estimate, classify
from smsid.identify.modes import IdentifiedMode, Poles
from smsid.identify.ssi import block_hankel, checked_orders, observability_poles
from smsid.identify.ssi_decimate import decimate, filter_length
from smsid.identify.stabilisation import Stability, stable_modes, stable_poles
from smsid.lab._output_spectra import band_kurtosis, correlation_window, spectral_lines
from smsid.lab._window_agreement import (
    RESAMPLED_ORDERS,
    finest_windows,
    group_modes,
    least_agreeing,
    resampled_scatter,
    sigma_over_windows,
)
from smsid.lab.decay import mode_parameters

ORDERS = tuple(range(4, 42, 2))
WINDOWS = tuple(float(w) for w in np.geomspace(0.15, 3.0, 12))
"""Past and future tried, in multiples of the time over which correlations stand out of their own scatter."""


STABILITY = Stability(
    frequency=0.01, damping=0.2, shape=0.01, largest_damping=0.1, share_of_orders=0.4, contribution=0.1
)
MOST_ROWS = 200

FAINT = 0.02
"""Share of the covariance down to which a stable pole is told as faint, though not as a mode."""

UNEVEN = 5.0
"""Outputs of standard deviations further apart are also tried as of equal size."""

DRIFT_CYCLES = 20
"""Of what moves slower than this often in the record, no mode is identified: it is a drift."""


IMPULSIVE_KURTOSIS = 6.0
"""Twice a Gaussian's: a few impacts carry the record, not a lasting excitation."""


@short_repr
@dataclass(frozen=True)
class AmbientMode:
    """A mode and what is uncertain about it.

    ``frequency`` [Hz] and ``damping`` with standard deviations from resampling blocks of the record;
    ``windows`` the share of correlation windows it was found with; ``kurtosis`` of its narrow band: 3 for
    a mode that lasting noise excites, 1.5 for a harmonic of a machine, much more where a few impacts do.
    """

    frequency: float
    frequency_sigma: float
    damping: float
    damping_sigma: float
    shape: np.ndarray
    contribution: float
    windows: float
    kurtosis: float

    @property
    def impulsive(self) -> bool:
        """Whether a few impacts carry what the record says about the mode, whose interval is then wide."""
        return self.kurtosis > IMPULSIVE_KURTOSIS

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the frequency, Gaussian [Hz]."""
        return (
            self.frequency - NORMAL95 * self.frequency_sigma,
            self.frequency + NORMAL95 * self.frequency_sigma,
        )


@dataclass(frozen=True)
class PoleDiagram:
    """A stabilisation diagram: poles by model order with the masks (k,) of the stable ones.

    ``window`` [s] is the length of past and future they were found with, one of many.
    """

    window: float
    poles: tuple[Poles, ...]
    stable: tuple[np.ndarray, ...]


@short_repr
@dataclass(frozen=True)
class AmbientModes:
    """Modes of a structure, ascending.

    ``separations`` [Hz] are the distances of neighbouring modes with standard deviations, found on the same
    resampled records: close modes move together. ``harmonics`` [Hz] are sines of the excitation, which are
    no modes; ``rate`` [Hz] after decimation, ``window`` [s] over which correlations stand out. ``diagram``
    is that of the middle one of the windows used, or of all windows where none could be. ``faint`` [Hz] are
    stable too, but carry less of the covariance than a mode has to; ``drift`` is the share of the variance
    (of outputs without their straight lines) that moves fewer than `DRIFT_CYCLES` times in the record.
    """

    modes: tuple[AmbientMode, ...]
    separations: tuple[tuple[float, float], ...]
    harmonics: tuple[float, ...]
    rate: float
    window: float
    diagram: PoleDiagram
    faint: tuple[float, ...] = ()
    drift: float = 0.0

    def estimate(self, name: str) -> Estimate:
        """Return frequencies [Hz], damping ratios and separations [Hz] as an estimate of a structure."""
        gaps = [
            classify(f"mode{k + 1}.frequency - mode{k}.frequency", apart, "Hz", sigma, "modes")
            for k, (apart, sigma) in enumerate(self.separations, start=1)
        ]
        return Estimate(name, "SSI-COV", (*mode_parameters(self.modes), *gaps))


def ambient_modes(
    y: np.ndarray,
    rate: float,
    *,
    highest_frequency: float,
    replicates: int = 40,
    rng: np.random.Generator | None = None,
) -> AmbientModes:
    """Identify modes from the outputs alone, by SSI-COV over many orders and correlation windows.

    Twelve lengths of past and future are tried, from a seventh to three times the time over which
    correlations stand out of their scatter (Bartlett's formula). A mode must be stable over orders; of the
    windows, those are used that resolve most modes while three at least agree on them. Values are medians
    over windows. Intervals come from identifying again with blocks of the record drawn at random.

    Every output loses its straight line, so that a drift chooses no modes; no correlation reaches across a
    gap. Where outputs differ in size by more than `UNEVEN`, they are taken as they are, and divided by their
    standard deviations, too: the smaller may be in another unit, or noise across the motion. What resolves
    more modes counts; shapes come back in the units of y.

    Args:
        y: (N,) or (N, l) outputs [any unit, one for each]; rows that are not finite are gaps.
        rate: [Hz].
        highest_frequency: modes above are not sought [Hz]; the record is decimated accordingly.
        replicates: number of resamplings.
        rng: for them; default a generator of fixed seed.

    Raises:
        NotIdentifiableError: nothing finite, too short, or no correlation stands out.
        SmsidError: y has more than two dimensions.

    Source: Peeters and De Roeck (1999) for SSI-COV; Jacobsen, Andersen and Brincker (2007) for harmonics by
    kurtosis.
    """
    factor = max(1, int(rate / (4.0 * highest_frequency)))
    generator = rng or np.random.default_rng(0)
    found = []
    for alike in (False, True):
        prepared = _prepare_pieces(y, rate, factor, alike=alike)
        sizes = np.sqrt(np.mean(np.concatenate(prepared[1]) ** 2, axis=0))
        found.append(_identify_modes(prepared, rate, highest_frequency, replicates, generator))
        sizes = sizes[sizes > 0.0]
        if not sizes.size or sizes.max() <= UNEVEN * sizes.min():
            break
    return max(found, key=lambda f: len(f.modes))  # of equals the first


Prepared = tuple[list[np.ndarray], list[np.ndarray], float, np.ndarray]


def _identify_modes(
    prepared: Prepared, rate: float, highest_frequency: float, replicates: int, generator: np.random.Generator
) -> AmbientModes:
    """Return the modes of outputs that `_prepare_pieces` has made; arguments as of `ambient_modes`."""
    pieces, slow, slow_rate, scale = prepared
    x = max(pieces, key=len)
    # correlations of a machine's harmonic never die away
    window = min(correlation_window(max(slow, key=len), slow_rate), MOST_ROWS / slow_rate)
    outputs = slow[0].shape[1]
    least = max(ORDERS) // outputs + 2
    rows = sorted({min(max(int(w * window * slow_rate), least), MOST_ROWS) for w in WINDOWS})
    blocks = min(max(10, int(sum(map(len, slow)) / (8 * max(rows)))), 30)
    draws = generator.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=replicates).astype(float)
    found: list[list[IdentifiedMode]] = []
    loose: list[list[IdentifiedMode]] = []
    again: list[list[tuple[Poles, ...]]] = []
    every: list[tuple[Poles, ...]] = []
    for count in rows:
        covariances = _block_covariances(slow, count, blocks)
        chosen = checked_orders(ORDERS, count, outputs, count * outputs)
        left, singular, right = np.linalg.svd(covariances.mean(axis=0), full_matrices=False)
        poles = observability_poles(left, singular, right, outputs, slow_rate, chosen)
        every.append(poles)
        stable = stable_modes(poles, slow_rate, replace(STABILITY, contribution=FAINT))
        loose.append([m for m in stable if m.frequency <= highest_frequency])
        found.append([m for m in loose[-1] if m.contribution >= STABILITY.contribution])
        # What a resampled covariance changes lies in the leading subspaces; there it is small to decompose.
        kept = min(2 * max(chosen), singular.size)
        left, right = left[:, :kept], right[:kept]
        small = np.einsum("ai,kab,jb->kij", left, covariances, right, optimize=True)
        few = chosen[:: -(-len(chosen) // RESAMPLED_ORDERS)]
        again.append([])
        for weights in draws:
            inner, values, outer = np.linalg.svd(np.einsum("k,kij->ij", weights / weights.sum(), small))
            own = observability_poles(left @ inner, values, outer @ right, outputs, slow_rate, few)
            again[-1].append(own)
    used = finest_windows(found, STABILITY.frequency)
    groups = [
        g
        for g in group_modes([found[k] for k in used], STABILITY.frequency)
        if len(g) >= least_agreeing(len(used))
    ]
    lines = spectral_lines(x, rate, highest_frequency)
    groups = [g for g in groups if not any(_is_line(g, line) for line in lines)]
    groups = sorted(groups, key=lambda g: np.median([m.frequency for m in g]))
    scatter = resampled_scatter(groups, [again[k] for k in used]) if groups else np.zeros((0, 0, 0, 2))
    modes = tuple(
        _mode(g, len(used), sigma_over_windows(scatter[:, :, k]), x, rate, scale)
        for k, g in enumerate(groups)
    )
    gaps = tuple(
        (
            high.frequency - low.frequency,
            float(sigma_over_windows(scatter[:, :, k + 1, :1] - scatter[:, :, k, :1])[0]),
        )
        for k, (low, high) in enumerate(pairwise(modes))
    )
    middle = used[len(used) // 2] if used else len(rows) // 2
    shown = every[middle]
    diagram = PoleDiagram(rows[middle] / slow_rate, tuple(shown), stable_poles(shown, STABILITY))
    seen = group_modes([loose[k] for k in used or range(len(rows))], STABILITY.frequency)
    middles = [
        float(np.median([m.frequency for m in g])) for g in seen if len(g) >= least_agreeing(len(used))
    ]
    told = [*(m.frequency for m in modes), *lines]
    faint = [f for f in middles if all(abs(f - other) > 2 * STABILITY.frequency * f for other in told)]
    return AmbientModes(
        modes, gaps, lines, slow_rate, window, diagram, tuple(sorted(faint)), _drift(pieces, rate, modes)
    )


def _prepare_pieces(y: np.ndarray, rate: float, factor: int, *, alike: bool) -> Prepared:
    """Return the pieces of y between gaps, without their straight lines and scaled; the same, decimated.

    ``alike`` gives every output unit variance, else the largest.

    Returns:
        pieces (N_i, l), the same decimated, their rate [Hz], and the scale (l,) of the outputs: zero for one
        that does not move.
    """
    y = np.asarray(y, float)
    y = y[:, None] if y.ndim == 1 else y
    if y.ndim != 2 or y.shape[1] == 0:
        raise SmsidError(f"y {y.shape} must be (N,) or (N, channels).")
    finite = np.isfinite(y).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], finite, [False])).astype(int)))
    runs = [y[a:b] for a, b in edges.reshape(-1, 2).tolist()]
    longest = max(map(len, runs), default=0)
    # A piece of a few samples tells nothing of a mode but its straight line.
    pieces = [detrend(run, axis=0) for run in runs if len(run) >= max(longest // 20, 2 * factor + 1, 3)]
    if not pieces:
        raise NotIdentifiableError(
            f"Of {len(y)} samples none are finite in a row.", advice="Leave out the outputs with gaps."
        )
    slow = [decimate(piece, rate, factor) for piece in pieces if len(piece) >= filter_length(factor)]
    if not slow:
        decimate(max(pieces, key=len), rate, factor)  # says what is too short
    slow_rate = slow[0][1]
    spread = np.sqrt(np.mean(np.concatenate([piece for piece, _ in slow]) ** 2, axis=0))
    still = spread <= 1e-12 * np.abs(y[finite]).max(axis=0)
    scale = np.where(still, 0.0, spread if alike else spread.max())
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    return [p * inverse for p in pieces], [p * inverse for p, _ in slow], slow_rate, scale


def _drift(pieces: list[np.ndarray], rate: float, modes: Sequence[AmbientMode]) -> float:
    """Return the share of the variance that moves fewer than `DRIFT_CYCLES` times in the longest piece, and
    well below the slowest mode found.
    """
    piece = max(pieces, key=len)
    power = np.sum(np.abs(np.fft.rfft(piece, axis=0)) ** 2, axis=1)
    slowest = min((0.5 * m.frequency * len(piece) / rate for m in modes), default=np.inf)
    return float(power[1 : int(min(DRIFT_CYCLES, slowest))].sum() / max(power[1:].sum(), 1e-300))


def _is_line(group: list[IdentifiedMode], line: float) -> bool:
    frequency = float(np.median([m.frequency for m in group]))
    return abs(frequency - line) < 0.005 * line and float(np.median([m.damping for m in group])) < 0.005


def _block_covariances(pieces: list[np.ndarray], rows: int, blocks: int) -> np.ndarray:
    """Covariances (<= blocks, rows l, rows l) between future and past, of blocks of the pieces."""
    columns = [max(len(y) - 2 * rows + 1, 0) for y in pieces]
    if sum(columns) < 2 * blocks:
        raise NotIdentifiableError(
            f"{sum(map(len, pieces))} samples are too few for {rows} block rows.",
            advice="Record longer.",
            samples=sum(map(len, pieces)),
        )
    # A block counts by its columns, however the gaps have cut it.
    share = sum(columns) / blocks
    found = np.zeros((blocks, rows * pieces[0].shape[1], rows * pieces[0].shape[1]))
    at = 0.0
    for y, width in zip(pieces, columns, strict=True):
        a = 0
        while a < width:
            block = min(int((at + 1e-9) / share), blocks - 1)
            b = width if block == blocks - 1 else min(width, a + max(1, round((block + 1) * share - at)))
            found[block] += block_hankel(y, a + rows, rows, b - a) @ block_hankel(y, a, rows, b - a).T / share
            at, a = at + b - a, b
    return found


def _mode(
    group: list[IdentifiedMode],
    windows: int,
    sigma: np.ndarray,
    y: np.ndarray,
    rate: float,
    scale: np.ndarray,
) -> AmbientMode:
    frequency = float(np.median([m.frequency for m in group]))
    damping = float(np.median([m.damping for m in group]))
    peaked = band_kurtosis(y, rate, frequency, max(4.0 * damping, 0.01) * frequency)
    shape = group[len(group) // 2].shape * scale
    shape = shape / shape[np.argmax(np.abs(shape))]
    return AmbientMode(
        frequency, float(sigma[0]), damping, float(sigma[1]), shape,
        float(np.median([m.contribution for m in group])), len(group) / windows, peaked,
    )  # fmt: skip
