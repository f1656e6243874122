"""Rates of the study of hidden effects with exact intervals, the confusion matrix, and both as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import beta

from tests.hidden.ceiling import chance

Row = Mapping[str, Any]
BANDS = ((0.0, 2.0, "1"), (2.0, 6.0, "3"), (6.0, 30.0, "10"), (30.0, np.inf, "above 30"))


def interval(hits: int, total: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact (Clopper-Pearson) interval of a rate."""
    tail = (1.0 - level) / 2.0
    low = float(beta.ppf(tail, hits, total - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, total - hits)) if hits < total else 1.0
    return low, high


def rate(rows: Sequence[Row], hit: Callable[[Row], bool]) -> dict[str, Any]:
    """Return hits, total, rate and its interval."""
    hits, total = sum(bool(hit(row)) for row in rows), len(rows)
    if not total:
        return {"hits": 0, "total": 0, "rate": None, "interval": None}
    return {
        "hits": hits,
        "total": total,
        "rate": round(hits / total, 4),
        "interval": [round(x, 4) for x in interval(hits, total)],
    }


def outcome_in(*names: str) -> Callable[[Row], bool]:
    """Return whether a row has one of the outcomes."""
    return lambda row: row["outcome"] in names


def summary(
    rows: list[dict[str, Any]], ceiling: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """Return all figures of the study; ``ceiling`` are those of `hidden_ceiling` by world."""
    of = {c: [r for r in rows if r["category"] == c] for c in {r["category"] for r in rows}}
    single = of.get("single", [])
    catalogued = [r for c in ("single", "onset", "pair") for r in of.get(c, [])]
    strengths = {}
    for low, high, label in BANDS:
        band = [r for r in single if low <= r["hidden"][0]["strength"] < high]
        strengths[label] = {
            "outcomes": dict(Counter(r["outcome"] for r in band)),
            "right": rate(band, outcome_in("right", "right_by_alias")),
            "right_without_aliases": rate(band, lambda r: r["alone"]),
            "wrong_family": rate(band, outcome_in("wrong_family")),
            "with_known_motion": _recognised(band, label, ceiling or {}),
        }
    deviations = np.array([r["deviation"] for r in rows if r["deviation"] is not None])
    gains = [
        r["gain_explained"] for r in single
        if r["gain_explained"] is not None and r["hidden"][0]["strength"] >= 2.9
    ]  # fmt: skip
    judged = [r for r in single if r.get("gain_of_true") and r["hidden"][0]["strength"] >= 2.9]
    of_true = [r["gain_of_true"] for r in judged]
    seconds = np.array([r["seconds"]["diagnose"] for r in rows])
    return {
        "runs": len(rows),
        "nothing_hidden": rate(of.get("nothing", []), outcome_in("false_alarm")),
        "nothing_hidden_wrong_noise": rate(of.get("wrong_noise", []), outcome_in("false_alarm")),
        "single_by_strength": strengths,
        "wrong_family": rate(catalogued, outcome_in("wrong_family")),
        "outside": {
            "outcomes": dict(Counter(r["outcome"] for r in of.get("outside", []))),
            "unexplained_or_family": rate(of.get("outside", []), outcome_in("unexplained", "right_family")),
            "right_equation": rate(
                of.get("outside", []), lambda r: r["equation"] or r["outcome"] == "right_family"
            ),
            "wrong_family": rate(of.get("outside", []), outcome_in("wrong_family")),
        },
        "onset": {
            "outcomes": dict(Counter(r["outcome"] for r in of.get("onset", []))),
            "right": rate(of.get("onset", []), outcome_in("right", "right_by_alias")),
        },
        "pairs": {
            "outcomes": dict(Counter(r["outcome"] for r in of.get("pair", []))),
            "both": rate(of.get("pair", []), outcome_in("right", "right_by_alias")),
        },
        "parameters": {
            "reported": len(deviations),
            "within_3_sigma": rate([{"d": d} for d in deviations], lambda r: abs(r["d"]) <= 3.0),
            "rms_deviation": round(float(np.sqrt(np.mean(deviations**2))), 3) if len(deviations) else None,
            "median_absolute_deviation_over_gaussian": (
                round(float(np.median(np.abs(deviations)) / 0.6745), 3) if len(deviations) else None
            ),
            "beyond_3_sigma": [
                {"seed": r["seed"], "hidden": _hidden(r), "deviation": round(r["deviation"], 1)}
                for r in rows
                if r["deviation"] is not None and abs(r["deviation"]) > 3.0
            ],
        },
        "gain": {
            "runs": len(gains),
            "median_share_explained": round(float(np.median(gains)), 4) if gains else None,
            "at_least_0.9": rate([{"g": g} for g in gains], lambda r: r["g"] >= 0.9),
            "at_least_0.9_of_true": rate(of_true, lambda r: r["excess"] >= 0.9),
            "at_least_0.9_by_an_efficient_estimate": _efficient(judged, ceiling or {}),
            "open_loop_within_10_%_of_true": rate(of_true, lambda r: r["open_loop"] <= 1.1),
            "open_loop_by_an_efficient_estimate": _open_loop(judged, ceiling or {}),
        },
        "seconds_of_cpu_one_cause_or_none": _seconds(
            [r for c in ("nothing", "wrong_noise", "single", "onset") for r in of.get(c, [])]
        ),
        "seconds_of_cpu_by_world": {
            w: _seconds([r for r in rows if r["world"] == w])
            | {"candidates": (ceiling or {}).get(w, {}).get("candidates")}
            for w in sorted({r["world"] for r in rows})
        },
        "seconds_of_cpu": {
            "median": round(float(np.median(seconds)), 2) if len(seconds) else None,
            "95 %": round(float(np.percentile(seconds, 95)), 2) if len(seconds) else None,
            "simulate_median": (
                round(float(np.median([r["seconds"]["simulate"] for r in rows])), 2) if rows else None
            ),
        },
        "confusion": confusion(rows),
        "not_right": [
            {k: r[k] for k in ("seed", "world", "category", "outcome", "named", "notes")}
            | {"hidden": _hidden(r)}
            for r in rows
            if r["outcome"] not in ("right", "right_by_alias")
            and not (r["category"] == "outside" and r["outcome"] in ("unexplained", "right_family"))
        ],
    }  # fmt: skip


def _hidden(row: Row) -> list[str]:
    return [f"{h['effect']} x{h['strength']:.3g}" for h in row["hidden"]]


def _recognised(band: Sequence[Row], label: str, ceiling: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Return the rate of a likelihood that knows the motion on such runs; ``None`` where it is not known."""
    known = [ceiling.get(r["world"], {}).get("recognised", {}).get(label) for r in band]
    return round(float(np.mean(known)), 4) if known and None not in known else None


def _efficient(rows: Sequence[Row], ceiling: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Return the rate at which 90 % would be gained if nothing were left but what the flight leaves unknown
    of the nominal parameters.
    """
    if not rows or any(r["world"] not in ceiling for r in rows):
        return None
    rng = np.random.default_rng(0)
    left = {w: np.array(ceiling[w]["held_out"]["eigenvalues"]) for w in {r["world"] for r in rows}}
    chances = [chance(left[r["world"]], 0.1 * r["gain_of_true"]["nominal"], rng) for r in rows]
    return round(float(np.mean(chances)), 4)


def _open_loop(rows: Sequence[Row], ceiling: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Return the rate at which such an estimate simulates a held-out flight within 10 % of the true model."""
    known = [ceiling.get(r["world"], {}).get("held_out", {}).get("open_loop") for r in rows]
    if not known or None in known:
        return None
    return round(float(np.mean([k["within_1.1"] for k in known if k])), 4)


def _seconds(rows: Sequence[Row]) -> dict[str, float]:
    seconds = [r["seconds"]["diagnose"] for r in rows]
    if not seconds:
        return {}
    return {
        "median": round(float(np.median(seconds)), 2),
        "95 %": round(float(np.percentile(seconds, 95)), 2),
    }


def confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Return counts by hidden family (or none, outside, pair) and named family (or adequate, unexplained)."""
    out: dict[str, Counter[str]] = {}
    for r in rows:
        match r["category"]:
            case "nothing" | "wrong_noise":
                hidden = "nothing"
            case "outside" | "pair":
                hidden = r["category"]
            case _:
                hidden = r["hidden"][0]["family"][0]
        named = "+".join(r["families"]) or r["verdict"]
        if r["families"] and r["verdict"] == "unexplained":
            named += " (unexplained)"
        out.setdefault(hidden, Counter())[named] += 1
    return {k: dict(v) for k, v in sorted(out.items())}


def _efficient_line(result: Mapping[str, Any], key: str) -> list[str]:
    share = result["gain"][key]
    return [] if share is None else [f"| - the same of an efficient estimate | | {100 * share:.1f} % | |"]


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables as Markdown."""
    levels = ", ".join(f"{k} {v}" for k, v in result["levels"].items())
    seconds, calibration = result["seconds_of_cpu"], result["parameters"]
    simple = result["seconds_of_cpu_one_cause_or_none"]
    lines = [
        "# Effects hidden in MuJoCo, and what the diagnosis said",
        "",
        f"{result['runs']} runs, seeds {_ranges(result['seeds'])}, sources of commit "
        f"{result['commit']} ({result['digest']}); {result['environment']['cpu']}, "
        f"{result['environment']['date']}. Thresholds are those of `smsid.diagnose.DetectionThresholds` "
        f"({levels}); the digest pins them, and only runs made with it are counted. "
        "Intervals are Clopper-Pearson, 95 %.",
        "",
        "| | wanted | found | interval |",
        "|---|---|---|---|",
        _line("false alarms, nothing hidden", "<= 1 %", result["nothing_hidden"]),
        _line("the same, noise levels wrong by 30 %", "<= 3 %", result["nothing_hidden_wrong_noise"]),
    ]
    wanted = {"1": ">= 90 %", "3": ">= 95 %", "10": ">= 98 %", "above 30": ">= 98 %"}
    for label, band in result["single_by_strength"].items():
        lines.append(_line(f"right cause, strength {label}", wanted[label], band["right"]))
        lines.append(_line(f"- without aliases, strength {label}", "", band["right_without_aliases"]))
        if band["with_known_motion"] is not None:
            share = 100 * band["with_known_motion"]
            lines.append(f"| - a likelihood that knows the motion, strength {label} | | {share:.1f} % | |")
    lines += [
        _line("wrong family", "<= 1 %", result["wrong_family"]),
        _line("outside: unexplained or family", ">= 95 %", result["outside"]["unexplained_or_family"]),
        _line("outside: right equation", "", result["outside"]["right_equation"]),
        _line("outside: wrong family", "<= 2 %", result["outside"]["wrong_family"]),
        _line("began midway, strength 10 and 30: right", "", result["onset"]["right"]),
        _line("pairs, strength 5 and 20: both", ">= 90 %", result["pairs"]["both"]),
        _line("parameters within 3 sigma", ">= 98 %", result["parameters"]["within_3_sigma"]),
        _line("gain: 90 % of the given model's excess explained", "", result["gain"]["at_least_0.9"]),
        _line(
            "- beyond the refitted nominal model: 90 % of the true model's gain",
            "",
            result["gain"]["at_least_0.9_of_true"],
        ),
        *_efficient_line(result, "at_least_0.9_by_an_efficient_estimate"),
        _line(
            "open-loop error within 10 % of the true model's",
            "",
            result["gain"]["open_loop_within_10_%_of_true"],
        ),
        *_efficient_line(result, "open_loop_by_an_efficient_estimate"),
        "",
        f"Reported sigmas: rms deviation {calibration['rms_deviation']}, median-based "
        f"{calibration['median_absolute_deviation_over_gaussian']} (1 is calibrated). CPU seconds "
        f"of a diagnosis: median {seconds['median']}, 95 % {seconds['95 %']}; without pairs and what is "
        f"outside the catalogue {simple.get('median')} and {simple.get('95 %')}. By world, with candidates: "
        + "; ".join(
            f"{w} ({t['candidates']}) {t['median']} and {t['95 %']}"
            for w, t in result["seconds_of_cpu_by_world"].items()
        )
        + ".",
        "",
        "*A likelihood that knows the motion* and all but the nominal parameters and the effect's size, on "
        "effects drawn likewise: how often it finds something at the level of the diagnosis and has what is "
        "hidden among the three that explain most. *An efficient estimate*: the chance that nine tenths are "
        "gained where nothing is wrong but the nominal parameters, which are known as well as the first "
        "flight's Fisher information allows, or that its simulation errs by at most a tenth more than the "
        "true model's (all: `hidden_ceiling.json`).",
        "",
        "## Confusion: hidden family against named",
        "",
        *_matrix(result["confusion"]),
        "",
        "## Outcomes by strength",
        "",
    ]
    lines += [f"- {k}: {v['outcomes']}" for k, v in result["single_by_strength"].items()]
    lines += ["", "## Runs that were not right", ""]
    for r in result["not_right"]:
        hidden = ", ".join(r["hidden"]) or "nothing"
        note = f" ({'; '.join(r['notes'])})" if r["notes"] else ""
        lines.append(f"- {r['seed']} {r['world']}: {hidden}: {r['outcome']}, named {r['named']}{note}")
    beyond = result["parameters"].get("beyond_3_sigma", ())
    lines += ["", "## Parameters beyond 3 sigma", ""] if beyond else []
    lines += [f"- {r['seed']}: {', '.join(r['hidden'])}: {r['deviation']:g}" for r in beyond]
    return "\n".join(lines) + "\n"


def _line(what: str, wanted: str, r: Mapping[str, Any]) -> str:
    if not r["total"]:
        return f"| {what} | {wanted} | no runs | |"
    low, high = r["interval"]
    found = f"{r['hits']} of {r['total']} ({100 * r['rate']:.1f} %)"
    return f"| {what} | {wanted} | {found} | {100 * low:.1f} to {100 * high:.1f} % |"


def _matrix(table: Mapping[str, Mapping[str, int]]) -> list[str]:
    columns = sorted({k for row in table.values() for k in row})
    lines = [f"| hidden | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for hidden, row in table.items():
        lines.append(f"| {hidden} | {' | '.join(str(row.get(c, '')) for c in columns)} |")
    return lines


def _ranges(seeds: Sequence[int]) -> str:
    return f"{seeds[0]} to {seeds[-1]}" if seeds else "none"
