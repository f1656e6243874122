"""``smsid export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def export_command(
    description: Annotated[Path, typer.Argument(help="description of the spacecraft or arm: a TOML")],
    output: Annotated[Path, typer.Option("--output", "-o", help="folder to make, whole or not at all")],
    estimate: Annotated[
        Path | None, typer.Argument(help="estimate of it (JSON of `smsid identify`); without: as described")
    ] = None,
    mujoco: Annotated[
        bool, typer.Option("--mujoco/--no-mujoco", help="write the MuJoCo XML of the whole spacecraft")
    ] = True,
) -> None:
    """Export for other programs: identified URDF, TOML, parameters as CSV, MuJoCo XML."""
    from rich.console import Console

    from smsid.description import load_description
    from smsid.export.folder import export_folder
    from smsid.identify.estimate import load_estimate

    console = Console()
    found = export_folder(
        load_description(description),
        output,
        None if estimate is None else load_estimate(estimate),
        mujoco=mujoco,
    )
    if found.bodies is not None:
        console.print(
            f"bodies agree with {found.bodies.combinations} identified combinations to "
            f"{found.bodies.misfit:.2f} standard deviations (root mean square)",
            soft_wrap=True,
        )
    for note in dict.fromkeys(found.notes):
        console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
    console.print(
        f"wrote {', '.join(found.files)} to {output}", markup=False, highlight=False, soft_wrap=True
    )
