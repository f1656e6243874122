"""Modal data of a panel from finite elements: Nastran's .f06, .pch and .op2, and plain tables, CSV and JSON.

A clamped structure that vibrates in a mass-normalised mode pulls at its root by -w^2 L: so the participation
factors are the single-point constraint forces over -w^2, whatever the program prints beside.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from smsid._explain import validate_tables
from smsid._reading import read_json
from smsid.description._nastran_reading import NastranMode, read_f06, read_op2, read_punch, read_weights
from smsid.effects.base import Vector3
from smsid.effects.table import StrictTable
from smsid.errors import DescriptionError

KEY = "finite_elements"
LARGEST_SPC = 1e-9
"""Constraint forces below this share of the largest are those of a node that holds nothing."""


class FiniteElements(StrictTable):
    """Where modal data of an appendage are: ``finite_elements = { file = "panel.f06", root = 1, ... }``.

    ``root``: node the panel is clamped at, about which rotations count; ``nodes`` those of the stations, in
    order; ``positions`` (by node) [m] are needed only of further clamped nodes, and of the root then.
    ``damping``: of all modes, or one each; ``modes``: how many of the first are taken.
    """

    file: str
    root: int | None = None
    nodes: tuple[int, ...] = ()
    positions: dict[int, Vector3] = Field(default_factory=dict)
    damping: float | tuple[float, ...] | None = None
    modes: int | None = Field(default=None, ge=1)


def with_finite_elements(tables: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a description's tables with the modal data of the files that its appendages name.

    What the table itself gives goes before what is read.

    Raises:
        DescriptionError: a file is missing, of no known suffix, or does not hold what is asked of it.
        MissingDependencyError: .op2 needs pyNastran (extra ``nastran``).
    """
    effects = tables.get("effect")
    if not isinstance(effects, list) or not any(isinstance(e, Mapping) and KEY in e for e in effects):
        return dict(tables)
    found = []
    for entry in effects:
        if not isinstance(entry, Mapping) or KEY not in entry:
            found.append(entry)
            continue
        rest = {k: v for k, v in entry.items() if k != KEY}
        where = f"[[effect]] '{entry.get('name')}', {KEY},"
        advice = 'Write finite_elements = { file = "panel.f06", nodes = [7], damping = 0.005 }.'
        asked = validate_tables(FiniteElements, entry[KEY], where, DescriptionError, advice=advice)
        found.append({**modal_data(folder / asked.file, asked), **rest})
    return {**tables, "effect": found}


def modal_data(path: Path, asked: FiniteElements) -> dict[str, Any]:
    """Return the keys of a modal appendage that a file tells: modes, and rigid properties where it has them.

    Raises:
        DescriptionError: as `with_finite_elements`.
        MissingDependencyError: .op2 needs pyNastran (extra ``nastran``).
    """
    if not path.is_file():
        raise DescriptionError(f"There is no file '{path}' of finite elements.", advice="Check the path.")
    match path.suffix.lower():
        case ".json":
            found = read_modal_json(path)
        case ".csv":
            found = read_modal_csv(path)
        case ".f06":
            text = path.read_text(errors="replace")
            found = {**read_weights(text), "mode": _modes(path, read_f06(text), asked)}
        case ".pch":
            found = {"mode": _modes(path, read_punch(path.read_text(errors="replace")), asked)}
        case ".op2":
            found = {"mode": _modes(path, read_op2(path), asked)}
        case suffix:
            raise DescriptionError(
                f"'{path}' ends in '{suffix}': no file of finite elements that is known.",
                advice="Give .f06, .pch or .op2 of Nastran, or a table as .csv or .json.",
            )
    modes = [dict(m) for m in found.get("mode", ())][: asked.modes]
    if not modes:
        raise DescriptionError(f"'{path}' holds no modes.", advice="Is it the right file?")
    if asked.damping is not None:
        each = list(asked.damping) if isinstance(asked.damping, tuple) else [asked.damping] * len(modes)
        if len(each) < len(modes):
            raise DescriptionError(
                f"'{path}' has {len(modes)} modes, `damping` {len(each)} values.", advice="Give one each."
            )
        for mode, value in zip(modes, each, strict=False):
            mode["damping"] = value
    if any("damping" not in mode for mode in modes):
        raise DescriptionError(
            f"'{path}' says nothing of damping.", advice=f"State it: {KEY} = {{ ..., damping = 0.005 }}."
        )
    return {**found, "mode": modes}


def _modes(path: Path, modes: list[NastranMode], asked: FiniteElements) -> list[dict[str, Any]]:
    """Return the modes as a description has them: mass-normalised, participation from constraint forces."""
    out = []
    for number, mode in enumerate(modes[: asked.modes], start=1):
        if not mode.forces:
            raise DescriptionError(
                f"'{path}' has no single-point constraint forces of mode {number}.",
                advice="Ask Nastran for SPCFORCES = ALL: the participation factors are made of them.",
            )
        missing = [n for n in asked.nodes if n not in mode.shape]
        if missing:
            raise DescriptionError(
                f"'{path}' has no eigenvector of node {', '.join(map(str, missing))}.",
                advice="Ask Nastran for DISPLACEMENT = ALL, or correct `nodes`.",
            )
        largest = max(np.abs(f).max() for f in mode.forces.values())
        held = [n for n, f in mode.forces.items() if np.abs(f).max() > LARGEST_SPC * largest]
        root = asked.root if asked.root is not None else held[0]
        far = [n for n in held if n != root]
        unplaced = [n for n in (*far, *([root] if far else [])) if n not in asked.positions]
        if unplaced:
            raise DescriptionError(
                f"The panel of '{path}' is held at the nodes {', '.join(map(str, held))}.",
                advice=f"Give `positions` of {', '.join(map(str, unplaced))}, or clamp it at one node.",
            )
        force, moment = np.zeros(3), np.zeros(3)
        for n in held:
            lever = np.subtract(asked.positions[n], asked.positions[root]) if far else np.zeros(3)
            force += mode.forces[n][:3]
            moment += mode.forces[n][3:] + np.cross(lever, mode.forces[n][:3])
        scale = -1.0 / (mode.eigenvalue * np.sqrt(mode.mass))
        shape = [tuple((mode.shape[n][:3] / np.sqrt(mode.mass)).tolist()) for n in asked.nodes]
        out.append(
            {
                "frequency": float(np.sqrt(mode.eigenvalue) / (2 * np.pi)),
                "translation": tuple((scale * force).tolist()),
                "rotation": tuple((scale * moment).tolist()),
                "shape": tuple(shape),
            }
        )
    return out


def read_modal_json(path: Path) -> dict[str, Any]:
    """Return the keys of a JSON; raises `DescriptionError` for one that is none or has other keys."""
    found = read_json(path, DescriptionError)
    known = {"mass", "center_of_mass", "inertia", "stations", "mode"}
    if not isinstance(found, dict) or set(found) - known:
        extra = sorted(set(found) - known) if isinstance(found, dict) else ["no table"]
        raise DescriptionError(
            f"'{path}' has {', '.join(extra)}.", advice=f"Keys: {', '.join(sorted(known))}."
        )
    return found


def read_modal_csv(path: Path) -> dict[str, Any]:
    """Read a mode a row: frequency, damping, tx ty tz, rx ry rz, and of each station s1x s1y s1z, ...

    Raises `DescriptionError` for columns that are missing or unknown.
    """
    with path.open(encoding="utf-8-sig", newline="") as stream:
        rows = [{k.strip(): v for k, v in row.items() if k} for row in csv.DictReader(stream)]
    names = list(rows[0]) if rows else []
    stations = sum(1 for name in names if re.fullmatch(r"s\d+x", name))
    wanted = ["frequency", *(f"{k}{a}" for k in "tr" for a in "xyz")]
    wanted += [f"s{k}{a}" for k in range(1, stations + 1) for a in "xyz"]
    missing = [name for name in wanted if name not in names]
    unknown = [name for name in names if name not in (*wanted, "damping")]
    if missing or unknown:
        raise DescriptionError(
            f"'{path}' has {f'no column {missing}' if missing else f'the unknown column {unknown}'}.",
            advice="Columns: frequency [Hz], damping, tx ty tz [kg^.5], rx ry rz [kg^.5 m], s1x s1y s1z ... "
            "[kg^-.5].",
        )
    try:
        numbers = [{k: float(v) for k, v in row.items()} for row in rows]
    except (TypeError, ValueError) as error:
        raise DescriptionError(
            f"'{path}' holds a cell that is no number: {error}.", advice="Mend it."
        ) from error
    modes = []
    for row in numbers:
        t, r, *shape = (
            tuple(row[f"{k}{axis}"] for axis in "xyz")
            for k in ("t", "r", *(f"s{k}" for k in range(1, stations + 1)))
        )
        mode = {k: row[k] for k in ("frequency", "damping") if k in row}
        modes.append({**mode, "translation": t, "rotation": r, "shape": tuple(shape)})
    return {"mode": modes}
