"""``smsid export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from smsid.cli.manners import Outcome
from smsid.cli.output import console, working
from smsid.cli.places import Writes


def export_command(
    description: Annotated[Path, typer.Argument(help="description of the spacecraft or arm: a TOML")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="folder to make, whole or not at all"), Writes(folder=True)
    ],
    estimate: Annotated[
        Path | None, typer.Argument(help="estimate of it (JSON of `smsid identify`); without: as described")
    ] = None,
    mujoco: Annotated[
        bool, typer.Option("--mujoco/--no-mujoco", help="write the MuJoCo XML of the whole spacecraft")
    ] = True,
) -> Outcome:
    """Export for other programs: identified URDF, TOML, parameters as CSV, MuJoCo XML."""
    from smsid.description import load_description
    from smsid.export.folder import export_folder
    from smsid.identify.estimate import load_estimate

    described = load_description(description)
    known = None if estimate is None else load_estimate(estimate)
    with working("exporting"):
        found = export_folder(described, output, known, mujoco=mujoco)
    out = console()
    document: dict[str, Any] = {"notes": list(found.notes)}
    if found.bodies is not None:
        document |= {"combinations": found.bodies.combinations, "misfit": found.bodies.misfit}
        out.print(
            f"bodies agree with {found.bodies.combinations} identified combinations to "
            f"{found.bodies.misfit:.2f} standard deviations (root mean square)",
            soft_wrap=True,
        )
    for note in dict.fromkeys(found.notes):
        out.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
    out.print(f"wrote {', '.join(found.files)} to {output}", markup=False, highlight=False, soft_wrap=True)
    return Outcome(document, [output / name for name in found.files])
