"""Any flight identifies a satellite: kinds of flights, sensors and clocks, first guesses 30 % off.

    python benchmarks/flights.py [draws] [kind ...]

The world is plain Newton's laws in numpy (`tests.estimation.satellite`), nothing of smsid moves in it. The
spread is the root mean square of the deviations in stated standard deviations (of an interval that is not
Gaussian: of its half on that side, over 1.96): where these are right, it is the spread over the Cramer-Rao
bound. Coverage is that of the 95 % intervals. ``chi2`` is the square of all deviations together by their
covariance, which is as large as their number in the mean. Rows are written as they come; a row that is there
is not run again.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _common import RESULTS, environment, write_result

from smsid._statistics import NORMAL95
from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.estimation.flight import FlightOptions
from smsid.estimation.identify_flights import FlightEstimate, identify_flights
from smsid.estimation.initial_state import InitialPrior
from smsid.identify.parameter_estimate import parse_combination
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.error_model import ErrorModel
from tests.estimation.satellite import Satellite, guess, recorded, rotation, true_values

NAME = "flights"
OFF = 0.3
JUST = 1e-9  # [s] before a time at which a command may jump


class Flown(Satellite):
    """The satellite with commands as they are within every step of the integration."""

    def fly(self, seconds, drive, step=0.02, start=None):
        """Return times, states, accelerations of O and inputs, as `Satellite.fly` does."""
        x = np.zeros(24)
        x[6] = 1.0
        x = x if start is None else np.array(start, dtype=float)
        times = np.arange(round(seconds / step) + 1) * step
        states, accelerations, inputs = [], [], []
        for t in times:
            begin, middle, end = drive(t + JUST), drive(t + step / 2), drive(t + step - JUST)
            k1, a = self.derivative(x, *begin)
            states.append(np.concatenate([x, k1[10:13]]))
            accelerations.append(a)
            inputs.append(np.concatenate(begin))
            k2 = self.derivative(x + step / 2 * k1, *middle)[0]
            k3 = self.derivative(x + step / 2 * k2, *middle)[0]
            k4 = self.derivative(x + step * k3, *end)[0]
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            x[3:7] /= np.linalg.norm(x[3:7])
        return times, np.array(states), np.array(accelerations), np.array(inputs)


RIGID = Flown(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
FULL = Flown()
LABELS = {"wheel": ("rw1", "rw2", "rw3")}
Drive = Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]
Record = Callable[[Satellite, np.random.Generator], list[Recording]]
NOTHING = ("command.force", "command.torque", "command.wheel_torque")


@dataclass(frozen=True)
class Kind:
    """A kind of flight: who flies, how it is recorded, what is assumed; ``sensors`` beside the usual ones."""

    record: Record
    truth: Satellite = RIGID
    options: FlightOptions | None = None
    sensors: tuple[Sensor, ...] = ()


def wheels_alone(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sines on all wheels."""
    return np.zeros(3), np.zeros(3), 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


def thrust_alone(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Burns of 5 s along each axis and back, attitude free."""
    force = np.zeros(3)
    k = int(t // 5.0)
    force[k % 3] = 2.0 if (k // 3) % 2 == 0 else -2.0
    return force, np.zeros(3), np.zeros(3)


def long_burns(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Burns of 7.5 s along each axis in turn and back, which leave the tank ringing."""
    force = np.zeros(3)
    k = int(t // 7.5)
    if k < 6:
        force[k // 2] = 2.0 if k % 2 == 0 else -2.0
    return force, np.zeros(3), np.zeros(3)


def moments(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Known torques on the bus, as of magnetic rods."""
    return np.zeros(3), 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2]), np.zeros(3)


def everything(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thrust, torques and wheels together."""
    return thrust_alone(t)[0], moments(t)[1], wheels_alone(t)[2]


def flown(
    drive: Drive, seconds: float = 30.0, *, start: np.ndarray | None = None, every: int = 5, without=()
) -> Record:
    """Return a recording at 10 Hz (every fifth step of 0.02 s)."""

    def record(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
        flight = truth.fly(seconds, drive, start=start)
        return [recorded(truth, flight, rng, every=every, without=without)]

    return record


def held_while_thrusting(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
    """Burns while wheels hold the attitude, by a controller nobody records: PD on rate and angle."""

    class Held(Flown):
        def derivative(self, x, force, torque, wheel_torque):
            q = x[3:7]
            wheel_torque = 8.0 * q[:3] * np.sign(q[3]) + 25.0 * x[10:13]
            return super().derivative(x, force, torque, wheel_torque)

    own = Held(**{k: getattr(truth, k) for k in truth.__dataclass_fields__})
    flight = own.fly(60.0, long_burns) if truth is FULL else own.fly(30.0, thrust_alone)
    return [recorded(truth, flight, rng, without=("command.wheel_torque", "command.torque"))]


def moving() -> np.ndarray:
    """Return a state that moves: turned, drifting, turning, wheels running."""
    start = np.zeros(24)
    start[3:7] = np.array([0.1, -0.2, 0.3, 0.9]) / np.linalg.norm([0.1, -0.2, 0.3, 0.9])
    start[7:10], start[10:13], start[21:24] = (0.2, -0.1, 0.05), (0.01, -0.008, 0.005), (1.0, -2.0, 3.0)
    return start


def position_alone(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
    """Positions of the bus at 1 Hz, 5 mm, and commands; the attitude at the start is known to 0.02 rad."""
    times, states, _, inputs = truth.fly(60.0, everything)
    k = slice(None, None, 50)
    at = np.array([rotation(q) @ np.array([0.5, 1.5, 0.6]) for q in states[k, 3:7]])
    channels = {
        "gnss.position": states[k, :3] + at + rng.normal(0.0, 5e-3, at.shape),
        "command.force": inputs[::5, :3],
        "command.torque": inputs[::5, 3:6],
        "command.wheel_torque": (inputs[:, 6:9] + truth.wheel * states[:, 24:27])[::5],  # as in `recorded`
    }
    timed = {n: (times[k] if n == "gnss.position" else times[::5], x) for n, x in channels.items()}
    return [Recording.from_arrays(None, timed, labels=LABELS, name="gnss")]


def clocks_of_their_own(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
    """Gyro 10 Hz, jitter of 20 ms, star tracker 2 Hz, tachometers 5 Hz, a tenth of the samples missing."""
    made = recorded(truth, truth.fly(30.0, everything), rng, every=1)
    time = np.asarray(made.time("gyro.angular_rate"))
    clocks = {}
    for source, step in {"gyro": 5, "st": 25, "tacho": 10, "command": 1}.items():
        index = np.arange(0, len(time), step)
        if source != "command":
            index = np.clip(index + rng.integers(-1, 2, len(index)), 0, len(time) - 1)
            index = np.unique(index[rng.uniform(size=len(index)) > 0.1])
        clocks[source] = index
    timed = {
        n: (time[clocks[n.split(".")[0]]], np.asarray(made[n])[clocks[n.split(".")[0]]])
        for n in made.channels
    }
    return [Recording.from_arrays(None, timed, labels=LABELS, name="clocks")]


def several(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
    """Three flights: thrust, wheels, a moving start."""
    flights = (("thrust", thrust_alone, None), ("wheels", wheels_alone, None), ("turning", moments, moving()))
    return [recorded(truth, truth.fly(20.0, d, start=s), rng, name=n) for n, d, s in flights]


def window(truth: Satellite, rng: np.random.Generator) -> list[Recording]:
    """The middle 30 s of 60 s, tank and panel in full swing."""
    flight = tuple(x[1000:2500] for x in truth.fly(60.0, everything))
    return [recorded(truth, flight, rng)]


GNSS = Sensor(
    name="gnss",
    kind="pose",
    quantities=("position",),
    rate=1.0,
    position=(0.5, 1.5, 0.6),
    errors={"position": ErrorModel(noise_sigma=5e-3)},
)
KINDS = {
    "moving start": Kind(flown(everything, start=moving())),
    "thrust, attitude free": Kind(flown(thrust_alone)),
    "thrust, held by wheels": Kind(held_while_thrusting),
    "held by wheels, tank and panel": Kind(held_while_thrusting, FULL),
    "moments": Kind(flown(moments)),
    "wheels alone": Kind(flown(wheels_alone)),
    "everything": Kind(flown(everything)),
    "everything, tank and panel": Kind(flown(everything, 60.0), FULL),
    "gyro and wheels": Kind(flown(wheels_alone, without=("st.attitude", "gyro.acceleration", *NOTHING))),
    "gyro, star tracker, wheels": Kind(flown(wheels_alone, without=("gyro.acceleration", *NOTHING))),
    "position alone": Kind(
        position_alone, sensors=(GNSS,), options=FlightOptions(initial=InitialPrior(attitude=0.02, rate=0.01))
    ),
    "clocks of their own": Kind(clocks_of_their_own),
    "1 Hz": Kind(flown(moments, 100.0, every=50)),
    "50 Hz": Kind(flown(everything, 10.0, every=1)),
    "several": Kind(several),
    "window": Kind(window, FULL),
}


def described(folder: Path, kind: Kind, off: float) -> Description:
    """Return the first guess, so much off."""
    full = kind.truth is FULL
    found = guess(folder, kind.truth, off=off, tank=full, panel=full)
    return found.model_copy(update={"sensor": (*found.sensor, *kind.sensors)})


def true_value(name: str, kind: Kind) -> float | None:
    """Return the truth of a parameter or combination, if it is one of the satellite's."""
    full = kind.truth is FULL
    truth = true_values(kind.truth, tank=full, panel=full)
    if name in truth:
        return truth[name]
    terms = parse_combination(name)
    return sum(f * truth[k] for k, f in terms.items()) if terms and set(terms) <= set(truth) else None


def row_of(name: str, seed: int) -> dict:
    """Return one row: deviations of what is identifiable, and the spread from a start at the truth."""
    kind, began = KINDS[name], time.process_time()
    recordings = kind.record(kind.truth, np.random.default_rng([seed, 91]))
    row: dict = {"kind": name, "seed": seed}
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = identify_flights(described(Path(folder), kind, OFF), recordings, options=kind.options)
        except SmsidError as error:
            return {**row, "error": f"{type(error).__name__}: {error}"}
        row["seconds"] = round(time.process_time() - began, 1)
        row["judgement"], row["widening"] = found.quality.judgement, round(found.quality.widening, 3)
        row["iterations"] = found.estimate.conditions["iterations"]
        row["off"], row["unseen"], row["other"], row["at_bound"] = {}, [], [], {}
        for p in found.estimate.parameters:
            truth = true_value(p.name, kind)
            if ": " in p.name:
                continue
            if truth is None:
                row["other"].append(p.name)
            elif p.note.startswith("at its bound"):
                row["at_bound"][p.name] = p.interval[0] <= truth <= p.interval[1]
            elif p.status != "identifiable":
                row["unseen"].append(p.name)
            else:
                low, high = p.interval
                half = (p.value - low if truth < p.value else high - p.value) / NORMAL95
                row["off"][p.name] = round((p.value - truth) / half, 3)
        row["chi2"], row["freedom"] = chi_square(found, kind, set(row["off"]))
    return row


def chi_square(found: FlightEstimate, kind: Kind, names: set[str]) -> tuple[float, int]:
    """Return the square of deviations by their covariance and how many; the sum of others left out."""
    parameters = found.estimate.parameters
    index = [i for i, p in enumerate(parameters) if p.name in names and p.name != "total.mass"]
    off = np.array([parameters[i].value - (true_value(parameters[i].name, kind) or 0.0) for i in index])
    return round(float(off @ np.linalg.solve(found.covariance[np.ix_(index, index)], off)), 2), len(index)


def summary(rows: list[dict]) -> list[dict]:
    """Return one line a kind: converged, coverage, root mean square of the deviations."""
    out = []
    for name in dict.fromkeys(r["kind"] for r in rows):
        own = [r for r in rows if r["kind"] == name]
        off = np.array([x for r in own for x in r.get("off", {}).values()])
        line = {"kind": name, "draws": len(own), "converged": sum("off" in r for r in own)}
        if len(off):
            line |= {"parameters": len(off), "coverage": round(float(np.mean(np.abs(off) < NORMAL95)), 3)}
            line["spread"] = round(float(np.sqrt(np.mean(off**2))), 3)
            square, freedom = (sum(r.get(k, 0) for r in own) for k in ("chi2", "freedom"))
            line["chi2 / freedom"] = round(square / max(freedom, 1), 3)
        line["explained"] = sum(r.get("judgement") == "explained" for r in own)
        out.append(line)
    return out


def main() -> None:
    """Run what is not there yet."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    path = RESULTS / f"{NAME}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    there = {(r["kind"], r["seed"]) for r in rows}
    for seed in range(draws):
        for name in sys.argv[2:] or KINDS:
            if (name, seed) in there:
                continue
            rows.append(row_of(name, seed))
            print(json.dumps(rows[-1]), flush=True)
            write_result(NAME, {"environment": environment("smsid"), "summary": summary(rows), "rows": rows})
    for line in summary(rows):
        print(json.dumps(line))


if __name__ == "__main__":
    main()
