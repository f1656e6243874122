"""Statistics of the accuracy benchmark over its runs, and the paper's figures to compare with."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from _accuracy_cases import IMUS
from _common import spread

Runs = dict[str, list[dict[str, Any]]]
Truths = dict[str, dict[str, Any]]

PAPER = {  # relative errors of Tables 2 and 3 [%]
    "exp1|total.mass": 0.04,
    "exp1|tank.mass": 0.6,
    **{f"exp1|tank.stiffness.{axis}": 0.78 for axis in "xyz"},
    "exp1|panel.linear_density": 2.266,
    "modes|panel.mode1.frequency": 0.114,
    "modes|panel.mode2.frequency": 0.354,
    "modes|panel.mode3.frequency": 0.245,
}
BEST, WORST = 0.01, 4.8  # [%] of Table 3
FREQUENCY_TARGET = 0.1  # [%]
PRINTED = {"r_cm": 1.1, "link2.mx + 2 link3.m": 2.6, "link3.mx": 2.6}  # [%] of Step A as printed, errata
STEP_A = {"r_cm": 0.1, "moments": 0.3}  # [%] targets, noise-free
GROUPS = ("exp1", "modes", "exp2.step_a", "exp2.step_b")


def statistics(records: Sequence[dict[str, Any]], key: str, true: dict[str, Any]) -> dict[str, Any] | None:
    """Return how one parameter comes out over the runs, errors in % of its reference; None if never found."""
    pairs = [r["values"][key] for r in records if key in r.get("values", {})]
    found = np.array([p for p in pairs if None not in p], dtype=float)
    if not len(found):
        return None
    error = 100.0 * (found[:, 0] - true["value"]) / true["reference"]
    sigma = 100.0 * found[:, 1] / true["reference"]
    several = len(error) > 1
    deviation = float(error.std(ddof=1)) if several else 0.0
    out = {
        "true": digits(true["value"], 7),
        "runs": len(error),
        "mean_abs_error": digits(np.abs(error).mean()),
        "median_abs_error": digits(np.median(np.abs(error))),
        "bias": digits(error.mean()),
        "spread": digits(deviation) if several else None,
        "predicted_sigma": digits(sigma.mean()),
        "spread_over_sigma": digits(deviation / sigma.mean(), 3) if several and sigma.mean() > 0 else None,
        "coverage_95": digits(np.mean(np.abs(error) <= 1.959964 * sigma), 3),
        "identifiable": digits(np.mean([key in r["identifiable"] for r in records if "values" in r]), 3),
    }
    if true["small"]:
        out["reference"] = digits(true["reference"])
    if key in PAPER:
        out["paper"] = PAPER[key]
    return out


def of_case(records: Sequence[dict[str, Any]], true: Truths) -> dict[str, Any]:
    """Return all parameters of one case, the small ones apart, and its failures."""
    tables: dict[str, dict[str, Any]] = {"parameters": {}, "small_parameters": {}}
    for key, one in true.items():
        row = statistics(records, key, one)
        if row is not None:
            tables["small_parameters" if one["small"] else "parameters"][key] = row
    good = [r for r in records if "values" in r]
    notes = Counter(note for r in good for note in {told(n) for n in r["notes"]})
    return {
        "runs": len(records),
        "failed": dict(
            Counter(
                re.sub(r"\d+ equations", "equations", r["failed"].split(",")[0])
                for r in records
                if "failed" in r
            )
        ),
        "notes": dict(notes),
        **tables,
        "step_a": {step: centre_error(good, true, step) for step in ("exp2.step_a", "exp2.step_a_printed")},
        "step_b": extremes(good, true, "exp2.step_b"),
        "step_b_printed": extremes(good, true, "exp2.step_b_printed"),
    }


def centre_error(records: Sequence[dict[str, Any]], true: Truths, step: str) -> dict[str, float] | None:
    """Return |error of r_cm| / |r_cm| [%]: mean over the runs, and that of the mean r_cm."""
    keys = _centres(step)
    centre = np.array([true[k]["value"] for k in keys])
    found = np.array([[r["values"][k][0] for k in keys] for r in records if keys[0] in r["values"]])
    if not len(found):
        return None
    size = np.linalg.norm(centre)
    return {
        "mean_error": digits(100 * np.linalg.norm(found - centre, axis=1).mean() / size),
        "error_of_mean": digits(100 * np.linalg.norm(found.mean(axis=0) - centre) / size),
    }


def _centres(step: str) -> list[str]:
    return [f"{step}|system_cm.{axis}" for axis in "xyz"]


def extremes(records: Sequence[dict[str, Any]], true: Truths, step: str) -> dict[str, Any] | None:
    """Return worst and best identifiable parameter that is not small, over the runs and in a single run."""
    keys = [k for k, one in true.items() if k.startswith(f"{step}|") and not one["small"]]
    rows = {k: statistics(records, k, true[k]) for k in keys}
    mean = {k: r["mean_abs_error"] for k, r in rows.items() if r is not None and r["identifiable"] > 0.5}
    if not mean:
        return None
    per_run = []
    for record in records:
        errors = [
            100 * abs(record["values"][k][0] - true[k]["value"]) / true[k]["reference"]
            for k in keys
            if k in record["identifiable"]
        ]
        if errors:
            per_run.append((min(errors), max(errors)))
    low, high = np.array(per_run).mean(axis=0)
    worst, best = max(mean, key=mean.__getitem__), min(mean, key=mean.__getitem__)
    return {
        "identifiable_parameters": len(mean),
        "worst": {"name": worst.split("|")[1], "mean_abs_error": mean[worst]},
        "best": {"name": best.split("|")[1], "mean_abs_error": mean[best]},
        "mean_abs_error_of_all": digits(np.mean(list(mean.values()))),
        "single_run_worst": digits(high),
        "single_run_best": digits(low),
    }


def targets(cases: dict[str, Any], free: dict[str, Any]) -> list[dict[str, Any]]:
    """Return every target with our figure and whether it is met."""
    rows = cases["reference"]["parameters"]
    a, b = free["step_a"], cases["reference"]["step_b"]
    out: list[dict[str, Any]] = []

    def add(name: str, target: float, ours: float, how: str) -> None:
        met = bool(ours <= target)
        out.append({"name": name, "target": target, "ours": digits(ours), "met": met, "how": how})

    mean = "mean absolute error over the seeds"
    add("M", 0.04, rows["exp1|total.mass"]["mean_abs_error"], f"{mean}, axes combined by variance")
    add("m_s", 0.6, rows["exp1|tank.mass"]["mean_abs_error"], f"{mean}, axes combined by variance")
    k = [rows[f"exp1|tank.stiffness.{axis}"]["mean_abs_error"] for axis in "xyz"]
    add("k_s, mean of the axes", 0.78, float(np.mean(k)), mean)
    for axis, value in zip("xyz", k, strict=True):
        add(f"k_s, {axis}", 0.78, value, mean)
    add("rho", 2.3, rows["exp1|panel.linear_density"]["mean_abs_error"], mean)
    for i in (1, 2, 3):
        row = rows[f"modes|panel.mode{i}.frequency"]
        add(f"clamped frequency {i}", FREQUENCY_TARGET, row["mean_abs_error"], mean)
    add("Step B, worst", WORST, b["worst"]["mean_abs_error"], f"{b['worst']['name']}: {mean}")
    add("Step B, worst of one run", WORST, b["single_run_worst"], "worst of each run, mean over the runs")
    add("Step B, best of one run", BEST, b["single_run_best"], "best of each run, mean over the runs")
    add("Step B, best", BEST, b["best"]["mean_abs_error"], f"{b['best']['name']}: {mean}")
    add(
        "Step A, r_cm, noise-free",
        STEP_A["r_cm"],
        a["exp2.step_a"]["mean_error"],
        "of its length from the base CM",
    )
    for name in ("link2.mx + 2 link3.m", "link3.mx"):
        value = free["parameters"][f"exp2.step_a|{name}"]["mean_abs_error"]
        add(f"Step A, {name}, noise-free", STEP_A["moments"], value, "with the slosh rate")
    return out


def independence(runs: Runs) -> dict[str, Any]:
    """Return how far wrong starting guesses move the result, in predicted standard deviations, by group."""
    right = {r["seed"]: r for r in runs["reference"] if "values" in r}
    out: dict[str, Any] = {}
    for group in GROUPS:
        moves = []
        for wrong in runs["guesses off by 30 %"]:
            if "values" not in wrong or wrong["seed"] not in right:
                continue
            base = right[wrong["seed"]]["values"]
            for key, (value, _) in wrong["values"].items():
                if key.startswith(f"{group}|") and key in base and None not in (value, *base[key]):
                    moves.append(abs(value - base[key][0]) / max(base[key][1], 1e-300))
        if moves:
            out[group] = {"largest": digits(max(moves)), "median": digits(np.median(moves))}
    return out


def calibration(case: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters whose spread over predicted sigma is outside 0.7 to 1.4."""
    rows = {**case["parameters"], **case["small_parameters"]}
    ratio = {k: r["spread_over_sigma"] for k, r in rows.items() if r["spread_over_sigma"] is not None}
    ratio = {k: v for k, v in ratio.items() if "printed" not in k and not k.startswith("axis")}
    inside = [0.7 <= v <= 1.4 for v in ratio.values()]
    return {
        "band": [0.7, 1.4],
        "parameters": len(ratio),
        "inside": int(sum(inside)),
        "outside": {k: v for (k, v), ok in zip(ratio.items(), inside, strict=True) if not ok},
    }


def inherited(records: Sequence[dict[str, Any]], true: Truths) -> dict[str, float]:
    """Return the correlation of Step B's errors with errors of Exp. 1, root mean square over Step B.

    Over parameters that are not small; with no relation, n runs give 1 / sqrt(n).
    """
    good = [r for r in records if "values" in r]

    def errors(key: str) -> np.ndarray:
        return np.array([r["values"][key][0] - true[key]["value"] for r in good])

    keys = [k for k, one in true.items() if k.startswith("exp2.step_b|") and not one["small"]]
    sources = [k for k in true if k.startswith("exp1|")]
    out = {}
    for source in sources:
        related = [np.corrcoef(errors(source), errors(k))[0, 1] for k in keys]
        out[source] = digits(np.sqrt(np.mean(np.square(related))), 2)
    return dict(sorted(out.items(), key=lambda pair: -pair[1]))


def timing(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return seconds by step, median and quartiles."""
    good = [r["timing"] for r in records if "timing" in r]
    seconds = {step: np.array([t[step] for t in good if step in t]) for step in good[0]}
    return {step: {**spread(s), "fastest": digits(s.min())} for step, s in seconds.items()}


def summary(
    runs: Runs, true: Truths, timed: Sequence[dict[str, Any]], load: Sequence[float]
) -> dict[str, Any]:
    """Return everything that is reported; ``timed`` are runs one after the other, under ``load``."""
    centres = _centres("exp2.step_a_printed")
    short = {k: one for k, one in true.items() if "_printed" not in k or k in centres}
    full = ("noise-free", "reference", "reference, Exp. 2 alone")
    cases = {name: of_case(records, true if name in full else short) for name, records in runs.items()}
    return {
        "errors_in": "% of the parameter; small ones in % of the largest of their kind on the same body",
        "imu_presets": list(IMUS),
        "targets": targets(cases, cases["noise-free"]),
        "seconds": {"paper": 7.0, "data_s": 200.0, "load": load, "ours": timing(timed)},
        "calibration": calibration(cases["reference"]),
        "calibration_with_exp1_exact": calibration(cases["reference, Exp. 2 alone"]),
        "step_b_errors_correlate_with": inherited(runs["reference"], true),
        "wrong_guesses_move_in_sigma": independence(runs),
        "cases": cases,
    }


def told(note: str) -> str:
    """Return a note without its numbers, so that runs that say the same count together."""
    note = re.split(r"(?<!Exp)\. ", note)[0].split(" comes out as ")
    return note[0] if len(note) == 1 else f"{note[0]} is not physical"


def digits(x: float, count: int = 4) -> float:
    """Round to significant digits."""
    return float(f"{float(x):.{count}g}")
