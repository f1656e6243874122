"""From arrays to what a recording holds, with every shape, unit and clock verified; and to xarray."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smsid.errors import RecordingError
from smsid.recording.channels import FIXED_LABELS, LABELLED_DIMS, Quantity, quantity_of, split_channel

FloatArray = NDArray[np.float64]

Stored = Mapping[str, tuple[tuple[str, ...], Any, Mapping[str, Any]]]
"""Variables of a dataset: dimensions, values, attributes; one along itself is a coordinate."""

ROLES = ("estimation", "validation", "unspecified")


@dataclass(frozen=True, eq=False)
class ArrayLayout:
    """What a recording holds.

    ``clocks`` (N,) [s]; ``channels``: dimensions, the clock first, and samples (N, ...); ``units`` of them;
    ``labels`` along dimensions, fixed ones too; ``header`` as `header` gives it.
    """

    clocks: dict[str, FloatArray]
    channels: dict[str, tuple[tuple[str, ...], FloatArray]]
    units: dict[str, str]
    labels: dict[str, tuple[str, ...]]
    header: dict[str, str]

    @property
    def own_labels(self) -> dict[str, tuple[str, ...]]:
        """Labels that a recording states."""
        return {dim: names for dim, names in self.labels.items() if dim not in FIXED_LABELS}

    def clock_of(self, source: str) -> str:
        """Name the clock that the channels of a source run on."""
        own = f"{source}.time"
        return own if own in self.clocks else "time"

    def parts(self) -> dict[str, Any]:
        """Give the channels as `Recording.from_arrays` takes them."""
        return {
            name: values if dims[0] == "time" else (self.clocks[dims[0]], values)
            for name, (dims, values) in self.channels.items()
        }

    def cut(self, rows: Mapping[str, slice | NDArray[np.int_]]) -> ArrayLayout:
        """Keep some rows by clock: a slice of them, or their numbers (n,)."""
        clocks = {
            clock: times[rows[clock]] if clock in rows else times for clock, times in self.clocks.items()
        }
        channels = {
            name: (dims, values[rows[dims[0]]] if dims[0] in rows else values)
            for name, (dims, values) in self.channels.items()
        }
        return replace(self, clocks=clocks, channels=channels)

    def without(self, names: Sequence[str]) -> ArrayLayout:
        """Leave channels out, and what they alone need; `RecordingError` where none is left."""
        channels = {name: own for name, own in self.channels.items() if name not in names}
        if not channels:
            raise RecordingError("The recording has no channels.", advice="Give at least one.")
        used = {dim for dims, _ in channels.values() for dim in dims} | {"time"}
        return replace(
            self,
            clocks={k: x for k, x in self.clocks.items() if k in used},
            channels=channels,
            units={k: x for k, x in self.units.items() if k in channels},
            labels={k: x for k, x in self.labels.items() if k in used},
        )

    def same(self, other: ArrayLayout) -> bool:
        """Compare all but the provenance; not a number equals itself."""
        if (list(self.channels), self.units, self.labels) != (
            list(other.channels),
            other.units,
            other.labels,
        ):
            return False
        pairs = [(x, other.channels[k]) for k, x in self.channels.items()]
        alike = all(a[0] == b[0] and np.array_equal(a[1], b[1], equal_nan=True) for a, b in pairs)
        times = self.clocks.keys() == other.clocks.keys() and all(
            np.array_equal(x, other.clocks[k], equal_nan=True) for k, x in self.clocks.items()
        )
        return alike and times and all(self.header[k] == other.header[k] for k in ("name", "role"))

    def stored(self) -> Stored:
        """Give it as variables of a dataset."""
        out: dict[str, Any] = {k: ((k,), times, {"unit": "s"}) for k, times in self.clocks.items()}
        out |= {dim: ((dim,), np.array(names), {}) for dim, names in self.labels.items()}
        for name, own in self.channels.items():
            quantity = quantity_of(name, unit=self.units[name])
            order = {"quaternion_order": "x y z w"} if quantity.is_quaternion else {}
            out[name] = (*own, {"unit": self.units[name], "frame": quantity.frame, **order})
        return out


def real_array(values: ArrayLike, what: str) -> FloatArray:
    """Copy real numbers into a read-only float64 array of their shape, or raise `RecordingError`."""
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
) -> ArrayLayout:
    """Lay out arrays, their shapes as in `Recording.from_arrays`; `RecordingError` where they do not fit."""
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
    laid: dict[str, tuple[tuple[str, ...], FloatArray]] = {}
    known_units: dict[str, str] = {}
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
        laid[name], known_units[name] = (dims, array), quantity.unit
    return ArrayLayout(clocks, laid, known_units, _labels(labels, sizes), dict(attributes))


def layout_of_dataset(stored: Stored, attributes: Mapping[str, Any]) -> ArrayLayout:
    """Lay out a dataset, or raise `RecordingError`."""
    advice, channels, units = "Build recordings with Recording.from_arrays.", {}, {}
    coordinates = {name: values for name, (dims, values, _) in stored.items() if dims == (name,)}
    for name, (dims, values, own) in stored.items():
        if name in coordinates:
            continue
        mine = f"{split_channel(name)[0]}.time"
        clock = mine if mine in coordinates else "time"
        if dims[:1] != (clock,) or clock not in coordinates:
            text = f"has dimensions {dims}; the first must be its clock '{clock}'."
            raise _fault(name, text, advice)
        if "unit" not in own:
            raise _fault(name, "has no unit attribute.", advice)
        channels[name] = values if clock == "time" else (coordinates[clock], values)
        units[name] = str(own["unit"])
    if not channels:
        raise RecordingError("The recording has no channels.", advice="Give at least one.")
    clocks = {"time"} | {f"{split_channel(name)[0]}.time" for name in channels}
    labels = {
        dim: tuple(str(label) for label in values)
        for dim, values in coordinates.items()
        if dim not in clocks and dim not in FIXED_LABELS
    }
    about = header(
        str(attributes.get("name", "")),
        str(attributes.get("role", "unspecified")),
        attributes.get("provenance", "{}"),
    )
    return build(coordinates.get("time"), channels, labels=labels, units=units, attributes=about)


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


def _labels(
    labels: Mapping[str, Sequence[str]], sizes: Mapping[str, tuple[int, str]]
) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {k: tuple(x) for k, x in FIXED_LABELS.items() if k in sizes}
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
            found[dim] = tuple(names)
    return found


def _fault(channel: str, text: str, advice: str, **evidence: Any) -> RecordingError:
    return RecordingError(f"Channel '{channel}' {text}", advice=advice, channel=channel, **evidence)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not JSON")
