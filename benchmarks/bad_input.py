"""What is wrong with a flight is refused or named: `smsid identify`, as a stranger calls it.

    python benchmarks/bad_input.py [case ...] [--folder FOLDER]

Two craft: the paper's, flown by `smsid simulate`, and a satellite without arm, by the numpy of
``tests/estimation/satellite.py``. Each fault is planted in their recordings, which are then identified by
command. An estimate is *wrong* if a parameter that is called identifiable is off that of the recordings as
they were by more than three of its standard deviations. *said*: a note that the model does not explain the
recordings, that they contradict each other or a prior, or one that names the channel at fault. Rows are
written as they come to ``results/bad_input.json``; a row that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _common import RESULTS, ROOT, environment, write_result
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description.files import save_description
from smsid.errors import SmsidError
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, load_recording, save_recording
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded

NAME = "bad_input"
RATE = 25.0  # [Hz] of the sensors of the paper's craft
WRONG = 3.0  # standard deviations of its own by which a wrong parameter is off
CRAFT = ("exp1", "exp2")
VERDICTS = ("does not explain", "contradict", "seem to be exchanged", "other sign", "doubtful")

GRASPED = """
[[effect]]
kind = "grasped_body"
name = "target"
frame = "tool"
mass = 60.0
centre = [0.3, 0.0, 0.0]
central_inertia = [5.0, 0.0, 5.0, 0.0, 0.0, 5.0]
"""

Mend = Callable[[Recording], Recording]


@dataclass(frozen=True)
class Case:
    """A fault: what is done to which recordings, what a message about it has to name, further options.

    ``harmless``: nothing is wrong; the estimate has to be that of the recordings as they were.
    """

    name: str
    craft: str
    spoil: dict[str, Mend]
    words: tuple[str, ...]
    options: tuple[str, ...] = ()
    harmless: bool = False

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names of what is identified: all the craft's, unless only a recording that is not its own is."""
        own = names_of(self.craft)
        return own if set(self.spoil) <= set(own) else tuple(self.spoil)


def on(channels: tuple[str, ...], change: Callable[[np.ndarray], np.ndarray]) -> Mend:
    """Return what changes channels."""

    def mend(recording: Recording) -> Recording:
        own = {c: change(np.array(recording[c], dtype=float)) for c in channels if c in recording}
        return recording.with_channels(own)

    return mend


def as_it_was(recording: Recording) -> Recording:
    """Return a recording without a fault."""
    return recording


def scaled(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what scales."""
    return lambda x: factor * x


def turned(column: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return what turns the sign of a column."""
    return lambda x: x * np.where(np.arange(x.shape[1]) == column, -1.0, 1.0)


def swapped(x: np.ndarray) -> np.ndarray:
    """Exchange the first two columns."""
    return x[:, [1, 0, *range(2, x.shape[1])]]


def constant(x: np.ndarray) -> np.ndarray:
    """Hold the first sample, without noise."""
    return np.repeat(x[:1], len(x), axis=0)


def relabelled(recording: Recording) -> Recording:
    """Put labelled columns, and their labels with them, into reverse order."""
    labels = {k: tuple(reversed(v)) for k, v in recording.labels.items() if k in ("joint", "wheel")}
    channels = {}
    for name in recording.channels:
        x = recording[name]
        for axis, dim in enumerate(recording.channel(name).dims[1:], start=1):
            if str(dim) in labels:
                x = np.flip(x, axis=axis)
        channels[name] = (recording.time(name), x)
    return Recording.from_arrays(
        recording.time(), channels, labels={**recording.labels, **labels}, role=recording.role,
        name=recording.name,
    )  # fmt: skip


def mislabelled(recording: Recording) -> Recording:
    """Give the first two joints, or wheels, each other's name."""
    kind = "joint" if "joint" in recording.labels else "wheel"
    a, b, *rest = recording.labels[kind]
    return Recording.from_arrays(
        recording.time(), {n: (recording.time(n), recording[n]) for n in recording.channels},
        labels={**recording.labels, kind: (b, a, *rest)}, role=recording.role, name=recording.name,
    )  # fmt: skip


def still(recording: Recording) -> Recording:
    """Return a flight in which nothing is done: readings are their first second's mean and noise."""
    rng, made = np.random.default_rng(1), {}
    for name in recording.channels:
        x = np.array(recording[name], dtype=float)
        if name.startswith("command."):
            made[name] = 0.0 * x
        elif not name.startswith("truth."):
            noise = np.std(np.diff(x[:50], axis=0), axis=0) / np.sqrt(2.0)
            x = x[:1] + noise * rng.standard_normal(x.shape)
            made[name] = x / np.linalg.norm(x, axis=1, keepdims=True) if name.endswith("attitude") else x
    return recording.with_channels(made)


def cases() -> Iterator[Case]:
    """Yield all faults."""
    wheels, force = ("tachometer.wheel_rate",), ("command.force",)
    joints = ("encoder.joint_position", "encoder.joint_velocity")
    named = ("wheel", "scale")
    for factor in (1.1, 1.3):
        by = f"scaled by {factor}"
        yield Case(f"wheels {by}", "craft", {"exp2": on(wheels, scaled(factor))}, named)
        yield Case(f"force {by}", "craft", {"exp1": on(force, scaled(factor))}, ("force", "scale"))
        both = dict.fromkeys(CRAFT, on((*wheels, *force), scaled(factor)))
        yield Case(f"wheels and force {by}, priors of 3 %", "craft", both, (), ("--cad", "0.03"))
    yield Case("joint's sign", "craft", dict.fromkeys(CRAFT, on(joints, turned(1))), ("joint2", "sign"))
    yield Case("joint's sign in one", "craft", {"exp2": on(joints, turned(1))}, ("joint2", "sign"))
    yield Case("wheel's sign", "craft", {"exp2": on(wheels, turned(2))}, ("wheel_z", "sign"))
    yield Case("joints exchanged", "craft", dict.fromkeys(CRAFT, on(joints, swapped)), ("joint1", "exchange"))
    yield Case("wheels exchanged", "craft", {"exp2": on(wheels, swapped)}, ("wheel_x", "exchange"))
    gyro = ("imu.angular_rate",)
    yield Case("gyro's axes exchanged", "craft", {"exp2": on(gyro, swapped)}, ("imu.angular_rate",))
    # the same on all axes there: nothing is wrong
    yield Case("force's axes exchanged", "craft", {"exp1": on(force, swapped)}, (), harmless=True)
    panel = ("panel.acceleration",)
    axes = on(panel, lambda x: x[..., [1, 0, 2]])
    yield Case("panel's axes exchanged", "craft", dict.fromkeys(CRAFT, axes), ("panel.acceleration",))
    for channel in (*gyro, "pose.velocity", "pose.position", "pose.attitude", *joints, *wheels, *panel):
        yield Case(f"constant {channel}", "craft", {"exp2": on((channel,), constant)}, (channel,))
    yield Case("constant force", "craft", {"exp1": on(force, constant)}, ("command.force",))
    for method in ("ml", "filter", "paper"):
        other = ("--method", method)
        yield Case(f"labels in order 3 2 1, {method}", "craft", dict.fromkeys(CRAFT, relabelled), (), other,
                   harmless=True)  # fmt: skip
        if method != "filter":
            yield Case(f"labels exchanged, {method}", "craft", dict.fromkeys(CRAFT, mislabelled),
                       ("joint1",), other)  # fmt: skip
    other = {"exp1": as_it_was, "grasped": as_it_was}
    yield Case("another craft's flight besides", "craft", other, ("contradict", "exp1"))
    yield Case("a satellite's flight", "craft", {"satellite": as_it_was}, ("wheel",))
    yield Case("nothing is done", "craft", dict.fromkeys(CRAFT, still), ("not identifiable",))
    yield Case("nothing is done in one", "craft", {"exp2": still}, ("not identifiable",))
    yield from _of_the_satellite()


def _of_the_satellite() -> Iterator[Case]:
    wheels, force, gyro = ("tacho.wheel_rate",), ("command.force",), ("gyro.angular_rate",)
    for name, channels in (("wheels", wheels), ("force", force)):
        one = {"satellite": on(channels, scaled(1.1))}
        yield Case(f"satellite: {name} scaled by 1.1", "satellite", one, ("scale", *channels))
    of = {
        "wheel's sign": (on(wheels, turned(1)), ("rw2", "sign")),
        "wheels exchanged": (on(wheels, swapped), ("rw1", "swapped")),
        "gyro's axes exchanged": (on(gyro, swapped), gyro),
        "force's axes exchanged": (on(force, swapped), force),
        "labels exchanged": (mislabelled, ("rw1", "exchange")),
        "constant gyro": (on(gyro, constant), gyro),
        "constant wheels": (on(wheels, constant), wheels),
        "constant tracker": (on(("st.attitude",), constant), ("st.attitude",)),
        "constant accelerometer": (on(("gyro.acceleration",), constant), ("gyro.acceleration",)),
        "nothing is done": (still, ("identifies nothing", "command.force")),
    }
    for name, (mend, words) in of.items():
        yield Case(f"satellite: {name}", "satellite", {"satellite": mend}, words)
    yield Case("satellite: labels in order 3 2 1", "satellite", {"satellite": relabelled}, (), harmless=True)
    yield Case("satellite: another craft's flight", "satellite", {"exp2": as_it_was}, ("joint1",))


class Flights:
    """Recordings as they were, their estimates, and descriptions, in a folder that a later run takes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.description = {
            "craft": folder / "urdf" / "paper_sms.toml",
            "satellite": folder / "satellite.toml",
        }
        if not self.description["craft"].exists():
            shutil.copytree(ROOT / "urdf", folder / "urdf")
            text = self.description["craft"].read_text(encoding="utf-8")
            text = text.replace('preset = "reference"', f'preset = "reference"\nrate = {RATE}')
            self.description["craft"].write_text(text, encoding="utf-8")
        if not self.description["satellite"].exists():
            save_description(guess(folder, Satellite(), off=0.02), self.description["satellite"])

    def recording(self, name: str) -> Recording:
        """Return a recording as it was."""
        path = self.folder / f"{name}.nc"
        if not path.exists():
            if name == "satellite":
                flown = Satellite().fly(90.0, burns_and_wheels)
                save_recording(recorded(Satellite(), flown, np.random.default_rng(3), name=name), path)
            else:
                description, experiment = self.description["craft"], name
                if name == "grasped":
                    description, experiment = description.with_name("grasped.toml"), "exp2"
                    description.write_text(self.description["craft"].read_text() + GRASPED, encoding="utf-8")
                code, said = called("simulate", str(description), experiment, "-o", str(path))
                if code:
                    raise SmsidError(said)
        return load_recording(path)

    def estimate(self, craft: str, method: str = "ml"):
        """Return the estimate from a craft's recordings as they were."""
        path = self.folder / f"{craft}_{method}.json"
        if not path.exists():
            files = [self.recording(n) and self.folder / f"{n}.nc" for n in names_of(craft)]
            code, said = self.identify(craft, files, path, ("--method", method))
            if code:
                raise SmsidError(f"{craft} as it was: {said}")
        return load_estimate(path)

    def identify(self, craft: str, files: list[Path], out: Path, options: tuple[str, ...]) -> tuple[int, str]:
        """Call the command; return its exit code and what it said."""
        out.unlink(missing_ok=True)
        paths = [str(f) for f in files]
        return called("identify", str(self.description[craft]), *paths, "-o", str(out), "--all", *options)


def names_of(craft: str) -> tuple[str, ...]:
    """Return the names of a craft's recordings."""
    return CRAFT if craft == "craft" else ("satellite",)


def called(*arguments: str) -> tuple[int, str]:
    """Call a command; return its exit code and all that it printed."""
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output + (str(result.exception) if result.exit_code else "")


def row_of(case: Case, flights: Flights) -> dict[str, Any]:
    """Plant a fault, identify, and return what came of it."""
    began = time.process_time()
    folder = flights.folder / "bad" / str(os.getpid())
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name in case.recordings:
        files.append(folder / f"{name}.nc")
        save_recording(case.spoil.get(name, as_it_was)(flights.recording(name)), files[-1])
    out = folder / "estimate.json"
    code, said = flights.identify(case.craft, files, out, case.options)
    row: dict[str, Any] = {"case": case.name, "exit": code}
    if code:
        text = " ".join(said.split())
        named = all(w.lower() in text.lower() for w in case.words)
        row |= {"outcome": "refused", "says": text[-600:], "names": named}
    else:
        row |= judged(case, load_estimate(out), flights)
    return row | {"seconds": round(time.process_time() - began, 1)}


def judged(case: Case, found, flights: Flights) -> dict[str, Any]:
    """Return how far off an estimate is, and what it says."""
    method = case.options[case.options.index("--method") + 1] if "--method" in case.options else "ml"
    clean = flights.estimate(case.craft, method)
    off = {
        p.name: (p.value - clean[p.name].value) / p.sigma
        for p in found.parameters
        if p.status == "identifiable" and p.name in clean and clean[p.name].status == "identifiable"
    }
    worst = max(off, key=lambda n: abs(off[n]), default="")
    notes = [n for n in found.notes if any(v in n for v in VERDICTS)]
    text = " ".join(
        [*found.notes, *("not identifiable" for p in found.parameters if p.status == "not_identifiable")]
    )
    wrong = abs(off.get(worst, 0.0)) > WRONG
    return {
        "outcome": ("wrong, " if wrong else "right, ") + ("said" if notes else "silent"),
        "off_in_sigma": {worst: round(off[worst], 2)} if worst else {},
        "identifiable": len(off),
        "of": len(found.parameters),
        "names": all(w.lower() in text.lower() for w in case.words),
        "says": [n[:400] for n in notes[:4]],
    }


def main() -> None:
    """Run what is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", nargs="*", help="only those whose names contain one of these")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / NAME)
    asked = parser.parse_args()
    flights = Flights(asked.folder)
    for case in cases():
        if case.name in {r["case"] for r in kept()} or not any(c in case.name for c in asked.cases or [""]):
            continue
        row = row_of(case, flights)
        print(json.dumps(row), flush=True)
        rows = [*kept(), row]  # another run may have written meanwhile
        write_result(NAME, {"environment": environment("smsid"), "summary": summary(rows), "rows": rows})
    print(json.dumps(summary(kept()), indent=1))


def kept() -> list[dict[str, Any]]:
    """Return the rows that are there."""
    path = RESULTS / f"{NAME}.json"
    return json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how many are refused or said, and which are not named."""
    return {
        "cases": len(rows),
        "outcomes": dict(sorted(Counter(r["outcome"] for r in rows).items())),
        "not_named": [r["case"] for r in rows if not r["names"]],
    }


if __name__ == "__main__":
    main()
