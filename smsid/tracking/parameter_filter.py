"""Extended Kalman filter with parameters in its state: one step and one correction at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.errors import SimulationError, SmsidError
from smsid.estimation.kalman import WILD, Applied, _lost
from smsid.estimation.measurements import Measured, matrix
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Belief, UnknownInput
from smsid.tracking.followed_parameters import Followed
from smsid.tracking.linearisation import Driven, Linearisation, Moment, can_exist

RELINEARISE = 0.3  # standard deviations by which parameters may move before models are built anew
BETTER = 0.7  # of how well the point of the models is known: what is believed is then a better one
FAR = 4.0  # standard deviations by which the models are too far, however well their point was known
CLOSE = 1e-3  # standard deviations within which a parameter is where the models are
ROUND = 1e-12  # relative: what keeps a covariance of parameters regular
NEGLIGIBLE = 1e-6  # of a parameter's size: nothing is built anew for less


@dataclass(frozen=True, eq=False)
class Correction:
    """What a sample told. ``rows`` are those read; by them: whitened ``innovations``, ``errors`` (measured
    minus predicted) and the same ``normalised``; ``whitening`` (n, n), ``gain`` (x, n), ``sensitivity``
    (n, x) and ``by_a`` (n, nv). ``moment`` is where it was linearised, ``log_likelihood`` without constants.
    """

    rows: np.ndarray
    innovations: np.ndarray
    errors: np.ndarray
    normalised: np.ndarray
    whitening: np.ndarray
    gain: np.ndarray
    sensitivity: np.ndarray
    by_a: np.ndarray
    moment: Moment
    log_likelihood: float


@dataclass(frozen=True, eq=False)
class Passage:
    """The way from one sample to the next: ``transition`` (x, x), ``forcing`` (2 nv, nv) takes accelerations
    at the ``moment`` in the middle to the state after ``seconds``.
    """

    transition: np.ndarray
    forcing: np.ndarray
    moment: Moment
    seconds: float


@dataclass(eq=False)
class ParameterFilter:
    """What is believed of motion, unknown inputs and parameters, and how it goes on.

    ``q`` (nq,), ``v`` (nv,), ``unknown`` inputs (k,) and ``values`` (m,) of the parameters at ``time`` [s];
    ``covariance`` (x, x) of the tangent of q, of v, of unknown inputs, and of parameters over their scales.
    ``input_noise`` (nv,) are variances of errors of applied forces, held over a step.
    """

    origin: Point
    followed: tuple[Followed, ...]
    layout: Measured
    locked: np.ndarray
    unknown_inputs: Sequence[UnknownInput]
    input_noise: np.ndarray
    time: float
    q: np.ndarray
    v: np.ndarray
    unknown: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    at: Linearisation = field(init=False)

    def __post_init__(self) -> None:
        self._unknowns = tuple(f.unknown for f in self.followed)
        self.scales = np.array([u.scale for u in self._unknowns])
        self._rates = np.array([f.rate for f in self.followed]) / self.scales
        self._walk = np.array([u.walk**2 for u in self.unknown_inputs])
        self._acts = np.array([u.dof for u in self.unknown_inputs], dtype=int)
        self._bends = np.array([u.kind != "bias" for u in self._unknowns])
        self.at = Linearisation(self.origin, self._unknowns, self.values, self.layout, self.locked)
        self.known_at = self.sigmas()
        self.rebuilt = 0

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return len(self.v)

    @property
    def parameters(self) -> slice:
        """Where parameters stand in the state."""
        return slice(2 * self.nv + len(self.unknown), None)

    def begin(self, belief: Belief, time: float) -> None:
        """Begin the motion anew; of the parameters, what is known stays and wanders until ``time`` [s]."""
        own = self.covariance[self.parameters, self.parameters].copy()
        own.flat[:: len(own) + 1] += self._rates**2 * max(0.0, time - self.time)
        sigma = np.array([u.sigma for u in self.unknown_inputs])
        nv, k = len(belief.v), len(sigma)
        p = np.zeros((2 * nv + k + len(own),) * 2)
        p[: 2 * nv, : 2 * nv] = belief.covariance
        p[2 * nv : 2 * nv + k, 2 * nv : 2 * nv + k] = np.diag(sigma**2)
        p[2 * nv + k :, 2 * nv + k :] = own
        self.q, self.v, self.unknown = belief.q.copy(), belief.v.copy(), np.zeros(k)
        self.covariance, self.time = p, time

    def linearise_at(self, values: np.ndarray, sigmas: np.ndarray) -> None:
        """Take models at values (m,) known within ``sigmas`` (m,), whatever is believed yet.

        What is believed stays; only about which point the filter is linear changes.
        """
        self.at = Linearisation(self.origin, self._unknowns, values, self.layout, self.locked)
        self.known_at = np.asarray(sigmas, dtype=float)

    def relinearise(self) -> bool:
        """Build the models anew where parameters have moved far; return whether they were.

        Not while the point that the models are at is known better than what is believed.
        """
        off = np.abs(self.values - self.at.values)
        sigma = self.sigmas()
        moved = off > np.maximum(RELINEARISE * sigma, NEGLIGIBLE * self.scales)
        moved &= (sigma <= BETTER * self.known_at) | (off > FAR * sigma)
        if not np.any(moved & self._bends):
            return False
        share = 1.0
        for _ in range(6):  # where no such spacecraft can be, go only part of the way
            values = self.at.values + share * (self.values - self.at.values)
            try:
                found = Linearisation(
                    self.origin, self._unknowns, values, self.layout, self.locked, before=self.at
                )
            except SmsidError:
                share *= 0.5
                continue
            if can_exist(found):
                if np.array_equal(found.values, self.at.values):
                    return False
                self.at, self.rebuilt, self.known_at = found, self.rebuilt + 1, sigma
                return True
            share *= 0.5
        return False

    def predicted(
        self, driven: Driven, k: int, before: np.ndarray | None
    ) -> tuple[Moment, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return moment, readings (m,), rates by accelerations (m, nv) and state (m, x), offset (x,).

        The offset is how far the state is off the moment, about which readings are linear. ``driven`` holds
        the forces at it as number ``k``; ``before`` (nv,) are those just before the first.
        """
        base, nv, acts = self.at.base, self.nv, self._acts
        off, q, v, driving = self._reference()
        tau = driven.base.at[k] + driving
        lin = base.plant.linear(self.time, q, v, tau)
        moment = Moment(self.time, q, v, tau, lin.a, lin.by_tau)
        forces = _about(driven.base, k, before, driving)
        h, cq, cv, ca = base.predict(moment, forces, base.plant)
        pairs = {i: (a.at[k] + driving, b.at[k] + driving) for i, (a, b) in driven.pairs.items()}
        big = np.empty((len(h), self.covariance.shape[0]))
        big[:, :nv] = ca @ lin.by_q + cq
        big[:, nv : 2 * nv] = ca @ lin.by_v + cv
        big[:, 2 * nv : 2 * nv + len(acts)] = ca @ lin.by_tau[:, acts]
        by_theta = self.at.readings(moment, forces)
        if ca.any():
            by_theta += ca @ self.at.accelerations(moment, pairs)
        big[:, self.parameters] = by_theta
        return moment, h, ca, big, off

    def correct(
        self,
        values: np.ndarray,
        attitudes: dict[str, np.ndarray],
        driven: Driven,
        k: int,
        before: np.ndarray | None,
    ) -> Correction | None:
        """Take in the ``values`` (rows,) of a sample, NaN where there is none; ``None`` if there are none.

        ``attitudes`` are quaternions (4,) by channel, whose rows are zero.

        ``driven`` holds the forces at it as number ``k``; ``before`` (nv,) are those just before the first.
        """
        there = np.flatnonzero(np.isfinite(values))
        if not len(there):
            return None
        moment, h, ca, big, off = self.predicted(driven, k, before)
        hk = big[there]
        residual = self._residual(values, attitudes, h, moment.q)[there] - hk @ off
        p = self.covariance
        ph = p @ hk.T
        s = hk @ ph
        s.flat[:: len(there) + 1] += self.layout.sigma[there] ** 2
        low, info = lapack.dpotrf(s, lower=1, clean=1)
        if info != 0 or not np.isfinite(residual).all():
            raise _lost(self.time)
        inverse, _ = lapack.dtrtri(low, lower=1)
        root = ph @ inverse.T
        white = inverse @ residual
        p = p - root @ root.T
        self.covariance = 0.5 * (p + p.T)
        self._move(root @ white)
        likely = -0.5 * float(white @ white) - float(np.log(low.diagonal()).sum())
        normalised = residual / np.sqrt(s.diagonal())
        return Correction(
            there, white, residual, normalised, inverse, root @ inverse, hk, ca[there], moment, likely
        )

    def advance(self, seconds: float, driven: Driven, k: int) -> Passage:
        """Go on for some seconds, under the forces of interval ``k``."""
        base, nv, acts = self.at.base, self.nv, self._acts
        off, q, v, driving = self._reference()
        substeps = driven.base.means.shape[1]
        start, theta = self.time, self.parameters
        transition, forcing, moment = self._nothing()
        inverse = np.zeros((nv, nv))
        for s in range(substeps):
            if s == substeps // 2:
                tau, t = driven.base.middle[k] + driving, start + 0.5 * seconds
                lin = base.plant.linear(t, q, v, tau)
                inverse, moment = lin.by_tau, Moment(t, q, v, tau, lin.a, lin.by_tau)
                pairs = {
                    i: (a.middle[k] + driving, b.middle[k] + driving) for i, (a, b) in driven.pairs.items()
                }
                f, psi = base.plant.transition(seconds, v, lin)
                forcing = psi[:, nv:]
                transition[: 2 * nv, : 2 * nv] = f
                transition[: 2 * nv, 2 * nv : 2 * nv + len(acts)] = forcing @ inverse[:, acts]
                transition[: 2 * nv, theta] = forcing @ self.at.accelerations(moment, pairs)
            tau, rise = driven.base.means[k, s] + driving, driven.base.rise[k, s]
            part = seconds / substeps
            q, v = base.plant.step(start + s * part, part, q, v, tau, rise)
        further = transition[: 2 * nv] @ off
        self.q, self.v = pin.integrate(base.plant.pin, q, further[:nv]), v + further[nv:]
        if not np.abs(self.v).max(initial=0.0) < WILD:
            raise _lost(start)
        b = forcing @ inverse
        p = transition @ self.covariance @ transition.T
        p[: 2 * nv, : 2 * nv] += (b * self.input_noise) @ b.T
        diagonal = p.reshape(-1)[:: len(p) + 1]  # a view: written in place
        diagonal[2 * nv : theta.start] += self._walk * seconds
        diagonal[theta] += self._rates**2 * seconds
        self.covariance = 0.5 * (p + p.T)
        self.time = start + seconds
        return Passage(transition, forcing, moment, seconds)

    def sigmas(self) -> np.ndarray:
        """Return standard deviations of the parameters (m,), in their units."""
        return self.scales * np.sqrt(self.covariance.diagonal()[self.parameters])

    def parameter_covariance(self) -> np.ndarray:
        """Return the covariance of the parameters (m, m), in their units."""
        return self.covariance[self.parameters, self.parameters] * np.outer(self.scales, self.scales)

    def _offset(self) -> np.ndarray:
        return (self.values - self.at.values) / self.scales

    def _reference(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return how far what is believed is from where it is linear (x,), and there q, v and unknown forces.

        That is the state which goes with the parameters of the models: its mean, given these. So the filter
        is linear about a motion that there can be, however far parameters at first are believed to be.
        """
        nv, theta = self.nv, self.parameters
        d = self._offset()
        off, p = np.zeros(len(self.covariance)), self.covariance
        off[theta] = d
        far = np.abs(d) > CLOSE * np.sqrt(p.diagonal()[theta])
        if far.any():
            own = p[theta, theta]
            size = np.sqrt(np.maximum(own.diagonal(), 1e-300))
            scaled = np.linalg.solve(own / np.outer(size, size) + ROUND * np.eye(len(d)), d / size)
            off[: theta.start] = p[: theta.start, theta] @ (scaled / size)
        q = pin.integrate(self.at.base.plant.pin, self.q, -off[:nv])
        driving = np.zeros(nv)
        np.add.at(driving, self._acts, self.unknown - off[2 * nv : theta.start])
        return off, q, self.v - off[nv : 2 * nv], driving

    def _nothing(self) -> tuple[np.ndarray, np.ndarray, Moment]:
        nv = self.nv
        zero = np.zeros(nv)
        moment = Moment(self.time, self.q, self.v, zero, zero, np.zeros((nv, nv)))
        return np.eye(len(self.covariance)), np.zeros((2 * nv, nv)), moment

    def _move(self, step: np.ndarray) -> None:
        nv, theta = self.nv, self.parameters
        if not np.isfinite(step).all():
            raise SimulationError(f"The filter lost the motion at t = {self.time:.6g} s.", time=self.time)
        self.q = pin.integrate(self.at.base.plant.pin, self.q, step[:nv])
        self.v = self.v + step[nv : 2 * nv]
        self.unknown = self.unknown + step[2 * nv : theta.start]
        self.values = self.values + self.scales * step[theta]

    def _residual(
        self, values: np.ndarray, attitudes: dict[str, np.ndarray], h: np.ndarray, q: np.ndarray
    ) -> np.ndarray:
        data = self.at.base.outputs.data
        out = values - h
        for block in data.blocks:
            if block.quantity == "attitude" and block.channel in attitudes:
                turn = matrix(q[3:7]).T @ matrix(attitudes[block.channel])
                out[block.rows] = pin.log3(turn) - h[block.rows]
            for start, bias in block.later:
                if self.time >= start:
                    out[block.rows] -= np.resize(bias, block.rows.stop - block.rows.start)
        return out


def _about(
    applied: Applied, k: int, earlier: np.ndarray | None, driving: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces (nv,) just before and just after sample k."""
    if k > 0:
        before = applied.means[k - 1, -1] + applied.rise[k - 1, -1]
    else:
        before = applied.at[0] if earlier is None else earlier
    after = applied.means[k, 0] - applied.rise[k, 0] if k < len(applied.means) else applied.at[k]
    return before + driving, after + driving
