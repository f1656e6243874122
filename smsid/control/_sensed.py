"""What sensors tell the controller, sample by sample: errors drawn for a whole run, applied as it goes.

The errors are those of `smsid.sensing`; measured are q_b, q_m of (41), their rates and the wheels'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.control.pd import MeasuredState
from smsid.errors import ControlError
from smsid.kernel.flight import Senses
from smsid.model.spacecraft import SpacecraftModel
from smsid.sensing.component import ComponentError
from smsid.sensing.error_model import ErrorModel
from smsid.sensing.observe import NoiseStreams
from smsid.sensing.sensor import Sensor

NEEDED = ("attitude", "angular_rate", "joint_position", "joint_velocity")
LINEAR = ("scale_error", "scale_sigma", "misalignment", "misalignment_sigma")


def measured_truth(model: SpacecraftModel, q: np.ndarray, v: np.ndarray) -> MeasuredState:
    """Return what perfect sensors see in the state q (nq,), v (nv,) [rad, rad/s]."""
    rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
    return MeasuredState(
        rotation, v[3:6].copy(), model.joint_angles(q), v[model.arm_joints.v], v[model.wheels.v]
    )


@dataclass
class _Stream:
    """One quantity: additive errors (k, ...), a linear map, limits, and what was last reported.

    ``mount`` (3, 3) takes the sensor's axes to the bus's, in which an attitude is reported.
    """

    rate: float
    late: float
    errors: np.ndarray
    linear: np.ndarray | None
    saturation: float | None
    step: float
    mount: np.ndarray = field(default_factory=lambda: np.eye(3))
    last: int = -1
    value: np.ndarray | None = None


class SensedState:
    """The state as sensors report it to a controller called at ``control_rate`` [Hz] for ``duration`` [s].

    Each sensor samples at its own rate, never faster than the controller asks; its delay is rounded up to
    whole calls of the controller. The first sensor that measures a quantity is used; wheel rates are
    optional. With ``rng`` a `NoiseStreams`, the errors are those that `smsid.sensing.observe` records with
    it, at the sensors' own rates.
    """

    def __init__(
        self,
        model: SpacecraftModel,
        sensors: Sequence[Sensor],
        duration: float,
        control_rate: float,
        rng: np.random.Generator | NoiseStreams,
    ) -> None:
        """Draw the errors; raises `ControlError` when a quantity the controller needs is not measured."""
        self.model, self.period = model, 1.0 / control_rate
        self.history: list[MeasuredState] = []
        self.streams: dict[str, _Stream] = {}
        sizes = {
            "attitude": 4,
            "angular_rate": 3,
            "joint_position": len(model.arm_joints),
            "joint_velocity": len(model.arm_joints),
            "wheel_rate": len(model.wheels),
        }
        for quantity, size in sizes.items():
            owner = next((s for s in sensors if quantity in s.quantities), None)
            if owner is None and size and quantity in NEEDED:
                raise ControlError(
                    f"No sensor measures {quantity.replace('_', ' ')}, which the controller needs.",
                    advice="Add a sensor to the description: pose, imu and encoder.",
                    sensors=[s.name for s in sensors],
                )
            if owner is not None and isinstance(rng, NoiseStreams):
                fresh = partial(rng.generator, f"{owner.name}.{quantity}")
                self.streams[quantity] = _stream(owner, quantity, size, duration, owner.rate, fresh)
            elif owner is not None:
                seed = int(np.random.default_rng(rng.integers(2**63)).integers(2**63))
                fresh = partial(np.random.default_rng, seed)
                rate = min(owner.rate, control_rate)
                self.streams[quantity] = _stream(owner, quantity, size, duration, rate, fresh)

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> MeasuredState:
        """Return what is reported at t [s]."""
        self.history.append(measured_truth(self.model, q, v))
        turned = self._read("attitude", t)
        wheels = self._read("wheel_rate", t) if "wheel_rate" in self.streams else None
        rest = [self._read(name, t) for name in NEEDED[1:]]
        return MeasuredState(turned, rest[0], rest[1], rest[2], wheels)

    def table(self, times: np.ndarray) -> Senses | None:
        """Return what the sensors do at the controller's calls (N,) [s], for the compiled flight.

        ``None`` where wheel rates are not measured or the attitude is rounded.
        """
        if "wheel_rate" not in self.streams or self.streams["attitude"].step > 0.0:
            return None
        widths = [s.errors[0].size for s in self.streams.values()]
        begins = np.cumsum([0, *widths])
        size, calls = int(begins[-1]), np.arange(len(times))
        errors, source = np.empty((len(times), size)), np.empty((len(times), len(widths)), dtype=np.int64)
        mix, bound, grain = np.eye(size), np.full(size, np.inf), np.zeros(size)
        for k, s in enumerate(self.streams.values()):
            columns = slice(begins[k], begins[k + 1])
            index = np.minimum((times * s.rate + 1e-6).astype(int), len(s.errors) - 1)
            errors[:, columns] = s.errors[index].reshape(len(times), -1)
            late = int(np.ceil(s.late / self.period - 1e-9))
            fresh = np.diff(index, prepend=-1) != 0
            source[:, k] = np.where(fresh, np.maximum(calls - late, 0), -1)
            if s.linear is not None:
                mix[columns, columns] = s.linear
            bound[columns] = np.inf if s.saturation is None else s.saturation
            grain[columns] = s.step
        return Senses(errors, source, mix, bound, grain)

    def _read(self, quantity: str, t: float) -> np.ndarray:
        s = self.streams[quantity]
        index = min(int(t * s.rate + 1e-6), len(s.errors) - 1)
        if index == s.last and s.value is not None:
            return s.value
        late = min(int(np.ceil(s.late / self.period - 1e-9)), len(self.history) - 1)
        state = self.history[-1 - late]
        s.last = index
        if quantity == "attitude":
            turn = state.rotation @ s.errors[index]
            found = s.value = _round_attitude(turn, s.step, s.mount) if s.step > 0.0 else turn
            return found
        names = {"angular_rate": "omega", "joint_position": "angles", "joint_velocity": "rates"}
        exact = getattr(state, names.get(quantity, "wheel_rates"))
        value = (exact if s.linear is None else exact @ s.linear) + s.errors[index]
        if s.saturation is not None:
            value = np.clip(value, -s.saturation, s.saturation)
        value = s.value = np.round(value / s.step) * s.step if s.step > 0.0 else value
        return value


def _stream(
    sensor: Sensor,
    quantity: str,
    size: int,
    duration: float,
    rate: float,
    fresh: Callable[[], np.random.Generator],
) -> _Stream:
    """Return what a sensor does at ``rate`` [Hz]; ``fresh`` gives its generator, always the same draws."""
    error = sensor.error(quantity)
    if any(np.any(e.scale_slope) for e in (error, *error.components.values())):
        raise ControlError(
            f"'{sensor.name}' has a scale that depends on the rate, which closed loops do not simulate.",
            advice="Leave its effect `scale_by_rate` out.",
            sensor=sensor.name,
        )

    def measured(errors: ErrorModel, times: np.ndarray, truth: np.ndarray) -> np.ndarray:
        own = sensor.model_copy(update={"errors": {quantity: errors}})
        return own.measure(quantity, times, truth, fresh(), delayed=True)

    times = np.arange(int(duration * rate + 1e-6) + 2) / rate
    nothing = {"delay": 0.0, "saturation": None, "quantisation": 0.0}
    if quantity == "attitude":
        still = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
        turns = Rotation.from_quat(measured(error.model_copy(update=nothing), times, still)).as_matrix()
        return _Stream(rate, error.delay, turns, None, None, error.quantisation, sensor.rotation)
    perfect = ErrorModel()
    additive = error.model_copy(update={**nothing, **{k: getattr(perfect, k) for k in LINEAR}})
    errors = measured(additive, times, np.zeros((len(times), size)))
    linear = None
    if error.misaligned or error.scaled:
        own = ("scale_error", "misalignment")
        parts = {
            key: ComponentError(**{k: getattr(p, k) for k in own}) for key, p in error.components.items()
        }
        only = ErrorModel(**{k: getattr(error, k) for k in LINEAR}, components=parts)
        linear = measured(only, np.arange(size) / rate, np.eye(size))
    return _Stream(rate, error.delay, errors, linear, error.saturation, error.quantisation)


def _round_attitude(rotation: np.ndarray, step: float, mount: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) whose quaternion, in the sensor's axes, is rounded and normalised again.

    ``mount`` (3, 3) takes the sensor's axes to the bus's.
    """
    whole = np.round(pin.Quaternion(rotation @ mount).coeffs() / step)
    return pin.Quaternion(whole / np.linalg.norm(whole)).toRotationMatrix() @ mount.T
