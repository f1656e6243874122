"""Joints that a log names in its columns: one channel of a quantity, with labels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.recording._guess import Group

WORD = "positions?|pos|angles?|velocit(?:y|ies)|vel|rates?|speeds?|efforts?|torques?|tau|currents?|q|dq|qd"
AFTER = re.compile(rf"[\s_./-]+(?:{WORD})(?:\s*[\[(].*[\])])?$", re.IGNORECASE)
BEFORE = re.compile(rf"^(?:{WORD})[\s_./-]+(?=\D)", re.IGNORECASE)
COMMANDED = re.compile(r"(^|[^a-z])(target|cmd|command|commanded|desired|setpoint|reference|ref|soll|goal)")


def joint_name(column: str) -> str:
    """Return the joint that a column is named after, less its quantity: '- arm_1_joint_effort' is
    'arm_1_joint'; empty where nothing but a quantity or a number is left.
    """
    text = re.sub(r"^\W+", "", column)
    bare = AFTER.sub("", text)
    bare = BEFORE.sub("", text) if bare == text else bare
    return bare if bare != text and re.search(r"[A-Za-z]", bare) else ""


def joint_labels(group: Group) -> tuple[str, ...]:
    """Return the names of a group's joints; none where its columns do not name each of them by itself.

    Joints that are only counted, such as ``joint1``, may be called otherwise in a description.
    """
    if not (group.quantity or "").startswith("joint_"):
        return ()
    names = tuple(joint_name(c) for c in group.columns)
    counted = all(name[-1:].isdigit() for name in names)
    return names if all(names) and len(set(names)) == len(names) and not counted else ()


def joined_by_quantity(found: list[Group], columns: Mapping[str, NDArray[Any]]) -> list[Group]:
    """Return the groups with those in one whose columns name different joints of one measured quantity.

    Joints of one mechanism do not all bear numbers: a torso's belongs to the arm's.
    """
    out: list[Group] = []
    places: dict[tuple[Any, ...], int] = {}
    for group in found:
        names = joint_labels(group)
        if not names or columns[group.columns[0]].ndim != 1:
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
