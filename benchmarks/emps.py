"""EMPS, a linear axis with ball screw: published values, two halves, and pulses it was not identified from.

Least squares by hand on the same data puts angles and forces through one Butterworth filter, forward and
backward, takes rates by differences, and is judged on pulses that went through the same filter: its error
depends on the band, of which two are shown. Of all instants and without a delay it gives what is published;
of those that are not near rest, with a delay, other friction, which is what `smsid` finds. The diagnosis
begins with the bare axis, from either file. Needs SMSID_DATA with the folder emps.

    python benchmarks/emps.py
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _common import environment, write_result
from scipy.io import loadmat
from scipy.ndimage import binary_dilation
from scipy.signal import butter, sosfiltfilt

from smsid.arm import identify_arm, with_friction_laws, with_joint_effects
from smsid.description import Description
from smsid.diagnose import diagnose
from smsid.recording import Recording

URDF = """<robot name="axis"><link name="base"/>
<link name="carriage"><inertial><mass value="90"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="500" velocity="1"/></joint></robot>"""
PUBLISHED = {
    "carriage.m": 95.109,
    "friction_slide.viscous": 203.503,
    "friction_slide.coulomb": 20.394,
    "bias_slide.torque": -3.165,
}
BANDS = (20.0, 80.0)  # [Hz]
SLOW = 0.005  # [m/s] below which the axis is at rest
NEAR = 0.025  # [s] of that, which is near rest
EDGE = 500  # samples at either end, where a filter does not know what lies beyond


def read(name: str, role: str) -> Recording:
    data = loadmat(str(Path(os.environ["SMSID_DATA"]) / "emps" / name))
    t, q, signal = (data[k].ravel() for k in ("t", "qm", "vir"))
    channels = {
        "encoder.joint_position": q[:, None],
        "drive.joint_torque": float(data["gtau"].item()) * signal[:, None],
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("slide",)}, role=role, name=name)


def by_hand(log: Recording, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns (N, 4) and force (N,) of mass, viscous and Coulomb friction and offset, all filtered alike."""
    step = float(np.median(np.diff(log.time("encoder.joint_position"))))
    sos = butter(4, cutoff * 2.0 * step, output="sos")
    q = sosfiltfilt(sos, log["encoder.joint_position"][:, 0])
    v = np.gradient(q, step)
    columns = np.column_stack([np.gradient(v, step), v, sosfiltfilt(sos, np.sign(v)), np.ones_like(v)])
    kept = slice(EDGE, -EDGE)
    return columns[kept], sosfiltfilt(sos, log["drive.joint_torque"][:, 0])[kept]


def slides(columns: np.ndarray, step: float) -> np.ndarray:
    """Which instants (N,) are not near rest."""
    return ~binary_dilation(np.abs(columns[:, 1]) <= SLOW, iterations=round(NEAR / step))


def with_delay(columns: np.ndarray, force: np.ndarray, step: float, used: np.ndarray) -> np.ndarray:
    """Least squares (5,) of the instants ``used`` with the delay behind the four others."""
    predicted = columns @ np.linalg.lstsq(columns[used], force[used], rcond=None)[0]
    columns = np.column_stack([columns, np.gradient(predicted, step)])
    return np.linalg.lstsq(columns[used], force[used], rcond=None)[0]


def diagnosed(bare: Description, log: Recording, other: Recording) -> dict[str, Any]:
    """What the diagnosis finds from the bare axis, and its error on the other recording."""
    found = diagnose(bare, [log], validation=[other]).diagnosis
    assert found.gain is not None, found.gain_reason
    return {
        "verdict": found.verdict,
        "values": {
            p.name: [round(p.value, 6), round(p.sigma, 6)] for c in found.causes for p in c.parameters
        },
        "held_out_relative_error": round(found.gain.channels[-1].extended, 4),
    }


def main() -> None:
    train, pulses = read("DATA_EMPS.mat", "estimation"), read("DATA_EMPS_PULSES.mat", "validation")
    hand = {}
    for band in BANDS:
        columns, force = by_hand(train, band)
        x = np.linalg.lstsq(columns, force, rcond=None)[0]
        step = float(np.median(np.diff(train.time("encoder.joint_position"))))
        sliding = with_delay(columns, force, step, slides(columns, step))
        columns, force = by_hand(pulses, band)
        hand[f"up to {band:g} Hz"] = {
            "values": {n: round(float(v), 3) for n, v in zip(PUBLISHED, x, strict=True)},
            "where_it_slides": {
                **{n: round(float(v), 3) for n, v in zip(PUBLISHED, sliding, strict=False)},
                "delay_ms": round(1e3 * float(sliding[-1]), 3),
            },
            "held_out_relative_error": round(
                float(np.linalg.norm(columns @ x - force) / np.linalg.norm(force)), 4
            ),
        }
    files = {"DATA_EMPS": train, "DATA_EMPS_PULSES": pulses}
    middle = float(train.time("encoder.joint_position").mean())
    ends = [float(x) for x in train.time("encoder.joint_position")[[0, -1]]]
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "axis.urdf").write_text(URDF)
        bare = Description(
            name="axis", urdf="axis.urdf", folder=Path(name), root="fixed", gravity=(0.0, 0.0, -9.81)
        )
        from_bare = {
            name: diagnosed(bare, log.with_role("estimation"), other.with_role("validation"))
            for (name, log), other in zip(files.items(), (pulses, train), strict=True)
        }
        print("from the bare axis", from_bare, flush=True)
        usual = with_joint_effects(bare, ("slide",), "joint_friction", "torque_offset")
        for law, arm, equal in (
            ("viscous and Coulomb, errors equally large as published", usual, True),
            ("viscous and Coulomb", usual, False),
            ("and by direction", with_friction_laws(usual, ("slide",), ("direction",)), False),
        ):
            found = identify_arm(arm, train, equal_errors=equal)
            halves = [
                identify_arm(arm, train.window(*w), equal_errors=equal).estimate
                for w in ((ends[0], middle), (middle, ends[1]))
            ]
            scores = {
                p.name: (p.value - halves[1][p.name].value) / np.hypot(p.sigma, halves[1][p.name].sigma)
                for p in halves[0].parameters
            }
            narrow = identify_arm(arm, train, cutoff=BANDS[0], equal_errors=equal)
            results[law] = {
                "values": {p.name: [round(p.value, 3), round(p.sigma, 3)] for p in found.estimate.parameters},
                "delay_ms": [round(1e3 * found.delay.value, 3), round(1e3 * found.delay.sigma, 3)],
                "relative_to_published": {
                    n: round(found.estimate[n].value / x - 1.0, 4)
                    for n, x in PUBLISHED.items()
                    if n in {p.name for p in found.estimate.parameters}
                },
                "halves_beyond_1.96_sigma": [int(sum(abs(z) > 1.96 for z in scores.values())), len(scores)],
                "samples_in_a_block": found.torques.length,
                "held_out_relative_error": round(found.judge(pulses).relative, 4),
                f"held_out_relative_error_up_to_{BANDS[0]:g}_Hz": round(narrow.judge(pulses).relative, 4),
            }
            print(law, results[law], flush=True)
    result = {
        "claim": "EMPS: published values within 1 % as they were found; what its sliding tells, "
        "halves agree, pulses predicted better than by hand",
        "command": "python benchmarks/emps.py",
        "environment": environment("pin", "numpy", "scipy"),
        "data": {"set": "emps", "identified_from": "DATA_EMPS.mat", "judged_on": "DATA_EMPS_PULSES.mat"},
        "by_hand": hand,
        "results": results,
        "diagnosis_from_the_bare_axis": from_bare,
    }
    print(write_result("emps", result))


if __name__ == "__main__":
    main()
