"""Make the recordings that ``smsid demo`` shows: a craft in MuJoCo, with friction its description lacks.

    python benchmarks/demo_recording.py [--folder smsid/datasets/bundled]

Nothing of smsid's model, effects or simulation takes part: the world is that of ``tests/hidden``. The
description says what the builder believed. Masses, moments and inertias of the world differ by several
per cent, the slosh's by a tenth, and joint 2 has viscous friction. ``truth.json`` holds what the world was;
nothing reads it but the page's last section, which compares. Channels are kept as 32-bit floats, whose
rounding is below three hundredths of each sensor's noise.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import mujoco
import numpy as np
from _common import ROOT

from smsid._files import atomic_path, atomic_write
from smsid.recording import Recording, save_recording
from tests.hidden import bodies
from tests.hidden.catalogue import hidden_effects
from tests.hidden.description import write_description
from tests.hidden.experiment import Commands, Multisine, column_names, design_joints, smooth_start
from tests.hidden.flight import fly
from tests.hidden.numbers import JOINTS, WHEELS, WORLDS, Numbers, moved
from tests.hidden.plant import Change
from tests.hidden.sensors import NOISE, measured

SEED = 20
DURATION = 30.0  # [s]
RATE = 25.0  # [Hz]
FINE = 2.5e-3  # [s]
LEVELS = {  # standard deviations; encoders of 21 bits, a good gyro and accelerometer, a star tracker
    "encoder.joint_position": 2e-6,
    "encoder.joint_velocity": 2e-5,
    "imu.angular_rate": 3e-5,
    "imu.acceleration": 3e-4,
}
HIDDEN, STRENGTH = "joint_friction:viscous@joint2", 1.5  # [N m s/rad]
NAME = "demo_craft"
OFF = {"bus": 0.04, "link1": 0.05, "link2": 0.05, "link3": 0.05}
"""Standard deviation of the masses' error, relative; of moments and inertias half of it."""
SLOSH = {"mass": 0.10, "stiffness": -0.08}

VISUALS = {
    "bus": '<geometry><box size="2 2 2"/></geometry>'
    '<material name="hull"><color rgba="0.80 0.67 0.36 1"/></material>',
    "link1": '<origin xyz="0 0 0.25"/><geometry><cylinder radius="0.14" length="0.5"/></geometry>'
    '<material name="arm"><color rgba="0.86 0.88 0.90 1"/></material>',
    "link2": '<origin xyz="1 0 0" rpy="0 1.5707963 0"/>'
    '<geometry><cylinder radius="0.10" length="2"/></geometry>'
    '<material name="arm"/>',
    "link3": '<origin xyz="1 0 0" rpy="0 1.5707963 0"/>'
    '<geometry><cylinder radius="0.08" length="2"/></geometry>'
    '<material name="arm"/>',
}


def true_world(nominal: Numbers, rng: np.random.Generator) -> Numbers:
    """Return the world as it is: the described one plus several per cent, drawn again while unphysical."""
    while True:
        change = {
            f"{name}.{symbol}": OFF[name] * size * rng.standard_normal() * (1.0 if symbol == "m" else 0.5)
            for name, theta in nominal.body.items()
            for symbol, size in zip(bodies.SYMBOLS, bodies.sizes(theta), strict=True)
        }
        for tank in nominal.tanks:
            change[f"{tank.name}.mass"] = SLOSH["mass"] * tank.mass
            for axis, value in zip("xyz", tank.stiffness, strict=True):
                change[f"{tank.name}.stiffness.{axis}"] = SLOSH["stiffness"] * value
        true = moved(nominal, change)
        if all(map(bodies.is_physical, true.body.values())):
            return true


def arm_and_wheels(n: Numbers, seed: tuple[int, int]) -> Commands:
    """Return torques of wheels and joints, no thrust; the joints' follow a path in the described world."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(DURATION * RATE) + 1) / RATE
    columns = column_names(n)
    values = np.zeros((len(time), len(columns)))
    window, _ = smooth_start(time, 1.0)
    values[:, 3:6] = window * Multisine.drawn(rng, np.full(3, 0.4), 0.02, 0.5)(time)
    design_joints(n, time, values, Multisine.drawn(rng, np.array([0.35, 0.3, 0.4]), 0.015, 0.15))
    return Commands(time, values.astype(np.float32).astype(float), columns)


def flight(
    world: Numbers,
    c: Commands,
    rng: np.random.Generator,
    changes: list[Change],
    noise: dict[str, float],
    role: str,
) -> Recording:
    """Fly commands that go in a line from sample to sample, as steps of `FINE`, and record every sample."""
    many = round(1.0 / (RATE * FINE))
    fine = np.arange((len(c.time) - 1) * many + 1) * FINE
    middle = np.column_stack([np.interp(fine + 0.5 * FINE, c.time, x) for x in c.values.T])
    exact = fly(world, Commands(fine, middle, c.columns), changes)
    found = measured({name: x[::many] for name, x in exact.items()}, c.time, rng, changes, noise)
    for channel, names in (("joint_torque", JOINTS), ("force", ("thruster",)), ("wheel_torque", WHEELS)):
        found[f"command.{channel}"] = c.values[:, [i for n in names for i in c.columns_of(n)]]
    return Recording.from_arrays(
        c.time,
        found,
        labels={"joint": list(JOINTS), "wheel": list(WHEELS)},
        provenance={"inputs": "linear", "simulated_by": f"MuJoCo {mujoco.__version__}"},
        role=role,
        name=f"{role} flight",
    )


def write_files(folder: Path) -> dict[str, object]:
    """Write description, both flights and the truth into a folder; return the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    nominal = Numbers(**{**vars(WORLDS["sms"]), "name": NAME})
    rng = np.random.default_rng(SEED)
    true = true_world(nominal, rng)
    noise = {**NOISE, **LEVELS}
    change = hidden_effects("sms")[HIDDEN].make(STRENGTH, None, rng)
    for k, role in enumerate(("estimation", "validation")):
        c = arm_and_wheels(nominal, (77, k))
        made = flight(true, c, rng.spawn(1)[0], [change], noise, role)
        data = made.dataset
        for channel in made.channels:
            source = np.asarray(data[channel])
            rounded = source.astype(np.float32)
            if channel in noise and np.abs(rounded - source).max() > 0.03 * noise[channel]:
                raise SystemExit(f"{channel}: 32 bits are too coarse for its noise")
            data[channel] = data[channel].copy(data=rounded)
        save_recording(Recording(data), folder / f"{role}.nc")
        _packed(folder / f"{role}.nc")
    write_description(nominal, folder, noise)
    _with_visuals(folder / f"{NAME}.urdf")
    _with_heading(folder / f"{NAME}.toml")
    total = sum(float(b[0]) for b in true.body.values()) + sum(t.mass for t in true.tanks)
    (tank,) = true.tanks
    truth: dict[str, object] = {
        "engine": f"MuJoCo {mujoco.__version__}",
        "made by": "benchmarks/demo_recording.py",
        "seed": SEED,
        "hidden": {"effect": "joint_friction", "location": "joint2", "parameter": "viscous",
                   "value": STRENGTH, "unit": "N m s/rad"},
        "parameters": {
            **{f"{name}.{s}": float(v) for name, theta in true.body.items()
               for s, v in zip(bodies.SYMBOLS, theta, strict=True)},
            "total.mass": total,
            "tank.mass": float(tank.mass),
            **{f"tank.{field}.{axis}": float(v) for field in ("stiffness", "damping")
               for axis, v in zip("xyz", getattr(tank, field), strict=True)},
        },
    }  # fmt: skip
    atomic_write(folder / "truth.json", json.dumps(truth, indent=1) + "\n")
    return truth


def _packed(path: Path) -> None:
    """Store the channels of a recording as 32-bit floats, compressed; the values are 32-bit already."""
    import xarray as xr

    data = xr.load_dataset(path, engine="h5netcdf", decode_times=False, mask_and_scale=False)
    times = {str(name) for name in data.coords}
    encoding: dict = {
        str(name): {"_FillValue": None, "zlib": True, "complevel": 9, "shuffle": True, "fletcher32": True}
        | ({} if name in times else {"dtype": "float32"})
        for name in data.variables
        if data[name].dtype.kind == "f"
    }
    with atomic_path(path) as temporary:
        data.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)


def _with_visuals(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for link, visual in VISUALS.items():
        text = re.sub(rf'(<link name="{link}">)', rf"\1<visual>{visual}</visual>", text)
    atomic_write(path, text)


def _with_heading(path: Path) -> None:
    heading = (
        "# The craft of `smsid demo` as its builder describes it.\n"
        "# What was flown differs, see benchmarks/demo_recording.py.\n"
    )
    text = path.read_text(encoding="utf-8").replace("rate = 20.0", f"rate = {RATE!r}")
    atomic_write(path, heading + text)


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the recordings that smsid demo shows.")
    parser.add_argument("--folder", type=Path, default=ROOT / "smsid" / "datasets" / "bundled")
    print(json.dumps(write_files(parser.parse_args().folder), indent=1))


if __name__ == "__main__":
    main()
