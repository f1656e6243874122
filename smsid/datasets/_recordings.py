"""The data sets as recordings and descriptions."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np

from smsid.datasets._fetch import data_set, fetch
from smsid.description import Description, load_description
from smsid.errors import RecordingError
from smsid.recording import Recording, read_columns
from smsid.recording.readers import CsvFormat

TX40_RATE = 5000.0  # [Hz]
SILVERBOX_RATE = 1e7 / 2**14  # [Hz]
SILVERBOX_ARROW = 40_000  # samples: the validation part, then multisines


def tx40(*, download: bool = True) -> tuple[Description, Recording]:
    """Return the Staubli TX40: its description with gears and zeros, and 9 s of motor motion at 5 kHz.

    Channels ``motor.joint_position`` and ``motor.joint_torque``, (45000, 6).

    Raises:
        RecordingError: as `fetch`.
    """
    found = fetch("staubli_tx40", download=download)
    names = tuple(f"joint_{k}" for k in range(1, 7))
    columns = [read_columns(found[file]) for file in ("pos_read_data.csv", "curr_data.csv")]
    position, torque = (np.column_stack([c[f"Joint_{k}"] for k in range(1, 7)]) for c in columns)
    recording = Recording.from_arrays(
        np.arange(len(position)) / TX40_RATE,
        {"motor.joint_position": position, "motor.joint_torque": torque},
        labels={"joint": names},
        provenance=_provenance("staubli_tx40"),
        name="staubli_tx40",
    )
    bundled = load_description(Path(str(files("smsid.datasets") / "tx40.toml")))
    return bundled.model_copy(update={"folder": found["tx40_mdh_modified.urdf"].parent}), recording


def silverbox(*, download: bool = True) -> tuple[Recording, Recording]:
    """Return the Silverbox for estimation (ten multisines) and for validation (the arrow).

    Channels ``extra.input`` and ``extra.output`` [V], (N,).

    Raises:
        RecordingError: as `fetch`.
    """
    columns = read_columns(fetch("silverbox", download=download)["SNLS80mV.csv"])
    drive, answer = columns["V1"], columns["V2"]
    if drive.size != 131_072:
        raise RecordingError(f"The Silverbox has 131072 samples, not {drive.size}.", advice="Copy it again.")

    def part(window: slice, role: str) -> Recording:
        times = np.arange(drive.size)[window] / SILVERBOX_RATE
        return Recording.from_arrays(
            times,
            {"extra.input": drive[window], "extra.output": answer[window]},
            units={"extra.input": "V", "extra.output": "V"},
            provenance=_provenance("silverbox"),
            role=role,
            name=f"silverbox {role}",
        )

    return part(slice(SILVERBOX_ARROW, None), "estimation"), part(slice(SILVERBOX_ARROW), "validation")


def cessipy_slab(*, download: bool = True) -> Recording:
    """Return the slab's ambient vibration: ``phone.acceleration`` (25291, 3) [m/s^2] in the phone's axes.

    Raises:
        RecordingError: as `fetch`.
    """
    path = fetch("cessipy_slab", download=download)["Example02_Smartphone_Data.csv"]
    columns = read_columns(path, CsvFormat(names=("t", "x", "y", "z"), skip_rows=1))
    return Recording.from_arrays(
        columns["t"],
        {"phone.acceleration": np.column_stack([columns[k] for k in "xyz"])},
        provenance=_provenance("cessipy_slab"),
        name="cessipy_slab",
    )


def antisloshing(*, download: bool = True) -> tuple[Description, Recording]:
    """Return the Comau arm that carries the tank, and its move: force, torque and joint angles at 500 Hz.

    Channels ``hand.force``, ``hand.torque`` (N, 3) [N, N m] in the axes of the sensor, whose clock is that of
    the bag; ``encoder.joint_position`` (N, 6) with the stamps of its messages.

    Raises:
        RecordingError: as `fetch`.
        MissingDependencyError: rosbags is not installed.
    """
    found = fetch("antisloshing", download=download)
    columns = read_columns(found["y_noRot.bag"])
    wrench, joints = "/atift_sensor/data", "/comau_smart_six/joint_states"
    clock = columns[f"{wrench}.time"]
    kept = np.concatenate([[True], np.diff(clock) > 0.0])
    force, torque = (
        np.column_stack([columns[f"{wrench}.{part}.{axis}"] for axis in "xyz"])[kept]
        for part in ("linear", "angular")
    )
    recording = Recording.from_arrays(
        None,
        {
            "hand.force": (clock[kept], force),
            "hand.torque": (clock[kept], torque),
            "encoder.joint_position": (columns[f"{joints}.stamp"], columns[f"{joints}.position"]),
        },
        labels={"joint": tuple(f"q{k}_joint" for k in range(1, 7))},
        provenance=_provenance("antisloshing"),
        name="antisloshing",
    )
    urdf = found["comau_smartsix5.urdf"]
    description = Description(
        name="comau_smartsix5", urdf=urdf.name, root="fixed", gravity=(0.0, 0.0, -9.81), meshes="ignored",
        inertias="trusted", folder=urdf.parent,
    )  # fmt: skip
    return description, recording


def _provenance(name: str) -> dict[str, str]:
    chosen = data_set(name)
    return {
        "data_set": name,
        "repository": chosen.repository,
        "commit": chosen.commit,
        "licence": chosen.licence,
    }
