"""``smsid identify`` for a welded arm."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from smsid.arm.identify import identify_arm
from smsid.arm.scales import torque_scales, with_torque_gains
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
    *,
    gains: bool = False,
    report: Path | None = None,
    inputs: Sequence[Path] = (),
    everything: bool = False,
) -> list[dict[str, Any]]:
    """Identify from the recording in the role estimation, judge by those in the role validation, and print.

    Returns for each recording how far its torques are predicted.

    With ``gains`` the gears' torque gains are found first, the described links taken as known. ``report``: an
    HTML to write as well, with the sums of the files ``inputs``.

    Raises:
        RecordingError: not exactly one recording to identify from, or as `identify_arm`.
        DescriptionError: as `identify_arm`.
        NotIdentifiableError: as `identify_arm`.
    """
    from smsid.cli.notes import told
    from smsid.cli.output import working
    from smsid.cli.tables import estimate_parts, plain_table

    train = [r for r in recordings if r.role != "validation"]
    if len(train) != 1:
        raise RecordingError(
            f"{len(train)} recordings to identify from were given for an arm.",
            advice="Give exactly one; those in the role validation are only judged by.",
            recordings=tuple(r.name for r in train),
        )
    if gains:
        scales = torque_scales(description, train[0], cutoff=cutoff)
        description = with_torque_gains(description, scales)
        for s in scales:
            spread = 1.959964 * s.sigma / s.value**2
            console.print(
                f"{s.joint}: {s.gain:.4g} +- {spread:.2g} N m per unit of signal, times the described gain"
            )
    with working("identifying the arm"):
        found = identify_arm(description, train[0], cutoff=cutoff)
        judged = [(r.name, r.role, found.judge(r)) for r in recordings]
    save_estimate(found.estimate, output)
    if report is not None:
        from smsid.report import provenance, write_report
        from smsid.report.arm import arm_report

        others = [r for r in recordings if r is not train[0]]
        write_report(arm_report(found, [train[0], *others], provenance(inputs)), report)
    for part in estimate_parts(found.estimate, everything=everything):
        console.print(part, highlight=False)
    table = plain_table(
        *("recording", "role", "all joints", *judged[0][2].by_joint),
        title="torques: |predicted - measured| / |measured|",
        left=("recording", "role"),
    )
    for name, role, errors in judged:
        table.add_row(name, role, f"{errors.relative:.4f}", *(f"{x:.3f}" for x in errors.by_joint.values()))
    console.print(table)
    for line in told(found.estimate.notes, everything=everything):
        console.print(line, markup=False, highlight=False)
    console.print(
        f"identified in {found.estimate.timing['total']:.1f} s; wrote {output}", markup=False, highlight=False
    )
    return [
        {"recording": name, "role": role, "relative": e.relative, "by_joint": dict(e.by_joint)}
        for name, role, e in judged
    ]
