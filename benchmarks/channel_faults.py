"""Plant faults of single components in three recordings and count which the channel checks name rightly.

A fault is named rightly if a finding has its kind, its component and its channel, or the channel it was
compared with: two related channels alone cannot tell which of them is wrong. Faults are planted where a
related channel exists. Clean recordings with other seeds must give no finding.

    python benchmarks/channel_faults.py [--seed 1] [--faults 60] [--clean 10]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from _common import ROOT, environment, write_result
from numpy.typing import NDArray

from smsid.recording import Recording
from smsid.recording._attitude import conjugate, multiply
from smsid.recording.checks import Finding, channel_findings

FloatArray = NDArray[np.float64]
AXES = "xyz"


def satellite(seed: int) -> Recording:
    """Record a rigid satellite without arm for 200 s at 20 Hz: wheels, star tracker, gyro, tachometers."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 200.0, 0.05)
    f = rng.uniform(0.02, 0.12, 3)
    torque = 0.08 * np.sin(2.0 * np.pi * f * t[:, None])
    inertia = np.array([80.0, 95.0, 70.0])
    rate = -0.08 / inertia * (1.0 - np.cos(2.0 * np.pi * f * t[:, None])) / (2.0 * np.pi * f)
    wheel = -rate * inertia / 0.04
    q = np.zeros((t.size, 4))
    q[0] = (0.1, -0.2, 0.3, np.sqrt(1.0 - 0.14))
    for k in range(t.size - 1):
        turn = 0.5 * (rate[k] + rate[k + 1]) * 0.05
        half = 0.5 * float(np.linalg.norm(turn))
        step = np.append(0.5 * turn * np.sinc(half / np.pi), np.cos(half))
        q[k + 1] = multiply(q[k], step)
    small = np.column_stack([0.5 * 3e-5 * rng.standard_normal((t.size, 3)), np.ones(t.size)])
    q = multiply(q, small)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return Recording.from_arrays(
        t,
        {
            "tracker.attitude": q,
            "gyro.angular_rate": rate + 1e-5 * rng.standard_normal(rate.shape),
            "tachometer.wheel_rate": wheel + 0.02 * rng.standard_normal(wheel.shape),
            "command.wheel_torque": torque,
        },
        labels={"wheel": ["rw1", "rw2", "rw3"]},
    )


def arm(seed: int) -> Recording:
    """Record an arm of three joints for 40 s at 100 Hz: encoder angles and joint rates."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.01)
    angle, rate = np.zeros((t.size, 3)), np.zeros((t.size, 3))
    for k in range(3):
        for _ in range(3):
            w, a, p = rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.4), rng.uniform(0.0, 6.0)
            angle[:, k] += a * np.sin(w * t + p)
            rate[:, k] += a * w * np.cos(w * t + p)
    return Recording.from_arrays(
        t,
        {
            "encoder.joint_position": angle + 2e-5 * rng.standard_normal(angle.shape),
            "encoder.joint_velocity": rate + 2e-3 * rng.standard_normal(rate.shape),
        },
        labels={"joint": ["j1", "j2", "j3"]},
    )


def craft(seed: int) -> Recording:
    """Fly the paper's craft in Exp. 2 with the sensors of its description."""
    from smsid.description import load_description
    from smsid.experiments import fly, named_experiment
    from smsid.model import build_model

    model = build_model(load_description(ROOT / "urdf" / "paper_sms.toml"))
    return fly(model, named_experiment("exp2", model), np.random.default_rng(seed)).recording


RECORDINGS: dict[str, tuple[Callable[[int], Recording], tuple[str, ...]]] = {
    "paper's craft": (
        craft,
        ("imu.angular_rate", "pose.velocity", "encoder.joint_velocity", "encoder.joint_position"),
    ),
    "satellite without arm": (satellite, ("gyro.angular_rate", "tracker.attitude")),
    "arm": (arm, ("encoder.joint_position", "encoder.joint_velocity")),
}
KINDS = (
    "swapped", "sign", "unit", "scale", "delay", "stuck", "saturated", "outlier", "single outlier",
    "quaternion", "full turn", "held",
)  # fmt: skip


def plant(
    recording: Recording, channel: str, kind: str, rng: np.random.Generator
) -> tuple[Recording, tuple[int, ...]]:
    """Plant a fault of one kind in a component of a channel; return the recording and the components."""
    x = np.array(recording[channel])
    t = recording.time(channel)
    k = int(rng.integers(x.shape[1]))
    other = (k + 1) % x.shape[1]
    touched: tuple[int, ...] = (k,)
    if kind == "swapped":
        x[:, [k, other]] = x[:, [other, k]]
        touched = (k, other)
    elif kind == "sign":
        x[:, k] *= -1.0
    elif kind == "unit":
        x[:, k] *= 1000.0 if channel.endswith(".velocity") else 180.0 / np.pi
    elif kind == "scale":
        x[:, k] *= 1.3
    elif kind == "delay":
        touched = ()
        x = np.column_stack([np.interp(t - 0.25, t, column) for column in x.T])
    elif kind == "stuck":
        x[x.shape[0] // 3 :, k] = x[x.shape[0] // 3, k]
    elif kind == "saturated":
        middle, half = float(np.median(x[:, k])), 0.5 * float(np.ptp(x[:, k]))
        x[:, k] = np.clip(x[:, k], middle - 0.4 * half, middle + 0.4 * half)
    elif kind == "outlier":
        at = rng.choice(x.shape[0], x.shape[0] // 50, replace=False)
        x[at, k] += 10.0 * float(np.std(x[:, k])) * rng.choice([-1.0, 1.0], at.size)
    elif kind == "single outlier":
        x[int(rng.integers(x.shape[0])), k] = 1e300
    elif kind == "quaternion":
        touched = ()
        x = (np.roll(x, 1, axis=1), np.roll(x, -1, axis=1), conjugate(x))[int(rng.integers(3))]
    elif kind == "full turn":
        shifted = x[:, k] - float(np.median(x[:, k])) + np.pi
        x[:, k] = (shifted + np.pi) % (2.0 * np.pi) - np.pi
    elif kind == "held":
        touched = ()
        x = x[10 * (np.arange(x.shape[0]) // 10)]
    return recording.with_channels({channel: x}), touched


def is_right(findings: tuple[Finding, ...], channel: str, kind: str, labels: tuple[str, ...]) -> bool:
    """Say whether a finding names channel (or pair), kind and components."""
    kind = "outlier" if kind == "single outlier" else kind
    return any(
        f.kind == kind and channel in (f.channel, f.other) and set(f.components) == set(labels)
        for f in findings
    )


def draw(name: str, rng: np.random.Generator) -> tuple[str, str]:
    """Draw a channel of a recording and a kind of fault that it can have."""
    channels = RECORDINGS[name][1]
    while True:
        channel, kind = channels[int(rng.integers(len(channels)))], KINDS[int(rng.integers(len(KINDS)))]
        attitude = channel.endswith(".attitude")
        if (kind == "quaternion") != attitude or (
            kind == "full turn" and not channel.endswith(".joint_position")
        ):
            continue
        return channel, kind


def measure(seed: int, faults: int, clean: int, names: tuple[str, ...] = tuple(RECORDINGS)) -> dict[str, Any]:
    """Plant ``faults`` faults in turn in the recordings and check ``clean`` recordings of each kind."""
    rng = np.random.default_rng(seed)
    rows, alarms = [], []
    sound = {name: RECORDINGS[name][0](seed) for name in names}
    for i in range(faults):
        name = names[i % len(names)]
        channel, kind = draw(name, rng)
        spoilt, touched = plant(sound[name], channel, kind, rng)
        dims = spoilt.channel(channel)
        labels = tuple(str(dims.coords[dims.dims[1]].values[k]) for k in touched)
        found = channel_findings(spoilt)
        rows.append(
            {
                "recording": name, "channel": channel, "kind": kind, "components": labels,
                "right": is_right(found, channel, kind, labels),
                "refused": any(f.clear for f in found), "said": [f.sentence for f in found],
            }
        )  # fmt: skip
    for name in names:
        for k in range(clean):
            said = [f.sentence for f in channel_findings(RECORDINGS[name][0](seed + 1 + k))]
            alarms += [{"recording": name, "seed": seed + 1 + k, "said": said}] if said else []
    return {
        "seed": seed,
        "planted": len(rows),
        "named_rightly": sum(row["right"] for row in rows),
        "refused": sum(row["refused"] for row in rows),
        "clean": clean * len(names),
        "false_alarms": alarms,
        "faults": rows,
    }


def main() -> None:
    """Measure and write ``results/channel_faults.json``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--faults", type=int, default=60)
    parser.add_argument("--clean", type=int, default=10)
    chosen = parser.parse_args()
    result = measure(chosen.seed, chosen.faults, chosen.clean)
    for row in result["faults"]:
        if not row["right"]:
            print(
                "not named rightly:",
                row["recording"],
                row["channel"],
                row["kind"],
                row["components"],
                row["said"],
            )
    print(
        f"{result['named_rightly']} of {result['planted']} named rightly, {result['refused']} refused; "
        f"{len(result['false_alarms'])} of {result['clean']} clean ones with an alarm: "
        f"{result['false_alarms']}"
    )
    write_result("channel_faults", {"environment": environment("smsid", "numpy", "scipy"), **result})


if __name__ == "__main__":
    main()
