"""What a linear regression needs of its rows, in square-root form: memory does not grow with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid.identify._tls import TlsSolution, solve_factor, triangular
from smsid.identify.robust import inverse_root


@dataclass
class RowSums:
    """Triangular factors of the rows of several kinds of equation, ``kinds`` of them in every sample.

    ``factors`` (n + 1, n + 1) of [A b] by kind; ``moved`` of what noise once more changes of it. The Gram
    matrix would do too, at the square of the condition number.
    """

    kinds: int
    samples: int = 0
    factors: list[np.ndarray] = field(default_factory=list)
    moved: list[np.ndarray] = field(default_factory=list)

    def add(
        self, rows: np.ndarray, rhs: np.ndarray, again: tuple[np.ndarray, np.ndarray] | None = None
    ) -> None:
        """Add samples: rows (N, kinds, n) and right-hand sides rhs (N, kinds); ``again`` with more noise."""
        block = np.concatenate([rows, rhs[:, :, None]], axis=2)
        width = block.shape[2]
        if not self.factors:
            self.factors = [np.zeros((0, width))] * self.kinds
            self.moved = [np.zeros((0, width))] * self.kinds
        for k in range(self.kinds):
            self.factors[k] = triangular(np.vstack([self.factors[k], block[:, k]]))
        if again is not None:
            other = np.concatenate([again[0], again[1][:, :, None]], axis=2) - block
            for k in range(self.kinds):
                self.moved[k] = triangular(np.vstack([self.moved[k], other[:, k]]))
        self.samples += len(rows)

    def columns(self, kinds: Sequence[int], chosen: Sequence[int]) -> np.ndarray:
        """Return rows (k, n) with the Gram matrix of the n ``chosen`` columns in these kinds of equation."""
        return np.vstack([self.factors[k][:, list(chosen)] for k in kinds])

    def residual(self, chosen: Sequence[int], x: np.ndarray) -> np.ndarray:
        """Return the root mean square (kinds,) that unknowns x (n,) of the ``chosen`` columns leave."""
        full = [*chosen, -1]
        left = [np.linalg.norm(f[:, full] @ np.append(x, -1.0)) for f in self.factors]
        return np.array(left) / np.sqrt(self.samples)

    def solved(
        self, chosen: Sequence[int], weights: np.ndarray, names: Sequence[str]
    ) -> tuple[TlsSolution, np.ndarray]:
        """Return the total-least-squares solution of rows with ``weights`` (kinds,), for white errors.

        With W (n, n), W W' = (rows' rows)^-1. Columns are brought to the length of the right-hand side; their
        errors are as ``moved`` shows them. Raises what `solve_factor` raises.
        """
        full = [*chosen, -1]
        weighted = [w * f[:, full] for w, f in zip(weights, self.factors, strict=True)]
        factor = triangular(np.vstack(weighted))
        scale = np.append(
            np.linalg.norm(factor[:, :-1], axis=0) / np.linalg.norm(factor[:, -1]), 1.0
        )  # columns as long as the right-hand side
        noise = None
        rows = float(self.kinds * self.samples)
        if any(len(m) for m in self.moved):
            moved = np.vstack([w * m[:, full] for w, m in zip(weights, self.moved, strict=True)]) / scale
            covariance = moved.T @ moved / rows
            size = float(np.trace(covariance))
            noise = covariance + 1e-12 * size * np.eye(len(covariance)) if size > 0.0 else None
        found = solve_factor(factor / scale, rows, noise=noise, names=names)
        return replace(found, x=found.x / scale[:-1]), inverse_root(factor[:, :-1])


@dataclass
class ScoreSums:
    """The middle of a covariance for errors correlated over ``lags`` samples, as in `hac_covariance`.

    Keeps the last ``lags`` scores of what it was given.
    """

    lags: int
    meat: np.ndarray | None = None
    last: np.ndarray | None = None

    def add(self, rows: np.ndarray, residual: np.ndarray) -> None:
        """Add samples that follow those before: rows (N, kinds, n), residuals (N, kinds), both weighted."""
        score = np.einsum("nki,nk->ni", rows, residual)
        last = score[:0] if self.last is None else self.last
        meat = np.zeros((score.shape[1],) * 2) if self.meat is None else self.meat
        meat += score.T @ score
        joined = np.vstack([last, score])
        for lag in range(1, min(self.lags, len(joined) - 1) + 1):
            later = joined[max(len(last), lag) :]
            earlier = joined[max(len(last), lag) - lag : len(joined) - lag]
            gamma = later.T @ earlier
            meat += (1.0 - lag / (self.lags + 1.0)) * (gamma + gamma.T)
        self.meat, self.last = meat, joined[-self.lags :]

    def covariance(self, root: np.ndarray) -> np.ndarray:
        """Return the covariance (n, n), W as `RowSums.solved` gives it."""
        assert self.meat is not None
        return root @ (root.T @ self.meat @ root) @ root.T
