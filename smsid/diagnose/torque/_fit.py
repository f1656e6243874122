"""Generalised least squares on torque equations: nominal parameters, effects found so far, and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid.arm.regression import solve_joints
from smsid.diagnose.torque._equations import TorqueEquations
from smsid.diagnose.torque.candidates import TorqueCandidate
from smsid.diagnose.torque.whitening import Whitening, cluster_projections
from smsid.effects.base import Effect

ROUNDS = 3
RANK = 1e-9
FLOOR = 1e-9
"""Noise is taken to be no less than this share of a joint's torque: of a simulation without any."""


@dataclass(frozen=True)
class TorquePrior:
    """What is known of the combinations before: ``mean`` and ``sigma`` (b,), infinite where nothing is.

    ``named`` has both by the combination's name.
    """

    mean: np.ndarray
    sigma: np.ndarray
    named: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def on(self, equations: TorqueEquations) -> TorquePrior:
        """Return what is known of the combinations of other equations, by name: in a tilt more shows."""
        names = equations.base.names
        if not self.named or (tuple(self.named) == names and len(names) == len(self.mean)):
            return self
        both = np.array([self.named.get(n, (0.0, np.inf)) for n in names])
        return replace(self, mean=both[:, 0], sigma=both[:, 1])

    @property
    def known(self) -> np.ndarray:
        """Mask (b,) of the combinations something is known of."""
        return np.isfinite(self.sigma)


@dataclass(frozen=True)
class TorqueTerm:
    """An accepted candidate with which of its parameters are free: places in its ``names``."""

    candidate: TorqueCandidate
    kept: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are free."""
        return tuple(self.candidate.names[i] for i in self.kept)


@dataclass(frozen=True)
class TorqueFit:
    """A fit of torque equations.

    ``x`` (b + terms,) combinations and the terms' parameters, ``covariance`` of both, never less than what
    uneven and correlated errors allow; ``load`` (N, joints) the predicted torque on the motion's instants
    [N m], ``residual`` (n, joints) measured minus predicted [N m]. ``columns`` (rows, k) and ``left`` (rows,)
    are whitened, priors below the samples; ``basis`` spans the columns.
    """

    equations: TorqueEquations
    prior: TorquePrior
    terms: tuple[TorqueTerm, ...]
    whitening: Whitening
    x: np.ndarray
    covariance: np.ndarray
    load: np.ndarray
    residual: np.ndarray
    columns: np.ndarray
    left: np.ndarray
    basis: np.ndarray

    @property
    def samples(self) -> int:
        """Instants that count."""
        return len(self.residual) - self.whitening.order

    @property
    def rows(self) -> int:
        """Whitened equations, priors not counted."""
        return self.samples * self.residual.shape[1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of x."""
        return (*self.equations.base.names, *(n for t in self.terms for n in t.names))

    @property
    def objective(self) -> float:
        """Sum of squares, priors included."""
        return float(self.left @ self.left)

    def term_values(self, term: TorqueTerm) -> tuple[np.ndarray, np.ndarray]:
        """Return the values (d,) and standard deviations (d,) of a term's parameters."""
        index = [self.names.index(n) for n in term.names]
        return self.x[index], np.sqrt(np.diag(self.covariance)[index])

    def rows_of(self, joints: Sequence[str]) -> np.ndarray:
        """Return the mask (rows + priors,) of the equations of some joints."""
        mask = np.zeros((self.samples, self.residual.shape[1]), dtype=bool)
        mask[:, [self.equations.names.index(j) for j in joints if j in self.equations.names]] = True
        if not mask.any():
            mask[:] = True  # what is no joint acts on all
        return np.concatenate([mask.ravel(), np.zeros(len(self.left) - mask.size, dtype=bool)])

    def without(self, terms: Sequence[TorqueTerm]) -> TorqueFit:
        """Return the fit with only some of its terms, on the same noise and predicted torques."""
        own = term_columns(self.equations, terms, self.load)
        found = _solve(self.equations, self.prior, tuple(terms), own, self.whitening)
        return replace(found, load=self.load)

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """Return torques (n, joints, d) whitened, with zeros for the priors: (rows + priors, d)."""
        white = self.whitening.apply(values, self.equations.near_rest)
        flat = white.reshape(-1, values.shape[2])
        return np.vstack([flat, np.zeros((len(self.left) - len(flat), flat.shape[1]))])


def rough_load(equations: TorqueEquations) -> np.ndarray:
    """Return the torque (N, joints) that the combinations alone predict, all joints alike [N m]."""
    size = np.sqrt(np.mean(equations.torque**2, axis=0)) + FLOOR
    plain = Whitening(np.zeros((len(size), 0)), size)
    free = TorquePrior(np.zeros(equations.rows.shape[2]), np.full(equations.rows.shape[2], np.inf))
    none = np.zeros((*equations.motion.torque.shape, 0))
    return _solve(equations, free, (), none, plain).load


def fit_torques(
    equations: TorqueEquations,
    prior: TorquePrior,
    terms: Sequence[TorqueTerm],
    whitening: Whitening,
    *,
    load: np.ndarray | None = None,
) -> TorqueFit:
    """Fit combinations and terms.

    Args:
        equations: of a recording.
        prior: of the combinations.
        terms: effects in the model.
        whitening: of the noise.
        load: (N, joints) predicted torques [N m] to start from, for columns that depend on them.
    """
    load = equations.motion.torque if load is None else load
    for _ in range(ROUNDS - 1):
        load = _solve(equations, prior, tuple(terms), term_columns(equations, terms, load), whitening).load
    return _solve(equations, prior, tuple(terms), term_columns(equations, terms, load), whitening)


def refit_as_identification(found: TorqueFit) -> TorqueFit:
    """Return a fit with values and covariance by the weights that identification has, see `solve_joints`.

    A search whitens its equations, to tell causes by small fast differences. What the model still lacks is
    slow, and whitened equations give values that predict other recordings less well. ``left``, ``columns``
    and ``basis`` stay the search's, whose tests they are for. Combinations that no motion excites stay
    nothing, as there; where some are known beforehand and others are not excited, the fit is returned.
    """
    size = np.linalg.norm(found.columns, axis=0)
    size[size == 0.0] = 1.0
    _, singular, vt = np.linalg.svd(found.columns / size, full_matrices=False)
    excited, prior = np.eye(len(size)), None
    if singular[-1] <= RANK * singular[0]:
        if found.prior.known.any():
            return found
        excited = vt[singular > RANK * singular[0]].T / size[:, None]
    elif found.prior.known.any():
        terms = len(found.x) - len(found.prior.mean)
        mean = np.append(found.prior.mean, np.zeros(terms))
        prior = mean, np.append(found.prior.sigma, np.full(terms, np.inf))
    equations = found.equations
    for _ in range(ROUNDS):
        own = term_columns(equations, found.terms, found.load)
        design = np.concatenate([equations.rows, equations.filtered(own)], axis=2)
        solved = solve_joints(design @ excited, equations.torque, prior, near=equations.near_rest)
        x, every = excited @ solved.x, np.concatenate([equations.fine, own], axis=2)
        covariance, residual = excited @ solved.covariance @ excited.T, equations.torque - design @ x
        found = replace(found, x=x, covariance=covariance, load=every @ x, residual=residual)
    return found


def term_columns(equations: TorqueEquations, terms: Sequence[TorqueTerm], load: np.ndarray) -> np.ndarray:
    """Return the terms' columns on the motion's instants (N, joints, parameters)."""
    parts = [t.candidate.columns(equations, load)[:, :, list(t.kept)] for t in terms]
    return np.concatenate([np.zeros((*load.shape, 0)), *parts], axis=2)


def _stack_priors(
    equations: TorqueEquations, design: np.ndarray, whitening: Whitening, prior: TorquePrior
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened columns and torques with the priors' rows below."""
    k = design.shape[2]
    columns = whitening.apply(design, equations.near_rest).reshape(-1, k)
    target = whitening.apply(equations.torque, equations.near_rest).ravel()
    known = np.flatnonzero(prior.known)
    rows = np.zeros((len(known), k))
    rows[np.arange(len(known)), known] = 1.0 / prior.sigma[known]
    return np.vstack([columns, rows]), np.concatenate([target, prior.mean[known] / prior.sigma[known]])


def _solve(
    equations: TorqueEquations,
    prior: TorquePrior,
    terms: tuple[TorqueTerm, ...],
    own: np.ndarray,
    whitening: Whitening,
) -> TorqueFit:
    design = np.concatenate([equations.rows, equations.filtered(own)], axis=2)
    columns, target = _stack_priors(equations, design, whitening, prior)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    u, singular, vt = np.linalg.svd(columns / size, full_matrices=False)
    keep = singular > RANK * singular[0]
    u, singular, vt = u[:, keep], singular[keep], vt[keep]
    x = (vt.T @ ((u.T @ target) / singular)) / size
    left = target - u @ (u.T @ target)
    root = (vt.T / singular) / size[:, None]  # x = root @ (u' target)
    samples = len(equations.torque) - whitening.order
    rows = samples * equations.torque.shape[1]
    sums = cluster_projections(u[:rows], left[:rows], samples)
    plain = root @ root.T
    robust = root @ (sums.T @ sums + u[rows:].T @ u[rows:]) @ root.T
    grown = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(plain), 1e-300), 1.0))
    every = np.concatenate([equations.fine, own], axis=2)
    return TorqueFit(
        equations, prior, terms, whitening, x, plain * np.outer(grown, grown), every @ x,
        equations.torque - design @ x, columns, left, u,
    )  # fmt: skip


def effects_of(found: TorqueFit) -> tuple[Effect, ...]:
    """Return the terms' effects at their values, those of one joint and kind in one; within bounds."""
    made: dict[str, Effect] = {e.name: e for e in found.equations.description.effect}
    names: list[str] = []
    for term in found.terms:
        effect = term.candidate.effect
        assert effect is not None
        here = made.get(effect.name, effect)
        if term.candidate.moves:  # the equations were made with it: what is left of it is little
            here = effect
        if term.candidate.shape == "stribeck":
            curve = ("stribeck_rate", "stribeck_exponent")  # of the columns it was fitted by
            here = here.model_copy(update={key: getattr(effect, key) for key in curve})
        bounds = {p.name: (p.lower, p.upper) for p in here.parameters()}
        values, _ = found.term_values(term)
        if term.candidate.moves:
            values = values + moved_values(term)
        own = {
            n: float(np.clip(v, *bounds[n])) for n, v in zip(term.names, values, strict=True) if n in bounds
        }
        made[effect.name] = here.with_values(own)
        names.append(effect.name)
    return tuple(made[n] for n in dict.fromkeys(names))


def with_equations(term: TorqueTerm, equations: TorqueEquations) -> TorqueTerm:
    """Return a joint's zero, the clock or the tilt as a term of equations made with it."""
    effect = term.candidate.effect
    assert effect is not None
    if term.candidate.moves == "clock":
        effect = effect.with_values({term.names[0]: equations.late})
    elif term.candidate.moves:
        listed = {e.name: e for e in equations.description.effect}
        effect = listed.get(effect.name, effect)
    return replace(term, candidate=replace(term.candidate, effect=effect))


def moved_values(term: TorqueTerm) -> np.ndarray:
    """Return the values (d,) that the equations were made with of a term that moves them [rad or s]."""
    effect = term.candidate.effect
    assert effect is not None
    values = {p.name: p.value for p in effect.parameters()}
    return np.array([values[n] for n in term.names])
