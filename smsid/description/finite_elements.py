"""Modal data of a panel from finite elements: Nastran's .f06, .pch and .op2, and plain tables, CSV and JSON.

A clamped structure that vibrates in a mass-normalised mode pulls at its root by -w^2 L: so the participation
factors are the single-point constraint forces over -w^2, whatever the program prints beside.
"""

from __future__ import annotations

import csv
import json
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from smsid.effects.base import Vector3
from smsid.effects.table import Table
from smsid.errors import DescriptionError, MissingDependencyError

logger = logging.getLogger(__name__)

KEY = "finite_elements"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"
ROW = re.compile(rf"\s*(\d+)\s+G\s+({NUMBER}(?:\s+{NUMBER}){{5}})\s*")
LARGEST_SPC = 1e-9
"""Constraint forces below this share of the largest are those of a node that holds nothing."""


class FiniteElements(Table):
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


@dataclass
class NastranMode:
    """A mode as printed: eigenvalue [1/s^2], generalised mass, motion and constraint forces (6,) by node."""

    eigenvalue: float
    mass: float = 1.0
    shape: dict[int, np.ndarray] = field(default_factory=dict)
    forces: dict[int, np.ndarray] = field(default_factory=dict)


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
    for effect in effects:
        if not isinstance(effect, Mapping) or KEY not in effect:
            found.append(effect)
            continue
        rest = {k: v for k, v in effect.items() if k != KEY}
        try:
            asked = FiniteElements.model_validate(effect[KEY])
        except ValidationError as error:
            reasons = "; ".join(f"'{'.'.join(map(str, e['loc']))}': {e['msg']}" for e in error.errors())
            raise DescriptionError(
                f"[[effect]] '{effect.get('name')}', {KEY}: {reasons}.",
                advice='Write finite_elements = { file = "panel.f06", nodes = [7], damping = 0.005 }.',
            ) from error
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
            found = _from_json(path)
        case ".csv":
            found = _from_csv(path)
        case ".f06":
            text = path.read_text(errors="replace")
            found = {**_rigid(text), "mode": _modes(path, read_f06(text), asked)}
        case ".pch":
            found = {"mode": _modes(path, read_punch(path.read_text(errors="replace")), asked)}
        case ".op2":
            found = {"mode": _modes(path, _read_op2(path), asked)}
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


def read_f06(text: str) -> list[NastranMode]:
    """Return the modes of an .f06: tables of eigenvalues, eigenvectors and constraint forces."""
    modes: list[NastranMode] = []
    table, current = "", 0.0
    for line in text.splitlines():
        squeezed = line.replace(" ", "").upper()
        if "REALEIGENVALUES" in squeezed:
            table = "values"
        elif "REALEIGENVECTORNO" in squeezed:
            table = "shape"
        elif "SINGLE-POINTCONSTRAINT" in squeezed:
            table = "forces"
        elif "GRIDPOINTWEIGHT" in squeezed or "MULTI-POINTCONSTRAINT" in squeezed or "LOADVECTOR" in squeezed:
            table = ""
        if match := re.search(rf"EIGENVALUE =\s*({NUMBER})", line):
            current = _float(match.group(1))
        if table == "values":
            row = line.split()
            if len(row) == 7 and row[0].isdigit() and row[1].isdigit():
                modes.append(NastranMode(_float(row[2]), _float(row[5])))
        elif table and (match := ROW.fullmatch(line)):
            into = getattr(_nearest(modes, current), table)
            into[int(match.group(1))] = np.array([_float(x) for x in match.group(2).split()])
    return modes


def read_punch(text: str) -> list[NastranMode]:
    """Return the modes of a .pch, which are taken as mass-normalised, Nastran's default."""
    modes: list[NastranMode] = []
    table, numbers, node = "", [], 0
    current: NastranMode | None = None
    for line in text.splitlines():
        if line.startswith("$"):
            word = line[1:].split("=")[0].strip().upper()
            if word.startswith(("EIGENVECTOR", "DISPLACEMENT", "SPCF", "ELEMENT", "MPCF", "OLOAD")):
                motion = word.startswith(("EIGENVECTOR", "DISPLACEMENT"))
                table = "forces" if word.startswith("SPCF") else "shape" if motion else ""
            if match := re.match(rf"\$EIGENVALUE\s*=\s*({NUMBER})", line):
                value = _float(match.group(1))
                known = [m for m in modes if abs(m.eigenvalue - value) <= 1e-6 * abs(value)]
                current = known[0] if known else NastranMode(value)
                modes += [] if known else [current]
            continue
        cells = line[:72]
        if cells.startswith("-CONT-"):
            numbers += [_float(x) for x in cells[6:].split()]
        elif match := re.match(r"\s*(\d+)\s+G\s", cells):
            node, numbers = int(match.group(1)), [_float(x) for x in cells[match.end() :].split()]
        if len(numbers) == 6 and table and current is not None:
            getattr(current, table)[node] = np.array(numbers)
            numbers = []
    return modes


def _read_op2(path: Path) -> list[NastranMode]:
    """Return the modes of an .op2."""
    try:
        OP2 = import_module("pyNastran.op2.op2").OP2
    except (ImportError, AttributeError) as error:  # it takes names of numpy that newer ones do not have
        raise MissingDependencyError(
            f"pyNastran cannot be loaded: {error}.",
            advice="Install it with: pip install 'smsid[nastran]' 'numpy<2.4', or give the .f06 or .pch.",
            module="pyNastran",
        ) from error
    model = OP2(debug=False, log=logger)
    try:
        model.read_op2(str(path), build_dataframe=False)
    except Exception as error:  # pyNastran raises its own errors, struct.error, ... depending on the place
        raise DescriptionError(
            f"'{path}' cannot be read as OP2: {error}.", advice="Is it cut short?"
        ) from error
    modes: list[NastranMode] = []
    for table in model.eigenvalues.values():
        pairs = zip(table.eigenvalues, table.generalized_mass, strict=True)
        modes += [NastranMode(float(x), float(m)) for x, m in pairs]
    if not modes:
        logger.warning("%s has no table of eigenvalues: its modes are taken as mass-normalised.", path)
        modes = [NastranMode(float(x)) for result in model.eigenvectors.values() for x in result.eigns]
    for kind, results in (("shape", model.eigenvectors), ("forces", model.spc_forces)):
        for result in results.values():
            for k, value in enumerate(result.eigns):
                into = getattr(_nearest(modes, float(value)), kind)
                rows = zip(result.node_gridtype[:, 0], result.data[k], strict=True)
                into.update({int(n): np.array(row, dtype=float) for n, row in rows})
    return modes


def _nearest(modes: list[NastranMode], value: float) -> NastranMode:
    if not modes:
        raise DescriptionError("Eigenvectors come before any eigenvalues.", advice="Is the file cut?")
    return min(modes, key=lambda m: abs(m.eigenvalue - value))


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


def _rigid(text: str) -> dict[str, Any]:
    """Return mass, centre and inertia about the reference point of an .f06's grid point weight generator."""
    start = re.search(r"W E I G H T\s+G E N E R A T O R", text)
    if start is None:
        return {}
    rows: list[list[float]] = []
    for line in text[start.end() :].splitlines():
        cells = [x for x in line.replace("*", " ").split() if re.fullmatch(NUMBER, x)]
        if "*" in line and len(cells) == 6:
            rows.append([_float(x) for x in cells])
        if len(rows) == 6:
            break
    if len(rows) < 6:
        return {}
    about = np.array(rows)
    mass, s, inertia = about[0, 0], about[3:, :3], about[3:, 3:]
    centre = np.array([s[2, 1], s[0, 2], s[1, 0]]) / mass  # s = m [c]x
    return {
        "mass": float(mass),
        "center_of_mass": tuple(centre.tolist()),
        "inertia": tuple(float(inertia[i]) for i in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))),
    }


def _from_json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DescriptionError(f"'{path}' is no JSON: {error}.", advice="Mend it.") from error
    known = {"mass", "center_of_mass", "inertia", "stations", "mode"}
    if not isinstance(found, dict) or set(found) - known:
        extra = sorted(set(found) - known) if isinstance(found, dict) else ["no table"]
        raise DescriptionError(
            f"'{path}' has {', '.join(extra)}.", advice=f"Keys: {', '.join(sorted(known))}."
        )
    return found


def _from_csv(path: Path) -> dict[str, Any]:
    """Read a mode a row: frequency, damping, tx ty tz, rx ry rz, and of each station s1x s1y s1z, ..."""
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
    return {
        "mode": [
            {
                "frequency": row["frequency"],
                **({"damping": row["damping"]} if "damping" in row else {}),
                "translation": _vector(row, "t"),
                "rotation": _vector(row, "r"),
                "shape": tuple(_vector(row, f"s{k}") for k in range(1, stations + 1)),
            }
            for row in numbers
        ]
    }


def _vector(row: Mapping[str, float], what: str) -> tuple[float, ...]:
    return tuple(row[f"{what}{axis}"] for axis in "xyz")


def _float(text: str) -> float:
    return float(text.upper().replace("D", "E"))
