"""Finding the files of a data set: local copies first, then the download cache."""

from __future__ import annotations

import gzip
import hashlib
import logging
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from urllib.parse import quote

from smsid._listing import did_you_mean
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
    return _download(chosen, file)


def _local(chosen: DataSet, file: DataFile) -> Path | None:
    root = os.environ.get(VARIABLE, "")
    for name in (file.name, f"{file.name}.gz"):
        path = Path(root) / chosen.name / name
        if root and path.is_file():
            return path
    return None


def _download(chosen: DataSet, file: DataFile) -> Path:
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


@dataclass(frozen=True)
class DataFile:
    """A published file: its name, the sha256 of its content, and its path in the repository if it is
    known.
    """

    name: str
    sha256: str
    path: str | None = None


@dataclass(frozen=True)
class DataSet:
    """Files of one GitHub repository at one commit, under one licence."""

    name: str
    summary: str
    repository: str
    commit: str
    licence: str
    files: tuple[DataFile, ...]


def data_set(name: str) -> DataSet:
    """Return a data set of the registry; raises `RecordingError` for an unknown name."""
    if name not in DATASETS:
        raise RecordingError(
            f"There is no data set '{name}'." + did_you_mean(name, DATASETS),
            advice=f"There are {', '.join(DATASETS)}.",
            known=tuple(DATASETS),
        )
    return DATASETS[name]


_ALL = (
    DataSet(
        "staubli_tx40",
        "six-axis industrial arm: motor positions and torques at 5 kHz for 9 s, URDF, documented friction",
        "thanhndv212/figaroh-examples",
        "c0b5c7f0",
        "Apache-2.0",
        (
            DataFile("pos_read_data.csv", "5cc1cecc1024ef0e331d0caba06f689456ab789ec3f1e904599c0a8be5c27bc8"),
            DataFile("curr_data.csv", "f4592f4ba4db42f5d7625688986be25b575ca34d0504b27979ca6b0276bd3af9"),
            DataFile("TX40_config.yaml", "0b17b5cdb953fa0d7bcfd1f2650444b53f98d414e8450d7908fcee10d65b80dc"),
            DataFile(
                "tx40_mdh_modified.urdf",
                "3d00cbd46279c915d594b1bb4610dbac78d1e99ed27f95de70984bde13486074",
                "examples/staubli_tx40/urdf/tx40_mdh_modified.urdf",
            ),
        ),
    ),
    DataSet(
        "silverbox",
        "electronic Duffing oscillator: input and output voltage, 131 072 samples at 610.35 Hz",
        "biaslab/nsi-silverbox",
        "728f07e4",
        "MIT",
        (DataFile("SNLS80mV.csv", "ae62d5a91230c10f76e6dd02c8a4fac3c9d4d8a95fbf50e87cb0c4885003e0f1"),),
    ),
    DataSet(
        "antisloshing",
        "water in a cylinder carried by a Comau Smart Six: force, torque and joint states at 500 Hz",
        "GiorgioMedico/AntiSloshing",
        "75eb6533",
        "MIT",
        (
            DataFile(
                "y_noRot.bag",
                "d92d28e24dda7d0d6efae6ea6779ad7b4ffb67904c57937e62ecdff43356c2d6",
                "Sloshing Models/Parameters_Estimation/bagfiles/290425/y_noRot.bag",
            ),
            DataFile(
                "y_2D_0m_0.8s_0deg_noRot.csv",
                "41eadbdbc08018b7e28192872ba6f595730d245943abbbc76ddfbf86d4dcb7b0",
            ),
            DataFile(
                "y_2D_0m_0.8s_0deg_noRot_joint.csv",
                "480164b7fc7ba871cb48a8b3e3980dc2bf7065715e7b548e8a27f6056ccab30b",
            ),
            DataFile(
                "comau_smartsix5.urdf",
                "5cd598f15d1ea99d205890e892896d55ca37bf6e4553d6fc2fd722ae0373b887",
                "Kinematics/Comau_Kinematics/URDF/comau_smartsix5.urdf",
            ),
        ),
    ),
    DataSet(
        "cessipy_slab",
        "concrete slab under ambient vibration: phone accelerometer, 25 291 x 3 at 425 Hz",
        "MatheusCarini/CESSIPy",
        "d8f1138a",
        "MIT",
        (
            DataFile(
                "Example02_Smartphone_Data.csv",
                "74f1d90dc00d623f8866e4dfb23f549c97471a421c92a562674282f3046088d4",
                "English/Example02_Smartphone_Data.csv",
            ),
        ),
    ),
)

DATASETS = MappingProxyType({d.name: d for d in _ALL})
"""Every data set by name."""
