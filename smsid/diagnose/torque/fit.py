"""Generalised least squares on torque equations: nominal parameters, effects found so far, and noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.arm.regression import solve_joints
from smsid.diagnose.torque.candidates import SIMPLE, TorqueCandidate
from smsid.diagnose.torque.equations import TorqueEquations
from smsid.diagnose.torque.whitening import Whitening, cluster_projections
from smsid.effects.base import Effect

MOST_TAKEN = 1 / 3  # of a joint's instants, that parameters may take of what its noise is learnt from
FEW_TAKEN = 1 / 6  # the same of parameters common to all joints: as many take slow noise away
ROUNDS = 3
RANK = 1e-9
RANK_OF_NOISE = 1e-6
ROUNDED = 1e-9  # share of its largest at any joint below which a column does nothing at one
FLOOR = 1e-9
"""Noise is taken to be no less than this share of a joint's torque: of a simulation without any."""

Fitted = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From columns (n, joints, k) and torques (n, joints) to what is left, and how many parameters that took."""


@dataclass(frozen=True)
class TorquePrior:
    """What is known of the combinations before: ``mean`` and ``sigma`` (b,), infinite where nothing is."""

    mean: np.ndarray
    sigma: np.ndarray

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


def learn_noise(equations: TorqueEquations, candidates: Sequence[TorqueCandidate]) -> Whitening:
    """Return the whitening of what no candidate explains, each joint fitted by itself where that can be.

    What a model lacks is no noise and must not hide in it: its spectrum is learnt beside all candidates at
    once. In a recording too short for that, parameters are common to all joints, beside all candidates,
    those of one parameter and a joint's own, or a joint's own friction, rotor and offset.
    """
    few = [c for c in candidates if len(c.joints) == 1 and len(c.names) == 1]
    simple = [c for c in few if c.shape in SIMPLE]
    # columns that depend on the torque take the predicted one: the measured one would explain its own noise
    load = _roughly(equations)
    count = len(equations.torque)

    def beside(chosen: Sequence[TorqueCandidate], fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
        columns = [c.columns(equations, load) for c in chosen]
        design = np.concatenate([equations.rows, *(equations.filtered(c) for c in columns)], axis=2)
        return fitted(design, equations.torque)

    residual, taken = beside(candidates, _fit_each_joint)
    if taken.max() > MOST_TAKEN * count:
        for chosen in (candidates, few, simple):
            residual, taken = beside(chosen, _fit_all_joints)
            if taken.max() < FEW_TAKEN * count:
                break
    if taken.max() > MOST_TAKEN * count:
        residual, taken = beside((), _fit_all_joints)
    scale = FLOOR * np.sqrt(np.mean(equations.torque**2, axis=0))
    return Whitening.of(residual, taken, scale, equations.near_rest)


def _fit_each_joint(design: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what columns (n, joints, k) leave of torques (n, joints), each joint with parameters of its own,
    and how many of these it takes (joints,).
    """
    residual, ranks = np.empty_like(torque), np.zeros(torque.shape[1])
    size = np.linalg.norm(design, axis=0)
    acts = size > ROUNDED * size.max(axis=0)  # at other joints a column may be what rounding leaves
    for j in range(torque.shape[1]):
        u = _spanned(design[:, j][:, acts[j]])
        residual[:, j] = torque[:, j] - u @ (u.T @ torque[:, j])
        ranks[j] = u.shape[1]
    return residual, ranks


def _fit_all_joints(design: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same with parameters common to all joints, which weigh by what each leaves."""
    n, joints = torque.shape
    sigma, residual, taken = np.sqrt(np.mean(torque**2, axis=0)) + FLOOR, torque, np.zeros(joints)
    for _ in range(ROUNDS):
        u = _spanned((design / sigma[:, None]).reshape(n * joints, -1))
        left = (torque / sigma).ravel()
        residual = (left - u @ (u.T @ left)).reshape(n, joints) * sigma
        taken = (u**2).sum(axis=1).reshape(n, joints).sum(axis=0)
        sigma = np.sqrt((residual**2).sum(axis=0) / np.maximum(n - taken, n / 4)) + FLOOR * sigma
    return residual, taken


def _spanned(columns: np.ndarray) -> np.ndarray:
    """Return orthonormal directions that columns span but for rounding."""
    size = np.linalg.norm(columns, axis=0)
    u, singular, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return u[:, singular > RANK_OF_NOISE * singular.max(initial=0.0)]


def _roughly(equations: TorqueEquations) -> np.ndarray:
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
        if term.candidate.moves:  # the equations were made with it: what is left of it is nil
            names.append(effect.name)
            made[effect.name] = effect
            continue
        here = made.get(effect.name, effect)
        if term.candidate.shape == "stribeck":
            curve = ("stribeck_rate", "stribeck_exponent")  # of the columns it was fitted by
            here = here.model_copy(update={key: getattr(effect, key) for key in curve})
        bounds = {p.name: (p.lower, p.upper) for p in here.parameters()}
        values, _ = found.term_values(term)
        own = {
            n: float(np.clip(v, *bounds[n])) for n, v in zip(term.names, values, strict=True) if n in bounds
        }
        made[effect.name] = here.with_values(own)
        names.append(effect.name)
    return tuple(made[n] for n in dict.fromkeys(names))


def with_equations(term: TorqueTerm, equations: TorqueEquations) -> TorqueTerm:
    """Return a joint's zero, or the clock, as a term of equations made with it."""
    effect = term.candidate.effect
    assert effect is not None
    if term.candidate.moves == "clock":
        effect = effect.with_values({term.names[0]: equations.late})
    elif term.candidate.moves == "zero":
        listed = {e.name: e for e in equations.description.effect}
        effect = listed.get(effect.name, effect)
    return replace(term, candidate=replace(term.candidate, effect=effect))


def moved_value(term: TorqueTerm) -> float:
    """Return the value that the equations were made with of a term that moves them [rad or s]."""
    effect = term.candidate.effect
    assert effect is not None
    return next(p.value for p in effect.parameters() if p.name == term.names[0])
