"""From arrays to the dataset behind a recording, with every shape, unit and clock verified."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smsid.errors import RecordingError
from smsid.recording.channels import FIXED_LABELS, LABELLED_DIMS, Quantity, quantity_of, split_channel

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

ROLES = ("estimation", "validation", "unspecified")


def real_array(values: ArrayLike, what: str) -> FloatArray:
    """Copy real numbers into a read-only float64 array, or raise `RecordingError`."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise RecordingError(f"{what} is not an array: {error}.", advice="Pass equally long rows.") from error
    if array.dtype.kind not in "fiu":
        raise RecordingError(
            f"{what} holds {array.dtype}, not real numbers.",
            advice="Convert it to float first.",
            dtype=str(array.dtype),
        )
    copy = np.array(array, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy


def clock_array(values: ArrayLike, clock: str) -> FloatArray:
    """Copy times into a read-only (N,) float64 array, or raise `RecordingError`."""
    times = real_array(values, f"Clock '{clock}'")
    if times.ndim != 1 or times.size == 0:
        raise RecordingError(
            f"Clock '{clock}' has shape {times.shape}; expected (N,) with at least one sample.",
            advice="Pass one time per sample, in seconds.",
            clock=clock,
            shape=times.shape,
        )
    return times


def clock_of(dataset: xr.Dataset, source: str) -> str:
    """Name the clock that the channels of a source run on."""
    own = f"{source}.time"
    return own if own in dataset.coords else "time"


def header(name: str, role: str, provenance: Mapping[str, Any] | str) -> dict[str, str]:
    """Give the attributes of a dataset; raise `RecordingError` on an unknown role or no JSON."""
    if role not in ROLES:
        raise RecordingError(
            f"A recording has no role '{role}'.", advice=f"Choose one of {', '.join(ROLES)}.", role=role
        )
    try:
        tree = json.loads(provenance) if isinstance(provenance, str) else dict(provenance)
        text = json.dumps(tree, default=_plain, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise RecordingError(
            f"The provenance cannot be written as JSON: {error}.",
            advice="Use text, finite numbers, lists and dictionaries.",
        ) from error
    if not isinstance(tree, dict):
        raise RecordingError("The provenance is not a table.", advice="Pass a dictionary.")
    return {"name": str(name), "role": role, "provenance": text}


def build(
    time: ArrayLike | None,
    channels: Mapping[str, Any],
    *,
    labels: Mapping[str, Sequence[str]],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
) -> xr.Dataset:
    """Lay out the arrays of `Recording.from_arrays`, or raise `RecordingError`."""
    import xarray as xr

    unused = [name for name in units if name not in channels]
    if unused:
        raise RecordingError(
            f"Units are given for channels that are not there: {', '.join(unused)}.",
            advice="Correct the names.",
            present=tuple(channels),
        )
    clocks: dict[str, FloatArray] = {}
    if time is not None:
        clocks["time"] = clock_array(time, "time")
    clock_by_source = _clocks(channels, clocks)
    coordinates: dict[str, Any] = {clock: (clock, times, {"unit": "s"}) for clock, times in clocks.items()}
    variables: dict[str, Any] = {}
    sizes: dict[str, tuple[int, str]] = {}
    for name, value in channels.items():
        source, _ = split_channel(name)
        quantity = quantity_of(name, unit=units.get(name))
        clock = clock_by_source[source]
        array = real_array(value[1] if isinstance(value, tuple) else value, f"Channel '{name}'")
        dims = _dims(name, quantity, array, clock, clocks[clock].size, labels)
        for dim, size in zip(dims[1:], array.shape[1:], strict=True):
            known, owner = sizes.setdefault(dim, (size, name))
            if known != size:
                raise RecordingError(
                    f"'{name}' has {size} of '{dim}', '{owner}' has {known}.",
                    advice=f"Pass labels={{'{source}.{dim}': [...]}} if '{source}' measures other ones.",
                    channel=name,
                    size=size,
                    expected=known,
                )
        order = {"quaternion_order": "x y z w"} if quantity.is_quaternion else {}
        variables[name] = (dims, array, {"unit": quantity.unit, "frame": quantity.frame, **order})
    coordinates.update(_labels(labels, sizes))
    return xr.Dataset(variables, coords=coordinates, attrs=dict(attributes))


def take_apart(dataset: xr.Dataset) -> tuple[FloatArray | None, dict[str, Any], dict[str, tuple[str, ...]]]:
    """Give back time, channels and labels as `build` takes them, or raise `RecordingError`."""
    time = np.asarray(dataset["time"].values) if "time" in dataset.coords else None
    channels: dict[str, Any] = {}
    for key, variable in dataset.data_vars.items():
        name = str(key)
        source, _ = split_channel(name)
        clock = clock_of(dataset, source)
        if variable.dims[:1] != (clock,) or clock not in dataset.coords:
            text = f"has dimensions {variable.dims}; the first must be its clock '{clock}'."
            raise _fault(name, text, "Build recordings with Recording.from_arrays.")
        values = variable.values
        channels[name] = values if clock == "time" else (dataset[clock].values, values)
    clocks = {"time"} | {f"{split_channel(name)[0]}.time" for name in channels}
    labels = {
        str(dim): tuple(str(label) for label in dataset[dim].values)
        for dim in dataset.coords
        if dim not in clocks and dim not in FIXED_LABELS
    }
    return time, channels, labels


def units_of(dataset: xr.Dataset) -> dict[str, str]:
    """Read the unit of every channel, or raise `RecordingError` where one is missing."""
    units = {}
    for key, variable in dataset.data_vars.items():
        if "unit" not in variable.attrs:
            raise _fault(str(key), "has no unit attribute.", "Build recordings with Recording.from_arrays.")
        units[str(key)] = str(variable.attrs["unit"])
    return units


def _clocks(channels: Mapping[str, Any], clocks: dict[str, FloatArray]) -> dict[str, str]:
    """Fill in the sources' own clocks; give the clock of each source."""
    used: dict[str, str] = {}
    for name, value in channels.items():
        source, _ = split_channel(name)
        own = f"{source}.time"
        clock = "time"
        if isinstance(value, tuple):
            if len(value) != 2:
                raise _fault(name, f"is a tuple of {len(value)}.", "Pass an array, or (time, array).")
            times = clock_array(value[0], own)
            if "time" not in clocks or not np.array_equal(times, clocks["time"], equal_nan=True):
                clock = own
                if own in clocks and not np.array_equal(times, clocks[own], equal_nan=True):
                    text = f"has another clock than the other channels of '{source}'."
                    raise _fault(name, text, "Give them one clock, or name two sources.")
                clocks[own] = times
        elif clock not in clocks:
            raise _fault(name, "has no clock.", "Pass time, or (time, array) for it.")
        if used.setdefault(source, clock) != clock:
            raise RecordingError(
                f"The channels of '{source}' are on two clocks, 'time' and '{own}'.",
                advice="Pass (time, array) for all of them or for none.",
                channel=name,
            )
    return used


def _dims(
    name: str, quantity: Quantity, array: FloatArray, clock: str, samples: int, labels: Mapping[str, Any]
) -> tuple[str, ...]:
    source, _ = split_channel(name)
    trailing = quantity.dims_of(array.shape[1:]) if array.ndim else None
    if trailing is None:
        text = f"has shape {array.shape}; expected {quantity.shapes()}."
        advice = ("The first axis is time.", "Use array[:, None] for a single column.")[array.ndim == 1]
        raise _fault(name, text, advice, shape=array.shape)
    if array.shape[0] != samples:
        text = f"has {array.shape[0]} samples, its clock '{clock}' has {samples}."
        advice = "Give the source a clock of its own with (time, array), or cut both to one length."
        raise _fault(name, text, advice, samples=array.shape[0], expected=samples)
    # Stations belong to one sensor; joints, wheels and modes to the spacecraft, unless labelled for a source.
    return (
        clock,
        *(f"{source}.{dim}" if dim == "station" or f"{source}.{dim}" in labels else dim for dim in trailing),
    )


def _labels(labels: Mapping[str, Sequence[str]], sizes: Mapping[str, tuple[int, str]]) -> dict[str, Any]:
    found: dict[str, Any] = {dim: (dim, list(names)) for dim, names in FIXED_LABELS.items() if dim in sizes}
    for key, values in labels.items():
        kind = key.rpartition(".")[2]
        names = [values] if isinstance(values, str) else [str(value) for value in values]
        if kind not in LABELLED_DIMS and key not in sizes:
            raise RecordingError(
                f"There is no dimension '{key}' to label.",
                advice=f"Labels go to {', '.join(LABELLED_DIMS)}, or '<source>.station'.",
                label=key,
            )
        if len(set(names)) != len(names):
            raise RecordingError(
                f"The labels of '{key}' repeat: {names}.", advice="Make them unique.", label=key
            )
        stations = [dim for dim in sizes if dim.endswith(".station") and dim not in labels]
        for dim in stations if key == "station" else [key]:
            if dim not in sizes:
                continue
            size, owner = sizes[dim]
            if len(names) != size:
                raise RecordingError(
                    f"'{key}' has {len(names)} labels, but '{owner}' has {size} columns.",
                    advice="Give one label per column.",
                    label=key,
                    channel=owner,
                )
            found[dim] = (dim, names)
    return found


def _fault(channel: str, text: str, advice: str, **evidence: Any) -> RecordingError:
    return RecordingError(f"Channel '{channel}' {text}", advice=advice, channel=channel, **evidence)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not JSON")
