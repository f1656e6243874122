"""Sound recordings of many kinds: of real hardware (SMSID_DATA), of another engine (SMSID_ORACLE)."""

from __future__ import annotations

import gzip
import io
import os
from collections.abc import Callable, Iterator
from functools import partial
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


Made = Iterator[tuple[str, Callable[[], Recording]]]
LATE = 0.19
"""How late TIAGo's joint rates are behind its angles [s]: 0.18 to 0.19 s in each of its eight joints, where
the correlation of increments and integrals over 0.5 s is above 0.999 (0.987 to 0.993 without).
"""


def of_another_engine() -> Made:
    """Yield the eleven recordings of MuJoCo by name, noise-free, each as what reads it."""
    for path in sorted(folder("SMSID_ORACLE").glob("*.npz")):
        kind = "oracle_exp1" if path.stem.startswith("exp1") else "oracle_exp2"
        yield f"oracle {path.stem}", partial(import_recording, path, kind)


def of_hardware() -> Made:
    """Yield eight recordings of six public data sets by name, each as what reads it."""
    data = folder("SMSID_DATA")
    yield "TX40", lambda: tx40(download=False)[1]
    for k, name in enumerate(("multisines", "arrow")):
        yield f"Silverbox, {name}", lambda k=k: silverbox(download=False)[k]
    yield "slab", partial(cessipy_slab, download=False)
    yield "tank on an arm", lambda: antisloshing(download=False)[1]
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        yield name, partial(_emps, data / "emps" / f"{name}.mat")
    yield "TIAGo, rates in time", partial(_tiago, data / "tiago", LATE)


def with_a_fault() -> Made:
    """Yield recordings of hardware that have a fault of their own."""
    yield "TIAGo as published", partial(_tiago, folder("SMSID_DATA") / "tiago", 0.0)


def of_the_demonstration() -> Made:
    """Yield the recordings that come with the package by name, each as what reads it."""
    for path in (demonstration().estimation, demonstration().validation):
        yield f"demonstration, {path.stem}", partial(load_recording, path)


def _emps(path: Path) -> Recording:
    read = {k: np.ravel(v) for k, v in loadmat(path).items() if k[0] != "_"}
    angle, force = read["qm"][:, None], EMPS_NEWTON * read["vir"][:, None]
    channels = {"encoder.joint_position": angle, "drive.joint_torque": force}
    return Recording.from_arrays(read["t"], channels, labels={"joint": ["slide"]})


def _tiago(path: Path, late: float) -> Recording:
    tables = {}
    for quantity in ("position", "velocity", "effort"):
        text = gzip.decompress((path / f"tiago_{quantity}.csv.gz").read_bytes()).decode()
        tables[quantity] = np.genfromtxt(io.StringIO(text), delimiter=",", skip_header=1)
    joints = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
    t = tables["position"][:, 0]
    return Recording.from_arrays(
        None,
        {
            "encoder.joint_position": (t, tables["position"][:, 1:]),
            "rates.joint_velocity": (t - late, tables["velocity"][:, 1:]),
            "extra.effort": (t, tables["effort"][:, 1:]),
        },
        labels={"joint": joints},
        units={"extra.effort": "A"},
    )
