"""Recordings as netCDF-4 files (HDF5), self-describing and whole or absent."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._files import atomic_write, check_target
from smsid.errors import OutputError, RecordingError
from smsid.recording._layout import Stored, layout_of_dataset
from smsid.recording.channels import quantity_of
from smsid.recording.recording import Recording

if TYPE_CHECKING:
    import h5py
    from xarray import Dataset

SCHEMA = "smsid.recording"
SCHEMA_VERSION = 1
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SEAL = b"smsid.blake2b-16"
"""Stands behind the HDF5 file, before the sum of it: HDF5 itself loops for ever on some damaged files.

Readers overlook what is behind the end, and programs that change the file cut it off."""
SUM_SIZE = 16
NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write a recording to a netCDF-4 file and give its path; the file appears whole or not at all.

    Every variable carries its unit and frame, quaternions their order, all data a checksum; the file names
    its schema and version. Reading needs no smsid: ``xarray.open_dataset(path, engine="h5netcdf")`` shows the
    same.

    Raises:
        RecordingError: the file cannot be written.
    """
    try:
        check_target(path)
        return _save_sealed(_file_bytes(recording), path)
    except OutputError as error:
        raise RecordingError(error.message, advice=error.advice, **error.evidence) from error


def _file_bytes(recording: Recording) -> bytes:
    """Return the bytes of the netCDF-4 file of a recording."""
    import h5netcdf
    import h5py

    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        file.attrs.update(
            **recording.layout.header, schema=SCHEMA, schema_version=SCHEMA_VERSION, time_unit="s"
        )
        for name, (dims, values, attributes) in recording.layout.stored().items():
            for dim, size in zip(dims, values.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = size
            # the checksum finds damage inside a file that still has its full length
            how = {"fletcher32": True} if name in recording else {}
            kind = h5py.string_dtype() if values.dtype.kind == "U" else values.dtype
            file.create_variable(name, dims, kind, values.astype(kind), **how).attrs.update(attributes)
    return content.getvalue()


def save_dataset(dataset: Dataset, path: str | os.PathLike[str]) -> Path:
    """Write a dataset to a netCDF-4 file with a sum of all its bytes, whole or not at all; give its path.

    Raises `OutputError` when the file cannot be written.
    """
    check_target(path)
    return _save_sealed(bytes(dataset.to_netcdf(engine="h5netcdf")), path)


def _save_sealed(content: bytes, path: str | os.PathLike[str]) -> Path:
    # HDF5 crashes when the disk is full as it closes a file; bytes in memory are written by ourselves
    return atomic_write(path, content + SEAL + hashlib.blake2b(content, digest_size=SUM_SIZE).digest())


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording that `save_recording` wrote.

    Raises:
        RecordingError: no such file, no HDF5, cut short or damaged, no smsid recording, or a schema version
            that this smsid does not know.
    """
    stored, attributes = _read_stored(path)
    schema, version = attributes.get("schema"), attributes.get("schema_version")
    if schema != SCHEMA:
        raise RecordingError(
            f"{path} is HDF5, but not a recording of smsid.",
            advice="Bring it in with import_recording and a mapping.",
            path=str(path),
            schema=schema,
        )
    if version != SCHEMA_VERSION:
        raise RecordingError(
            f"{path} has schema version {version}; this smsid reads version {SCHEMA_VERSION}.",
            advice="Read it with the smsid that wrote it, or update smsid.",
            path=str(path),
            version=version,
        )
    try:
        _check_conventions(stored)
        return Recording(layout_of_dataset(stored, attributes))
    except RecordingError as error:
        raise error.at(path) from error


def _read_stored(path: str | os.PathLike[str]) -> tuple[Stored, dict[str, Any]]:
    """Return the variables and attributes of a netCDF-4 file by HDF5 alone: xarray and h5netcdf take long."""
    import h5py

    check_hdf5(path)
    with open_hdf5(path) as file:
        stored: Stored = {}
        for name, own in file.items():
            attributes = dict(own.attrs)
            if isinstance(own, h5py.Group) or bytes(attributes.get("NAME", b"")).startswith(NO_VARIABLE):
                continue
            scales = attributes.pop("DIMENSION_LIST", ())
            dims = (name,) if "CLASS" in attributes else tuple(str(file[s[0]].name)[1:] for s in scales)
            values = own.asstr()[...] if own.dtype.kind in "OS" else own[...]
            stored[name] = dims, values, {k: _plain(v) for k, v in attributes.items()}
        return stored, {k: _plain(v) for k, v in file.attrs.items()}


def _plain(value: Any) -> Any:
    """Return an attribute as a number or string, where it is one."""
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode() if isinstance(value, bytes) else value


def read_dataset(path: str | os.PathLike[str]) -> Dataset:
    """Return what a netCDF-4 file holds, as it stands there: no dates are made of times, nothing is masked.

    Raises:
        RecordingError: no such file, no HDF5, cut short, damaged, or it takes data from other files.
    """
    import xarray as xr

    check_hdf5(path)
    # h5netcdf leaves a half-made object behind where HDF5 cannot open the file; it then speaks on stderr
    with open_hdf5(path) as file:
        file.attrs.get("_nc3_strict")  # what it looks at before it can be closed
        how: dict[str, Any] = dict.fromkeys(("decode_times", "mask_and_scale", "decode_timedelta"), False)
        return xr.load_dataset(path, engine="h5netcdf", **how)


@contextmanager
def open_hdf5(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """Give an HDF5 file to read from; what goes wrong inside the block is the file's damage.

    Raises:
        RecordingError: cut short, damaged, or it takes data from other files.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            refuse_other_files(file, path)
            yield file
    except RecordingError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError, ... by where it breaks
        raise damaged_error(path, error) from error


def file_attribute(path: str | os.PathLike[str], name: str) -> str:
    """Return an attribute of an HDF5 file as text; nothing where there is none or the file is damaged."""
    import h5py

    try:
        check_hdf5(path)
        with h5py.File(path, "r") as file:
            return str(file.attrs.get(name, ""))
    except Exception:  # as above; whoever reads the file says what is wrong with it
        return ""


def check_hdf5(path: str | os.PathLike[str]) -> None:
    """Raise `RecordingError` unless a file starts like HDF5 and, if smsid wrote it, is as it was written."""
    file = Path(path)
    if not file.is_file():
        raise RecordingError(f"There is no file {path}.", advice="Check the path.", path=str(path))
    try:
        with file.open("rb") as stream:
            start = stream.read(len(HDF5_SIGNATURE))
    except OSError as error:
        raise RecordingError(
            f"Cannot read {path}: {error}.", advice="Check its permissions.", path=str(path)
        ) from error
    if start == HDF5_SIGNATURE:
        return _check_sum(file)
    if HDF5_SIGNATURE.startswith(start):
        raise damaged_error(path, None)
    if start[:3] == b"CDF":
        advice = "It is classic netCDF; convert it with: nccopy -k netCDF-4 <file> <new file>."
    else:
        advice = "Is it the right file? Logs in other formats come in with import_recording and a mapping."
    raise RecordingError(f"{path} is not an HDF5 file.", advice=advice, path=str(path))


def _check_sum(path: Path) -> None:
    with path.open("rb") as stream:
        size = max(path.stat().st_size - len(SEAL) - SUM_SIZE, 0)
        stream.seek(size)
        seal = stream.read()
        stream.seek(0)
        found = hashlib.blake2b(digest_size=SUM_SIZE)
        while seal.startswith(SEAL) and (block := stream.read(min(1 << 20, size - stream.tell()))):
            found.update(block)
    if SEAL[:6] in seal and seal != SEAL + found.digest():
        raise damaged_error(path, None)


def refuse_other_files(file: h5py.File, path: str | os.PathLike[str]) -> None:
    """Raise `RecordingError` where an open HDF5 file takes data from other files of the machine.

    HDF5 can name any file as the place of a dataset's bytes, and link to others: a log that somebody sends
    would bring in what only its reader may see.
    """
    import h5py

    def visit(name: str, node: Any) -> None:  # every object once, also where groups hold each other
        if isinstance(node, h5py.Dataset) and (node.external or node.is_virtual):
            raise _elsewhere(path, name)
        if isinstance(node, h5py.Group):
            for link in node:
                if node.get(link, getlink=True, getclass=True) is h5py.ExternalLink:
                    raise _elsewhere(path, f"{name}/{link}")

    visit("", file)
    file.visititems(visit)


def _elsewhere(path: str | os.PathLike[str], name: str) -> RecordingError:
    return RecordingError(
        f"{path}: '{name}' takes its data from another file.",
        advice="Write one file that holds its own data, for instance with h5repack.",
        path=str(path),
        name=name,
    )


def damaged_error(path: str | os.PathLike[str], error: Exception | None) -> RecordingError:
    """Return the error of an HDF5 file that cannot be read, or is not as it was written."""
    size = Path(path).stat().st_size
    return RecordingError(
        f"{path} ({size} bytes) is cut short or damaged{f': {error}' if error else ''}.",
        advice="Copy it again from where it was made.",
        path=str(path),
        size=size,
    )


def _check_conventions(stored: Stored) -> None:
    for name, (dims, _, attributes) in stored.items():
        if dims == (name,):
            continue
        quantity = quantity_of(name, unit=attributes.get("unit"))
        frame, order = attributes.get("frame"), attributes.get("quaternion_order")
        if frame != quantity.frame or (quantity.is_quaternion and order != "x y z w"):
            raise RecordingError(
                f"Channel '{name}' is in frame '{frame}' (quaternion order {order}); expected "
                f"'{quantity.frame}'{' and x y z w' if quantity.is_quaternion else ''}.",
                advice="Bring it in with import_recording and a mapping, which converts conventions.",
                channel=name,
            )
