"""Arrays of HDF5, netCDF-4 and MATLAB 7.3 files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording.storage import check_hdf5, refuse_other_files


def read_hdf5(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric arrays of an HDF5 or netCDF-4 file by path, ``group/name``.

    Packed netCDF variables (``scale_factor``, ``add_offset``, ``_FillValue``) are unpacked, missing samples
    to NaN.

    Raises:
        RecordingError: no HDF5, cut short or damaged.
    """
    return {name: _unpacked(values, attributes) for name, values, attributes in _datasets(path)}


def read_matlab_hdf5(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric arrays of a MATLAB 7.3 file, with MATLAB's axes; fields are called ``data.imu.acc``.

    Raises:
        RecordingError: cut short or damaged.
    """
    # MATLAB writes column-major, so HDF5 sees every array transposed.
    return {
        name.replace("/", "."): np.squeeze(values.T)
        for name, values, _ in _datasets(path, skip_user_block=True)
        if not name.startswith("#")
    }


def _datasets(path: Path, *, skip_user_block: bool = False) -> list[tuple[str, NDArray[Any], dict[str, Any]]]:
    import h5py

    if not skip_user_block:
        check_hdf5(path)
    found: list[tuple[str, NDArray[Any], dict[str, Any]]] = []

    def visit(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.dtype.kind in "fiub":
            found.append((name, np.asarray(node[()]), dict(node.attrs)))

    try:
        with h5py.File(path, "r") as file:
            refuse_other_files(file, path)
            file.visititems(visit)
    except RecordingError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError, ... depending on the place
        raise RecordingError(
            f"{path} ({path.stat().st_size} bytes) cannot be read as HDF5: {error}.",
            advice="It is cut short or damaged: copy it again from where it was made.",
            path=str(path),
            size=path.stat().st_size,
        ) from error
    return found


def _unpacked(values: NDArray[Any], attributes: dict[str, Any]) -> NDArray[Any]:
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
