"""``smsid lab``: tests in the laboratory from the command line."""

from __future__ import annotations

import typer

from smsid.cli.lab_fetch import fetch
from smsid.cli.lab_modal import modal
from smsid.cli.lab_oscillator import oscillator
from smsid.cli.lab_tank import tank

lab_app = typer.Typer(
    name="lab",
    help="Tests in the laboratory: a tank that is moved, a structure that vibrates, a driven oscillator.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for _command in (fetch, tank, modal, oscillator):
    lab_app.command()(_command)
