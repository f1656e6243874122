"""``smsid export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.output import say, show_spinner
from smsid.cli.places import Writes
from smsid.errors import OutputError

if TYPE_CHECKING:
    from smsid.description import Description
    from smsid.identify.estimate import Estimate


def export_command(
    description: Annotated[
        Path,
        typer.Argument(
            help="description of the spacecraft or arm: a TOML; of an arm identified without one its URDF"
        ),
    ],
    estimate: Annotated[
        Path | None, typer.Argument(help="estimate of it (JSON of `smsid identify`); without: as described")
    ] = None,
    mujoco: Annotated[
        bool, typer.Option("--mujoco/--no-mujoco", help="write the MuJoCo XML of the whole spacecraft")
    ] = True,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="folder to make, whole or not at all"),
        Writes(folder=True),
    ] = None,
    linear: Annotated[
        Path | None,
        typer.Option(help="linear plant about home, named inputs and outputs, uncertainty: .json or .mat"),
        Writes((".json", ".mat")),
    ] = None,
    fmu: Annotated[
        Path | None, typer.Option(help="FMI 3.0 unit for co-simulation"), Writes((".fmu",))
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of the draws for the plant's uncertainty")] = 0,
) -> CommandResult:
    """Export for other programs: URDF, TOML, CSV and MuJoCo XML; a linear plant; an FMU."""
    from smsid.description import load_description
    from smsid.identify.estimate import load_estimate

    if output is None and linear is None and fmu is None:
        raise OutputError("Nothing is to be written.", advice="State --output, --linear or --fmu.")
    known = None if estimate is None else load_estimate(estimate)
    if known is not None and description.suffix == ".urdf" and known.method.endswith("least squares"):
        described = _bare_arm(description, known)
    else:
        described = load_description(description)
    document: dict[str, Any] = {"notes": []}
    written: list[Path] = []
    if linear is not None:
        written.append(_write_linear(described, known, linear, seed, document))
    if fmu is not None:
        from smsid.export.fmu import write_fmu

        with show_spinner("building the FMU"):
            written.append(write_fmu(described, fmu, known))
    if output is not None:
        written += _write_folder(described, known, output, mujoco, document)
    return CommandResult(document, written)


def _bare_arm(urdf: Path, known: Estimate) -> Description:
    """Return an arm as it was identified without a TOML, with the effects that the estimate knows."""
    from smsid.arm.identify import rigid_arm
    from smsid.arm.presets import with_identified_effects
    from smsid.arm.setup import arm_description

    bare = arm_description(urdf)
    return with_identified_effects(bare, rigid_arm(bare).arm_joints.names, {p.name for p in known.parameters})


def _write_linear(
    described: Description, known: Estimate | None, path: Path, seed: int, document: dict[str, Any]
) -> Path:
    import numpy as np

    from smsid.export.linear_plant import linear_plant, save_linear_plant

    with show_spinner("linearising"):
        plant = linear_plant(described, known, rng=np.random.default_rng(seed))
        save_linear_plant(plant, path)
    document["notes"] += plant.notes
    say(f"linear plant: {len(plant.states)} states, inputs {', '.join(plant.inputs)}")
    if plant.a_sigma is not None:
        say(f"its uncertainty is that of {len(plant.draws)} draws of the estimate")
    for note in plant.notes:
        say(f"note: {note}")
    return path


def _write_folder(
    described: Description, known: Estimate | None, output: Path, mujoco: bool, document: dict[str, Any]
) -> list[Path]:
    from smsid.export.folder import export_folder

    with show_spinner("exporting"):
        found = export_folder(described, output, known, mujoco=mujoco)
    document["notes"] += found.notes
    if found.bodies is not None and found.bodies.combinations:
        document |= {"combinations": len(found.bodies.combinations), "misfit": found.bodies.misfit}
        say(
            f"bodies agree with {len(found.bodies.combinations)} identified combinations to "
            f"{found.bodies.misfit:.2f} standard deviations (root mean square)"
        )
    for note in dict.fromkeys(found.notes):
        say(f"note: {note}")
    return [output / name for name in found.files]
