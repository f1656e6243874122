"""Guesses from names and numbers of columns: what is a clock, which columns make a channel, in what unit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError
from smsid.recording._name_order import TURNS, sorted_by_name
from smsid.recording._units import bare, convert, written_unit
from smsid.recording.channels import QUANTITIES

CLOCK = re.compile(
    r"(^|[^a-z])(t|time|times|timestamps?|stamp|zeit|uhrzeit|zeitstempel|temps|tiempo|tempo|tid|tow|epoch|elapsed|"
    r"uptime|utc|secs?|seconds|millis|micros|datetime|s|ms|us|ns|msec|usec|nsec|milliseconds)($|[^a-z])|"
    r"time(stamp)?(_?[munµ]?s(ecs?|econds?)?)?$"
)
COUNTER = re.compile(
    r"(^|[^a-z])(seq|sequence|count|counter|cnt|index|idx|id|frames?|packets?|row|sample|samples|nr|no|"
    r"unnamed|apid|ssc)($|[^a-z])|counter$|count$|seq$"
)
NO_SIGNAL = re.compile(r"covarianc|checksum|(^|[^a-z])crc")
ABOUT = re.compile(r"bias|(^|[^a-z])(std|stddev|variance|offset|limit)($|[^a-z])")
"""Words of columns that say something about a quantity and are none themselves."""
BY_UNIT = {"rad": "joint_position", "degree": "joint_position", "rad/s": "joint_velocity",
           "degree/s": "joint_velocity", "rpm": "joint_velocity", "N m": "joint_torque"}  # fmt: skip
"""What numbered columns of joints are by the unit that they state."""

NAMES: tuple[tuple[str, str, str], ...] = (
    (r"quat|orientation|attitude|lage", "attitude", "1"),
    (r"current|strom|corriente|corrente|courant|\bcurr|(^|[^a-z])i_?motor", "current", "A"),
    (r"torque|effort|tau|drehmoment|couple|coppia|moment|(^|[^a-z])trq", "joint_torque", "N m"),
    (r"joint.*(vel|speed)|(^|[^a-z])(dq|qd|qdot)[^a-z]*$", "joint_velocity", "rad/s"),
    (r"joint.*(pos|angle)|winkel|angle|encoder|(^|[^a-z])q[^a-z]*$", "joint_position", "rad"),
    (r"gyr|angular.?vel|angular.?rate|omega|drehrate|[./]angular([./]|$)", "angular_rate", "rad/s"),
    (r"acc|beschl|axis.*m/s2|linear.?acc", "acceleration", "m/s^2"),
    (r"force|kraft|forza|fuerza", "force", "N"),
    (r"vel|speed|geschw|vitesse", "velocity", "m/s"),
    (r"pos|(^|[^a-z])translation", "position", "m"),
)
"""Pattern in the name, quantity, unit expected. A current is no quantity of a recording: it needs a gear's
gain.
"""

LETTERS = {"a": "acceleration", "g": "angular_rate", "w": "angular_rate", "v": "velocity", "p": "position",
           "f": "force"}  # fmt: skip
"""What a letter before x, y, z usually stands for."""
QUATERNIONS = ("i j k w", "i j k r", "i j k s", "i j k real", "x y z s", "x y z r", "x y z 0", "x y z scalar",
               "v1 v2 v3 s", "vx vy vz s", "vec1 vec2 vec3 scalar", "1 2 3 w", "1 2 3 s")  # fmt: skip
"""Ends of names of the components of a quaternion, scalar last, beside x y z w and numbers."""
OF_AXES = {"joint_torque": "torque", "joint_velocity": "angular_rate"}
OF_JOINTS = {"position": "joint_position", "velocity": "joint_velocity"}
JOINTS = re.compile(r"joint|arm|axis|axes|motor|servo|actuator|achse|(^|[^a-z])[ja]_?\d")
OF_A_BODY = re.compile(r"(?i)(body|bus|base|sat|craft|imu|gyro?|angular|omega|rate|vel|[\W_])*")
"""What stands before roll, pitch or yaw of a body; anything else is a joint's name."""
NUMERIC = "fiu"


@dataclass(frozen=True)
class Group:
    """Columns that make one channel.

    ``quantity`` is None when the name says nothing; ``unit`` is as written in the name, or the usual one.
    ``order`` is the order of a quaternion's columns, None where it is guessed. ``rows`` are the samples that
    are not blank, None for all.
    """

    stem: str
    columns: tuple[str, ...]
    quantity: str | None
    unit: str
    unit_written: bool
    order: str | None = None
    rows: NDArray[np.bool_] | None = None


def stated_unit(columns: Mapping[str, NDArray[Any]], name: str) -> str | None:
    """Return the unit of one of the columns (N,) by a row of units or its name, as mapping files write it."""
    return getattr(columns, "units", {}).get(name) or written_unit(name)


def is_clock(name: str, values: NDArray[Any], *, surely: bool = False) -> bool:
    """Tell whether a column (N,) is a clock: so named or ``surely`` one, and going mostly or always on.

    A counter, an angle or anything else that rises steadily is none: what it counts in is not known.
    """
    named = surely or is_named_time(name)
    if values.ndim != 1 or values.dtype.kind not in NUMERIC or values.size < 3 or not named:
        return False
    steps = np.diff(values[np.isfinite(values)].astype(np.float64))
    if steps.size < 2 or not np.any(steps != 0.0):
        return False
    return max(float(np.mean(steps > 0.0)), float(np.mean(steps < 0.0))) > 0.5 or bool(np.all(steps >= 0.0))


def is_named_time(name: str) -> bool:
    """Tell whether a column is called a time, and no counter."""
    tail = re.split(r"[./]", bare(name).strip("./"))[-1]
    lowered = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", tail).lower()
    last = {name: max((m.end() for m in pattern.finditer(lowered)), default=-1)
            for name, pattern in (("clock", CLOCK), ("counter", COUNTER))}  # fmt: skip
    return last["clock"] > last["counter"]  # a packet's time is one, a time's index is none


def rises_evenly(values: NDArray[Any]) -> bool:
    """Tell whether numbers (N,) nearly always increase by nearly the same, as times and counters do."""
    if values.ndim != 1 or values.dtype.kind not in NUMERIC or values.size < 4:
        return False
    steps = np.diff(values[np.isfinite(values)].astype(np.float64))
    if steps.size < 3:
        return False
    middle = float(np.median(steps))
    even = float(np.percentile(np.abs(steps - middle), 90)) < 0.01 * middle
    return middle > 0.0 and float(np.mean(steps > 0.0)) > 0.999 and even


def is_counter(name: str, values: NDArray[Any]) -> bool:
    """Tell whether a column (N,) counts rows or messages."""
    text = bare(name).lower()
    return bool(COUNTER.search(text)) and rises_evenly(values)


def groups(columns: Mapping[str, NDArray[Any]], skip: set[str]) -> list[Group]:
    """Put columns (N,) whose names differ in an axis or a number only together, in order of the file."""
    blank: Mapping[str, NDArray[np.bool_]] = getattr(columns, "blank", {})
    names = [
        name
        for name, values in columns.items()
        if name not in skip
        and values.dtype.kind in NUMERIC
        and values.ndim in (1, 2)
        and values.shape[0] > 0
        and not NO_SIGNAL.search(name.lower())
        and not is_counter(name, values)
    ]
    stems: dict[tuple[Any, ...], list[str]] = {}
    single = {bare(name): name for name in names if columns[name].ndim == 1}
    quaternions = _quaternions(columns, {n: n for n in names if columns[n].ndim == 1} | single)
    for name in names:
        values = columns[name]
        if name in quaternions:
            stem, members = quaternions[name]
            stems.setdefault((stem, "quaternion", *members), list(members))
            continue
        stem, kind = _stem(bare(name), single) if values.ndim == 1 else (bare(name), "array")
        rows = blank[name].tobytes() if name in blank else b""
        # Columns of other units, lengths or blank rows are no components of one channel; damaged ones
        # (of samples that are not finite) shall not spoil the others.
        unit = stated_unit(columns, name) if kind != "axis" else ""
        sound = bool(np.isfinite(values).all()) or bool(rows)
        stems.setdefault((stem, kind, values.shape, unit, rows, sound), []).append(name)
    return [_group(columns, stem, kind, members) for (stem, kind, *_), members in stems.items()]


def _quaternions(
    columns: Mapping[str, NDArray[Any]], single: Mapping[str, str]
) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Give by column the stem and the columns, scalar last, of the unit quaternion that it belongs to."""
    found: dict[str, tuple[str, tuple[str, ...]]] = {}
    for ends in map(str.split, QUATERNIONS):
        for name in single:
            stem = name[: -len(ends[-1])]
            if not name.lower().endswith(ends[-1]) or not re.search(r"(?i)q|att|rot|orient|lage", stem):
                continue
            alternatives = [[f"{stem}{end}", f"{stem}{end.upper()}"] for end in ends]
            members = tuple(next((single[n] for n in names if n in single), "") for names in alternatives)
            alike = all(members) and len({columns[m].shape for m in members}) == 1
            if alike and _unit(columns, list(members)):
                found |= dict.fromkeys(members, (f"{stem}#", members))
    return found


def _stem(name: str, single: Mapping[str, str]) -> tuple[str, str]:
    """Give the name with '#' for its axis or number, and which of both it is."""
    for found in re.finditer(r"(?i)roll|pitch|yaw", name):
        before, word, after = name[: found.start()], found.group(), name[found.end() :]
        spelt = str.upper if word.isupper() else str.lower if word.islower() else str.capitalize
        siblings = all(f"{before}{spelt(turn)}{after}" in single for turn in TURNS)
        if siblings and OF_A_BODY.fullmatch(before) and not JOINTS.search(after.lower()):
            return f"{before}#{after}", "turn"
    for found in reversed(list(re.finditer(r"[xyzwXYZW]", name))):
        before, letter, after = name[: found.start()], found.group(), name[found.end() :]
        axes = "xyz" if letter.islower() else "XYZ"
        if all(f"{before}{axis}{after}" in single for axis in axes):
            if letter in "wW" and not re.search(r"(?i)q|orientation|attitude|rot|lage|(^|[._/ ])$", before):
                continue
            return f"{before}#{after}", "axis"
    runs = list(re.finditer(r"\d+", name))
    best, most = None, 1
    for run in reversed(runs):
        pattern = re.compile(re.escape(name[: run.start()]) + r"\d+" + re.escape(name[run.end() :]))
        siblings = sum(1 for other in single if pattern.fullmatch(other))
        if siblings > most:
            best, most = run, siblings
    best = best or (runs[-1] if runs and runs[-1].end() == len(name) and runs[-1].start() else None)
    if best is None:
        return name, "single"
    before = name[: best.start()]
    return (
        f"{before if name[best.end() :] else re.sub(r'[ _.-]$', '', before)}#{name[best.end() :]}",
        "number",
    )


def _group(columns: Mapping[str, NDArray[Any]], stem: str, kind: str, members: list[str]) -> Group:
    members = list(sorted_by_name(members)) if kind in ("axis", "number", "turn") else members
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", " ".join(map(bare, members))).lower()
    quantity = next((q for pattern, q, _ in NAMES if re.search(pattern, text)), None)
    order = None
    if ABOUT.search(text):
        quantity = None
    if kind == "number" and quantity is None and not ABOUT.search(text) and JOINTS.search(text):
        quantity = BY_UNIT.get(stated_unit(columns, members[0]) or "")
    if kind == "quaternion":
        quantity, order = "attitude", "xyzw"
    elif kind == "axis":
        letter = re.search(r"(?i)(?:^|[^a-z])([a-z])[ _.]?#", stem)
        if quantity in (None, "joint_position") and letter:
            quantity = LETTERS.get(letter.group(1).lower())
        elif quantity is None and re.fullmatch(r"#", stem):
            quantity = "position"
        quantity = OF_AXES.get(quantity or "", quantity)
        if len(members) == 4:
            axes = [bare(name)[stem.index("#")].lower() for name in members]
            members = [name for _, name in sorted(zip(map("xyzw".index, axes), members, strict=True))]
            quantity, order = "attitude", "xyzw"
        elif quantity == "attitude" or quantity == "joint_position":
            quantity = None
    elif kind == "turn":
        turns_at = quantity is None and fits(stated_unit(columns, members[0]) or "1", "rad/s")
        quantity = "angular_rate" if turns_at or "rate" in text else OF_AXES.get(quantity or "", quantity)
        quantity = quantity if quantity in ("angular_rate", "torque") else None  # angles are no quaternion
    elif kind in ("number", "single") and quantity != "current":
        quantity = _of_numbered(quantity, kind, len(members), text)
    quaternion = len(members) == 4 and re.search(r"(?i)q|att|rot", stem)
    if kind != "array" and quaternion and _unit(columns, members):
        quantity = "attitude"
    elif quantity == "attitude" and kind != "array" and len(members) != 4:
        quantity = None
    usual = "A" if quantity == "current" else QUANTITIES[quantity].unit if quantity else "1"
    unit = stated_unit(columns, members[0])
    if unit is not None and quantity in QUANTITIES and quantity != "attitude" and not fits(unit, usual):
        quantity = None  # what the unit says counts, not the name
    short = unit is not None and len(unit) == 1 and f"[{unit}" not in members[0] and quantity is None
    if short and members[0] not in getattr(columns, "units", {}):
        unit = None  # a letter at the end of a name is a unit only where one is expected
    if quantity is None:
        usual = "1"
    blank = getattr(columns, "blank", {}).get(members[0])
    rows = None if blank is None else ~blank
    return Group(stem, tuple(members), quantity, unit or usual, unit is not None, order, rows)


def _of_numbered(quantity: str | None, kind: str, count: int, text: str) -> str | None:
    """Choose the quantity of columns that are numbered, or of a single one: joints rather than axes."""
    jointed = bool(JOINTS.search(text))
    if quantity in ("position", "velocity") and (kind == "number" or jointed):
        return OF_JOINTS[quantity]
    if quantity is None or quantity.startswith("joint_") or quantity == "attitude":
        return quantity
    return quantity if count == 3 else None


def fits(unit: str, usual: str) -> bool:
    """Tell whether a unit can become another."""
    try:
        convert(np.zeros(1), unit, usual, "")
    except RecordingError:
        return False
    return True


def suspicion(group: Group, values: NDArray[Any]) -> str | None:
    """Say why the unit of a group may not be ``group.unit``, from the size of its values (N, k)."""
    finite = values[np.isfinite(values).all(axis=1)]
    if not finite.size:
        return None
    largest = float(np.abs(finite).max())
    scale = largest or 1.0  # squares of damaged numbers overflow
    middle = scale * float(np.median(np.linalg.norm(finite / scale, axis=1)))
    name = group.stem
    if group.quantity == "joint_position" and group.unit == "rad" and largest > 4.0 * np.pi:
        return f"'{name}' reaches {largest:.4g}: degrees, or motor angles before a gear, rather than rad?"
    if group.quantity in ("angular_rate", "joint_velocity") and group.unit == "rad/s" and largest > 35.0:
        return f"'{name}' reaches {largest:.4g}: degrees per second or rpm rather than rad/s?"
    if group.quantity == "acceleration" and group.unit == "m/s^2" and finite.shape[1] == 3:
        if 0.9 < middle < 1.1:
            return f"'{name}' has a median size of {middle:.3g}: in units of gravity rather than m/s^2?"
        if 900.0 < middle < 1100.0:
            return f"'{name}' has a median size of {middle:.4g}: in thousandths of gravity rather than m/s^2?"
    if group.quantity == "attitude":
        norm = np.linalg.norm(finite, axis=1)
        if finite.shape[1] != 4 or np.abs(norm - 1.0).max() > 1e-3:
            return f"'{name}' is no unit quaternion: norms from {norm.min():.4g} to {norm.max():.4g}."
    if group.quantity == "current":
        return f"'{name}' looks like a current: it is a torque only through a gain (`torque_gain` of a gear)."
    return None


def _unit(columns: Mapping[str, NDArray[Any]], names: list[str]) -> bool:
    norm = np.linalg.norm(np.stack([columns[n] for n in names], axis=1).astype(np.float64), axis=1)
    known = norm[np.isfinite(norm)]
    return bool(known.size and np.abs(known - 1.0).max() < 0.05)


WORD = "positions?|pos|angles?|velocit(?:y|ies)|vel|rates?|speeds?|efforts?|torques?|tau|currents?|q|dq|qd"
AFTER = re.compile(rf"[\s_./-]+(?:{WORD})(?:\s*[\[(].*[\])])?$", re.IGNORECASE)
BEFORE = re.compile(rf"^(?:{WORD})[\s_./-]+(?=\D)", re.IGNORECASE)
COMMANDED = re.compile(r"(^|[^a-z])(target|cmd|command|commanded|desired|setpoint|reference|ref|soll|goal)")


def joint_name(column: str) -> str:
    """Return the joint that a column is named after, less its quantity: '- arm_1_joint_effort' is
    'arm_1_joint'; empty where nothing but a quantity or a number is left.
    """
    text = re.sub(r"^\W+", "", bare(column))
    name = AFTER.sub("", text)
    name = BEFORE.sub("", text) if name == text else name
    return name if name != text and re.search(r"[A-Za-z]", name) else ""


def joint_labels(group: Group) -> tuple[str, ...]:
    """Return the names of a group's joints; none where its columns do not name each of them by itself."""
    if not (group.quantity or "").startswith("joint_"):
        return ()
    names = tuple(joint_name(c) for c in group.columns)
    return names if all(names) and len(set(names)) == len(names) else ()


def are_counted(labels: tuple[str, ...]) -> bool:
    """Tell whether joints are only counted, such as ``joint1``: another device's may be, too."""
    return bool(labels) and all(name[-1].isdigit() for name in labels)


def joined_by_quantity(found: list[Group], columns: Mapping[str, NDArray[Any]]) -> list[Group]:
    """Return the groups with those in one whose columns (N,) name different joints of one measured quantity.

    Joints of one mechanism do not all bear numbers: a torso's belongs to the arm's.
    """
    out: list[Group] = []
    places: dict[tuple[Any, ...], int] = {}
    for group in found:
        names = joint_labels(group)
        if not names or are_counted(names) or columns[group.columns[0]].ndim != 1:
            out.append(group)
            continue
        rows = b"" if group.rows is None else np.asarray(group.rows).tobytes()
        text = " ".join(group.columns).lower()
        key = (group.quantity, columns[group.columns[0]].shape, rows, bool(COMMANDED.search(text)))
        key = (*key, group.unit, group.unit_written)
        if key in places:
            together = replace(out[places[key]], columns=(*out[places[key]].columns, *group.columns))
            if joint_labels(together):
                out[places[key]] = together
                continue
        places[key] = len(out)
        out.append(group)
    return out
