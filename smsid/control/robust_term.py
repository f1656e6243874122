"""The H-infinity term u_inf for the error dynamics (47), with u_inf inside the bracket.

The printed (46) adds u_inf to the torques; put into (40) that gives the wrong sign and adds a torque to an
acceleration. Inside,

    Q_c = J_c^-T (H (qdd_d + K_D de + K_P e - u_inf) + c)  gives  dde + K_D de + K_P e = d_tot + u_inf  (47).

Generalised plant of one group of coordinates, a_fb = K_P (e + n_1) + K_D (de + n_2) - u what is fed back:

    dde = d - a_fb,   w = (d, n_1, n_2),   z = (W_e e, W_T a_fb),   y = (e + n_1, de + n_2).

a_fb / d is the complementary sensitivity at the plant's input, so |W_T| times it below one is stability for
every |H^-1 H_hat - I| below |W_T|. The noise in a_fb makes D11 nonzero.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from smsid.control._hinfinity import Plant, Synthesis, feasible, synthesize
from smsid.control._robust import FlexiblePlant, Pole, least_damping, named_poles
from smsid.control._statespace import StateSpace, hinf_norm, lower_lft, stack
from smsid.control.gains import Gains
from smsid.control.weights import ROLL_OFF, SLOWEST, DesignWeights
from smsid.errors import ControlError

logger = logging.getLogger(__name__)
SLOWER = (0.7, 0.5, 0.35, 0.25, 0.18)
"""Crossovers tried below the weights', relative to it: less is more where noise outweighs disturbance."""
NUDGES = 25
"""Steps of 2 % above the least bound on e that are tried until the norm is met for certain."""
WORTH = 0.97
"""A slower loop is taken when it lowers the bound on e at least to this share."""
KEPT = 0.8
"""Share of its own damping, base free or held, that a mode has to keep."""
RELAXED = (1.5, 2.0, 3.0, 5.0, 10.0)
"""Times the least bound on the error that is asked for when nothing else helps."""


@dataclass(frozen=True)
class DesignBlock:
    """The design of one group of ``coordinates``: ``error`` (k,) [rad] is the bound reached for gamma = 1,
    with the bound on the uncertainty rising to one at ``crossover`` [rad/s].

    ``sensitivity`` and ``complementary`` are the peaks of S and T at the plant's input; ``gain_margin``
    (lower, upper) factors and ``phase_margin`` [deg] follow, guaranteed for all channels at once. ``poles``
    [rad/s] are those of the loop on the rigid model, weights left out.
    """

    coordinates: np.ndarray
    synthesis: Synthesis
    error: np.ndarray
    crossover: float
    sensitivity: float
    complementary: float
    gain_margin: tuple[float, float]
    phase_margin: float
    poles: np.ndarray


@dataclass(frozen=True)
class RobustTerm:
    """u_inf = K (e, de): ``controller`` takes (e (n,), de (n,)) [rad, rad/s] to u_inf (n,) [rad/s^2]."""

    gains: Gains
    weights: DesignWeights
    controller: StateSpace
    blocks: tuple[DesignBlock, ...]

    @property
    def gamma(self) -> float:
        """Largest norm of the blocks' weighted loops."""
        return max(b.synthesis.norm for b in self.blocks)


def design_robust_term(
    gains: Gains,
    weights: DesignWeights,
    *,
    error: float | np.ndarray | None = None,
    slower: tuple[float, ...] = SLOWER,
    relaxed: float = 1.0,
) -> RobustTerm:
    """Return the H-infinity term for gains and weights.

    ``error`` (n,) [rad] is the wanted bound on e for disturbance and noise of the weights' size; by default
    the smallest that keeps gamma at one, group by group, at the weights' crossover or at the one of
    ``slower``, relative to it, where the bound is smallest; ``relaxed`` times that is asked for.

    Raises `ControlError` when sizes do not fit or even no bound on e leaves a robust loop.
    """
    if gains.size != weights.size:
        raise ControlError(
            f"The gains are for {gains.size} coordinates, the weights for {weights.size}.",
            advice="Both need 3 of attitude and one per arm joint.",
        )
    n, order = gains.size, gains.blocks()
    designed = [_design(gains, weights, index, error, slower, relaxed) for index in order]
    inputs = np.eye(2 * n)[np.concatenate([[*index, *(n + index)] for index in order])]  # by groups
    outputs = np.eye(n)[:, np.concatenate(order)]
    joined = stack([controller for _, controller in designed]).scaled(outputs, inputs)
    return RobustTerm(gains, weights, joined, tuple(block for block, _ in designed))


def _design(
    gains: Gains,
    weights: DesignWeights,
    index: np.ndarray,
    error: float | np.ndarray | None,
    slower: tuple[float, ...],
    relaxed: float,
) -> tuple[DesignBlock, StateSpace]:
    kp, kd = gains.proportional[np.ix_(index, index)], gains.derivative[np.ix_(index, index)]
    part = replace(
        weights,
        disturbance=weights.disturbance[index],
        angle_noise=weights.angle_noise[index],
        rate_noise=weights.rate_noise[index],
    )
    # what PD alone leaves of a steady disturbance
    passive = np.linalg.solve(kp, part.disturbance)
    passive = np.maximum(np.abs(passive), 1e-3 * np.abs(passive).max())
    if error is None:
        stated, share = part, _smallest(kp, kd, part, passive)
        for factor in slower:
            if stated.integral >= factor * stated.crossover:
                break
            other = _lower_crossover(stated, factor)
            if _reaches(kp, kd, other, WORTH * share * passive):
                part, share = other, _smallest(kp, kd, other, passive, WORTH * share)
        bound = relaxed * share * passive
        found = synthesize(error_plant(kp, kd, part, bound), gamma=1.0)
    else:
        bound = np.broadcast_to(np.asarray(error, dtype=float), gains.size)[index]
        if not (bound > 0.0).all():
            raise ControlError(f"A bound on the error of {bound} rad is not positive.")
        found = synthesize(error_plant(kp, kd, part, bound))
    noise = np.concatenate([1.0 / part.angle_noise, 1.0 / part.rate_noise])
    controller = found.controller.scaled(np.diag(effective_disturbance(kp, kd, part)), np.diag(noise))
    return _design_block(kp, kd, controller, index, found, bound, part.crossover), controller


def _lower_crossover(weights: DesignWeights, factor: float) -> DesignWeights:
    """Return the weights at a lower crossover, with the noise that is left in the narrower band."""
    root = float(np.sqrt(factor))
    return replace(
        weights,
        crossover=factor * weights.crossover,
        angle_noise=root * weights.angle_noise,
        rate_noise=root * weights.rate_noise,
    )


def _reaches(kp: np.ndarray, kd: np.ndarray, weights: DesignWeights, error: np.ndarray) -> bool:
    return feasible(error_plant(kp, kd, weights, error), 1.0)


def _smallest(
    kp: np.ndarray, kd: np.ndarray, weights: DesignWeights, passive: np.ndarray, high: float | None = None
) -> float:
    """Return the smallest share of the passive error that is feasible, to 2 %; ``high`` is known to be."""
    low = 1e-6
    if high is None:
        high = 10.0
        while not _reaches(kp, kd, weights, high * passive):
            high *= 10.0
            if high > 1e7:
                raise _no_term_reason(kp, kd, weights, high * passive)
    else:
        low = 0.3 * high
        while _reaches(kp, kd, weights, low * passive):
            low, high = 0.3 * low, low
    while high > 1.02 * low:
        middle = float(np.sqrt(low * high))
        if _reaches(kp, kd, weights, middle * passive):
            high = middle
        else:
            low = middle
    # so near the least bound rounding may decide whether the norm is met: what is returned has been tried
    for _ in range(NUDGES):
        high *= 1.02
        if _reaches(kp, kd, weights, high * passive):
            break
    return high


def _no_term_reason(
    kp: np.ndarray, kd: np.ndarray, weights: DesignWeights, error: np.ndarray
) -> ControlError:
    """Return why there is no term although ``error`` (k,) [rad] is allowed: the loop, or our arithmetic.

    No term at all, u_inf = 0, is a controller as well: where it meets the norm, one exists.
    """
    plant, k = error_plant(kp, kd, weights, error), len(kp)
    alone, _ = hinf_norm(lower_lft(plant.system.balance_states(), StateSpace.zero_system(k, 2 * k)))
    if alone < 1.0:
        return ControlError(
            f"The H-infinity synthesis failed numerically: PD alone meets its bound (norm {alone:.3g}), but "
            "no controller was computed.",
            advice="The weights are too far apart in size: give noise and disturbance that are nearer to "
            "what the flight will see, or fly PD alone.",
            norm_of_pd=alone,
            disturbance=weights.disturbance,
            angle_noise=weights.angle_noise,
            rate_noise=weights.rate_noise,
        )
    return ControlError(
        "No H-infinity term keeps the loop robust, whatever error is allowed.",
        advice=f"Too much uncertainty ({100.0 * weights.uncertainty:.3g} %) for these gains and a crossover "
        f"of {weights.crossover:.3g} rad/s: lower the gains, raise the crossover (a faster controller, less "
        "delay), or identify first.",
        norm_of_pd=alone,
        uncertainty=weights.uncertainty,
    )


def error_plant(kp: np.ndarray, kd: np.ndarray, weights: DesignWeights, error: np.ndarray) -> Plant:
    """Return the normalised generalised plant of (47) for k coupled coordinates; see the module.

    ``kp``, ``kd`` (k, k), ``error`` (k,) [rad] that counts as one. States: e, de, and those of W_e, W_T and
    N.
    """
    k = len(kp)
    one, zero = np.eye(k), np.zeros((k, k))
    d = np.diag(effective_disturbance(kp, kd, weights))
    n1, n2 = np.diag(weights.angle_noise), np.diag(weights.rate_noise)
    # W_e = (s + i) / (s + slow), its inverse N on the angle noise (what is averaged away does not count),
    # W_T = R (s + delta c) / (s + R c)
    corner, c, delta = weights.integral, weights.crossover, weights.uncertainty
    slow, fast = SLOWEST * max(corner, 1e-3), ROLL_OFF * c
    gap = corner - slow
    to_e, to_a = np.linalg.inv(np.diag(error)), np.linalg.inv(d)
    p, v = to_a @ kp, to_a @ kd
    a = np.block(
        [
            [zero, one, zero, zero, zero],
            [-kp, -kd, zero, zero, gap * kp @ n1],
            [gap * to_e, zero, -slow * one, zero, zero],
            [p, v, zero, -fast * one, -gap * p @ n1],
            [zero, zero, zero, zero, -corner * one],
        ]
    )
    b1 = np.block(
        [
            [zero, zero, zero],
            [d, -kp @ n1, -kd @ n2],
            [zero, zero, zero],
            [zero, p @ n1, v @ n2],
            [zero, one, zero],
        ]
    )
    b2 = np.vstack([zero, d, zero, -one, zero])
    c1 = np.block(
        [
            [to_e, zero, one, zero, zero],
            [ROLL_OFF * p, ROLL_OFF * v, zero, ROLL_OFF * (delta * c - fast) * one, -ROLL_OFF * gap * p @ n1],
        ]
    )
    d11 = np.block([[zero, zero, zero], [zero, ROLL_OFF * p @ n1, ROLL_OFF * v @ n2]])
    d12 = np.vstack([zero, -ROLL_OFF * one])
    i1, i2 = np.linalg.inv(n1), np.linalg.inv(n2)
    c2 = np.block([[i1, zero, zero, zero, -gap * one], [zero, i2, zero, zero, zero]])
    d21 = np.block([[zero, one, zero], [zero, zero, one]])
    system = StateSpace(
        a, np.hstack([b1, b2]), np.vstack([c1, c2]), np.block([[d11, d12], [d21, np.zeros((2 * k, k))]])
    )
    return Plant(system, k, 2 * k)


def effective_disturbance(kp: np.ndarray, kd: np.ndarray, weights: DesignWeights) -> np.ndarray:
    """Return the disturbance (k,) with what noise makes PD ask for, which disturbs like anything else.

    ``kp``, ``kd`` (k, k) of (47) [1/s^2, 1/s].
    """
    noise = np.abs(kp) @ weights.angle_noise + np.abs(kd) @ weights.rate_noise
    return weights.disturbance + noise


def rigid_loop(kp: np.ndarray, kd: np.ndarray, controller: StateSpace) -> StateSpace:
    """Return the loop from d to (e, a_fb) on the rigid, exactly known model: (47) under u_inf = K (e, de).

    ``kp``, ``kd`` (k, k) [1/s^2, 1/s].
    """
    zero, one = np.zeros_like(kp), np.eye(len(kp))
    double_integrator = StateSpace(
        np.block([[zero, one], [zero, zero]]),
        np.block([[zero, zero], [one, -one]]),
        np.block([[one, zero], [zero, zero], [one, zero], [zero, one]]),
        np.block([[zero, zero], [zero, one], [zero, zero], [zero, zero]]),
    )
    k = controller
    return lower_lft(double_integrator, StateSpace(k.a, k.b, -k.c, np.hstack([kp, kd]) - k.d))


def _design_block(
    kp: np.ndarray,
    kd: np.ndarray,
    controller: StateSpace,
    index: np.ndarray,
    found: Synthesis,
    error: np.ndarray,
    crossover: float,
) -> DesignBlock:
    loop = rigid_loop(kp, kd, controller)
    k = len(index)
    t = StateSpace(loop.a, loop.b, loop.c[k:], loop.d[k:])
    s = StateSpace(loop.a, loop.b, -loop.c[k:], np.eye(k))
    peak_s, _ = hinf_norm(s)
    peak_t, _ = hinf_norm(t)
    lower = min(peak_s / (peak_s + 1.0), 1.0 - 1.0 / peak_t if peak_t > 1.0 else 0.0)
    upper = max(peak_s / (peak_s - 1.0) if peak_s > 1.0 else np.inf, 1.0 + 1.0 / peak_t)
    phase = np.degrees(2.0 * np.arcsin(min(1.0, 0.5 / min(peak_s, peak_t))))
    return DesignBlock(
        index, found, error, crossover, peak_s, peak_t, (lower, upper), float(phase), loop.poles
    )


def guarded_term(
    plant: FlexiblePlant, inertia: np.ndarray, gains: Gains, weights: DesignWeights
) -> tuple[RobustTerm, tuple[Pole, ...]]:
    """Return the H-infinity term and the named poles of the loop with slosh and bending inside.

    The slower the loop may cross over, the less noise and the more phase lag it has at the slow modes, and
    the less error is asked for, the more it does: crossovers are given up, slowest first, then the bound on
    the error is relaxed, until every mode keeps `KEPT` of its damping. What is left to be told stands in the
    poles' flags. ``inertia`` (3 + n, 3 + n) is the controller's H_hat [kg m^2].

    Raises `ControlError` as `design_robust_term`.
    """
    own = least_damping(plant)
    slower, relaxed = SLOWER, iter(RELAXED)
    factor: float | None = 1.0
    while True:
        term = design_robust_term(gains, weights, slower=slower, relaxed=factor)
        poles = named_poles(plant, inertia, gains, term.controller)
        lost = [p.name for p in poles if p.value.imag > 0.0 and p.damping < KEPT * own.get(p.name, 0.0)]
        if not lost:
            return term, poles
        if slower:
            chosen = min(b.crossover for b in term.blocks)
            # what was not chosen need not be tried again
            slower = tuple(s for s in slower if s * weights.crossover > chosen * (1.0 + 1e-9))
            logger.info("%s would lose damping: crossovers above %.3g rad/s only", ", ".join(lost), chosen)
            continue
        factor = next(relaxed, None)
        if factor is None:
            return term, poles
        logger.info("%s would lose damping: %.3g times the least bound on the error", ", ".join(lost), factor)
