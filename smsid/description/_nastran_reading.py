"""Modes that Nastran found, from its .f06, .pch and .op2: eigenvalues with motion and constraint forces."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from smsid.errors import DescriptionError, MissingDependencyError

logger = logging.getLogger(__name__)

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"
ROW = re.compile(rf"\s*(\d+)\s+G\s+({NUMBER}(?:\s+{NUMBER}){{5}})\s*")


@dataclass
class NastranMode:
    """A mode as printed: eigenvalue [1/s^2], generalised mass, motion and constraint forces (6,) by node."""

    eigenvalue: float
    mass: float = 1.0
    shape: dict[int, np.ndarray] = field(default_factory=dict)
    forces: dict[int, np.ndarray] = field(default_factory=dict)


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


def read_op2(path: Path) -> list[NastranMode]:
    """Return the modes of an .op2.

    Raises:
        DescriptionError: it is no OP2, or damaged.
        MissingDependencyError: pyNastran (extra ``nastran``) is missing or does not load.
    """
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


def read_weights(text: str) -> dict[str, Any]:
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


def _float(text: str) -> float:
    return float(text.upper().replace("D", "E"))
