"""The model-based controller: PD (43), or with the H-infinity term inside the bracket, (46) as corrected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.control._attitude import Coordinates, attitude_error
from smsid.control._statespace import StateSpace
from smsid.control.gains import Gains
from smsid.control.reduced import ReducedDynamics
from smsid.control.robust_term import RobustTerm
from smsid.control.trajectory import Motion
from smsid.errors import ControlError


@dataclass(frozen=True)
class MeasuredState:
    """What the controller sees: ``rotation`` (3, 3) body to inertial, ``omega`` (3,) body axes [rad/s].

    ``angles``, ``rates`` (n,) of the arm joints [rad, rad/s]; ``wheel_rates`` (w,) [rad/s], or None: then the
    controller takes them from the conserved momentum, zero.
    """

    rotation: np.ndarray
    omega: np.ndarray
    angles: np.ndarray
    rates: np.ndarray
    wheel_rates: np.ndarray | None = None


@dataclass(frozen=True)
class TorqueCommand:
    """Q_c (3 + n,) [N m]: wheel torque on the base, body axes, and joint torques; with the errors behind it.

    ``error``, ``error_rate`` (3 + n,) e and de [rad, rad/s] as measured; ``robust`` (3 + n,) u_inf [rad/s^2].
    """

    torques: np.ndarray
    error: np.ndarray
    error_rate: np.ndarray
    robust: np.ndarray


class ModelBasedController:
    """Q_c = J_c^-T (H (qdd_d + K_D de + K_P e - u_inf) + c): equation (43), and (46) with u_inf where (47)
    needs it.

    With ``robust``, a design or (e, de) to u_inf, the term's state lives here: one controller per run,
    `reset` between runs. ``period`` [s] is that of its calls; without robust term it is not needed.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        gains: Gains,
        reference: Motion,
        *,
        robust: RobustTerm | StateSpace | None = None,
        period: float | None = None,
        coordinates: Coordinates = "quaternion",
    ) -> None:
        """Raise `ControlError` when sizes do not fit or a robust term comes without ``period``."""
        for what, size in (("gains", gains.size), ("reference", reference.size)):
            if size != dynamics.size:
                raise ControlError(
                    f"The {what} have {size} coordinates, the spacecraft has {dynamics.size}: 3 of "
                    f"attitude and the joints {', '.join(dynamics.arm.names)}."
                )
        self.dynamics, self.gains, self.reference = dynamics, gains, reference
        self.coordinates: Coordinates = coordinates
        self.filter: StateSpace | None = None
        if robust is not None:
            term = robust.controller if isinstance(robust, RobustTerm) else robust
            if period is None or term.d.shape != (dynamics.size, 2 * dynamics.size):
                raise ControlError(
                    "The robust term needs the period of the calls, and the spacecraft's size."
                )
            self.filter = term.sampled(period)
        self.reset()

    def reset(self) -> None:
        """Forget the state of the robust term."""
        self.state = np.zeros(self.filter.order if self.filter else 0)

    def command(self, t: float, seen: MeasuredState) -> TorqueCommand:
        """Return the torques for time t [s].

        Raises `ControlError` where the attitude's coordinates are singular.
        """
        wanted, wanted_rate, wanted_acceleration = self.reference.at(t)
        base = attitude_error(
            self.coordinates, seen.rotation, seen.omega, wanted[:3], wanted_rate[:3], wanted_acceleration[:3]
        )
        error = np.concatenate([base.error, wanted[3:] - seen.angles])
        rate = np.concatenate([base.rate, wanted_rate[3:] - seen.rates])
        acceleration = self.gains.derivative @ rate + self.gains.proportional @ error
        robust = self._robust(error, rate)
        acceleration -= robust
        acceleration[:3] = base.jacobian @ acceleration[:3] + base.bias
        acceleration[3:] += wanted_acceleration[3:]
        terms = self.dynamics.body_terms(seen.omega, seen.angles, seen.rates, seen.wheel_rates)
        return TorqueCommand(self.dynamics.torques(terms, acceleration), error, rate, robust)

    def _robust(self, error: np.ndarray, rate: np.ndarray) -> np.ndarray:
        if self.filter is None:
            return np.zeros(len(error))
        f, y = self.filter, np.concatenate([error, rate])
        out = f.c @ self.state + f.d @ y
        self.state = f.a @ self.state + f.b @ y
        return out
