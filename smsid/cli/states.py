"""``smsid identify --states``: hidden states of the flights, smoothed, as a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.places import Writes
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from smsid.estimation.identify_flights import FlightEstimate

StatesPath = Annotated[
    Path | None,
    typer.Option(
        "--states",
        help="recording to write as well of what no sensor saw: slosh, modes and biases with standard "
        "deviations; identifies by the filter (--method filter)",
    ),
    Writes((".nc",)),
]


def check_states(method: str, root: str) -> str:
    """Return the method that estimates hidden states instead of one; raise `SmsidError` if there is none."""
    if root == "fixed" or method == "paper":
        raise SmsidError(
            "--states is for spacecraft identified by the filter.",
            advice="Leave it out, or use --method filter.",
        )
    return "filter"


def write_states(found: FlightEstimate, path: Path) -> None:
    """Write the smoothed hidden states of flights as a recording."""
    from smsid.cli.output import working
    from smsid.estimation.hidden_states import hidden_states
    from smsid.recording import save_recording

    with working("smoothing hidden states"):
        states = hidden_states(found)
    save_recording(states, path)
