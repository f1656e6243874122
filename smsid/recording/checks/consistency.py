"""Kinematically related channels of a recording check each other, component by component."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from smsid.recording.checks import sample_faults
from smsid.recording.checks.finding import Finding
from smsid.recording.checks.increments import KinematicPair
from smsid.recording.checks.pair_check import PairCheck, component_labels
from smsid.recording.checks.resting import resting_findings
from smsid.recording.checks.unit_causes import PAIRS

if TYPE_CHECKING:
    from smsid.recording.recording import Recording


def channel_findings(recording: Recording) -> tuple[Finding, ...]:
    """Find components of channels that contradict themselves or a kinematically related channel.

    Raises nothing for a recording whose clocks increase and whose samples are finite; see `Recording.check`.
    """
    found: list[Finding] = []
    with_error: set[tuple[str, str]] = set()
    for name in recording.channels:
        if name.startswith(("command.", "extra.", "truth.")) or recording[name].ndim != 2:
            continue
        t, values = recording.time(name), recording[name]
        held = sample_faults.held_finding(name, t, values)
        found += [held] if held else []
        for k, label in enumerate(component_labels(recording, name)):
            own = [sample_faults.outlier_finding(name, label, t, values[:, k])]
            if name.endswith(".joint_position"):
                own.append(sample_faults.full_turn_finding(name, label, t, values[:, k]))
            for finding in own:
                if finding is not None:
                    found.append(finding)
                    with_error.add((name, label))
    pairs = []
    for first, second, _ in PAIRS:
        for x, v in _pairs(recording, first, second):
            pair = _kinematic_pair(recording, x, v)
            if pair is not None:
                pairs.append((x, v, pair))
    for x, v, pair in pairs:
        check = PairCheck(recording, x, v, pair, with_error)
        resting = [f for f in resting_findings(check) if (f.channel, f.components[0]) not in with_error]
        if any(f.kind == "saturated" for f in resting) and check.delayed():
            # where one turns round, the other, late, still moves
            resting = [f for f in resting if f.kind != "saturated"]
        found += resting
        with_error |= {(f.channel, f.components[0]) for f in resting}
    for x, v, pair in sorted(pairs, key=lambda one: one[2].kind == "inertial"):
        if pair.kind == "inertial" and any(f.kind == "quaternion" for f in found):
            continue  # turned by an attitude of another convention
        found += PairCheck(recording, x, v, pair, with_error).findings()
    return tuple(found)


def _pairs(recording: Recording, first: str, second: str) -> Iterator[tuple[str, str]]:
    def named(quantity: str) -> list[str]:
        return [
            name
            for name in recording.channels
            if name.partition(".")[2] == quantity and not name.startswith(("extra.", "truth."))
        ]

    for x in named(first):
        for v in named(second):
            commanded = x.startswith("command.") or (v.startswith("command.") and second != "wheel_torque")
            same = first == "attitude" or recording[x].shape[1:] == recording[v].shape[1:]
            if not commanded and same and recording[v].ndim == 2:
                yield x, v


def _kinematic_pair(recording: Recording, x: str, v: str) -> KinematicPair | None:
    values = recording[x]
    arrays = (recording.time(x), values, recording.time(v), recording[v])
    if max(float(np.abs(values).max()), float(np.abs(recording[v]).max())) > 1e100:
        arrays = (arrays[0], np.clip(values, -1e30, 1e30), arrays[2], np.clip(arrays[3], -1e30, 1e30))
    if x.endswith(".attitude"):
        norms = np.linalg.norm(values, axis=1, keepdims=True)
        if not 0.5 < float(norms.min()) <= float(norms.max()) < 2.0:
            return None
        return KinematicPair(arrays[0], values / norms, arrays[2], arrays[3], "attitude")
    if v.endswith(".acceleration"):
        attitudes = [name for name in recording.channels if name.endswith(".attitude")]
        if not attitudes:
            return None
        own = x.partition(".")[0] + ".attitude"
        q = own if own in attitudes else attitudes[0]
        return KinematicPair(*arrays, "inertial", (recording.time(q), recording[q]))
    return KinematicPair(*arrays)
