"""``smsid regressor``: how accurate the regressors of one's own machine are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.options import DescriptionPath, ShowAll
from smsid.cli.output import print_parts, working

if TYPE_CHECKING:
    from rich.console import RenderableType

    from smsid.export.regressor_check import RegressorCheck

NAME = 80  # characters of a combination in the table


def regressor_command(
    description: DescriptionPath,
    states: Annotated[int, typer.Option(min=1, help="random states to compare at")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="seed of the states")] = 1,
    fixed: Annotated[bool, typer.Option("--fixed", help="the root link stands on the ground")] = False,
    show_all: ShowAll = False,
) -> Outcome:
    """Check momentum and torque regressors against Pinocchio, MuJoCo and identities; name base parameters."""
    import numpy as np

    from smsid.description import load_description
    from smsid.export.regressor_check import check_regressor
    from smsid.model import build_model

    described = load_description(description)
    if fixed:
        described = described.model_copy(update={"root": "fixed"})
    model = build_model(described)
    with working("comparing"):
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
    return Outcome(document)


def check_parts(found: RegressorCheck, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print: worst errors, condition, time, and the base parameters by name."""
    from rich.text import Text

    from smsid.cli.notes import clipped
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
        yield Text(text if everything else clipped(text))
