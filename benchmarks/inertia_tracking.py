"""The inertia of a rigid satellite followed on line: it ramps, it begins off, and wheels fill up.

    python benchmarks/inertia_tracking.py [draws] [profile ...]

The satellite of `inertia_ladder` with wheels and an unknown constant torque, rungs 7 to 10 of that ladder, by
`smsid.track` and `Stream`. *ramping*: Izz grows from 4.53 to 6.5 kg m^2 in the 60 s (7: mean error from 4 to
56 s; 8: after 12 s). Which element changes is not known, nor that it does steadily: all wander alike by
`RATE`, or all or one of them have a trend of about `STEADY`, whichever makes the innovations likeliest;
*smoothed* is what the whole record says of each time. *constant*: begins at 85 % of
the truth (9: error at the end). *online*: every `SEGMENT` seconds the momentum that wheels go to is chosen
among `TARGETS` by the tracker's own covariance a segment ahead, in an envelope of 0.85 of 0.3 N m s (10).
Errors are norms over the norm of the six elements. Rows that are there are not run again.
"""

from __future__ import annotations

import itertools
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _common import RESULTS, environment, write_result
from _rigid_satellite import (
    DISTURBANCE,
    ELEMENTS,
    GYRO,
    INERTIA,
    SECONDS,
    TIMES,
    covariance_bound,
    elements,
    move,
    profiles,
    turned,
    with_elements,
)
from inertia_ladder import TACHOMETER, WHEEL, described, recorded

from smsid.errors import SimulationError
from smsid.tracking import Sample, Stream, Tracker, track_recordings

NAME = "inertia_tracking"
PROFILES = (
    "chirps",
    "three tones",
    "binary held 4 s",
    "sines in three phases 0.02 Hz",
    "sines in three phases 0.08 Hz",
)
GROWTH = np.diag([0.0, 0.0, (6.5 - INERTIA[2, 2]) / SECONDS])  # [kg m^2/s]
RATE = 2.0 / np.sqrt(SECONDS)  # [kg m^2/sqrt(s)]: 2 kg m^2 in a minute
STEADY = 0.05  # [kg m^2/s], of any sign: the prior of a trend
NAMES = [f"bus.I{'xyz'[i]}{'xyz'[k]}" for i, k in ELEMENTS]
PUSH = [f"push.torque.{a}" for a in "xyz"]
FULL, ENVELOPE, TORQUE = (
    0.3,
    0.85,
    0.129,
)  # [N m s], share of it that is used, [N m] norm as energies are alike
SEGMENT, STEP = 3.0, 0.1  # [s]
BEGIN = 9.0  # [s] that the stream looks at first, to find where to be linear
TARGETS = np.array([x for x in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(x)])


def tracked(rung: str, torque: np.ndarray, seed: int, folder: Path) -> dict:
    """Return the errors of a history over time."""
    growth = GROWTH if rung == "ramping" else None
    motion = move(torque, wheels=True, external=DISTURBANCE, growth=growth)
    walks, warm_up = {"none": {}}, SECONDS
    if rung == "ramping":
        walks = {f"all by {RATE:.2g}": dict.fromkeys(NAMES, RATE)}
        walks |= {"all steadily": dict.fromkeys(NAMES, (0.0, STEADY))}
        walks |= {f"{n} steadily": {n: (0.0, STEADY)} for n in NAMES}
        warm_up = 8.0  # the length of the published windows
    best = None
    description = described(folder, "disturbed")
    recording = recorded("disturbed", torque, motion, np.random.default_rng([seed, 7]))
    for label, walk in walks.items():
        follow = dict.fromkeys([*NAMES, *PUSH], 0.0) | walk
        try:
            found, _ = track_recordings(
                description,
                [recording],
                follow=follow,
                every=0.1,
                warm_up=warm_up,
                smooth=rung == "ramping",
            )
        except SimulationError:  # lost: no model of this motion
            continue
        likely = found.conditions["log_likelihood"]
        if best is None or likely > best[0]:
            best = likely, label, found
    assert best is not None
    _, walk, history = best
    truth = elements(INERTIA) + (0.0 if growth is None else np.outer(history.time, elements(growth)))
    place = [history.names.index(n) for n in NAMES]
    off = history.values[:, place] - truth
    error = np.linalg.norm(off, axis=1) / np.linalg.norm(np.broadcast_to(truth, off.shape), axis=1)
    z = off / history.sigmas[:, place]
    row = {"walk": walk, "saturated": round(motion.saturated, 3), "at_end": float(error[-1])}
    if rung == "ramping":
        inner = (history.time >= 4.0) & (history.time <= 56.0)
        late = history.time >= 12.0
        row |= {"windows": float(error[inner].mean()), "after_12_s": float(error[late].mean())}
        row["inside"] = float(np.mean(np.abs(z[late]) < 1.96))
        smoothed = history.smoothed
        off = smoothed.values[:, place] - truth
        row["smoothed"] = float(np.mean(np.linalg.norm(off, axis=1) / np.linalg.norm(truth, axis=1)))
        row["smoothed_inside"] = float(np.mean(np.abs(off / smoothed.sigmas[:, place]) < 1.96))
    else:
        row |= {"off": [round(float(x), 2) for x in z[-1]], "bound": bound(torque)}
        row["sigma"] = float(np.linalg.norm(history.sigmas[-1, place])) / np.linalg.norm(elements(INERTIA))
    return row


def bound(torque: np.ndarray) -> float:
    """Return the Cramer-Rao bound of the error, relative."""

    def rates(inertia: np.ndarray, start: np.ndarray, external: np.ndarray) -> np.ndarray:
        return move(torque, inertia, wheels=True, external=external, start=start).rate

    return float(
        np.sqrt(np.trace(covariance_bound(rates, disturbed=True))) / np.linalg.norm(elements(INERTIA))
    )


def slew(momentum: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return a segment of wheel torques (n, ..., 3), held over steps, that bring momenta to a target."""
    out = []
    for _ in range(round(SEGMENT / STEP)):
        wanted = (target - momentum) / STEP
        size = np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1e-12)
        out.append(wanted * np.minimum(1.0, TORQUE / size))
        momentum = momentum + STEP * out[-1]
    return np.array(out)


def chosen(tracker: Tracker, momentum: np.ndarray) -> np.ndarray:
    """Return the target (3,) after which the trace of the elements' covariance is least, as predicted."""
    f = tracker.filter
    place = [
        *(f.parameters.start + tracker.names.index(n) for n in (*NAMES, *PUSH)),
        3 + f.nv,
        4 + f.nv,
        5 + f.nv,
    ]
    information = np.linalg.inv(tracker.covariance[np.ix_(place, place)])
    here = np.concatenate([tracker.values[[tracker.names.index(n) for n in (*NAMES, *PUSH)]], f.v[3:6]])
    change = np.array([1e-4] * 6 + [1e-6] * 6)
    x = here + np.concatenate([np.diag(change), -np.diag(change)])
    inertia = np.array([with_elements(e) for e in x[:, :6]])[:, None]
    inverse = np.linalg.inv(inertia)
    h = np.broadcast_to(momentum, (1, len(TARGETS), 3))
    w = np.broadcast_to(x[:, None, 9:], (len(x), len(TARGETS), 3))
    gained = np.zeros((len(TARGETS), 12, 12))
    for u in slew(h, ENVELOPE * FULL * TARGETS):
        after = h + STEP * u
        w = turned(w, h, after, np.broadcast_to(-u, (3, *u.shape)), STEP, inertia, inverse, x[:, None, 6:9])
        h = after
        by = (w[:12] - w[12:]) / (2.0 * change[:, None, None]) / GYRO  # (12, targets, 3)
        gained += np.einsum("itk,jtk->tij", by, by)
    left = np.linalg.inv(information + gained)
    return ENVELOPE * FULL * TARGETS[np.argmin(np.trace(left[:, :6, :6], axis1=1, axis2=2))]


def online(seed: int, folder: Path) -> dict:
    """Return the error at the end where the excitation is chosen as the flight goes on."""
    rng = np.random.default_rng([seed, 7])
    description = described(folder, "disturbed")
    follow = dict.fromkeys([*NAMES, *PUSH], 0.0)
    stream = Stream(description, follow=follow, begin=BEGIN)
    w, h, torque, queue, full = np.zeros(3), np.zeros(3), np.zeros(3), [], 0
    inverse, seconds = np.linalg.inv(INERTIA), []
    for k in range(len(TIMES)):
        read = {
            "gyro.angular_rate": w + GYRO * rng.standard_normal(3),
            "tacho.wheel_rate": h / WHEEL + TACHOMETER * rng.standard_normal(3),
        }
        if not queue:  # what is chosen now acts from this sample on
            began, tracker = time.perf_counter(), stream.tracker
            target = ENVELOPE * FULL * np.eye(3)[round(k * STEP / SEGMENT) % 3]
            if tracker is not None:
                target = chosen(tracker, h)
            seconds.append(time.perf_counter() - began)
            queue = list(slew(h, target))
        torque = queue.pop(0)
        stream.hear(Sample.of(TIMES[k], {**read, "command.wheel_torque": torque}))
        after = np.clip(h + STEP * torque, -FULL, FULL)
        full += bool(np.any(np.abs(after) >= FULL))
        w = turned(
            w, h, after, np.broadcast_to(-(after - h) / STEP, (3, 3)), STEP, INERTIA, inverse, DISTURBANCE
        )
        h = after
    tracker = stream.tracker
    assert tracker is not None
    tracker.flush()
    place = [tracker.names.index(n) for n in NAMES]
    off, sigma = tracker.values[place] - elements(INERTIA), tracker.sigmas[place]
    norm = np.linalg.norm(elements(INERTIA))
    return {
        "at_end": float(np.linalg.norm(off) / norm),
        "sigma": float(np.linalg.norm(sigma) / norm),
        "off": [round(float(x), 2) for x in off / sigma],
        "saturated": full / len(TIMES),
        "choice_seconds": float(np.median(seconds)),
    }


def summary(rows: list[dict]) -> list[dict]:
    """Return one line for every rung and profile: errors in percent, as means over draws."""
    out = []
    for rung, profile in dict.fromkeys((r["rung"], r["profile"]) for r in rows):
        own = [r for r in rows if (r["rung"], r["profile"]) == (rung, profile)]
        line = {"rung": rung, "profile": profile, "draws": len(own)}
        for key in ("windows", "after_12_s", "at_end", "smoothed", "bound", "sigma"):
            if key in own[0]:
                line[f"{key}_percent"] = 100.0 * float(np.mean([r[key] for r in own]))
        for key in ("inside", "smoothed_inside", "saturated"):
            if key in own[0]:
                line[key] = float(np.mean([r[key] for r in own]))
        if "off" in own[0]:
            line["coverage"] = float(np.mean(np.abs([x for r in own for x in r["off"]]) < 1.96))
        out.append(line)
    return out


def main() -> None:
    """Run what is not there yet."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    path = RESULTS / f"{NAME}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    there = {(r["rung"], r["profile"], r["seed"]) for r in rows}
    torques = profiles()
    plan = [(rung, p) for rung in ("ramping", "constant") for p in sys.argv[2:] or PROFILES] + [
        ("online", "chosen")
    ]
    for seed in range(draws):
        for rung, profile in plan:
            if (rung, profile, seed) in there:
                continue
            began = time.process_time()
            with tempfile.TemporaryDirectory() as folder:
                if rung == "online":
                    found = online(seed, Path(folder))
                else:
                    found = tracked(rung, torques[profile], seed, Path(folder))
            took = round(time.process_time() - began, 1)
            rows.append({"rung": rung, "profile": profile, "seed": seed, **found, "seconds": took})
            print(json.dumps(rows[-1]), flush=True)
            write_result(NAME, {"environment": environment("smsid"), "summary": summary(rows), "rows": rows})
    for line in summary(rows):
        print(json.dumps(line))


if __name__ == "__main__":
    main()
