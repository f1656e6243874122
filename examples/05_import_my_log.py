# /// script
# dependencies = ["smsid[plot]"]
# ///
"""A log as a foreign logger writes it: see what is in it, say it in a mapping, import it, and be refused.

python examples/05_import_my_log.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

from smsid.description import load_description
from smsid.errors import RecordingError
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.recording import Recording, import_recording, save_recording
from smsid.recording.inspect import inspect_file

matplotlib.use("Agg")
from matplotlib import pyplot as plt

MAPPING = """
[recording]
name = "flight 12"
role = "estimation"

[time]
column = "stamp [ms]"
unit = "ms"

[channel."imu.angular_rate"]
columns = ["gyro_x", "gyro_y", "gyro_z"]
unit = "degree/s"
frame = "body"

[channel."encoder.joint_position"]
columns = ["q1", "q2", "q3"]
unit = "degree"
labels = ["joint1", "joint2", "joint3"]
"""


def foreign_log(file: Path) -> Recording:
    """Write a flight in milliseconds and degrees, and return it."""
    model = build_model(load_description(urdf_folder() / "paper_sms.toml"))
    plan = named_experiment("exp2", model).model_copy(update={"duration": 20.0})
    flight = fly(model, plan, np.random.default_rng(1)).recording
    columns = {"stamp [ms]": 1e3 * flight.time("imu.angular_rate")}
    columns |= {f"gyro_{x}": np.degrees(flight["imu.angular_rate"][:, k]) for k, x in enumerate("xyz")}
    columns |= {f"q{k + 1}": np.degrees(flight["encoder.joint_position"][:, k]) for k in range(3)}
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, delimiter=";", header=";".join(columns), comments="")
    return flight


def main(folder: Path) -> None:
    """Write, look, map, import, draw."""
    log, mapping = folder / "log.csv", folder / "map.toml"
    flight = foreign_log(log)
    seen = inspect_file(log)
    for clock in seen.clocks:
        print(f"clock {clock.name}: {clock.samples} samples at {clock.rate:.4g} Hz, in {clock.unit}")
    print("suspicious:", *(seen.suspicions or ["nothing"]))

    mapping.write_text(MAPPING, encoding="utf-8")
    recording = import_recording(log, mapping)
    print("channels:", ", ".join(f"{c} [{recording.unit(c)}]" for c in recording.channels))
    save_recording(recording, folder / "flight12.nc")
    error = np.abs(recording["imu.angular_rate"] - flight["imu.angular_rate"]).max()
    print(f"largest difference from what was flown: {error:.1e} rad/s")

    mapping.write_text(MAPPING.replace('"gyro_z"', '"gyro_zz"'), encoding="utf-8")
    try:
        import_recording(log, mapping)
    except RecordingError as refused:
        print("refused:", refused)
    mapping.write_text(MAPPING, encoding="utf-8")

    figure, (top, bottom) = plt.subplots(2, sharex=True, figsize=(8, 5), layout="constrained")
    top.plot(recording.time(), recording["imu.angular_rate"])
    top.set_ylabel("gyro [rad/s]")
    bottom.plot(recording.time(), recording["encoder.joint_position"], label=recording.labels["joint"])
    bottom.set_ylabel("joints [rad]")
    bottom.set_xlabel("time [s]")
    bottom.legend()
    figure.savefig(folder / "log.png", dpi=120)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
