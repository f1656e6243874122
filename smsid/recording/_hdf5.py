"""Arrays of HDF5, netCDF-4 and MATLAB 7.3 files, and objects of MATLAB, of which only names can be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.recording.storage import check_hdf5, open_hdf5


def read_hdf5(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric arrays of an HDF5 or netCDF-4 file by path, ``group/name``.

    Packed netCDF variables (``scale_factor``, ``add_offset``, ``_FillValue``) are unpacked, missing samples
    to NaN.

    Raises:
        RecordingError: no HDF5, cut short or damaged.
    """
    return {name: _unpack_values(values, attributes) for name, values, attributes in _datasets(path)}


def read_matlab_hdf5(path: Path) -> dict[str, Any]:
    """Read a MATLAB 7.3 file as nested dictionaries, with MATLAB's axes.

    Structures are dictionaries, arrays of structures and cells lists, characters text; objects such as
    timeseries are `MatlabObject`.

    Raises:
        RecordingError: cut short or damaged.
    """
    with open_hdf5(path) as file:
        tree = {str(k): _matlab(file[k], file) for k in file if not str(k).startswith("#")}
        return {name: value for name, value in tree.items() if value is not None}


def _matlab(node: Any, file: Any) -> Any:
    """Return a group as a dictionary, or a list of them; a dataset as an array, text or list."""
    import h5py

    if isinstance(node, h5py.Group):
        fields = {str(k): v for k in node if (v := _matlab(node[k], file)) is not None}
        # The fields of an array of structures are arrays of references of one length.
        sizes = {len(v) for v in fields.values() if isinstance(v, list)}
        if fields and len(sizes) == 1 and all(isinstance(v, list) for v in fields.values()):
            return [{k: v[i] for k, v in fields.items()} for i in range(sizes.pop())]
        return fields
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in node.attrs or kind not in BUILT_IN:
        return MatlabObject("", kind)
    if h5py.check_ref_dtype(node.dtype) is not None:
        found = [_matlab(file[r], file) for r in np.ravel(node[()].T) if r]
        return None if any(x is None for x in found) else found
    if node.attrs.get("MATLAB_empty", 0) or node.dtype.kind not in "fiub":
        return None
    # MATLAB writes column-major, so HDF5 sees every array transposed.
    values = np.squeeze(np.asarray(node[()]).T)
    return "".join(map(chr, np.ravel(values))) if kind == "char" else values


def _datasets(path: Path) -> list[tuple[str, NDArray[Any], dict[str, Any]]]:
    import h5py

    check_hdf5(path)
    found: list[tuple[str, NDArray[Any], dict[str, Any]]] = []

    def visit(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.dtype.kind in "fiub":
            found.append((name, np.asarray(node[()]), dict(node.attrs)))

    with open_hdf5(path) as file:
        file.visititems(visit)
    return found


def _unpack_values(values: NDArray[Any], attributes: dict[str, Any]) -> NDArray[Any]:
    fill = [attributes[key] for key in ("_FillValue", "missing_value") if key in attributes]
    scale, offset = attributes.get("scale_factor"), attributes.get("add_offset")
    missing = np.zeros(values.shape, dtype=bool)
    for value in fill:
        missing |= values == np.ravel(value)[0]
    if scale is None and offset is None and not missing.any():
        return values
    unpacked = values.astype(np.float64)
    unpacked *= 1.0 if scale is None else float(np.ravel(scale)[0])
    unpacked += 0.0 if offset is None else float(np.ravel(offset)[0])
    unpacked[missing] = np.nan
    return unpacked


OPAQUE = ("s0", "s1", "s2", "arr")  # fields of what scipy makes of an object: name, system, class, reference
BUILT_IN = {"char", "logical", "cell", "struct", "single", "double", "canonical empty", ""}
BUILT_IN |= {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}

MENDS = {
    "timeseries": "log = struct('time', {0}.Time, 'data', {0}.Data); save('log.mat', 'log', '-v7')",
    "timetable": "log = struct('time', seconds({0}.Properties.RowTimes), 'data', {0}.Variables); "
    "save('log.mat', 'log', '-v7')",
    "Dataset": "for k = 1:numElements({0}), e = {0}.getElement(k); log.(matlab.lang.makeValidName(e.Name)) = "
    "struct('time', e.Values.Time, 'data', e.Values.Data); end, save('log.mat', 'log', '-v7')",
    "": "log = struct('time', t, 'data', x); save('log.mat', 'log', '-v7')",
}
"""By class, the line of MATLAB that writes an object, {0}, as a structure of arrays."""


@dataclass(frozen=True)
class MatlabObject:
    """An object of a MATLAB file: its variable or field, and its class."""

    name: str
    kind: str

    def __str__(self) -> str:
        return f"'{self.name}' ({self.kind})"


def opaque_class(value: Any) -> tuple[str, str] | None:
    """Return name (empty in a structure) and class of an object as scipy reads it; None of anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.names != OPAQUE or not value.size:
        return None
    row = value.ravel()[0]
    name, kind = (
        x.decode(errors="replace") if isinstance(x, bytes) else str(x) for x in (row["s0"], row["s2"])
    )
    return name, kind


def mend(objects: Sequence[MatlabObject]) -> str:
    """Return what to do about objects: the lines of MATLAB that write each kind of them."""
    lines = {}
    for one in objects:
        key = next((k for k in MENDS if k and one.kind.endswith(k)), "")
        lines.setdefault(key, MENDS[key].format(one.name or "x"))
    return "In MATLAB: " + "; or: ".join(lines.values()) + "."
