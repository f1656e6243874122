"""The error of one measured quantity: delay, misalignment, scale, bias, noise, outliers, a stuck channel."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator
from scipy.spatial.transform import Rotation

from smsid.errors import DescriptionError, RecordingError
from smsid.sensing.component import ComponentError, Finite, Magnitude, Share, held, place_of
from smsid.sensing.signals import (
    FloatArray,
    check_samples,
    compose,
    fixed_errors,
    gauss_markov,
    is_given,
    random_walk,
    resample,
    sampling_rate,
)

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]

GAUSS_MARKOV_ALLAN_PEAK = 0.6173642831444414
"""Peak of the Allan deviation of a first-order Gauss-Markov process, in units of its standard deviation."""

COARSEST_ATTITUDE = 0.5
"""Steps of a quaternion's components are below it: the largest of them may be no larger, and none be left."""


class ErrorModel(BaseModel):
    r"""Error of one measured vector quantity, in the quantity's own unit, along the sensor's own axes.

    What is not given is zero: ``ErrorModel()`` is a perfect sensor. A value is a scalar or one value per axis
    (last dimension of the data). The errors are applied in this order::

        delay, time offset -> misalignment -> scale -> bias (constant + instability + random walk)
              -> white noise -> outliers -> saturation -> quantisation -> stuck

    An attitude is a quaternion; its bias, noise, instability and random walk are rotation vectors [rad] in
    the sensor's frame, ``q_measured = q * exp(misalignment) * exp(bias + noise)``. Its quantisation is the
    step [1] that the quaternion's four components are rounded to before they are normalised again. Scale and
    saturation have no meaning there and are refused.

    Attributes:
        noise_density: white noise, two-sided density [unit/sqrt(Hz)]: one sigma per sample is
            ``noise_density * sqrt(rate)``. It is the coefficient N of IEEE Std 952 (angle or velocity random
            walk, e.g. rad/s/sqrt(Hz) = rad/sqrt(s)). A data sheet that plots a one-sided density, as those of
            accelerometers in ug/sqrt(Hz) do, is divided by sqrt(2) first.
        noise_sigma: white noise, one sigma per sample whatever the rate [unit]. This or ``noise_density``.
        bias: constant bias [unit].
        bias_sigma: one sigma of a turn-on bias drawn once per recording, each axis and station apart [unit].
        bias_instability: floor of the Allan deviation [unit], the number data sheets print as bias (in-run)
            instability. See below.
        bias_correlation_time: correlation time T of the in-run bias [s]; goes with ``bias_instability``.
        random_walk: rate random walk, coefficient K of IEEE Std 952 [unit/sqrt(s)]: the variance of the bias
            grows as ``random_walk**2 * t``, from zero at the first sample.
        scale_error: relative scale error [1]; ``1e-4`` reads 100 ppm too much.
        scale_slope: what the scale error grows by with the size of the true value [1/unit].
        scale_sigma: one sigma of a scale error drawn once per recording [1].
        misalignment: rotation vector [rad] from the nominal to the true axes: a vector reads
            ``exp(misalignment)^T x``. For 3-vectors and attitudes.
        misalignment_sigma: one sigma per component of a misalignment drawn once per recording [rad].
        quantisation: step of the output, rounded to nearest [unit]; that of an attitude is below 0.5 [1].
        saturation: the output is clipped to ``+-saturation`` [unit] (before rounding to a step).
        delay: age of what is reported [s]: the sample at ``t`` is the truth at ``t - delay``.
        time_offset: error of the sensor's clock [s], either sign, on top of ``delay``: the sample at ``t`` is
            the truth at ``t - delay - time_offset``.
        bias_from: time from which ``bias`` is there [s]; always when not given.
        outlier_rate: share of samples that are outliers [1], drawn for each component.
        outlier_size: standard deviation of what an outlier adds [unit].
        stuck_from: time from which the channel repeats its last value [s]; never when not given.
        components: errors of single components on top, by index (see `smsid.sensing.component`).

    Bias instability. The in-run bias is a stationary first-order Gauss-Markov process of standard deviation
    ``s`` and correlation time ``T``. Its Allan variance is (IEEE Std 952, exponentially correlated noise,
    with q_c^2 T_c = 2 s^2)

    .. math:: \sigma^2(\tau) = \frac{2 s^2 T}{\tau}
              \left[1 - \frac{T}{2\tau}\left(3 - 4 e^{-\tau/T} + e^{-2\tau/T}\right)\right],

    which peaks at ``tau = 1.893 T`` with ``sigma = 0.6174 s``. The peak is set to the data sheet's floor:
    ``s = bias_instability / 0.6174`` (`gauss_markov_sigma`). True flicker noise of coefficient B has a floor
    of ``sqrt(2 ln 2 / pi) B = 0.664 B``: a data sheet that prints B instead of the floor is multiplied by
    0.664 first.

    Raises:
        pydantic.ValidationError: unknown key, negative or non-finite value, both noises, or an instability
            without a correlation time.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    noise_density: Magnitude | tuple[Magnitude, ...] | None = None
    noise_sigma: Magnitude | tuple[Magnitude, ...] | None = None
    bias: Finite | tuple[Finite, ...] = 0.0
    bias_sigma: Magnitude | tuple[Magnitude, ...] = 0.0
    bias_instability: Magnitude | tuple[Magnitude, ...] = 0.0
    bias_correlation_time: Positive | None = None
    random_walk: Magnitude | tuple[Magnitude, ...] = 0.0
    scale_error: Finite | tuple[Finite, ...] = 0.0
    scale_slope: Finite | tuple[Finite, ...] = 0.0
    scale_sigma: Magnitude | tuple[Magnitude, ...] = 0.0
    misalignment: Triple = (0.0, 0.0, 0.0)
    misalignment_sigma: Magnitude | tuple[Magnitude, Magnitude, Magnitude] = 0.0
    quantisation: Magnitude = 0.0
    saturation: Positive | None = None
    delay: Magnitude = 0.0
    time_offset: Finite = 0.0
    bias_from: Finite | None = None
    outlier_rate: Share = 0.0
    outlier_size: Magnitude = 0.0
    stuck_from: Finite | None = None
    components: dict[str, ComponentError] = Field(default_factory=dict)

    def later(self, shift: float) -> ErrorModel:
        """Return the errors on a clock that shows ``shift`` [s] more."""
        parts = {k: p.model_copy(update=_begun_later(p, shift)) for k, p in self.components.items()}
        return self.model_copy(update={**_begun_later(self, shift), "components": parts})

    @model_validator(mode="after")
    def _consistent(self) -> ErrorModel:
        if self.noise_density is not None and self.noise_sigma is not None:
            raise ValueError("noise_density and noise_sigma are both given; give one of them")
        if is_given(self.bias_instability) and self.bias_correlation_time is None:
            raise ValueError("bias_instability needs bias_correlation_time [s]")
        if self.bias_correlation_time is not None and not is_given(self.bias_instability):
            raise ValueError("bias_correlation_time is given without bias_instability")
        return self

    @property
    def gauss_markov_sigma(self) -> FloatArray:
        """Standard deviation of the in-run bias [unit]: () or (axes,)."""
        return np.asarray(self.bias_instability, dtype=float) / GAUSS_MARKOV_ALLAN_PEAK

    @property
    def lag(self) -> float:
        """Age of what a sample reports, by its own stamp [s]: delay plus time offset."""
        return self.delay + self.time_offset

    @property
    def not_of_attitude(self) -> tuple[str, ...]:
        """The terms given that have no meaning for an attitude."""
        components = ("components",) if self.components else ()
        return (*(name for name in _NOT_OF_ATTITUDE if is_given(getattr(self, name))), *components)

    @property
    def misaligned(self) -> bool:
        """Whether the axes are turned."""
        fixed = any(is_given(p.misalignment) for p in (self, *self.components.values()))
        return fixed or is_given(self.misalignment_sigma)

    @property
    def scaled(self) -> bool:
        """Whether the scale is wrong."""
        parts = (self, *self.components.values())
        return is_given(self.scale_sigma) or any(
            is_given(p.scale_error) or is_given(p.scale_slope) for p in parts
        )

    @property
    def limited(self) -> bool:
        """Whether a reading may be `meaningless`."""
        parts = (self, *self.components.values())
        return self.saturation is not None or any(p.stuck_from is not None for p in parts)

    def white_sigma(self, rate: float) -> FloatArray:
        """Return one sigma of the white noise of a sample taken at ``rate`` [Hz]: () or (axes,) [unit].

        Raises:
            RecordingError: ``rate`` is not positive and finite.
        """
        if not (math.isfinite(rate) and rate > 0.0):
            told = "cannot be told: too few samples" if math.isnan(rate) else f"is {rate} Hz"
            raise RecordingError(f"The sampling rate {told}.", advice="It must be positive.", rate=rate)
        if self.noise_density is not None:
            return np.asarray(self.noise_density, dtype=float) * math.sqrt(rate)
        return np.asarray(self.noise_sigma if self.noise_sigma is not None else 0.0, dtype=float)

    def meaningless(self, times: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
        """Return which readings (N, ...) say nothing of what is measured: at the limit, or stuck.

        ``times`` (N,) [s], ``values`` (N, ...).
        """
        bad = np.zeros(values.shape, dtype=bool)
        if self.saturation is not None:
            bad |= np.abs(values) >= self.saturation * (1.0 - 1e-12)
        for place, part in self.parts(values.shape):
            if part.stuck_from is not None:
                bad[place] |= np.reshape(times >= part.stuck_from, (-1, *(1,) * (bad[place].ndim - 1)))
        return bad

    def apply(
        self,
        times: ArrayLike,
        ideal: ArrayLike,
        rng: np.random.Generator | None,
        *,
        attitude: bool = False,
        rate: float | None = None,
        delayed: bool = False,
    ) -> FloatArray:
        """Return what the sensor reports.

        Every error term draws from its own child of ``rng``, so switching one off leaves the others as they
        were, and a longer recording begins with the same samples.

        Args:
            times: (N,) sampling times [s], increasing.
            ideal: (N,), (N, axes) or (N, stations, axes) true values [unit]; (N, 4) quaternions x y z w with
                ``attitude``.
            rng: source of every draw; it needs a seed sequence (`numpy.random.default_rng` has one).
                ``None``: nothing is drawn, saturated or rounded.
            attitude: the values are quaternions.
            rate: sampling rate [Hz] of ``noise_density``; by default from the median step of ``times``.
            delayed: ``ideal`` is already the truth at ``t - lag``; otherwise it is interpolated (see
                `resample`), holding the first value before the start and the last after the end.

        Raises:
            RecordingError: shapes do not fit, a value is not finite, times do not increase, or the rate is
                needed and cannot be told from fewer than two samples.
            DescriptionError: a value per axis does not fit the number of axes, or a term has no meaning here.
        """
        t, x = check_samples(times, ideal, attitude)
        draw = {} if rng is None else dict(zip(_TERMS, rng.spawn(len(_TERMS)), strict=True))
        if not delayed:
            x = self._late(t, x, attitude)
        shape = (*x.shape[:-1], 3) if attitude else x.shape
        self._check_axes(shape, attitude)

        x = self._misalign(x, draw.get("misalignment"), attitude)
        x = self._scale(x, draw.get("scale"))
        error = self._biases(t, shape, draw.get("bias"))
        if draw and is_given(self.bias_instability) and self.bias_correlation_time is not None:
            unit = gauss_markov(t, self.bias_correlation_time, shape, draw["markov"])
            error += self.gauss_markov_sigma * unit
        if draw and is_given(self.random_walk):
            error += np.asarray(self.random_walk) * random_walk(t, shape, draw["walk"])
        if draw and (is_given(self.noise_density) or is_given(self.noise_sigma)):
            if rate is None and self.noise_density is not None:
                rate = sampling_rate(t)
            error += self.white_sigma(1.0 if rate is None else rate) * draw["white"].standard_normal(shape)
        if draw:
            self._add_outliers(error, draw["outlier"], draw["outlier size"])
        if attitude and np.any(error):
            x = compose(x, Rotation.from_rotvec(error))
        elif not attitude:
            x = x + error
        if draw and self.saturation is not None:
            x = np.clip(x, -self.saturation, self.saturation)
        x = self._quantise(x) if draw else x
        if draw and attitude and self.quantisation > 0.0:
            x = x / np.linalg.norm(x, axis=-1, keepdims=True)
        return self._stick(t, x)

    def systematic(
        self, times: ArrayLike, ideal: ArrayLike, attitude: bool = False, *, delayed: bool = False
    ) -> FloatArray:
        """Return the part of what the sensor reports that is the same every time, without limits and steps.

        Delay and time offset, misalignment, scale, bias and a stuck channel: `apply` without ``rng``, with
        its ``times`` (N,) and ``ideal`` (N, ...). Raises what `apply` raises.
        """
        return self.apply(times, ideal, None, attitude=attitude, delayed=delayed)

    def _late(self, t: FloatArray, x: FloatArray, attitude: bool) -> FloatArray:
        if self.lag == 0.0:
            return x
        return resample(t, x, np.clip(t - self.lag, t[0], t[-1]), attitude=attitude)

    def parts(
        self, shape: tuple[int, ...]
    ) -> list[tuple[tuple[slice | int, ...], ErrorModel | ComponentError]]:
        """Return where in values of a shape (N, ...) the errors of the whole quantity and of single
        components act, and these errors.
        """
        whole = tuple(slice(None) for _ in shape)
        return [(whole, self), *((place_of(key, shape), part) for key, part in self.components.items())]

    def turns(self, shape: tuple[int, ...]) -> FloatArray:
        """Return the fixed turns (..., 3) [rad] of the axes of values of a ``shape`` (N, ..., 3)."""
        found = np.zeros((1, *shape[1:]))
        for place, part in self.parts(found.shape):
            found[place] += part.misalignment
        return found[0]

    def _scale(self, x: FloatArray, rng: np.random.Generator | None) -> FloatArray:
        factor = np.zeros(x.shape) + (1.0 + fixed_errors(0.0, self.scale_sigma, x.shape, rng))
        for place, part in self.parts(x.shape):
            factor[place] += np.asarray(part.scale_error) + np.asarray(part.scale_slope) * np.abs(x[place])
        return x * factor

    def _biases(self, t: FloatArray, shape: tuple[int, ...], rng: np.random.Generator | None) -> FloatArray:
        error = np.zeros(shape) + fixed_errors(0.0, self.bias_sigma, shape, rng)
        for place, part in self.parts(shape):
            on = np.zeros(shape)
            on[place] = part.bias
            if part.bias_from is not None:
                on[t < part.bias_from] = 0.0
            error += on
        return error

    def _add_outliers(self, error: FloatArray, which: np.random.Generator, size: np.random.Generator) -> None:
        parts = self.parts(error.shape)
        any_there = any(part.outlier_rate > 0.0 for _, part in parts)
        for place, part in parts:
            if any_there and (part is self or part.outlier_rate > 0.0):  # the whole always takes its draws
                chance = which.random(error[place].shape) < part.outlier_rate
                draw = size.standard_normal(chance.shape)
                error[place] += np.where(chance, part.outlier_size * draw, 0.0)

    def _quantise(self, y: FloatArray) -> FloatArray:
        y = y.copy()
        for place, part in self.parts(y.shape):
            if part.quantisation > (0.0 if part is self else self.quantisation):
                y[place] = np.round(y[place] / part.quantisation) * part.quantisation
        return y

    def _stick(self, t: FloatArray, y: FloatArray) -> FloatArray:
        y = y.copy()
        for place, part in self.parts(y.shape):
            if part.stuck_from is not None:
                y[place] = held(t, y[place], part.stuck_from)
        return y

    def _misalign(self, x: FloatArray, rng: np.random.Generator | None, attitude: bool) -> FloatArray:
        if not self.misaligned:
            return x
        shape = (*x.shape[:-1], 3)
        turns = fixed_errors(self.turns(shape), self.misalignment_sigma, shape, rng)
        if attitude:
            return compose(x, Rotation.from_rotvec(turns))
        matrix = Rotation.from_rotvec(np.reshape(turns, (-1, 3))).as_matrix().reshape(*turns.shape[:-1], 3, 3)
        return np.einsum("...ji,...j->...i", matrix, x)

    def _check_axes(self, shape: tuple[int, ...], attitude: bool) -> None:
        axes = shape[-1] if len(shape) > 1 else 1
        for name in _PER_AXIS:
            value = getattr(self, name)
            if isinstance(value, tuple) and (len(value) != axes or len(shape) == 1):
                raise DescriptionError(
                    f"{name} has {len(value)} values for a quantity of {axes} axes.",
                    advice="Give one number, or one per axis.",
                    key=name,
                    values=value,
                    axes=axes,
                )
        if self.misaligned and axes != 3:
            raise DescriptionError(
                f"misalignment is given for a quantity of {axes} axes.",
                advice="Only a 3-vector or an attitude can be misaligned.",
                axes=axes,
            )
        if attitude and self.not_of_attitude:
            raise DescriptionError(
                f"An attitude has no {', '.join(self.not_of_attitude)}.",
                advice="Use noise, bias and misalignment, which are rotation vectors [rad].",
                keys=self.not_of_attitude,
            )
        if attitude and self.quantisation >= COARSEST_ATTITUDE:
            raise DescriptionError(
                f"Quaternions cannot be rounded to a step of {self.quantisation}.",
                advice=f"Give a step below {COARSEST_ATTITUDE}: it is that of their components.",
                key="quantisation",
                value=self.quantisation,
            )


_TERMS = ("bias", "scale", "misalignment", "markov", "walk", "white", "outlier", "outlier size")
_NOT_OF_ATTITUDE = ("scale_error", "scale_slope", "scale_sigma", "saturation")
_PER_AXIS = (
    "noise_density",
    "noise_sigma",
    "bias",
    "bias_sigma",
    "bias_instability",
    "random_walk",
    "scale_error",
    "scale_slope",
    "scale_sigma",
)


def _begun_later(errors: ErrorModel | ComponentError, shift: float) -> dict[str, float]:
    """Return when a bias is there and a reading is stuck on a clock that shows ``shift`` [s] more."""
    begun = {"bias_from": errors.bias_from, "stuck_from": errors.stuck_from}
    return {name: time + shift for name, time in begun.items() if time is not None}
