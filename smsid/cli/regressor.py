"""``smsid regressor``: how accurate the regressors of one's own machine are."""

from __future__ import annotations

from typing import Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import DescriptionPath
from smsid.cli.output import console, working


def regressor_command(
    description: DescriptionPath,
    states: Annotated[int, typer.Option(min=1, help="random states to compare at")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="seed of the states")] = 1,
) -> Outcome:
    """Check momentum and torque regressors against Pinocchio, MuJoCo and identities; name base parameters."""
    import numpy as np

    from smsid.description import load_description
    from smsid.model import build_model
    from smsid.model.regressor_check import check_regressor

    model = build_model(load_description(description))
    with working("comparing"):
        found = check_regressor(model, np.random.default_rng(seed), states=states)
    out = console()
    for name, error in found.errors.items():
        out.print(f"worst relative error, {name}: {error:.1e}", highlight=False)
    for why in found.not_compared:
        out.print(f"not compared: {why}", highlight=False)
    out.print(
        f"{len(found.base)} base parameters of {found.parameters}; "
        f"condition number {found.base.condition:.0f}; "
        + ", ".join(f"{name} {t:.0f} microseconds a state" for name, t in found.microseconds.items()),
        highlight=False,
        soft_wrap=True,
    )
    for name, unit in zip(found.base.names, found.base.units, strict=True):
        out.print(f"  {name} [{unit}]", markup=False, highlight=False, soft_wrap=True)
    if found.base.unseen:
        out.print(f"not seen: {', '.join(found.base.unseen)}", markup=False, highlight=False, soft_wrap=True)
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
