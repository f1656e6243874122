"""Following spacecraft on line: how fast, how steadily, how soon a change is told, how right in the end.

    python benchmarks/online.py [speed] [hours] [grasp] [end] [fuel] [--draws 50]

*speed*: the paper's craft at 100 Hz for 60 and 300 s, by chosen parameters, compiled and plain; times real
time on one core, the whole of `track_recordings` and a sample alone. *hours*: one tracker with its change
detector is fed a rigid satellite at 10 Hz in flights of 5000 s: alarms, and memory after each. *grasp*:
the paper's craft without tank and panel at 20 Hz moves its arm; a body drifting with the gripper is grasped
at an unknown time. *end*: the filter after a minute, begun by its first tenth, against the maximum of the
posterior (`identify_flights`' own) and against the truth. *fuel*: ten burns of the numpy satellite that
empty its tank. Rows that are there are not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from _common import RESULTS, ROOT, environment, write_result
from _exp2 import URDF, smooth_inputs
from _rigid_satellite import GYRO, INERTIA, elements, turned
from inertia_ladder import TACHOMETER, WHEEL, described

from smsid.description import load_description
from smsid.description.schema import Description
from smsid.effects import GraspedBody, TankFill
from smsid.estimation.flight import FlightOptions
from smsid.inputs.signals import sample
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import observe
from smsid.simulate import Sampled, simulate, truth_of
from smsid.tracking import ChangeDetector, Sample, Setting, Tracker, track_recordings
from smsid.tracking._change_detection import SETTLING

sys.path.insert(0, str(ROOT))

from tests.estimation.satellite import Satellite, guess, recorded

NAME = "online"
FOLLOWED = {
    "8": ("link3.m", "tank.mass", "tank.stiffness.*", "panel.mode1.*", "panel.mode2.frequency"),
    "12": ("link3.m", "bus.m", "tank.mass", "tank.stiffness.*", "tank.damping.*", "panel.mode?.frequency"),
    "all": ("*",),
}
ELEMENTS = ("xx", "xy", "yy", "xz", "yz", "zz")
MASSES = (10.0, 30.0, 60.0, 120.0)  # [kg]
FLIGHT, RATE = 50_000, 10.0  # samples of a steady flight, [Hz]


def paper(rate: float, *, rigid: bool = False) -> Description:
    """Return the paper's craft with all sensors at one rate."""
    d = load_description(URDF / "paper_sms.toml")
    sensors = tuple(s.model_copy(update={"rate": rate}) for s in d.effective_sensors())
    if rigid:
        d = d.model_copy(update={"effect": ()})
        sensors = tuple(s for s in sensors if s.name != "panel")
    return d.model_copy(update={"sensor": sensors})


def flown(
    d: Description, seconds: float, rate: float, seed: int, shift: float = 0.0, start=None
) -> tuple[Recording, np.ndarray, np.ndarray]:
    """Return what is recorded of the paper's torques, held, from ``shift`` [s] on, and q and v at the end."""
    times, own = np.arange(round(seconds * rate) + 1) / rate, smooth_inputs()
    held = {
        name: Sampled.from_samples(times, sample(getattr(own, name), times + shift), degree=0)
        for name in ("wheel_torque", "joint_torque")
    }
    q0, v0 = (None, None) if start is None else start
    model = build_model(d)
    motion = simulate(model, replace(own, **held), seconds, q0=q0, v0=v0)
    sensors = d.effective_sensors()
    found = observe(
        truth_of(motion, sensors), sensors, start=0.0, stop=seconds, rng=np.random.default_rng(seed),
        exact=tuple(f"command.{n}" for n in held), rate=rate, name="paper",
    )  # fmt: skip
    end = motion.states(np.array([seconds]))
    return found, end.q[0], end.v[0]


def speed(_: int) -> list[dict]:
    """Return one row for each set of parameters and way."""
    rate, rows, d = 100.0, [], paper(100.0)
    recordings = {seconds: flown(d, seconds, rate, 1)[0] for seconds in (60.0, 300.0)}
    short, _, _ = flown(d, 1.0, rate, 1)
    for way, label, seconds in (
        ("1", "8", 60.0), ("1", "8", 300.0), ("1", "12", 60.0), ("1", "all", 60.0), ("0", "8", 60.0)
    ):  # fmt: skip
        recording = recordings[seconds]
        os.environ["SMSID_COMPILED"] = way
        follow = dict.fromkeys(FOLLOWED[label])
        track_recordings(d, [short], follow=follow, warm_up=0.0)  # compiled, or from its cache
        began = time.process_time()
        _, tracker = track_recordings(d, [recording], follow=follow, warm_up=0.0)
        whole = time.process_time() - began
        rows.append(
            {
                "part": "speed",
                "key": f"{label} {'compiled' if way == '1' else 'plain'}, {seconds:.0f} s",
                "parameters": len(tracker.names),
                "samples": tracker.samples,
                "seconds": round(whole, 3),
                "times_real_time": round(seconds / whole, 2),
                "milliseconds_a_sample": round(1e3 * whole / tracker.samples, 4),
                "models_built_anew": tracker.filter.rebuilt,
            }
        )
    os.environ["SMSID_COMPILED"] = "1"
    return rows


def memory() -> float:
    """Return the resident memory [MiB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def steady(flights: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rates, wheel momenta and wheel torques (flights, n, 3) under a slow dither of the wheels."""
    rng, step, n = np.random.default_rng(seed), 1.0 / RATE, FLIGHT
    period, phase = rng.uniform(20.0, 60.0, (flights, 3)), rng.uniform(0.0, 2 * np.pi, (flights, 3))
    inverse, w, h = np.linalg.inv(INERTIA), np.zeros((flights, 3)), np.zeros((flights, 3))
    out = np.empty((3, flights, n, 3))
    for k in range(n):
        torque = 0.02 * np.sin(2 * np.pi * k * step / period + phase)
        out[0, :, k], out[1, :, k] = w, h
        after = h + step * torque
        given = np.broadcast_to(-torque, (3, flights, 3))
        now = turned(w, h, after, given, step, INERTIA, inverse, np.zeros(3))
        # of the motor, that turns its wheel against what the body does
        out[2, :, k] = torque + WHEEL * RATE * (now - w)
        w, h = now, after
    return out[0], out[1], out[2]


def hours(draw: int) -> list[dict]:
    """Return alarms of a flight, and how memory grows after its first tenth."""
    (rate,), (momentum,), (torque,) = steady(1, draw + 5)
    with tempfile.TemporaryDirectory() as folder:
        follow = dict.fromkeys([*(f"bus.I{e}" for e in ELEMENTS), "gyro.angular_rate.bias.*"], 0.0)
        tracker = Tracker(described(Path(folder), "wheels"), follow=follow)
        detector = ChangeDetector.watch(tracker, false_alarms=0.1)
        rng, began, first = np.random.default_rng([draw, 6]), time.process_time(), 0.0
        for k in range(FLIGHT):
            read = {
                "gyro.angular_rate": rate[k] + GYRO * rng.standard_normal(3),
                "tacho.wheel_rate": momentum[k] / WHEEL + TACHOMETER * rng.standard_normal(3),
                "command.wheel_torque": torque[k],
            }
            tracker.update(Sample(k / RATE, read))
            if k == FLIGHT // 10:
                first = memory()
        spent = time.process_time() - began
    return [
        {
            "part": "hours",
            "key": f"draw {draw}",
            "samples": FLIGHT,
            "hours": round(FLIGHT / RATE / 3600.0, 2),
            "alarms": len(detector.changes),
            "memory_growth_mib": round(memory() - first, 2),
            "milliseconds_a_sample": round(1e3 * spent / FLIGHT, 4),
        }
    ]


def grasp(draw: int) -> list[dict]:
    """Return when a grasped body was told, and what was said of its mass 20 s after it was grasped."""
    rng, rate = np.random.default_rng([draw, 3]), 20.0
    mass, at = MASSES[draw % len(MASSES)], round(rng.uniform(25.0, 40.0) * rate) / rate
    side = mass ** (1.0 / 3.0) * 0.1
    place = np.array([0.5, 0.0, 0.0]) + 0.2 * rng.standard_normal(3)
    body = GraspedBody(
        name="prey", frame="link3", mass=mass, centre=tuple(place),
        central_inertia=tuple(mass * side**2 * np.array([1.0, 0.0, 1.2, 0.0, 0.0, 0.8])),
    )  # fmt: skip
    d = paper(rate, rigid=True)
    before, q, v = flown(d, at, rate, draw)
    after, _, _ = flown(d.with_effects(body), 20.0, rate, draw + 1000, at, (q, v))
    follow = dict.fromkeys(("link3.*", "bus.I*"), 0.0)
    setting = Setting.of(d, build_model(d))
    tracker = Tracker(d, follow=follow, cad=0.01, setting=setting)
    detector = ChangeDetector.watch(tracker, false_alarms=0.1)
    for recording, shift, first in ((before, 0.0, 0), (after, at, 1)):  # the last of one is the next's first
        channels = {c: np.asarray(recording[c]) for c in recording.channels if not c.startswith("truth")}
        for k, t in enumerate(recording.time()):
            if k >= first:
                tracker.update(Sample(float(t) + shift, {c: x[k].ravel() for c, x in channels.items()}))
    tracker.flush()
    told = [c for c in detector.changes if c.alarm > at]
    i = tracker.names.index("link3.m")
    gained = tracker.values[i] - tracker.start.mean[i]
    sigma = tracker.sigmas[i]
    return [
        {
            "part": "grasp",
            "key": f"draw {draw}",
            "mass": mass,
            "after": round(told[0].alarm - at, 2) if told else None,
            "told": round(told[0].alarm + SETTLING - at, 2) if told else None,
            "group": told[0].group if told else None,
            "before_it": len(detector.changes) - len(told),
            "error": round(float(gained - mass), 4),
            "z": round(float((gained - mass) / sigma), 2),
            "sigma": round(float(sigma), 4),
        }
    ]


def end(draw: int) -> list[dict]:
    """Return how far the filter ends from the batch estimate and from the truth, in standard deviations."""
    from smsid.estimation._maximum import maximise
    from smsid.estimation.flight import flight_of
    from smsid.estimation.parameter_vector import Point
    from smsid.tracking import followed_parameters

    rng, n = np.random.default_rng([draw, 11]), 601
    torque = 0.1 * np.sin(
        2 * np.pi * np.arange(n)[:, None] / RATE * np.array([0.03, 0.05, 0.08]) + rng.uniform(0, 6, 3)
    )
    inverse, w, h = np.linalg.inv(INERTIA), np.zeros(3), np.zeros(3)
    rate, momentum = np.empty((n, 3)), np.empty((n, 3))
    command = np.empty((n, 3))
    for k in range(n):  # torques go straight from sample to sample
        rate[k], momentum[k] = w, h
        # of the motor, that turns its wheel against what the body does
        command[k] = torque[k] + WHEEL * inverse @ (-torque[k] - np.cross(w, INERTIA @ w + h))
        ahead = torque[min(k + 1, n - 1)]
        middle = 0.5 * (torque[k] + ahead)
        after = h + middle / RATE
        given = -np.array([torque[k], middle, ahead])
        w, h = turned(w, h, after, given, 1 / RATE, INERTIA, inverse, np.zeros(3)), after
    with tempfile.TemporaryDirectory() as folder:
        d = described(Path(folder), "wheels")
        recording = Recording.from_arrays(
            np.arange(n) / RATE,
            {
                "gyro.angular_rate": rate + GYRO * rng.standard_normal((n, 3)),
                "tacho.wheel_rate": momentum / WHEEL + TACHOMETER * rng.standard_normal((n, 3)),
                "command.wheel_torque": command,
            },
            labels={"wheel": ("rw0", "rw1", "rw2")},
            name="minute",
        )
        follow, options = {"bus.I*": 0.0}, FlightOptions(drive="command")
        history, _ = track_recordings(d, [recording], follow=follow, options=options, warm_up=6.0)
        unknowns = [f.unknown for f in followed_parameters(d, follow=follow).followed]
        best = maximise(Point.of(d), unknowns, [flight_of(Point.of(d), recording, "minute", options)])[0]
        batch = np.array([best.point.value(u) for u in unknowns])
        batch += np.linalg.solve(best.gram, best.slope) * best.scales
        truth = elements(INERTIA)
    sigma = history.sigmas[-1]
    return [
        {
            "part": "end",
            "key": f"draw {draw}",
            "from_batch": round(float(np.abs((history.values[-1] - batch) / sigma).max()), 4),
            "z": np.round((history.values[-1] - truth) / sigma, 2).tolist(),
        }
    ]


def emptied(now: Callable[[float], Satellite], start: np.ndarray, drive, seconds: float, step: float):
    """Return what `Satellite.fly` does of one whose masses are those of ``now(t)``, steps at a time."""
    state, parts = start, []
    for k in range(round(seconds / step)):
        t = k * step  # masses change little in a step: they are those of its middle
        own = now(t + 0.5 * step).fly(step, lambda _, t=t: drive(t), step=step, start=state)
        state = own[1][-1, :24]
        parts.append((np.array([t]), own[1][:1], own[2][:1], own[3][:1]))
    return [np.concatenate([p[i] for p in parts]) for i in range(4)], state


def fuel(draw: int) -> list[dict]:
    """Return errors of mass, slosh stiffness and frequency after each of ten burns that empty the tank."""
    rng, burns, seconds, rows = np.random.default_rng([draw, 13]), 10, 40.0, []
    thrusting = seconds - 2.0  # [s]: what happens after the last sample nobody knows
    truth = Satellite(tank=(15.0, 0.5, 0.06), panel=(1.0, 0.1, 1e-6, -1e-6))
    at, liquid, consumption = np.array(truth.tank_at), 30.0, 1e-3 * rng.uniform(0.9, 1.1)
    with tempfile.TemporaryDirectory() as folder:
        d = guess(Path(folder), truth, off=0.02, panel=False)
        fill = TankFill(
            name="fuel",
            tank="tank",
            propellant=liquid,
            consumption=1e-3,
            height=1.2,
            prior={"consumption": 1e-4},
        )
        law = fill.model_copy(update={"consumption": consumption})
        impulse, states, recordings, state = 0.0, [], [], np.eye(1, 24, 6)[0]

        def at_impulse(used: float) -> Satellite:
            gone, share, stiffness = law.shares(used)
            rest = -gone + 15.0 * (1.0 - share)  # of what moves with the bus
            own = np.array(truth.inertia) + rest * (at @ at * np.eye(3) - np.outer(at, at))
            centre = (truth.mass * np.array(truth.centre) + rest * at) / (truth.mass + rest)
            tank = 15.0 * share, 0.5 * stiffness, 0.06 * np.sqrt(share * stiffness)
            return replace(
                truth, mass=truth.mass + rest, centre=tuple(centre), inertia=tuple(map(tuple, own)), tank=tank
            )

        for i in range(burns):
            phase = rng.uniform(0, 6, 3)

            def drive(t: float, phase: np.ndarray = phase) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
                level = np.floor((t + 1e-9) / 2.0) * 2.0  # thrusters are held for two seconds
                force = 4.0 * np.sign(np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * level + phase))
                force *= t < thrusting - 1e-9
                wheel = 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.08, 0.03]) * level + phase)
                return force, np.zeros(3), wheel

            def used(t: float, begun: float = impulse) -> Satellite:
                return at_impulse(begun + 12.0 * min(t, thrusting))  # 12 N by three pairs of thrusters

            flown, state = emptied(used, state, drive, seconds, 0.02)
            recordings.append(recorded(truth, flown, rng, name=f"burn {i}"))
            impulse += 12.0 * thrusting
            states.append((impulse, at_impulse(impulse)))
        follow = {"bus.*": 0.0, "tank.mass": 0.0, "tank.stiffness.*": 0.0}
        follow |= {"tank.damping.*": 0.0, "fuel.consumption": 0.0}
        options = FlightOptions(drive="command")
        history, _ = track_recordings(
            d.with_effects(*d.effect, fill), recordings, follow=follow, options=options, gap=60.0
        )
    place = {n: i for i, n in enumerate(history.names)}
    for i, (used, then) in enumerate(states):
        last = int(np.flatnonzero(history.recording == i)[-1])
        values, sigmas = history.values[last], history.sigmas[last]
        c, c_sigma = (x[place["fuel.consumption"]] for x in (values, sigmas))
        (gone, _, softer), (*_, more) = (
            fill.model_copy(update={"consumption": x}).shares(used) for x in (c, c + c_sigma)
        )
        mass = values[place["bus.m"]] + values[place["tank.mass"]] - gone
        own = [place[f"tank.stiffness.{a}"] for a in "xyz"]
        share = law.shares(used)[1]
        stiffness, m = values[own] * softer, values[place["tank.mass"]] * share
        frequency, wanted = np.sqrt(stiffness / m), np.sqrt(then.tank[1] / then.tank[0])
        spread = frequency * np.hypot(
            0.5 * sigmas[own] / values[own], 0.5 * sigmas[place["tank.mass"]] / values[place["tank.mass"]]
        )
        rows.append(
            {
                "part": "fuel",
                "key": f"draw {draw} burn {i}",
                "mass_percent": round(100 * (mass / (then.mass + then.tank[0]) - 1.0), 4),
                "used_kg": round(law.shares(used)[0], 3),
                "consumption_z": round(float((c - consumption) / c_sigma), 2),
                "stiffness_z": np.round(
                    (stiffness - then.tank[1])
                    / np.hypot(sigmas[own] * softer, values[own] * (more - softer)),
                    2,
                ).tolist(),
                "frequency_z": np.round((frequency - wanted) / spread, 2).tolist(),
                "frequency_percent": np.round(100 * (frequency / wanted - 1.0), 3).tolist(),
            }
        )
    return rows


PARTS: dict[str, tuple[Callable[[int], list[dict]], bool]] = {
    "speed": (speed, False),
    "end": (end, True),
    "grasp": (grasp, True),
    "fuel": (fuel, True),
    "hours": (hours, True),
}


def summary(rows: list[dict]) -> dict:
    """Return the figures by part."""
    by = {part: [r for r in rows if r["part"] == part] for part in PARTS}
    out: dict = {}
    if by["speed"]:
        out["speed"] = {r["key"]: r["times_real_time"] for r in by["speed"]}
    if by["hours"]:
        out["hours"] = {k: round(sum(r[k] for r in by["hours"]), 2) for k in ("samples", "hours", "alarms")}
        for key in ("memory_growth_mib", "milliseconds_a_sample"):
            out["hours"][f"{key}_most"] = max(r[key] for r in by["hours"])
    if by["grasp"]:
        told = [r for r in by["grasp"] if r["after"] is not None]
        out["grasp"] = {
            "draws": len(by["grasp"]),
            "told_within_2_s": sum(r["after"] <= 2.0 for r in told),
            "named_link3": sum(r["group"] == "link3" for r in told),
            "inside_95_percent": sum(abs(r["z"]) < 1.96 for r in by["grasp"]),
            "false_before": sum(r["before_it"] for r in by["grasp"]),
        }
    if by["end"]:
        z = np.array([r["z"] for r in by["end"]])
        out["end"] = {
            "draws": len(z),
            "from_batch_most": max(r["from_batch"] for r in by["end"]),
            "coverage_95": round(float(np.mean(np.abs(z) < 1.96)), 4),
        }
    if by["fuel"]:
        out["fuel"] = {
            "burns": len(by["fuel"]),
            "mass_percent_most": max(abs(r["mass_percent"]) for r in by["fuel"]),
            "stiffness_inside": round(
                float(np.mean(np.abs([r["stiffness_z"] for r in by["fuel"]]) < 1.96)), 3
            ),
            "frequency_inside": round(
                float(np.mean(np.abs([r["frequency_z"] for r in by["fuel"]]) < 1.96)), 3
            ),
        }
    return out


def main() -> None:
    """Run what is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    parser.add_argument("--draws", type=int, default=50)
    given = parser.parse_args()
    path = RESULTS / f"{NAME}.json"

    def read() -> list[dict]:  # again before it is written: parts may run beside each other
        return json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []

    rows = read()
    for part in given.parts or PARTS:
        run, drawn = PARTS[part]
        for draw in range(given.draws if drawn else 1):
            there = [f"{r['key']} " for r in rows if r["part"] == part]
            if any(not drawn or key.startswith(f"draw {draw} ") for key in there):
                continue
            found = run(draw)
            rows = read() + found
            write_result(NAME, {"environment": environment("smsid"), "summary": summary(rows), "rows": rows})
            print(json.dumps(rows[-1]), flush=True)
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
