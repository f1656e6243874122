"""Gains, friction, rotors and limits of servo joints from what their equations say, divided by stiffness."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from smsid.arm._servo_equations import is_known
from smsid.arm.identify import GROUP
from smsid.arm.joint_torques import JointTorques
from smsid.arm.regression import JointRegression
from smsid.arm.units import joint_unit
from smsid.effects import Servo
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import ParameterEstimate, classify
from smsid.model.spacecraft import SpacecraftModel

ALIKE = 0.1
"""Largest scatter of the torque at a limit, as a share of it."""


def physical_values(
    model: SpacecraftModel,
    torques: JointTorques,
    solved: JointRegression,
    servos: Mapping[int, Servo],
    inside: np.ndarray,
) -> tuple[tuple[ParameterEstimate, ...], np.ndarray]:
    """Return gains, friction, rotors and offsets, and their covariance (n, n).

    The equations give them divided by stiffness; ``inside`` (B, joints) are the blocks that were fitted.

    Raises:
        NotIdentifiableError: nothing gives a joint's stiffness.
    """
    known = {p.name: p for e in model.description.effect for p in e.parameters()}
    joint_of = {e.name: str(getattr(e, "joint", "")) for e in model.description.effect}
    by_joint = {s.joint: (k, s) for k, s in servos.items()}
    n = len(torques.names)
    jacobian, values, units, shares = np.zeros((n, n)), np.zeros(n), [], np.ones(n)
    for i, name in enumerate(torques.names):
        joint = joint_of[name.partition(".")[0]]
        k, servo = by_joint[joint]
        scale = f"{servo.name}.stiffness"
        shares[i] = max(float(np.mean(inside[:, k])), 1e-3)
        units.append(joint_unit(known[name].unit, model, joint))
        if name == scale:
            values[i] = 1.0 / solved.x[i]
            jacobian[i, i] = -1.0 / solved.x[i] ** 2
            continue
        at = torques.names.index(scale) if scale in torques.names else None
        inverse = solved.x[at] if at is not None else 1.0 / servo.stiffness
        values[i] = solved.x[i] / inverse
        jacobian[i, i] = 1.0 / inverse
        if at is not None:
            jacobian[i, at] = -solved.x[i] / inverse**2
        if name.endswith(".viscous"):
            gain = f"{servo.name}.damping"
            if gain in torques.names:  # on the rate as on the command
                g = torques.names.index(gain)
                values[i] -= solved.x[g] / inverse
                jacobian[i, g] = -1.0 / inverse
                if at is not None:
                    jacobian[i, at] += solved.x[g] / inverse**2
            elif is_known(servo, "damping"):
                values[i] -= servo.damping
    lost = 1.0 / np.sqrt(shares)  # blocks left out count as without noise
    covariance = jacobian @ (solved.covariance * np.outer(lost, lost)) @ jacobian.T
    sigma = np.sqrt(np.diag(covariance))
    for i, name in enumerate(torques.names):
        if name.endswith(".stiffness") and not (solved.x[i] > 3.0 * solved.sigma[i]):
            raise NotIdentifiableError(
                f"Neither gravity nor inertia of the links shows at '{joint_of[name.partition('.')[0]]}' in "
                f"the {shares[i]:.0%} of the time that it moves and is not at a limit of its torque: its "
                "stiffness cannot be told.",
                advice="Move it more and away from the limit, or state its stiffness and list it in `known`.",
                parameter=name,
                share=shares[i],
            )
    found = [
        classify(name, float(x), unit, float(s), GROUP, nominal=known[name].value)
        for name, x, unit, s in zip(torques.names, values, units, sigma, strict=True)
    ]
    return tuple(found), covariance


def torque_limits(
    model: SpacecraftModel,
    torques: JointTorques,
    rates: np.ndarray,
    solved: JointRegression,
    servos: Mapping[int, Servo],
    inside: np.ndarray,
    values: Mapping[str, float],
) -> list[ParameterEstimate]:
    """Return the torques that servos were limited to: what moved the joint while the error grew.

    There the controller's damping acts no more, which viscous friction holds: both are regressed. ``rates``
    (B, joints) [rad/s | m/s], ``inside`` (B, joints) where no limit was reached, see `physical_values`.

    Raises:
        NotIdentifiableError: what moves the joint there is not alike.
    """
    predicted = np.einsum("bjn,n->bj", torques.rows, solved.x)
    found = []
    for k, s in servos.items():
        beyond = ~inside[:, k]
        if not beyond.any():
            continue
        stiffness = values.get(f"{s.name}.stiffness", s.stiffness)
        own = predicted[:, k]
        sign = np.sign(torques.torque[beyond, k])
        columns = np.column_stack([np.ones(sign.size), sign * rates[beyond, k]])
        given = stiffness * sign * own[beyond]
        fitted, *_ = np.linalg.lstsq(columns, given, rcond=None)
        limit, spread = float(fitted[0]), float(np.std(given - columns @ fitted))
        if not max(spread, stiffness * float(solved.noise[k])) < ALIKE * limit:
            raise NotIdentifiableError(
                f"The error of '{s.joint}' grows beyond what moves it for {beyond.mean():.0%} of the time, "
                "not at one limit of its torque.",
                advice="Record a motion that keeps away from the limit, or loads that the servo can move.",
                joint=s.joint,
            )
        runs = max(int(np.count_nonzero(np.diff(beyond.astype(int)) == 1)), 1)
        lever = float(np.linalg.pinv(columns.T @ columns)[0, 0]) * beyond.sum() / runs
        sigma = max(spread * float(np.sqrt(lever)), stiffness * float(solved.noise[k]))
        unit = joint_unit("N m", model, s.joint)
        found.append(classify(f"{s.name}.limit", limit, unit, sigma, GROUP))
    return found
