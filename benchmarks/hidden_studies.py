"""The studies of hidden effects side by side and together, with exact intervals.

    python benchmarks/hidden_studies.py

Reads what `hidden_effects` summed up for each commit (``results/hidden_effects_<commit>.json``) and writes
``results/hidden_studies.json`` and ``.md``. Each study judged the sources of its commit; together they tell
how often a diagnosis was right while they were mended, and the last one how often it is.
"""

from __future__ import annotations

import json
from typing import Any

from _common import RESULTS, environment, write_result
from _hidden_summary import interval
from rich.console import Console

from smsid._files import atomic_write

STUDIES = (
    "122f17d",
    "154d43e",
    "f26edc2",
    "bc6639e",
    "f287636",
    "f02e9e8",
    "658345c",
    "02b55e7",
    "6374faf",
    "91d27e9",
    "7f38066",
    "6ee3787",
    "33a4183",
)
FIGURES = (
    ("false alarms, nothing hidden", "<= 1 %", "nothing_hidden"),
    ("the same, noise levels wrong by 30 %", "<= 3 %", "nothing_hidden_wrong_noise"),
    ("right cause, strength 1", ">= 90 %", "single_by_strength/1/right"),
    ("right cause, strength 3", ">= 95 %", "single_by_strength/3/right"),
    ("right cause, strength 10", ">= 98 %", "single_by_strength/10/right"),
    ("right cause, strength above 30", ">= 98 %", "single_by_strength/above 30/right"),
    ("wrong family", "<= 1 %", "wrong_family"),
    ("outside: unexplained or family", ">= 95 %", "outside/unexplained_or_family"),
    ("outside: right equation", "", "outside/right_equation"),
    ("outside: wrong family", "<= 2 %", "outside/wrong_family"),
    ("began midway, strength 10 and 30: right", "", "onset/right"),
    ("pairs, strength 5 and 20: both", ">= 90 %", "pairs/both"),
    ("parameters within 3 sigma", ">= 98 %", "parameters/within_3_sigma"),
    ("gain: 90 % of the given model's excess explained", "", "gain/at_least_0.9"),
    (
        "beyond the refitted nominal model: 90 % of the true model's gain",
        ">= 90 %",
        "gain/at_least_0.9_of_true",
    ),
    ("open-loop error within 10 % of the true model's", "", "gain/open_loop_within_10_%_of_true"),
)
SIZES = (
    ("reported sigmas, median-based", "parameters/median_absolute_deviation_over_gaussian"),
    ("reported sigmas, rms", "parameters/rms_deviation"),
    (
        "nine tenths of the true model's gain, an efficient estimate",
        "gain/at_least_0.9_by_an_efficient_estimate",
    ),
    ("arm (55 candidates), seconds of CPU, median", "seconds_of_cpu_by_world/arm/median"),
    ("arm, 95 %", "seconds_of_cpu_by_world/arm/95 %"),
    ("sms (122 candidates), median", "seconds_of_cpu_by_world/sms/median"),
    ("sms, 95 %", "seconds_of_cpu_by_world/sms/95 %"),
)


def at(result: Any, path: str) -> Any:
    """Return what stands at ``a/b/c`` in nested dicts."""
    for key in path.split("/"):
        result = result[key]
    return result


def together(studies: dict[str, Any], path: str) -> dict[str, Any]:
    """Add hits and totals of one figure over all studies."""
    hits, total = (sum(at(s, path)[k] for s in studies.values()) for k in ("hits", "total"))
    return {
        "hits": hits,
        "total": total,
        "rate": round(hits / total, 4),
        "interval": [round(x, 4) for x in interval(hits, total)],
    }


def markdown(studies: dict[str, Any], pooled: dict[str, Any]) -> str:
    """Return both tables."""
    head = [f"{c} ({s['runs']})" for c, s in studies.items()]
    runs = sum(s["runs"] for s in studies.values())
    lines = [
        "# Effects hidden in MuJoCo, all studies",
        "",
        "Each of the sources of one commit, frozen before seeds were drawn (`hidden_effects_<commit>.md`), "
        "with its number of runs. Intervals are Clopper-Pearson, 95 %.",
        "",
        f"| | wanted | {' | '.join(head)} | together ({runs}) | interval |",
        "|---" * (len(head) + 4) + "|",
    ]
    for name, wanted, path in FIGURES:
        each = [f"{at(s, path)['hits']} of {at(s, path)['total']}" for s in studies.values()]
        p = pooled[path]
        low, high = (100.0 * x for x in p["interval"])
        whole = f"{p['hits']} of {p['total']} ({100.0 * p['rate']:.1f} %)"
        lines.append(f"| {name} | {wanted} | {' | '.join(each)} | {whole} | {low:.1f} to {high:.1f} % |")
    lines += ["", f"| | {' | '.join(head)} |", "|---" * (len(head) + 1) + "|"]
    for name, path in SIZES:
        lines.append(f"| {name} | {' | '.join(f'{at(s, path):g}' for s in studies.values())} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write both files."""
    studies = {
        c: json.loads((RESULTS / f"hidden_effects_{c}.json").read_text(encoding="utf-8")) for c in STUDIES
    }
    pooled = {path: together(studies, path) for _, _, path in FIGURES}
    result = {
        "environment": environment("smsid"),
        "studies": {
            c: {"runs": s["runs"], "digest": s["digest"], "seeds": [min(s["seeds"]), max(s["seeds"])]}
            for c, s in studies.items()
        },
        "together": pooled,
    }
    text = markdown(studies, pooled)
    write_result("hidden_studies", result)
    Console().print(str(atomic_write(RESULTS / "hidden_studies.md", text)))


if __name__ == "__main__":
    main()
