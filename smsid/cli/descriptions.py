"""``smsid new`` and ``smsid check``: a first description of one's own craft, and what is wrong in one."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.options import DescriptionPath
from smsid.cli.output import say
from smsid.errors import SmsidError


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
) -> Outcome:
    """Write a commented description of a new craft into this folder, with a bus, sensors and limits."""
    from smsid._files import atomic_write
    from smsid.description import load_description
    from smsid.description.draft import Draft, draft_arm
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
    draft = Draft(name, tuple(map(draft_arm, arm or ())), wheels, tank, lengths, mass, size)
    atomic_write(files[1], draft.urdf())
    atomic_write(files[0], draft.toml())
    model = build_model(load_description(files[0]))
    say(
        f"{model.mass:.4g} kg, {len(model.arm_joints)} arm joints, {len(model.wheels)} wheels. Lines marked "
        f"GUESS are yours to fill in; then `smsid check {files[0]}`."
    )
    return Outcome({"mass": model.mass}, files)


def check_command(description: DescriptionPath) -> Outcome:
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
    return Outcome(document, exit_code=1 if found.wrong else 0)
