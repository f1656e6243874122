"""Finding the files of a data set: local copies first, then the download cache."""

from __future__ import annotations

import gzip
import hashlib
import logging
import os
import zlib
from pathlib import Path
from urllib.parse import quote

from smsid.datasets.registry import DataFile, DataSet, data_set
from smsid.errors import RecordingError, require

logger = logging.getLogger(__name__)

VARIABLE = "SMSID_DATA"
"""Environment variable that names the folder of local copies."""


def fetch(name: str, *, download: bool = True) -> dict[str, Path]:
    """Return the files of a data set by name, each verified against its published sum.

    A file is taken from ``$SMSID_DATA/<data set>/``, as it is or gzipped (``.gz``; the sum is that of the
    content), else from pooch's cache, else downloaded from its repository (extra ``data``).

    Args:
        name: of the data set, see `smsid.datasets.DATASETS`.
        download: allow the cache and the network; without it local copies must be there.

    Raises:
        RecordingError: unknown data set, a local file whose content is not the published one, a file that is
            absent and may or can not be downloaded.
        MissingDependencyError: a file has to be downloaded and pooch is not installed.
    """
    chosen = data_set(name)
    return {file.name: _file(chosen, file, download) for file in chosen.files}


def have(name: str) -> bool:
    """Tell whether all files of a data set are among the local copies, without reading them."""
    chosen = data_set(name)
    return all(_local(chosen, file) is not None for file in chosen.files)


def sha256(path: Path) -> str:
    """Return the sha256 of a file's content, unpacked if it is gzipped.

    Raises:
        RecordingError: the gzip is damaged.
    """
    digest = hashlib.sha256()
    try:
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as stream:
            while chunk := stream.read(1 << 20):
                digest.update(chunk)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise RecordingError(
            f"{path} is damaged: {error}.", advice="Copy it again.", path=str(path)
        ) from error
    return digest.hexdigest()


def _file(chosen: DataSet, file: DataFile, download: bool) -> Path:
    local = _local(chosen, file)
    if local is not None:
        found = sha256(local)
        if found != file.sha256:
            raise RecordingError(
                f"{local} is not the published file: its sha256 is {found}, not {file.sha256}.",
                advice=f"Copy it again from {chosen.repository} at {chosen.commit}, or take it out of "
                f"${VARIABLE}.",
                path=str(local),
                sha256=found,
            )
        return local
    if not download:
        raise RecordingError(
            f"'{file.name}' of data set '{chosen.name}' is absent.",
            advice=f"Set {VARIABLE} to a folder with {chosen.name}/{file.name} (or .gz), from "
            f"{chosen.repository} at commit {chosen.commit} ({chosen.licence}), or allow the download.",
            data_set=chosen.name,
            file=file.name,
        )
    return _downloaded(chosen, file)


def _local(chosen: DataSet, file: DataFile) -> Path | None:
    root = os.environ.get(VARIABLE, "")
    for name in (file.name, f"{file.name}.gz"):
        path = Path(root) / chosen.name / name
        if root and path.is_file():
            return path
    return None


def _downloaded(chosen: DataSet, file: DataFile) -> Path:
    if file.path is None:
        raise RecordingError(
            f"'{file.name}' of data set '{chosen.name}' is absent, and where it lies in its repository is "
            "unknown.",
            advice=f"Look for it in {chosen.repository} at commit {chosen.commit} (sha256 {file.sha256}) "
            f"and put it into ${VARIABLE}/{chosen.name}/.",
            data_set=chosen.name,
            file=file.name,
        )
    pooch = require("pooch", "data")
    url = f"https://raw.githubusercontent.com/{chosen.repository}/{chosen.commit}/{quote(file.path)}"
    logger.info("%s of '%s' from %s", file.name, chosen.name, url)
    try:
        path = pooch.retrieve(
            url,
            known_hash=f"sha256:{file.sha256}",
            fname=file.name,
            path=Path(pooch.os_cache("smsid")) / chosen.name,
        )
    except Exception as error:  # pooch raises ValueError for a wrong sum, requests' errors for the network
        raise RecordingError(
            f"'{file.name}' of data set '{chosen.name}' cannot be downloaded from {url}: {error}.",
            advice=f"Check the network, or put the file into ${VARIABLE}/{chosen.name}/.",
            url=url,
        ) from error
    return Path(path)
