"""Exp. 1 as a linear system: what unit pulses of thrust do to outputs, derivatives and limits.

With the attitude held everything is linear in the thrust. A pulse of 1 N over one interval on one axis has a
response; any thrust that is constant over intervals has the sum of its pulses' responses, shifted. So has
the Jacobian of the outputs, and information is a quadratic form of the thrust with an exact gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from smsid.design._forecast import Forecast
from smsid.design._limits import Limits, root_moments, tip_shapes
from smsid.likelihood.inputs import DrivenMotion, ThrustHistory
from smsid.likelihood.jacobian import columns
from smsid.likelihood.normal import inverse
from smsid.likelihood.nuisance_parameters import NuisanceValues
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, longest_step
from smsid.likelihood.time_grid import Timeline
from smsid.model.spacecraft import SpacecraftModel

SAME = 1e-10  # relative difference of columns that count as proportional


@dataclass(frozen=True)
class Bound:
    """A linear response ``y`` (times, components) whose length must stay below ``limit``.

    ``response`` (times, components, axes) is that to a unit pulse in the first interval.
    """

    quantity: str
    response: np.ndarray
    limit: float


@dataclass(frozen=True)
class ThrustSpace:
    """Thrust of ``intervals`` constant pieces on some axes, and what follows from it.

    ``rows`` (samples, outputs, reduced, axes) are the whitened derivatives of the outputs by a reduced set of
    parameters for a unit pulse in the first interval, ``still`` (samples, outputs, reduced) without thrust;
    ``spread`` (reduced, n) takes parameters and local ones to the reduced. ``stride`` samples to an interval.
    """

    forecast: Forecast
    axes: tuple[int, ...]
    intervals: int
    stride: int
    rows: np.ndarray
    still: np.ndarray
    spread: np.ndarray
    known: np.ndarray
    bounds: tuple[Bound, ...]
    force: float

    @property
    def interval(self) -> float:
        """Length of an interval [s]."""
        return self.forecast.duration / self.intervals

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.still)

    @cached_property
    def _padded(self) -> int:
        return 2 * self.samples

    @cached_property
    def _used(self) -> tuple[np.ndarray, ...]:
        """Per axis, which (output, reduced) pairs answer at all."""
        return tuple(np.flatnonzero(self.rows[..., a].any(axis=0).ravel()) for a in range(len(self.axes)))

    @cached_property
    def _spectra(self) -> tuple[np.ndarray, ...]:
        flat = self.rows.reshape(self.samples, -1, len(self.axes))
        return tuple(
            np.fft.rfft(flat[:, used, a], n=self._padded, axis=0) for a, used in enumerate(self._used)
        )

    def jacobian(self, thrust: np.ndarray) -> np.ndarray:
        """Return the whitened derivatives (samples, outputs, reduced) under thrust (intervals, axes) [N]."""
        out = self.still.copy().reshape(self.samples, -1)
        for a, (used, spectrum) in enumerate(zip(self._used, self._spectra, strict=True)):
            train = np.zeros(self.samples)
            train[: self.intervals * self.stride : self.stride] = thrust[:, a]
            answer = np.fft.irfft(
                spectrum * np.fft.rfft(train, n=self._padded)[:, None], n=self._padded, axis=0
            )
            out[:, used] += answer[: self.samples]
        return out.reshape(self.still.shape)

    def covariance(self, thrust: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the covariance (n, n) of parameters and local ones, and the Jacobian it is from."""
        jacobian = self.jacobian(thrust)
        flat = jacobian.reshape(-1, jacobian.shape[2])
        information = self.spread.T @ (flat.T @ flat) @ self.spread + self.known
        return inverse(information), jacobian

    def cost_gradient(self, jacobian: np.ndarray, weight: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """Return the gradient (intervals, axes) of a cost with derivative ``weight`` by the covariance.

        ``jacobian`` (samples, readings, n) as `jacobian` returns it.
        """
        inner = self.spread @ covariance @ weight @ covariance @ self.spread.T
        back = (jacobian @ inner).reshape(self.samples, -1)
        out = np.empty((self.intervals, len(self.axes)))
        for a, (used, spectrum) in enumerate(zip(self._used, self._spectra, strict=True)):
            other = np.fft.rfft(back[:, used], n=self._padded, axis=0)
            lagged = np.fft.irfft((other * spectrum.conj()).sum(axis=1), n=self._padded)
            out[:, a] = -2.0 * lagged[: self.intervals * self.stride : self.stride]
        return out

    def restrict_axes(self, chosen: Sequence[int]) -> ThrustSpace:
        """Return the space of thrusts on some of its axes only, numbered within it."""
        index = list(chosen)
        bounds = tuple(replace(b, response=b.response[..., index]) for b in self.bounds)
        axes = tuple(self.axes[i] for i in index)
        return replace(self, axes=axes, rows=self.rows[..., index], bounds=bounds)

    def matrix(self, bound: Bound) -> np.ndarray:
        """Return the linear map (times, components, intervals, axes) of a bound."""
        out = np.zeros((*bound.response.shape[:2], self.intervals, len(self.axes)))
        for i in range(self.intervals):
            first = i * self.stride
            out[first:, :, i] = bound.response[: len(bound.response) - first]
        return out


def thrust_space(
    forecast: Forecast, axes: tuple[int, ...], intervals: int, limits: Limits, force: float
) -> ThrustSpace:
    """Return the space of thrusts of a spacecraft whose attitude is held, arm and wheels locked.

    ``axes`` of the body along which thrust acts; ``force`` [N] is the most per axis. ``forecast.rate`` is
    raised so that a whole number of samples falls on an interval.
    """
    stride = max(1, int(np.ceil(forecast.rate * forecast.duration / intervals - 1e-9)))
    forecast = Forecast(forecast.model, forecast.duration, stride * intervals / forecast.duration)
    model, parameters = forecast.model, forecast.parameters
    timeline = Timeline.of(0.0, forecast.duration, [forecast.duration / intervals], 2.0 * longest_step(model))
    channels = forecast.channels(timeline)

    def flown(axis: int, size: float) -> tuple[np.ndarray, np.ndarray, RecordingTerm, NuisanceValues]:
        piece, local = forecast.piece(_drive(forecast, axis, size, intervals), timeline, channels)
        prediction = piece.predict(parameters, local)
        nodes = columns(piece, parameters, local, prediction)
        found = []
        for channel, own in zip(piece.channels, nodes, strict=True):
            white = channel.whitening @ own
            found.append(
                (channel.coarse_weights @ white.reshape(len(white), -1)).reshape(-1, *white.shape[1:])
            )
        q = timeline.interpolation(channels[0].times) @ prediction.q
        return np.concatenate(found, axis=1), q - model.home, piece, local

    both = [[flown(axis, size) for size in (1.0, 2.0)] for axis in axes]
    stacked = np.stack([two[0] - one[0] for one, two in both], axis=-1)
    still = 2.0 * both[0][0][0] - both[0][1][0]
    bounds = [_responses(model, limits, two[1] - one[1]) for one, two in both]
    _, _, piece, local = both[0][0]
    keep, spread = _proportional(np.concatenate([still[..., None], stacked], axis=-1))
    known = np.zeros((still.shape[2],) * 2)
    _, prior = Prior(parameters).residual(parameters)
    known[: parameters.size, : parameters.size] = prior.T @ prior
    own, _, _ = piece.prior(local)
    known[parameters.size :, parameters.size :] = own
    merged = tuple(
        Bound(b[0].quantity, np.stack([x.response for x in b], axis=-1), b[0].limit)
        for b in zip(*bounds, strict=True)
    )
    return ThrustSpace(
        forecast,
        axes,
        intervals,
        stride,
        stacked[:, :, keep],
        still[:, :, keep],
        spread,
        known,
        merged,
        force,
    )


def _drive(forecast: Forecast, axis: int, size: float, intervals: int) -> DrivenMotion:
    model = forecast.model
    locked = {int(i) for i in (*model.arm_joints.v, *model.wheels.v)} | {3, 4, 5}
    free = np.array([i for i in range(model.nv) if i not in locked])
    values = np.zeros((3, 6))
    values[0, axis] = size
    times = np.array([0.0, forecast.duration / intervals, forecast.duration])
    return DrivenMotion(free, model.home.copy(), True, ThrustHistory(times, values, True), None, None)


def _responses(model: SpacecraftModel, limits: Limits, q: np.ndarray) -> list[Bound]:
    """Bounded responses to one pulse, from coordinates q (times, nq) less home."""
    usable, found = limits.usable_share, []
    if limits.stroke is not None:
        found += [Bound(f"stroke of {s.name}", q[:, s.q], usable * limits.stroke) for s in model.slosh]
    for joints in model.appendages:
        panel, place = joints.appendage, [model.pin.joints[j].idx_q for j in joints.joints]
        delta = q[:, place] * joints.scale
        if limits.tip is not None:
            name, limit = f"tip of {panel.name}", usable * limits.tip
            found += [Bound(name, delta @ shape, limit) for shape in tip_shapes(panel)]
        if limits.root_moment is not None:
            name, limit = f"root moment of {panel.name}", usable * limits.root_moment
            found.append(Bound(name, delta @ root_moments(panel), limit))
    return found


def _proportional(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which columns (axis 2) to keep, and the map (kept, n) that gives all from them."""
    n = rows.shape[2]
    flat = np.moveaxis(rows, 2, 0).reshape(n, -1)
    size = np.linalg.norm(flat, axis=1)
    keep: list[int] = []
    spread = np.zeros((0, n))
    for i in np.flatnonzero(size > 0.0):
        for k, j in enumerate(keep):
            factor = float(flat[i] @ flat[j]) / size[j] ** 2
            if np.linalg.norm(flat[i] - factor * flat[j]) < SAME * size[i]:
                spread[k, i] = factor
                break
        else:
            keep.append(int(i))
            spread = np.vstack([spread, np.eye(n)[i]])
    return np.array(keep), spread
