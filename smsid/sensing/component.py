"""Errors of a single component of a measured quantity: one joint, one axis, one station."""

from __future__ import annotations

import re
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from smsid.errors import DescriptionError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Magnitude = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class ComponentError(BaseModel):
    """What one component has beyond its quantity's `ErrorModel`, in the quantity's unit.

    Attributes:
        bias: added to the quantity's [unit], from ``bias_from`` [s] on if given.
        scale_error: added to the quantity's [1].
        scale_slope: added to the quantity's [1/unit].
        misalignment: turn about this axis, added to the quantity's rotation vector [rad].
        quantisation: step, where it is coarser than the quantity's [unit].
        outlier_rate: share of samples that are outliers, beside the quantity's.
        outlier_size: standard deviation of those outliers [unit].
        stuck_from: time from which the component repeats its last value [s].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    bias: Finite = 0.0
    bias_from: Finite | None = None
    scale_error: Finite = 0.0
    scale_slope: Finite = 0.0
    misalignment: Finite = 0.0
    quantisation: Magnitude = 0.0
    outlier_rate: Share = 0.0
    outlier_size: Magnitude = 0.0
    stuck_from: Finite | None = None


_KEY = re.compile(r"(?:(\d+),)?(\d*)")


def place_of(key: str, shape: tuple[int, ...]) -> tuple[slice | int, ...]:
    """Return the index of a component into values of ``shape`` (N, axes) or (N, stations, axes).

    A key is ``"1"``: the second axis, joint or wheel (of every station), ``"2,1"``: that of the third
    station, or ``"2,"``: the whole third station.

    Raises:
        DescriptionError: the key cannot be read, or there is no such component.
    """
    match = _KEY.fullmatch(key)
    station, axis = (match[1], match[2]) if match else (None, "")
    ok = match is not None and (station is not None or axis != "")
    ok = ok and (axis == "" or (len(shape) > 1 and int(axis) < shape[-1]))
    ok = ok and (station is None or (len(shape) == 3 and int(station) < shape[1]))
    if not ok:
        raise DescriptionError(
            f"There is no component '{key}' in values of shape (N, {', '.join(map(str, shape[1:]))}).",
            advice='Give "axis", "station,axis" or "station,", counted from zero.',
            key=key,
            shape=shape,
        )
    place: list[slice | int] = [slice(None)] * len(shape)
    if axis != "":
        place[-1] = int(axis)
    if station is not None:
        place[1] = int(station)
    return tuple(place)


def held(times: np.ndarray, values: np.ndarray, start: float) -> np.ndarray:
    """Return values (N, ...) that repeat, from ``start`` [s] on, the last one before it (or the first).

    ``times`` (N,) [s].
    """
    last = max(int(np.searchsorted(times, start)) - 1, 0)
    out = values.copy()
    out[last + 1 :] = values[last]
    return out
