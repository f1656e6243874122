"""Plant 60 faults of single components in three recordings: which are named, and which pass ``identify``?

A fault is named rightly if a finding has its kind, its component and its channel, or the channel it was
compared with: two related channels alone cannot tell which of them is wrong. Faults are planted where a
related channel exists. 30 clean recordings of all kinds must give no finding.

Each faulty recording is then identified. The estimate is wrong if a parameter that is called identifiable is
off that of the clean recording (same noise) by more than 3 of its own standard deviations. A wrong one has to
say so: that the model does not explain the recording, or that the channel at fault is doubtful or left out.

    SMSID_DATA=... SMSID_ORACLE=... python benchmarks/channel_faults.py [--seed 2601] [--faults 60]

What is done is kept in ``build/``, so that it can be stopped.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import _clean_recordings as clean_recordings
import numpy as np
from _common import ROOT, environment, write_result
from _faulty_recordings import KINDS

from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate, load_estimate, save_estimate
from smsid.recording import Recording, load_recording, save_recording
from smsid.recording.attitude import conjugate
from smsid.recording.checks import SampleFault

CLAIM = "faults of components are named, and none that matters passes identify in silence"
FAULTS = (
    "swapped", "sign", "unit", "scale", "delay", "stuck", "saturated", "outlier", "single outlier",
    "quaternion", "full turn", "held",
)  # fmt: skip
WRONG = 3.0  # standard deviations of its own by which a wrong estimate is off


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


def is_right(findings: tuple[SampleFault, ...], channel: str, kind: str, labels: tuple[str, ...]) -> bool:
    """Say whether a finding names channel (or pair), kind and components."""
    kind = "outlier" if kind == "single outlier" else kind
    return any(
        f.kind == kind and channel in (f.channel, f.other) and set(f.components) == set(labels)
        for f in findings
    )


def draw(name: str, rng: np.random.Generator) -> tuple[str, str]:
    """Draw a channel of a recording and a kind of fault that it can have."""
    channels = KINDS[name].channels
    while True:
        channel, kind = channels[int(rng.integers(len(channels)))], FAULTS[int(rng.integers(len(FAULTS)))]
        attitude = channel.endswith(".attitude")
        if (kind == "quaternion") != attitude or (
            kind == "full turn" and not channel.endswith(".joint_position")
        ):
            continue
        return channel, kind


def planted(
    seed: int,
    faults: int,
    names: tuple[str, ...] = tuple(KINDS),
    made: Callable[[str, int], Recording] = lambda name, seed: KINDS[name].make(seed),
) -> Iterator[tuple[dict[str, Any], Recording]]:
    """Yield each fault, as far as it is known when it is planted, with the recording that has it."""
    rng = np.random.default_rng(seed)
    sound = {name: made(name, seed) for name in names}
    for i in range(faults):
        name = names[i % len(names)]
        channel, kind = draw(name, rng)
        with_error, touched = plant(sound[name], channel, kind, rng)
        dims = with_error.channel(channel)
        labels = [str(dims.coords[dims.dims[1]].values[k]) for k in touched]
        yield (
            {"number": i, "recording": name, "channel": channel, "kind": kind, "components": labels},
            with_error,
        )


def named(row: dict[str, Any], recording: Recording) -> dict[str, Any]:
    """Return what `inspect` says of a fault, and whether that is right."""
    found = recording.contradictions().findings
    right = is_right(found, row["channel"], row["kind"], tuple(row["components"]))
    return {"right": right, "clear": any(f.clear for f in found), "said": [f.sentence for f in found]}


def identified(row: dict[str, Any], recording: Recording, sound: Callable[[], Estimate]) -> dict[str, Any]:
    """Identify a faulty recording: how far off is what it calls identifiable, and does it say so?"""
    began = time.process_time()
    try:
        found = KINDS[row["recording"]].identify(recording)
    except SmsidError as error:
        seconds = round(time.process_time() - began, 1)
        return {"outcome": "refused", "by": f"{type(error).__name__}: {error}"[:300], "seconds": seconds}
    clean = sound()
    off = {
        p.name: (p.value - clean[p.name].value) / p.sigma
        for p in found.parameters
        if p.status == "identifiable" and p.name in clean
    }
    worst = max(off, key=lambda n: abs(off[n]), default="")
    says = [n for n in found.notes if is_verdict(n, row["channel"])]
    wrong = abs(off.get(worst, 0.0)) > WRONG
    return {
        "outcome": ("wrong, " if wrong else "right, ") + ("said" if says else "silent"),
        "off_in_sigma": {worst: round(off[worst], 2)} if worst else {},
        "identifiable": len(off),
        "says": says[:3],
        "seconds": round(time.process_time() - began, 1),
    }


def is_verdict(note: str, channel: str) -> bool:
    """Say whether a note tells that an estimate is not to be believed, or what is wrong with a channel."""
    blames = ("doubtful", "isolated outliers", "bridged")
    return "does not explain" in note or (channel in note and any(word in note for word in blames))


def clean(seed: int) -> Iterator[tuple[str, Callable[[], Recording]]]:
    """Yield 30 sound recordings: of hardware, of another engine, and of the three kinds with other seeds."""
    yield from clean_recordings.of_hardware()
    yield from clean_recordings.of_another_engine()
    yield from clean_recordings.of_the_demonstration()
    for name, count in (("paper's craft", 1), ("satellite without arm", 4), ("arm", 4)):
        for k in range(seed + 1, seed + 1 + count):
            yield f"{name}, seed {k}", partial(KINDS[name].make, k)


def main() -> None:
    """Measure and write ``results/channel_faults.json``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=2601)
    parser.add_argument("--faults", type=int, default=60)
    parser.add_argument("--minutes", type=float, default=60.0, help="of processor time to identify for")
    asked = parser.parse_args()
    kept = Kept(asked.seed)
    rows, recordings = [], {}
    for row, recording in planted(asked.seed, asked.faults, made=kept.recording):
        row |= kept.of(f"fault {row['number']}, named", partial(named, row, recording))
        rows.append(row)
        recordings[row["number"]] = recording
    said = {name: kept.of(name, lambda make=make: make().suspicious()) for name, make in clean(asked.seed)}
    real = {
        name: kept.of(name, lambda make=make: make().suspicious())
        for name, make in clean_recordings.with_a_fault()
    }
    cheap = ["arm", "satellite without arm", "paper's craft"]
    for row in sorted(rows, key=lambda r: (not r["clear"], cheap.index(r["recording"]))):
        key, name = f"fault {row['number']}, identified", row["recording"]
        if key in kept.made or time.process_time() < 60.0 * asked.minutes:
            row |= kept.of(
                key, lambda r=row, n=name: identified(r, recordings[r["number"]], partial(kept.estimate, n))
            )
    result = summary(asked.seed, rows, said) | {"named_in_recordings_with_a_fault": real}
    print({k: v for k, v in result.items() if k != "faults"})
    write_result("channel_faults", {**result, "environment": environment("smsid", "numpy", "scipy")})


class Kept:
    """What was made, by its name, in files that a later run goes on with."""

    def __init__(self, seed: int) -> None:
        self.seed, self.folder = seed, ROOT / "build" / f"channel_faults_{seed}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.path = self.folder / "made.jsonl"
        lines = self.path.read_text(encoding="utf-8").splitlines() if self.path.is_file() else []
        self.made: dict[str, Any] = dict(json.loads(line) for line in lines)

    def of(self, key: str, make: Callable[[], Any]) -> Any:
        """Return what is kept under a name, made where it is not."""
        if key not in self.made:
            self.made[key] = make()
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([key, self.made[key]]) + "\n")
            print(key, self.made[key], flush=True)
        return self.made[key]

    def recording(self, name: str, seed: int) -> Recording:
        """Return the clean recording of a kind."""
        path = self.folder / f"{name}.nc"
        if not path.is_file():
            save_recording(KINDS[name].make(seed), path)
        return load_recording(path)

    def estimate(self, name: str) -> Estimate:
        """Return the estimate from the clean recording of a kind."""
        path = self.folder / f"{name}.json"
        if not path.is_file():
            save_estimate(KINDS[name].identify(self.recording(name, self.seed)), path)
        return load_estimate(path)


def summary(seed: int, rows: list[dict[str, Any]], said: dict[str, list[str]]) -> dict[str, Any]:
    """Return the document of the result."""
    outcomes = Counter(row.get("outcome", "not run") for row in rows)
    return {
        "claim": CLAIM,
        "seed": seed,
        "planted": len(rows),
        "named_rightly": sum(row["right"] for row in rows),
        "clear": sum(row["clear"] for row in rows),
        "identified": dict(sorted(outcomes.items())),
        "wrong_in_silence": [row["number"] for row in rows if row.get("outcome") == "wrong, silent"],
        "clean": len(said),
        "false_alarms": {name: told for name, told in said.items() if told},
        "faults": rows,
    }


if __name__ == "__main__":
    main()
