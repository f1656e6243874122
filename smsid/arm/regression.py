"""Least squares over joints of different noise, with errors that are correlated in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import norm, t

from smsid.arm.near_rest import variance_ratio
from smsid.errors import NotIdentifiableError

ROUNDS = 10
SETTLED = 1e-3
STRETCHES = (6, 20)
"""Least and most stretches of time, whose errors are taken to be independent of each other."""

PER_STRETCH = 5
"""Correlation lengths that a stretch has at least, if six of them fit in the recording.

Of the residual; where that is not white, of the torques too: what the model lacks depends on where the arm is
and how it moves, so that errors are alike for as long as the motion is, however much noise is on top.
"""


MOST_ORDER = 6
"""Samples of its past that a residual is regressed on, at most."""

ROUNDING = 1e-12
"""Share of a variance, left by the past, that is rounding."""

LEFT = 0.05
"""Least share of the errors that the fit is taken to leave where it takes all: at a frequency, or of what one
stretch alone tells."""


@dataclass(frozen=True)
class JointRegression:
    """Solution of torque = rows x.

    ``x`` (n,), ``covariance`` (n, n), ``noise`` (joints,) standard deviation of the residual of each joint
    [N m], where it is not near rest, ``lags`` the number of samples over which the residual is correlated,
    ``condition`` of the scaled weighted rows.
    """

    x: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    lags: int
    condition: float

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (n,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def solve_joints(
    rows: np.ndarray,
    torque: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    near: np.ndarray | None = None,
    gain_sigma: np.ndarray | None = None,
    rough: bool = False,
) -> JointRegression:
    """Weighted least squares with one weight per joint, found with it; covariance from stretches of time.

    Near rest, where no law says what friction is, a joint's errors have a weight of their own.

    Friction that the model lacks is no white noise: the residual stays correlated, and differs with the
    motion. The covariance is `stretch_covariance`. A joint without a motor, whose torque is zero throughout,
    tells ratios of its parameters only, see `_without_scale`.

    Args:
        rows: (N, joints, n).
        torque: (N, joints) [N m].
        prior: means and standard deviations (n,), infinite where nothing is known; these weigh as much as the
            equations of one correlation length do.
        near: (N, joints) where joints are near rest, see `near_rest`; by default nowhere.
        gain_sigma: (joints,) relative standard deviations of what torques were multiplied by.
        rough: take errors for equally large everywhere, in the covariance: for steps on the way.

    Raises:
        NotIdentifiableError: fewer equations than unknowns, or columns that depend on each other.

    Source: Gautier (1997), *Dynamic identification of robots with power model*, for the weights.
    """
    samples, joints, n = rows.shape
    if samples * joints <= n:
        raise NotIdentifiableError(
            f"{samples * joints} equations for {n} unknowns.", advice="Record longer.", samples=samples
        )
    scale = np.linalg.norm(rows, axis=(0, 1))
    if not scale.min() > 0.0:
        raise NotIdentifiableError(
            "A parameter does not enter at all.", advice="Excite its joint.", column=int(scale.argmin())
        )
    # One triangle per joint, and one near rest, hold all that equations say; rounds only weight them anew.
    near = np.zeros((samples, joints), dtype=bool) if near is None else near
    places = [(j, w) for j in range(joints) for w in (~near[:, j], near[:, j]) if w.any()]
    triangles = [_triangle(rows[w, j] / scale, torque[w, j]) for j, w in places]
    # a joint without a motor has no torque: the others say what one weighs before there is a residual
    size = np.sqrt(np.mean(torque**2, axis=0))
    idle = np.flatnonzero(size == 0.0)
    given, rows, torque = rows, rows.copy() if idle.size else rows, torque.copy() if idle.size else torque
    noise = np.maximum(np.where(size > 0.0, size, size.max(initial=0.0)), 1e-12)
    level = np.tile(noise, (samples, 1))
    known, lags = _prior_rows(prior, scale), 1
    for _ in range(ROUNDS):
        weighted = known * np.sqrt(max(lags, 1))
        weights = [level[int(w.argmax()), j] for j, w in places]
        stacked = np.vstack([*(r / s for r, s in zip(triangles, weights, strict=True)), weighted])
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
        column = np.linalg.norm(triangle[:, :-1], axis=0)
        square = triangle[:n, :n] / column
        singular = np.linalg.svd(square, compute_uv=False)
        rank = np.count_nonzero(singular > 1e-10 * singular[0])
        if rank < n:
            raise NotIdentifiableError(
                f"Only {rank} of {n} combinations are excited.",
                advice="Move the joints through more configurations, rates and accelerations.",
                rank=int(rank),
            )
        x = solve_triangular(square, triangle[:n, n]) / column / scale
        for j in idle:
            rows[:, j], torque[:, j] = _without_scale(given[:, j], x)
        for k, (j, w) in enumerate(places):
            if j in idle:
                triangles[k] = _triangle(rows[w, j] / scale, torque[w, j])
        residual = torque - rows @ x
        larger = np.where(near, variance_ratio(residual**2, near), 1.0)
        noise = np.maximum(np.sqrt(np.mean(residual**2 / larger, axis=0)), 1e-12)
        before, level = level, noise * np.sqrt(larger)
        if known.size:
            lags = correlation_lags(residual / level)
        if np.all(np.abs(level - before) <= SETTLED * before):
            break
    white = residual / level
    lags = correlation_lags(white)
    if rough:
        root = np.linalg.inv(triangle[:n, :n])
        covariance = max(lags, 1) * root @ root.T
    else:
        longest = max(lags, correlation_lags(rows @ x)) if lags > 1 else 1
        stretches = int(np.clip(samples // (PER_STRETCH * longest), *STRETCHES))
        covariance = stretch_covariance(rows / scale / level[:, :, None], white, stretches, weighted[:, :-1])
    if gain_sigma is not None:
        root = np.linalg.inv(triangle[:n, :n])
        forces = np.einsum("tjn,tj->nj", rows, torque * gain_sigma / level**2) / scale[:, None]
        moved = root @ root.T @ forces
        covariance = covariance + moved @ moved.T
    covariance *= np.outer(1.0 / scale, 1.0 / scale)
    return JointRegression(x, covariance, noise, lags, float(singular[0] / singular[-1]))


def _triangle(rows: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return the triangle (k, n + 1) of rows (N, n) and torques (N,); most columns do not act on a joint."""
    used = np.append(np.any(rows != 0.0, axis=0), True)
    own = np.asarray(np.linalg.qr(np.column_stack([rows, torque])[:, used], mode="r"))
    out = np.zeros((len(own), used.size))
    out[:, used] = own
    return out


def stretch_covariance(
    rows: np.ndarray, residual: np.ndarray, stretches: int, prior: np.ndarray
) -> np.ndarray:
    """Return the covariance (n, n) of least squares whose errors are correlated and uneven, from stretches
    of time.

    Without a stretch the estimate is moved by ``(I - H_g)^-1 Q_g' e_g`` in coordinates where the information
    is I (the jackknife of clusters: MacKinnon, Nielsen and Webb 2023, CV3). The spread over few stretches is
    itself uncertain: it is shrunk (Ledoit and Wolf 2004) to what errors that are alike at all times, of the
    spectrum of every joint's residual, would give.

    Args:
        rows: (N, joints, n) whitened by the noise of every joint.
        residual: (N, joints) likewise.
        stretches: number of stretches.
        prior: (k, n) rows of what is known beforehand, in units of its noise.
    """
    samples, joints, n = rows.shape
    flat = rows.reshape(-1, n)
    root = np.linalg.solve(
        np.linalg.qr(np.vstack([flat, prior]), mode="r"), np.eye(n)
    )  # x = root @ coordinates
    basis = (flat @ root).reshape(samples, joints, n)
    count = int(min(stretches, max(samples // 10, 2)))
    starts = np.linspace(0, samples, count, endpoint=False).astype(int)
    scores = np.add.reduceat((basis * residual[:, :, None]).sum(axis=1), starts, axis=0)  # (count, n)
    moved = np.empty((count, n))
    for g, part in enumerate(np.split(basis, starts[1:])):
        share, axes = np.linalg.eigh(np.tensordot(part, part, ((0, 1), (0, 1))))
        moved[g] = axes / np.maximum(1.0 - share, LEFT) @ (axes.T @ scores[g])
    target = sum(_spectral_spread(basis[:, j], residual[:, j], count // 2) for j in range(joints))
    each = moved * np.sqrt(float(count))
    spread = each.T @ each / count
    distance = float(np.sum((spread - target) ** 2))
    scatter = float(sum(np.sum((np.outer(z, z) - spread) ** 2) for z in each)) / count**2
    share = min(scatter / max(distance, 1e-300), 1.0)
    few = float(t.ppf(0.975, count - 1) / norm.ppf(0.975)) ** 2  # 95 % of a spread over few stretches
    told = prior @ root
    return root @ (share * target + (1.0 - share) * few * spread + told.T @ told) @ root.T


def _spectral_spread(basis: np.ndarray, residual: np.ndarray, width: int) -> np.ndarray:
    """Return the covariance (n, n) of ``basis.T @ errors``, of basis (N, n) and errors of a spectrum.

    The spectrum is the residual's (N,): whitened by an autoregression, averaged over ``width`` frequencies
    to either side, and coloured again (Andrews and Monahan 1992); for what the fit took out at each frequency
    it is made up. It is nowhere below its mean: that would narrow intervals by what may be chance.
    """
    samples = len(residual)
    past = autoregression(residual, min(MOST_ORDER, samples // 20))
    gain = np.abs(np.fft.rfft(np.append(1.0, -past), samples)) ** 2
    waves = np.fft.rfft(basis, axis=0) / np.sqrt(samples)
    power = np.abs(np.fft.rfft(residual)) ** 2 / samples * gain
    left = 1.0 - np.sum(np.abs(waves) ** 2, axis=1)
    window = np.ones(2 * width + 1)
    power, left = (np.convolve(np.pad(x, width, mode="reflect"), window, "valid") for x in (power, left))
    power = power / np.maximum(left, LEFT * window.size) / gain
    power = np.maximum(power, np.mean(power))
    both = np.full(len(power), 2.0)  # frequencies below zero
    both[[0, -1] if samples % 2 == 0 else [0]] = 1.0
    return np.real(waves.conj().T @ (waves * (power * both)[:, None]))


def autoregression(x: np.ndarray, most: int) -> np.ndarray:
    """Return coefficients of the autoregression of x (n,) that Bayes's criterion prefers, of at most an
    order; the first is that of the sample before. No others where there are few samples.
    """
    n = len(x) - most
    if most == 0 or n < 4 * most or not np.any(x):
        return np.zeros(0)
    late = np.stack([x[most - k : len(x) - k] for k in range(most + 1)])
    return autoregression_of(late @ late.T / n, n)[0]


def autoregression_of(products: np.ndarray, samples: int) -> tuple[np.ndarray, float]:
    """Return coefficients (most,) of the autoregression of noise with mean products (most + 1, most + 1) of
    its samples and those before, and the variance of its innovations; of the order that Bayes's criterion
    prefers.
    """
    most, whole = len(products) - 1, float(products[0, 0])
    out, innovations = np.zeros(most), whole
    least = samples * np.log(whole) if whole > 0.0 else -np.inf
    for order in range(1, most + 1):
        past = slice(1, order + 1)
        found = np.linalg.lstsq(products[past, past], products[past, 0], rcond=None)[0]
        variance = float(products[0, 0] - found @ products[past, 0])
        if not variance > ROUNDING * whole:  # it is told by its past but for rounding
            break
        value = samples * np.log(variance) + order * np.log(samples)
        if value < least:
            out, innovations, least = np.append(found, np.zeros(most - order)), variance, value
    return out, innovations


class Projection:
    """Columns (B, n) that are fitted, to be projected out of others (Frisch-Waugh)."""

    def __init__(self, columns: np.ndarray) -> None:
        self.basis = _orthonormal(columns, 1e-9)

    def left(self, values: np.ndarray) -> np.ndarray:
        """Return what the columns leave of values (B,) or (B, m)."""
        return values - self.basis @ (self.basis.T @ values)

    def beyond(self, columns: np.ndarray, least: float) -> np.ndarray:
        """Return an orthonormal basis (B, k) of what columns (B, m) add: those of which more than a share
        ``least`` is left.
        """
        beyond = self.left(columns)
        new = np.linalg.norm(beyond, axis=0) > least * np.linalg.norm(columns, axis=0)
        return _orthonormal(beyond[:, new], 1e-6)


def _orthonormal(columns: np.ndarray, least: float) -> np.ndarray:
    """Return an orthonormal basis (B, k) of columns (B, n), singular values below ``least`` left out."""
    if not columns.shape[1]:
        return columns
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, singular, _ = np.linalg.svd(columns / size, full_matrices=False)
    return u[:, singular > least * singular.max(initial=1e-300)]


def _without_scale(rows: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``rows @ x = 0`` (N, n) divided by the size of its terms, linearised at x: rows and right side.

    What is wrong with such an equation is noise of its columns, in proportion to x: least squares would make
    it smaller by making x smaller. Over the size of the terms it does not change with the scale of x.
    """
    left, terms = rows @ x, np.sum(rows**2, axis=0) * x
    slope = terms / max(float(terms @ x), 1e-300)  # of the size's logarithm
    return rows - np.outer(left, slope), -left


def _prior_rows(prior: tuple[np.ndarray, np.ndarray] | None, scale: np.ndarray) -> np.ndarray:
    """Rows (k, n + 1) of a prior beside those of the triangles."""
    n = len(scale)
    if prior is None:
        return np.zeros((0, n + 1))
    mean, sigma = prior
    places = np.flatnonzero(np.isfinite(sigma))
    rows = np.zeros((len(places), n + 1))
    rows[np.arange(len(places)), places] = 1.0 / (sigma[places] * scale[places])
    rows[:, -1] = mean[places] / sigma[places]
    return rows


def correlation_lags(residual: np.ndarray) -> int:
    """Return the first lag at which the mean autocorrelation of residual (N, k) falls below 0.05.

    At most a tenth of the record. Columns of zeros are not there.
    """
    x = residual[:, np.any(residual != 0.0, axis=0)]
    if not x.size:
        return 1
    x = x - x.mean(axis=0)
    samples = len(x)
    size = 2 ** int(np.ceil(np.log2(2 * samples)))
    spectrum = np.abs(np.fft.rfft(x, size, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[: samples // 10 + 1]
    mean = np.mean(correlation / np.maximum(correlation[0], 1e-300), axis=1)
    below = np.flatnonzero(mean < 0.05)
    return int(below[0]) if below.size else samples // 10
