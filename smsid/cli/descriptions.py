"""Descriptions: ``smsid new`` drafts one, ``check`` tells what is wrong, ``regressor`` how accurate it is."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.options import DescriptionPath, ShowAll
from smsid.cli.output import print_parts, say, show_spinner
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from smsid.export.regressor_check import RegressorCheck


def new_command(
    name: Annotated[str, typer.Argument(help="name of the craft; NAME.toml and NAME_bus.urdf are written")],
    arm: Annotated[
        list[str] | None,
        typer.Option(help="URDF of an arm, or a robot of example-robot-data; may be given more than once"),
    ] = None,
    wheels: Annotated[int, typer.Option(min=0, max=12, help="number of reaction wheels")] = 3,
    tank: Annotated[
        int, typer.Option("--tank", count=True, help="a tank of fuel that sloshes; repeat it for more")
    ] = 0,
    panel: Annotated[str | None, typer.Option(help="with a panel of length x width [m], as 6x3")] = None,
    mass: Annotated[float, typer.Option(help="mass of the bus [kg]")] = 200.0,
    size: Annotated[float, typer.Option(help="edge of the bus [m]")] = 1.0,
) -> CommandResult:
    """Write a commented description of a new craft into this folder, with a bus, sensors and limits."""
    from smsid._files import atomic_write
    from smsid.description import load_description
    from smsid.description.draft import CraftDraft, draft_arm
    from smsid.model import build_model

    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise SmsidError(f"'{name}' is no name for a craft.", advice="Use letters, digits, _ and -.")
    if not (0.0 < mass < 1e7 and 0.0 < size < 1e3):
        raise SmsidError(f"A bus of {mass:g} kg and {size:g} m is not possible.", advice="Give kg and m.")
    lengths = None
    if panel is not None:
        match = re.fullmatch(r"(\d+\.?\d*)x(\d+\.?\d*)", panel)
        lengths = (float(match[1]), float(match[2])) if match else None
        if lengths is None or not min(lengths) > 0.0:
            raise SmsidError(f"'{panel}' is no size of a panel.", advice="Give length x width [m], as 6x3.")
    files = Path(f"{name}.toml"), Path(f"{name}_bus.urdf")
    for file in files:
        if os.path.lexists(file):
            raise SmsidError(f"'{file}' exists.", advice="Choose another name, or remove it.")
    draft = CraftDraft(name, tuple(map(draft_arm, arm or ())), wheels, tank, lengths, mass, size)
    atomic_write(files[1], draft.urdf())
    atomic_write(files[0], draft.toml())
    model = build_model(load_description(files[0]))
    say(
        f"{model.mass:.4g} kg, {len(model.arm_joints)} arm joints, {len(model.wheels)} wheels. Lines marked "
        f"GUESS are yours to fill in; then `smsid check {files[0]}`."
    )
    return CommandResult({"mass": model.mass}, files)


def check_command(description: DescriptionPath) -> CommandResult:
    """Tell all that is wrong or doubtful in a description, its URDFs and the model; exit code 1 if wrong."""
    from smsid.cli.file_kind import kind_of
    from smsid.model.review import review_description

    kind = kind_of(
        description
    )  # a file that is not there is no description with faults, another kind neither
    if kind != "description":
        raise SmsidError(
            f"'{description}' is of the kind '{kind.replace('_', ' ')}', no description.",
            advice="Give the TOML or URDF of the spacecraft.",
        )
    found = review_description(description)
    for label, findings in (("wrong", found.wrong), ("doubtful", found.doubtful)):
        for text in findings:
            say(f"{label}: {text}")
    say(f"{len(found.wrong)} wrong, {len(found.doubtful)} doubtful")
    document = {"wrong": list(found.wrong), "doubtful": list(found.doubtful)}
    return CommandResult(document, exit_code=1 if found.wrong else 0)


NAME = 80  # characters of a combination in the table


def regressor_command(
    description: DescriptionPath,
    states: Annotated[int, typer.Option(min=1, help="random states to compare at")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="seed of the states")] = 1,
    fixed: Annotated[bool, typer.Option("--fixed", help="the root link stands on the ground")] = False,
    show_all: ShowAll = False,
) -> CommandResult:
    """Check momentum and torque regressors against Pinocchio, MuJoCo and identities; name base parameters."""
    import numpy as np

    from smsid.description import load_description
    from smsid.export.regressor_check import check_regressor
    from smsid.model import build_model

    described = load_description(description)
    if fixed:
        described = described.model_copy(update={"root": "fixed"})
    model = build_model(described)
    with show_spinner("comparing"):
        found = check_regressor(model, np.random.default_rng(seed), states=states)
    print_parts(check_parts(found, everything=show_all))
    document = {
        "states": found.states,
        "errors": found.errors,
        "not_compared": list(found.not_compared),
        "condition": found.base.condition,
        "base_parameters": [
            {"name": n, "unit": u} for n, u in zip(found.base.names, found.base.units, strict=True)
        ],
        "unseen": list(found.base.unseen),
        "microseconds": found.microseconds,
    }
    return CommandResult(document)


def check_parts(found: RegressorCheck, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print: worst errors, condition, time, and the base parameters by name."""
    from rich.text import Text

    from smsid.cli.output import clip_line
    from smsid.cli.tables import ROWS, cut_tables, plain_table
    from smsid.identify.estimate_text import short_name

    worst = plain_table("compared with", "worst relative error", left=("compared with",))
    for name, error in found.errors.items():
        worst.add_row(name, f"{error:.1e}")
    yield worst
    yield from (Text(f"not compared: {why}") for why in found.not_compared)
    times = ", ".join(f"{name} {t:.0f}" for name, t in found.microseconds.items())
    yield f"{found.states} random states; microseconds a state: {times}"
    count = f"{len(found.base)} base parameters of {found.parameters}"
    yield f"{count}, condition number {found.base.condition:.0f}"
    base = plain_table("base parameter", "unit", left=("base parameter", "unit"), fold=everything)
    for name, unit in zip(found.base.names, found.base.units, strict=True):
        base.add_row(Text(name if everything else short_name(name, NAME)), unit)
    yield from cut_tables([base], everything, ROWS)
    if found.base.unseen:
        text = f"not seen: {', '.join(found.base.unseen)}"
        yield Text(text if everything else clip_line(text))
