"""Sound recordings of all kinds: of real hardware (SMSID_DATA), of another engine (SMSID_ORACLE)."""

from __future__ import annotations

import gzip
import io
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from smsid.datasets import antisloshing, cessipy_slab, demonstration, silverbox, tx40
from smsid.recording import Recording, import_recording, load_recording

EMPS_NEWTON = 35.15
"""Force of the drive by unit of its control signal, published with the data [N]."""


def folder(variable: str) -> Path:
    """Return the folder an environment variable names; ends the program where it names none."""
    path = Path(os.environ.get(variable) or "/nonexistent")
    if not path.is_dir():
        raise SystemExit(f"Set {variable} to the folder of the recordings.")
    return path


def of_another_engine() -> Iterator[tuple[str, Recording]]:
    """Yield the eleven recordings of MuJoCo by name, noise-free."""
    for path in sorted(folder("SMSID_ORACLE").glob("*.npz")):
        kind = "oracle_exp1" if path.stem.startswith("exp1") else "oracle_exp2"
        yield f"oracle {path.stem}", import_recording(path, kind)


def of_hardware() -> Iterator[tuple[str, Recording]]:
    """Yield eight recordings of six public data sets by name."""
    data = folder("SMSID_DATA")
    yield "TX40", tx40(download=False)[1]
    for name, part in zip(("multisines", "arrow"), silverbox(download=False), strict=True):
        yield f"Silverbox, {name}", part
    yield "slab", cessipy_slab(download=False)
    yield "tank on an arm", antisloshing(download=False)[1]
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        read = {k: np.ravel(v) for k, v in loadmat(data / "emps" / f"{name}.mat").items() if k[0] != "_"}
        yield (
            name,
            Recording.from_arrays(
                read["t"],
                {
                    "encoder.joint_position": read["qm"][:, None],
                    "drive.joint_torque": EMPS_NEWTON * read["vir"][:, None],
                },
                labels={"joint": ["slide"]},
            ),
        )
    yield "TIAGo", _tiago(data / "tiago")


def _tiago(path: Path) -> Recording:
    tables = {}
    for quantity in ("position", "velocity", "effort"):
        text = gzip.decompress((path / f"tiago_{quantity}.csv.gz").read_bytes()).decode()
        tables[quantity] = np.genfromtxt(io.StringIO(text), delimiter=",", skip_header=1)
    joints = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
    t = tables["position"][:, 0]
    kept = np.concatenate([[True], np.diff(t) > 0.0])
    return Recording.from_arrays(
        t[kept],
        {
            "encoder.joint_position": tables["position"][kept, 1:],
            "encoder.joint_velocity": tables["velocity"][kept, 1:],
            "extra.effort": tables["effort"][kept, 1:],
        },
        labels={"joint": joints},
        units={"extra.effort": "A"},
    )


def of_the_demonstration() -> Iterator[tuple[str, Recording]]:
    """Yield the recordings that come with the package by name."""
    for path in (demonstration().estimation, demonstration().validation):
        yield f"demonstration, {path.stem}", load_recording(path)
