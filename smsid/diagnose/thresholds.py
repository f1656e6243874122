"""Every threshold that a verdict rests on: value, unit, reason, and what calibrated it.

Modules take their numbers from `THRESHOLDS`; the table in docs/diagnosis_steps.md is written from it. Grids,
steps and limits of effort, which decide how long a search takes, stay where they are used.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from smsid._files import atomic_write

BEGIN, END = "<!-- thresholds: begin -->", "<!-- thresholds: end -->"
STUDIES = "checked by thirteen studies of hidden effects"
CHOSEN = "not calibrated: chosen"


def _row(value: Any, unit: str, reason: str, calibrated: str = CHOSEN) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason, "calibrated": calibrated})


@dataclass(frozen=True)
class Thresholds:
    """Thresholds by name; unit, reason and calibration are in the fields' metadata."""

    candidate: float = _row(0.003, "chance", "of a false first cause, over all candidates tried", STUDIES)
    further: float = _row(
        0.0003,
        "chance",
        "the same of a cause beside another or a fault: two things wrong take more evidence than one",
        STUDIES,
    )
    block: float = _row(
        0.0003, "chance", "of a generic test, over all of them, below which something is left", STUDIES
    )
    alias: float = _row(
        6.6,
        "doubled log odds",
        "within which two candidates are not told apart: what is there is beaten by more in 0.5 % of cases",
        STUDIES,
    )
    onset: float = _row(
        9.2,
        "doubled log odds",
        "that a beginning midway has to gain beyond its search: a hundred times as likely",
        STUDIES,
    )
    linear: float = _row(
        400.0,
        "likelihood ratio",
        "up to which a linear score is believed without a refit of the contenders",
        STUDIES,
    )
    beside: float = _row(
        0.001,
        "share of the ratio",
        "of the strongest cause, below which what is left may be its errors of integration",
        STUDIES,
    )
    near: float = _row(0.5, "correlation", "least one of two candidates that are taken for each other")
    beyond: float = _row(
        0.001,
        "chance",
        "of how far a rival explains more than what is there, by which the latter is rejected",
        "chi-squared",
    )
    nested: float = _row(
        0.05,
        "chance",
        "at which further parameters of a sibling are taken to explain something",
        "chi-squared",
    )
    contained: float = _row(0.99, "correlation", "above which a candidate of more parameters can do the same")
    contained_better: float = _row(0.9, "correlation", "the same where it explains more")
    left_out: float = _row(0.05, "chance", "of all aliases that are left out together")
    surplus: float = _row(
        3.0, "1", "times its linear score that a refitted candidate may gain without a second look"
    )
    excited: float = _row(
        1e-12,
        "share of information",
        "that rounding may leave of a column beside the fitted parameters",
        "float64",
    )
    beginning_apart: float = _row(
        25.0,
        "likelihood ratio",
        "against the best time, above which an effect did not begin then: 5 standard deviations",
        "chi-squared",
    )
    beginning_strong: float = _row(400.0, "likelihood ratio", "above which a beginning shows to the sample")
    beginning_poor: float = _row(
        10.0, "standard deviations", "of a sum of squares, above which a fit with a beginning is poor"
    )
    beginning_moved: float = _row(
        4.0, "likelihood ratio", "that a move of a beginning has to gain, to first order"
    )
    beginnings_sought: float = _row(
        60.0, "likelihood ratio", "above which beginnings are sought for all contenders"
    )
    coarse_close: float = _row(
        0.9, "share of the gain", "of the best strong cause, below which another is not fitted"
    )
    strays: float = _row(
        30.0, "times the noise", "that a first fit leaves, above which strong causes are tried first"
    )
    lost: float = _row(
        1.0,
        "share of the motion",
        "that the fitted nominal model may leave before no cause is looked for",
        "no motion predicts as well",
    )
    misfit: float = _row(
        10.0, "times the noise", "over all channels, above which what the model cannot follow is counted"
    )
    followed: float = _row(2.0, "times the noise", "below which the model is taken to follow again")
    slow: float = _row(
        1.2,
        "ratio of variances",
        "of prediction errors over that of their differences, above which they are not noise alone",
    )
    mostly: float = _row(
        0.9, "share of the excess", "that causes have to take away where the model never follows"
    )
    own_channel: float = _row(
        3.0, "times the noise", "left on a cause's own channel, above which the cause does not explain it"
    )
    sensor_reads: float = _row(0.1, "1", "of what it should read, below which a sensor would read nothing")
    body_left: float = _row(0.01, "share of its mass", "that has to be left of a body")
    power: float = _row(
        0.95, "chance", "with which an effect of the strength in `limits` is found", "the convention"
    )
    in_turn: float = _row(
        1.0, "s", "between the beginnings of causes of one family, above which they are pieces of a drift"
    )
    curved: float = _row(1.5, "1", "times what its slopes promise that a fit may gain")
    steps_seen: float = _row(
        4.0, "squares", "of errors of integration in the innovations, above which steps are halved"
    )
    vertical_seen: float = _row(
        400.0, "likelihood ratio", "from which a recording tells which way the vertical turns"
    )
    shortest: int = _row(100, "samples", "below which nothing is said")
    loud: float = _row(5.0, "times the noise", "above which a channel is doubted")
    foreign: float = _row(
        0.5, "share of the motion", "left open loop, above which a recording is not this spacecraft's"
    )
    moves: float = _row(20.0, "times the noise", "that a channel has to move to be asked")
    stuck_run: int = _row(12, "samples", "alike in a row that noise does not give", "rounding of a Gaussian")
    repeats: int = _row(
        4, "samples", "the same where no other sample repeats the one before", "a chance of 1e-8"
    )
    fine: float = _row(30.0, "steps of rounding", "that the noise has to be for that", "a chance of 1e-8")
    outlier: float = _row(6.0, "standard deviations", "of a prediction error", "Gauss")
    outlier_alone: float = _row(
        7.0, "standard deviations", "the same of fewer than three", "one in ten million recordings"
    )
    outlier_calm: float = _row(3.0, "standard deviations", "that the readings before and after stay below")
    outlier_elsewhere: float = _row(
        4.0, "standard deviations", "that the other channels stay below at that sample"
    )
    outlier_wide: float = _row(3.0, "times the noise", "least size of the wide distribution of outliers")
    at_rest: float = _row(
        2.0,
        "rms",
        "of normalised errors up to which what repeats itself is at rest; rounding has 1.73",
        "rounding",
    )
    torque_candidate: float = _row(0.003, "chance", "measured torques: as `candidate`")
    torque_block: float = _row(0.001, "chance", "measured torques: as `block`")
    torque_alias: float = _row(9.2, "doubled log odds", "measured torques: as `alias`")
    torque_excited: float = _row(1e-4, "share of information", "measured torques: as `excited`")
    torque_foreign: float = _row(0.7, "share of the torque", "measured torques: as `foreign`")
    torque_shortest: int = _row(100, "instants", "measured torques: as `shortest`")
    stamps: float = _row(
        0.05, "sampling intervals", "below which no delay is claimed: stamps and samplers are not that exact"
    )


THRESHOLDS = Thresholds()


def thresholds_reference() -> str:
    """Return Markdown with a row per threshold."""
    lines = ["| threshold | value | unit | reason | calibrated by |", "|---|---|---|---|---|"]
    for f in fields(Thresholds):
        m = f.metadata
        lines.append(f"| `{f.name}` | {f.default:g} | {m['unit']} | {m['reason']} | {m['calibrated']} |")
    return "\n".join(lines) + "\n"


def write_thresholds(path: str | os.PathLike[str]) -> None:
    """Put the table between its two marks in a Markdown file."""
    text = Path(path).read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    atomic_write(path, f"{before}{BEGIN}\n{thresholds_reference()}{END}{after}")
