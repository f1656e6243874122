"""All studies of hidden effects side by side and together.

    python benchmarks/hidden_studies.py

The study in ``results/hidden_effects.json`` joins those in ``results/hidden_studies.json``, by the commit of
its sources; the table ``hidden_studies.md`` is written from that file alone. Run it before the next study
takes the place of the last one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from _common import RESULTS, environment, write_result
from _hidden_summary import interval

from smsid._files import atomic_write

NAME = "hidden_studies"
COUNTS = {
    "nothing_hidden": ("false alarms, nothing hidden", "<= 1 %"),
    "nothing_hidden_wrong_noise": ("the same, noise levels wrong by 30 %", "<= 3 %"),
    "single_by_strength/1/right": ("right cause, strength 1", ">= 90 %"),
    "single_by_strength/3/right": ("right cause, strength 3", ">= 95 %"),
    "single_by_strength/10/right": ("right cause, strength 10", ">= 98 %"),
    "single_by_strength/above 30/right": ("right cause, strength above 30", ">= 98 %"),
    "wrong_family": ("wrong family", "<= 1 %"),
    "outside/unexplained_or_family": ("outside: unexplained or family", ">= 95 %"),
    "outside/right_equation": ("outside: right equation", ""),
    "outside/wrong_family": ("outside: wrong family", "<= 2 %"),
    "onset/right": ("began midway, strength 10 and 30: right", ""),
    "pairs/both": ("pairs, strength 5 and 20: both", ">= 90 %"),
    "parameters/within_3_sigma": ("parameters within 3 sigma", ">= 98 %"),
    "gain/at_least_0.9": ("gain: 90 % of the given model's excess explained", ""),
    "gain/at_least_0.9_of_true": (
        "beyond the refitted nominal model: 90 % of the true model's gain", ">= 90 %",
    ),
    "gain/open_loop_within_10_%_of_true": ("open-loop error within 10 % of the true model's", ""),
}  # fmt: skip
VALUES = {
    "parameters/median_absolute_deviation_over_gaussian": "reported sigmas, median-based",
    "parameters/rms_deviation": "reported sigmas, rms",
    "gain/at_least_0.9_by_an_efficient_estimate": (
        "nine tenths of the true model's gain, an efficient estimate"
    ),
    "seconds_of_cpu_by_world/arm/median": "arm (55 candidates), seconds of CPU, median",
    "seconds_of_cpu_by_world/arm/95 %": "arm, 95 %",
    "seconds_of_cpu_by_world/sms/median": "sms (122 candidates), median",
    "seconds_of_cpu_by_world/sms/95 %": "sms, 95 %",
}


def main() -> None:
    """Add the last study, if it is not there, and write the table."""
    studies = json.loads((RESULTS / f"{NAME}.json").read_text(encoding="utf-8"))["studies"]
    last = json.loads((RESULTS / "hidden_effects.json").read_text(encoding="utf-8"))
    studies.setdefault(last["commit"], study(last))
    result = {"environment": environment("smsid"), "studies": studies, "together": together(studies)}
    write_result(NAME, result)
    atomic_write(RESULTS / f"{NAME}.md", markdown(result))
    print(f"{len(studies)} studies, {sum(s['runs'] for s in studies.values())} runs")


def study(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return of a result of `hidden_effects` what is kept: hits and totals, and values."""
    rates = {path: at(result, path) for path in COUNTS}
    return {
        "runs": result["runs"],
        "digest": result["digest"],
        "seeds": [result["seeds"][0], result["seeds"][-1]],
        "counts": {path: [r["hits"], r["total"]] for path, r in rates.items() if r},
        "values": {path: at(result, path) for path in VALUES},
    }


def at(result: Mapping[str, Any], path: str) -> Any:
    """Return what stands at a path of a result; ``None`` where nothing does."""
    found: Any = result
    for key in path.split("/"):
        found = (found or {}).get(key)
    return found


def together(studies: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return hits, totals, rates and exact intervals over all studies."""
    out = {}
    for path in COUNTS:
        counted = [s["counts"][path] for s in studies.values() if path in s["counts"]]
        hits, total = (sum(c[k] for c in counted) for k in (0, 1))
        out[path] = {
            "hits": hits, "total": total, "rate": round(hits / total, 4),
            "interval": [round(x, 4) for x in interval(hits, total)],
        }  # fmt: skip
    return out


def markdown(result: Mapping[str, Any]) -> str:
    """Return the table."""
    studies, whole = result["studies"], result["together"]
    runs = sum(s["runs"] for s in studies.values())
    names = [f"{name} ({s['runs']})" for name, s in studies.items()]
    lines = [
        "# Effects hidden in MuJoCo, all studies", "",
        "Each of the sources of one commit, frozen before seeds were drawn (each in the repository at the "
        "commit after the one it judged; the last one beside this file), with its number of runs. Intervals "
        "are Clopper-Pearson, 95 %.", "",
        *head(["", "wanted", *names, f"together ({runs})", "interval"]),
    ]  # fmt: skip
    for path, (label, wanted) in COUNTS.items():
        own = [s["counts"].get(path) for s in studies.values()]
        r = whole[path]
        low, high = (100.0 * x for x in r["interval"])
        lines.append(row([
            label, wanted, *("no runs" if c is None else f"{c[0]} of {c[1]}" for c in own),
            f"{r['hits']} of {r['total']} ({100.0 * r['rate']:.1f} %)", f"{low:.1f} to {high:.1f} %",
        ]))  # fmt: skip
    lines += ["", *head(["", *names])]
    for path, label in VALUES.items():
        own = [s["values"].get(path) for s in studies.values()]
        lines.append(row([label, *("" if v is None else f"{v:g}" for v in own)]))
    return "\n".join(lines) + "\n"


def head(cells: Sequence[str]) -> list[str]:
    return [row(cells), "|" + "---|" * len(cells)]


def row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
