"""``smsid lab``: tests in the laboratory, and public data sets as recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.lab_modal import modal
from smsid.cli.lab_oscillator import oscillator
from smsid.cli.lab_tank import tank
from smsid.cli.output import working
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from smsid.description import Description
    from smsid.recording import Recording


def fetch(
    name: Annotated[str, typer.Argument(help="staubli_tx40, silverbox, antisloshing or cessipy_slab")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="folder for recordings and description"),
        Writes(folder=True),
    ],
) -> Outcome:
    """Write a public data set as recordings (and descriptions): from SMSID_DATA, else downloaded."""
    from smsid.description import Description, save_description
    from smsid.recording import save_recording

    with working(f"fetching {name}"):
        parts = _parts(name)
    output.mkdir(parents=True, exist_ok=True)
    for file, part in parts.items():
        if isinstance(part, Description):
            save_description(part, output / file)
        else:
            save_recording(part, output / file)
    return Outcome({"data_set": name}, [output / file for file in parts])


def _parts(name: str) -> dict[str, Description | Recording]:
    """A data set's descriptions and recordings by file name, cut where the benchmarks cut."""
    from smsid import datasets
    from smsid.arm import with_joint_effects
    from smsid.effects import MotorCoupling

    datasets.data_set(name)
    if name == "silverbox":
        train, held = datasets.silverbox()
        return {"silverbox.nc": train, "silverbox_validation.nc": held}
    if name == "cessipy_slab":
        return {"cessipy_slab.nc": datasets.cessipy_slab()}
    if name == "antisloshing":
        carrier, log = datasets.antisloshing()
        return {"antisloshing.toml": carrier, "antisloshing.nc": log}
    bare, log = datasets.tx40()
    times = log.time()
    kinds = ("joint_friction", "motor_inertia", "torque_offset")
    full = with_joint_effects(bare, log.labels["joint"], *kinds).with_effects(
        MotorCoupling(name="wrist", joints=("joint_5", "joint_6"))
    )
    return {
        "tx40_rigid.toml": bare,
        "tx40.toml": full,
        "tx40.nc": log.window(0.0, float(times[times < 6.0][-1])).with_role("estimation"),
        "tx40_validation.nc": log.window(6.0, float(times[-1])).with_role("validation"),
    }


lab_app = typer.Typer(
    name="lab",
    help="Tests in the laboratory: a tank that is moved, a structure that vibrates, a driven oscillator.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for _command in (fetch, tank, modal, oscillator):
    lab_app.command()(_command)
