"""Public recordings of real hardware: where each comes from, its licence, and the sums of its files."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from smsid._listing import did_you_mean
from smsid.errors import RecordingError


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
