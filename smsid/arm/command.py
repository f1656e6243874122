"""``smsid identify`` for a welded arm."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from smsid.arm.identify import identify_arm
from smsid.description import Description
from smsid.errors import RecordingError
from smsid.identify.estimate import save_estimate
from smsid.recording import Recording


def identify_and_judge(
    description: Description,
    recordings: Sequence[Recording],
    output: Path,
    cutoff: float | None,
    console: Console,
) -> None:
    """Identify from the recording in the role estimation, judge by those in the role validation, and print.

    Raises:
        RecordingError: not exactly one recording for estimation, or as `identify_arm`.
        DescriptionError: as `identify_arm`.
        NotIdentifiableError: as `identify_arm`.
    """
    from smsid.cli.tables import estimate_table

    train = [r for r in recordings if r.role == "estimation"]
    if len(train) != 1:
        raise RecordingError(
            f"{len(train)} recordings in the role estimation were given for an arm.",
            advice="Give exactly one; more in the role validation are judged by.",
            recordings=tuple(r.name for r in train),
        )
    found = identify_arm(description, train[0], cutoff=cutoff)
    judged = [(r.name, r.role, found.judge(r)) for r in recordings]
    save_estimate(found.estimate, output)
    for table in estimate_table(found.estimate):
        console.print(table)
    table = Table(title="torques: |predicted - measured| / |measured|", title_justify="left")
    for name in ("recording", "role", "all joints", *judged[0][2].by_joint):
        table.add_column(name, justify="left" if name in ("recording", "role") else "right")
    for name, role, errors in judged:
        table.add_row(name, role, f"{errors.relative:.4f}", *(f"{x:.3f}" for x in errors.by_joint.values()))
    console.print(table)
    for note in found.estimate.notes:
        console.print(f"note: {note}", markup=False, highlight=False)
    console.print(f"{found.estimate.timing['total']:.2f} s; wrote {output}", markup=False, highlight=False)
