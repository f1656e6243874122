"""Every threshold that a verdict rests on: value, unit, reason, and what calibrated it.

Modules take their numbers from `THRESHOLDS`; the table in docs/diagnosis_steps.md is written from it. Grids,
steps and limits of effort, which decide how long a search takes, stay where they are used.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from scipy.stats import norm

from smsid._files import atomic_write
from smsid.estimation.map_estimate import COSINES

BEGIN, END = "<!-- thresholds: begin -->", "<!-- thresholds: end -->"
STUDIES = "checked by studies of hidden effects"
CHOSEN, CHI2 = "not calibrated: chosen", "chi-squared"
ODDS, RATIO, SIGMAS = "doubled log odds", "likelihood ratio", "standard deviations"
NOISE, SHARE, MOTION = "times the noise", "share of information", "of the motion"


def _row(value: Any, unit: str, reason: str, calibrated: str = CHOSEN) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason, "calibrated": calibrated})


@dataclass(frozen=True)
class DetectionThresholds:
    """Thresholds by name, and where a search ends; unit, reason and calibration are in the metadata."""

    candidate: float = _row(0.003, "chance", "of a false first cause, over all candidates tried", STUDIES)
    further: float = _row(3e-4, "chance", "the same of a cause beside another or a fault", STUDIES)
    block: float = _row(3e-4, "chance", "of a generic test, over all, below which something is left", STUDIES)
    alias: float = _row(6.6, ODDS, "within which two candidates are not told apart: 0.5 % of cases", STUDIES)
    onset: float = _row(9.2, ODDS, "that a beginning midway gains beyond its search: 100 to 1", STUDIES)
    linear: float = _row(400.0, RATIO, "up to which a linear score is believed without a refit", STUDIES)
    beside: float = _row(
        1e-3, "of the ratio", "of the strongest cause, in one noise: less may be its law", STUDIES
    )
    near: float = _row(0.5, "correlation", "least one of two candidates that are taken for each other")
    beyond: float = _row(1e-3, "chance", "of what a rival explains more, by which it is rejected", CHI2)
    nested: float = _row(0.05, "chance", "at which further parameters or a proven cause count", CHI2)
    contained: float = _row(0.99, "correlation", "above which a candidate of more parameters can do the same")
    contained_better: float = _row(0.9, "correlation", "the same where it explains more")
    left_out: float = _row(0.05, "chance", "of all aliases that are left out together")
    aliases: int = _row(2, "1", "aliases that are named whatever their chances are")
    adds_sure: float = _row(2.0, SIGMAS, "added to what a sibling has beside a weak cause's parameters")
    adds_much: float = _row(0.5, "of the cause", "that this may not reach for the sibling to be rejected")
    tested: float = _row(1e-6, SHARE, "that has to be left of a generic test's column beside what is fitted")
    surplus: float = _row(3.0, "1", "times its linear score that a refit may gain without a second look")
    excited: float = _row(1e-12, SHARE, "that rounding leaves of a column beside what is fitted", "float64")
    beginning_apart: float = _row(25.0, RATIO, "against the best time: 5 standard deviations off", CHI2)
    beginning_moved: float = _row(4.0, RATIO, "that a move of a beginning has to gain, to first order")
    beginnings_sought: float = _row(60.0, RATIO, "above which beginnings are sought for all contenders")
    close: float = _row(
        0.9, "of the best", "in worth, below which a strong candidate is not refitted beside it"
    )
    strays: float = _row(
        30.0, NOISE, "that a first fit leaves, or sigmas its parameters are off: strong causes come first"
    )
    lost: float = _row(1.0, MOTION, "that the nominal fit leaves: no motion predicts it too", "definition")
    misfit: float = _row(10.0, NOISE, "over all channels, above which what is not followed is counted")
    followed: float = _row(2.0, NOISE, "below which the model is taken to follow again")
    noise_left: float = _row(1.1, NOISE, "up to which a model leaves nothing but noise")
    far_start: float = _row(
        4.0, SIGMAS, "of 0.3 m, beyond which a start in motion is believed before a search", "one recording"
    )
    alone: float = _row(0.5, "of the squares", "of errors, that go with a channel that strays by itself")
    hopeful: float = _row(
        0.5, "of the squares", "a candidate takes, in stated noise: does the rest follow with it?"
    )
    closer: float = _row(
        0.5, "of the noise left", "two steps before, to which a fit comes that goes on to the noise"
    )
    noise_told: int = _row(50, "samples", "below which a component says nothing of its noise")
    spectrum: int = _row(8, "segments", "of the spectrum that misfit is read from", "simulated errors")
    peeled: int = _row(3, "1", "equations and channels at most that are taken as unknown")
    several: int = _row(2, "1", "causes beside which, before one more, one unknown torque is asked", STUDIES)
    hidden: float = _row(30.0, "variance", "of an input's noise that hides it, over what one sample tells")
    slow: float = _row(1.2, "1", "variance of prediction errors over their differences': more is no noise")
    mostly: float = _row(0.9, "of the excess", "that causes take away where the model never follows")
    own_channel: float = _row(3.0, NOISE, "left on what a cause changes most: more is not explained")
    sensor_reads: float = _row(0.1, "1", "of what it should read, below which a sensor would read nothing")
    body_left: float = _row(0.01, "of its mass", "that has to be left of a body")
    power: float = _row(0.95, "chance", "with which an effect as strong as its limit is found", "convention")
    in_turn: float = _row(1.0, "s", "between beginnings of one family: pieces of a drift")
    curved: float = _row(1.5, "1", "times what its slopes promise that a fit may gain")
    shape_share: float = _row(
        0.05, "of the variance", "by errors of a shape left open, above which a channel need not be white"
    )
    steps_seen: float = _row(4.0, "squares", "of errors of integration in the innovations: steps are halved")
    vertical_seen: float = _row(400.0, RATIO, "from which a recording tells which way the vertical turns")
    shortest: int = _row(100, "samples", "below which nothing is said")
    loud: float = _row(5.0, NOISE, "above which a channel is doubted")
    foreign: float = _row(0.5, MOTION, "left open loop, above which a recording is not this spacecraft's")
    moves: float = _row(20.0, NOISE, "that a channel has to move to be asked")
    stuck_run: int = _row(12, "samples", "alike in a row that noise does not give", "rounding of a Gaussian")
    repeats: int = _row(4, "samples", "the same where no other sample repeats the one before", "chance 1e-8")
    fine: float = _row(30.0, "steps of rounding", "that the noise has to be for that", "chance 1e-8")
    coarse_step: float = _row(0.3, NOISE, "stated, below which steps of a channel are no rounding")
    on_grid: float = _row(0.95, "of the readings", "that lie on a grid of rounding: others may be outliers")
    off_grid: float = _row(
        2.0, "steps", "within which the lengths of rounded unit quaternions are", "rounding"
    )
    grid_told: int = _row(8, "readings", "of attitude that have to tell a step of rounding")
    outlier: float = _row(6.0, SIGMAS, "of a prediction error", "Gauss")
    outlier_alone: float = _row(
        7.0, SIGMAS, "the same of fewer than `outlier_few`", "one in ten million recordings"
    )
    outlier_few: int = _row(3, "1", "outliers of a component, below which each stands out by itself")
    outlier_calm: float = _row(3.0, SIGMAS, "that the readings before and after stay below")
    outlier_elsewhere: float = _row(4.0, SIGMAS, "that the other channels stay below at that sample")
    outlier_wide: float = _row(3.0, NOISE, "least size of the wide distribution of outliers")
    at_rest: float = _row(2.0, "rms", "of normalised errors of what rests; rounding has 1.73", "rounding")
    torque_block: float = _row(1e-3, "chance", "measured torques: as `block`")
    torque_alias: float = _row(9.2, ODDS, "measured torques: as `alias`")
    torque_excited: float = _row(1e-4, SHARE, "measured torques: as `excited`")
    torque_foreign: float = _row(0.7, "of the torque", "measured torques: as `foreign`")
    torque_shortest: int = _row(60, "instants", "measured torques: as `shortest`")
    torque_causes: int = _row(6, "1", "measured torques: most causes of a joint")
    torque_alike: float = _row(
        0.5, "1", "measured torques: of what a coupling's joints say, that each says at least"
    )
    torque_stretches: int = _row(40, "1", "of time, whose errors are taken for independent")
    same: float = _row(0.9999, "correlation", "above which candidates of one kind are one error, tried once")
    cosines: int = _row(COSINES, "1", "slowest, that errors beside misfit are judged by", "simulated errors")
    poorly_known: float = _row(0.02, "of the value", "standard deviation above which a profile is followed")
    more_likely: float = _row(0.3, "log-posterior", "above which a point of a profile is a better maximum")
    restarts: int = _row(3, "1", "times at most that one is met, before no end of an interval is claimed")
    stamps: float = _row(0.05, "intervals", "below which no delay is claimed: stamps are not that exact")
    causes: int = _row(
        3, "1", "most causes that are looked for; those of one panel or tank count once, but are no more"
    )
    contenders: int = _row(3, "1", "most candidates that are refitted in a round")

    @property
    def beside_a_cause(self) -> DetectionThresholds:
        """The levels for what stands beside a cause or a fault that is known: two take more evidence."""
        return replace(self, candidate=min(self.candidate, self.further))

    def detectable(self, tried: int) -> float:
        """Return how many standard deviations an effect has to have to be found with the stated power, among
        so many candidates.
        """
        return float(norm.isf(self.candidate / max(tried, 1) / 2.0) + norm.isf(1.0 - self.power))


THRESHOLDS = DetectionThresholds()


def thresholds_reference() -> str:
    """Return Markdown with a row per threshold."""
    lines = ["| threshold | value | unit | reason | calibrated by |", "|---|---|---|---|---|"]
    for f in fields(DetectionThresholds):
        m = f.metadata
        lines.append(f"| `{f.name}` | {f.default:g} | {m['unit']} | {m['reason']} | {m['calibrated']} |")
    return "\n".join(lines) + "\n"


def write_thresholds(path: str | os.PathLike[str]) -> None:
    """Put the table between its two marks in a Markdown file."""
    text = Path(path).read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    atomic_write(path, f"{before}{BEGIN}\n{thresholds_reference()}{END}{after}")
