"""How a candidate does on a fit of torque equations, what is fitted and its simpler siblings free to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.torque._fit import TorqueFit
from smsid.diagnose.torque.candidates import SIMPLE, TorqueCandidate
from smsid.diagnose.torque.whitening import robust_p_value

ROUNDING = 1e-11
FOLDS = 4


@dataclass(frozen=True)
class TorqueScore:
    """How a candidate does on a fit.

    ``ratio`` on ``freedom`` degrees, ``kept`` the parameters that are excited, new and within their bounds,
    ``estimate`` of these with ``covariance``; ``p_value`` allows for uneven and correlated errors.
    ``columns`` (rows, d) are orthonormal.
    """

    candidate: TorqueCandidate
    ratio: float
    freedom: int
    kept: tuple[int, ...]
    estimate: np.ndarray
    covariance: np.ndarray
    p_value: float
    columns: np.ndarray

    def gain(self, samples: int) -> float:
        """Return the gain in Bayes's criterion, searched variants paid for."""
        return self.ratio - self.freedom * float(np.log(samples)) - 2.0 * float(np.log(self.candidate.grid))


def score_candidates(current: TorqueFit, candidates: Sequence[TorqueCandidate]) -> list[TorqueScore]:
    """Score candidates on a fit, the best first."""
    simple = [c for c in candidates if c.shape in SIMPLE]
    found = [s for c in candidates if (s := score(current, c, simple)) is not None]
    return sorted(found, key=lambda s: -s.gain(current.samples))


def score(
    current: TorqueFit, candidate: TorqueCandidate, simple: Sequence[TorqueCandidate] = ()
) -> TorqueScore | None:
    """Return the score of a candidate beside what is fitted; ``None`` when nothing of it is excited.

    One that is not simple itself has the ``simple`` ones of its own joints beside it: a coupling is what
    neither joint's own friction explains.
    """
    names = current.names
    kept = [i for i, n in enumerate(candidate.names) if n not in names]
    if not kept:
        return None
    beside = _own_simple(current, candidate, simple)
    left = current.left - beside @ (beside.T @ current.left)
    white = _white(current, candidate, kept)
    while kept:
        found = _project_columns(left, white, np.hstack([current.basis, beside]), current.rows)
        if found is None:
            return None
        estimate, covariance, basis, used = found
        kept, white = [kept[i] for i in used], white[:, used]
        below = [estimate[i] - candidate.lower[k] for i, k in enumerate(kept)]
        worst = int(np.argmin(below))
        if candidate.needs is not None and candidate.needs not in kept:
            return None
        if below[worst] >= 0.0:
            after = left - basis @ (basis.T @ left)
            # on the noise that its own equations have with it: what they still lack is not its merit
            level = max(1.0, float(np.mean(after[current.rows_of(candidate.joints)] ** 2)))
            ratio = float(np.sum((basis.T @ left) ** 2)) / level
            after, covariance = after / np.sqrt(level), covariance * level
            p = robust_p_value(basis[: current.rows], after[: current.rows], ratio, current.samples)
            return TorqueScore(candidate, ratio, basis.shape[1], tuple(kept), estimate, covariance, p, basis)
        del kept[worst]
        white = np.delete(white, worst, axis=1)
    return None


def predicts(current: TorqueFit, s: TorqueScore) -> bool:
    """Whether a candidate predicts parts of the recording it was not fitted to better than the fit without.

    The recording is cut in `FOLDS`; over all of them together, and in most, the squares left must fall.
    What only happens to look alike in one stretch does not pass.
    """
    more = _white(current, s.candidate, s.kept)
    joints = current.residual.shape[1]
    target = current.columns @ current.x + current.left
    gains = []
    for k in range(FOLDS):
        test = np.zeros(len(target), dtype=bool)
        test[joints * (k * current.samples // FOLDS) : joints * ((k + 1) * current.samples // FOLDS)] = True
        errors = []
        for columns in (current.columns, np.hstack([current.columns, more])):
            size = np.linalg.norm(columns[~test], axis=0)
            size[size == 0.0] = 1.0
            x = np.linalg.lstsq(columns[~test] / size, target[~test], rcond=1e-7)[0] / size
            errors.append(float(np.sum((target[test] - columns[test] @ x) ** 2)))
        gains.append(errors[0] - errors[1])
    return sum(gains) > 0.0 and sum(g > 0.0 for g in gains) > FOLDS // 2


def acts_on_all(current: TorqueFit, s: TorqueScore, simple: Sequence[TorqueCandidate], level: float) -> bool:
    """Whether a coupling shows in the equation of each of its joints by itself, at a level of significance.

    A motor that turns with two joints is felt by both alike, between half and twice as much as both together
    say; what one joint's torque has in common with another's rate for any other reason shows in one equation,
    and hardly in the other.
    """
    if len(s.candidate.joints) < 2:
        return True
    beside = _own_simple(current, s.candidate, simple)
    left = current.left - beside @ (beside.T @ current.left)
    fitted = np.hstack([current.basis, beside])
    white = _white(current, s.candidate, s.kept)
    for joint in s.candidate.joints:
        rows = current.rows_of((joint,))
        found = _project_columns(left, white * rows[:, None], fitted, current.rows)
        if found is None:
            return False
        basis = found[2]
        after = left - basis @ (basis.T @ left)
        size = max(1.0, float(np.mean(after[rows] ** 2)))
        ratio = float(np.sum((basis.T @ left) ** 2)) / size
        both, told = s.estimate[found[3]], np.linalg.pinv(found[1])
        share = float(found[0] @ told @ both) / float(both @ told @ both)
        alike = THRESHOLDS.torque_alike < share < 1.0 / THRESHOLDS.torque_alike
        scaled = after[: current.rows] / np.sqrt(size)
        if not alike or robust_p_value(basis[: current.rows], scaled, ratio, current.samples) > level:
            return False
    return True


def correlation(first: TorqueScore, second: TorqueScore) -> float:
    """Return the largest canonical correlation of two candidates beside what is fitted."""
    return float(np.linalg.svd(first.columns.T @ second.columns, compute_uv=False).max(initial=0.0))


def _white(current: TorqueFit, candidate: TorqueCandidate, kept: Sequence[int]) -> np.ndarray:
    columns = candidate.columns(current.equations, current.load)[:, :, list(kept)]
    return current.whitened(current.equations.filtered(columns))


def _own_simple(
    current: TorqueFit, candidate: TorqueCandidate, simple: Sequence[TorqueCandidate]
) -> np.ndarray:
    """Orthonormal basis of the simple candidates of a candidate's joints that are not fitted (rows, k)."""
    basis = np.zeros((len(current.left), 0))
    if candidate.shape in SIMPLE:
        return basis
    own = {n for n in candidate.names}
    for c in simple:
        if c.location in candidate.joints and not set(c.names) & (own | set(current.names)):
            fitted = np.hstack([current.basis, basis])
            found = _project_columns(current.left, _white(current, c, (0,)), fitted, current.rows)
            if found is not None:
                basis = np.column_stack([basis, found[2]])
    return basis


def _project_columns(
    left: np.ndarray, white: np.ndarray, fitted: np.ndarray, rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[int]] | None:
    """Estimate, covariance, orthonormal basis and places of the columns excited beside ``fitted``.

    ``rows`` are samples, those below them priors.
    """
    raw = np.einsum("ij,ij->j", white, white)
    beyond = white - fitted @ (fitted.T @ white)
    used: list[int] = []
    basis = np.zeros((len(beyond), 0))
    for i in range(white.shape[1]):
        rest = beyond[:, i] - basis @ (basis.T @ beyond[:, i])
        size = float(rest @ rest)
        # what a prior keeps from moving is not poorly excited
        by_prior = float(rest[rows:] @ rest[rows:]) > 0.5 * size
        if raw[i] > 0.0 and size > (ROUNDING if by_prior else THRESHOLDS.torque_excited) * raw[i]:
            used.append(i)
            basis = np.column_stack([basis, rest / np.sqrt(size)])
    if not used:
        return None
    inverse = np.linalg.inv(basis.T @ beyond[:, used])
    return inverse @ (basis.T @ left), inverse @ inverse.T, basis, used
