"""Summary of the likelihood study: spread, bias and coverage of every parameter against bound and chance."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import binom, chi2, norm

FAMILY = 0.01  # chance that any parameter of an estimator at the bound leaves its band
SEEN = 0.5  # prior's share of the variance above which a parameter counts as not seen


def summary(runs: list[dict[str, Any]], bound: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of one case, of maximum likelihood and of the linear method beside it."""
    out: dict[str, Any] = {}
    for method in ("ml", "linear"):
        own = [r for r in runs if r["method"] == method]
        if own:
            out[method] = _of_method(own, bound)
    return out


def _of_method(runs: list[dict[str, Any]], bound: dict[str, Any]) -> dict[str, Any]:
    good = [r for r in runs if "values" in r]
    out: dict[str, Any] = {
        "runs": len(runs),
        "failed": [r["failed"] for r in runs if "failed" in r],
    }
    n = len(good)
    if n < 10:
        return out
    if all("physical" in r for r in good):
        out["unphysical inertias"] = sum(not r["physical"] for r in good)
    table = {}
    for name, (truth, sigma, share, synchronised) in bound.items():
        if share > SEEN or any(name not in r["values"] for r in good):
            continue
        pairs = np.array([r["values"][name] for r in good])
        error = pairs[:, 0] - truth
        inside = (pairs[:, 2] <= truth) & (truth <= pairs[:, 3])
        table[name] = {
            "truth": truth,
            "bound": sigma,
            "bound / with clocks that agree": sigma / synchronised,
            "spread / bound": float(np.std(error, ddof=1) / sigma),
            "predicted / bound": float(np.median(pairs[:, 1]) / sigma),
            "bias / bound": float(np.mean(error) / sigma),
            "coverage 95 %": float(np.mean(inside)),
            "identifiable": float(np.mean([name in r["identifiable"] for r in good])),
        }
    out["parameters"] = table
    m = len(table)
    spread = np.array([x["spread / bound"] for x in table.values()])
    bias = np.array([x["bias / bound"] for x in table.values()])
    cover = np.array([x["coverage 95 %"] for x in table.values()])
    band = np.sqrt(chi2.ppf([FAMILY / m / 2, 1 - FAMILY / m / 2], n - 1) / (n - 1))
    low, high = binom.ppf([FAMILY / m / 2, 1 - FAMILY / m / 2], n, 0.95) / n
    clocks = np.array([x["bound / with clocks that agree"] for x in table.values()])
    out |= {
        "bound / with clocks that agree, median": float(np.median(clocks)),
        "bound / with clocks that agree, largest": float(clocks.max()),
        "root mean square of spread / bound": float(np.sqrt(np.mean(spread**2))),
        "largest spread / bound": float(spread.max()),
        "smallest spread / bound": float(spread.min()),
        "chance: band of a spread / bound": band.tolist(),
        "largest |bias| / bound": float(np.abs(bias).max()),
        "chance: largest |bias| / bound": float(norm.ppf(1 - FAMILY / m / 2) / np.sqrt(n)),
        "mean coverage": float(cover.mean()),
        "smallest coverage": float(cover.min()),
        "largest coverage": float(cover.max()),
        "chance: band of a coverage": [float(low), float(high)],
        "spreads above 1.1 times the band": [
            k for k, x in table.items() if x["spread / bound"] > 1.1 * band[1]
        ],
        "coverages outside the band": [k for k, x in table.items() if not low <= x["coverage 95 %"] <= high],
        "median cpu seconds": float(np.median([r["cpu_seconds"] for r in good])),
    }
    return out


def markdown(document: dict[str, Any]) -> str:
    """Return the page: one table of cases, then one of parameters per case."""
    lines = [
        "# Maximum likelihood against the Cramer-Rao bound",
        "",
        "By `python benchmarks/likelihood.py`; how, is said there. Spread, predicted standard deviation and",
        "bias in units of the bound; *chance* is the band that an estimator exactly at the bound would keep",
        "to for all parameters at once with 99 % probability, for this many runs. *Clocks* is what it costs",
        "that encoders' and tachometers' clocks are estimated: the bound over that with clocks that agree.",
        "",
        "| case, method | runs | failed | rms spread | largest spread (chance) | largest bias (chance) "
        "| mean coverage | coverage from - to (chance) | CPU s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for case, methods in document["cases"].items():
        for method, x in methods.items():
            if "parameters" not in x:
                continue
            low, high = x["chance: band of a coverage"]
            lines.append(
                f"| {case}, {method} | {x['runs']} | {len(x['failed'])} "
                f"| {x['root mean square of spread / bound']:.3f} "
                f"| {x['largest spread / bound']:.3f} ({x['chance: band of a spread / bound'][1]:.3f}) "
                f"| {x['largest |bias| / bound']:.3f} ({x['chance: largest |bias| / bound']:.3f}) "
                f"| {100 * x['mean coverage']:.1f} % "
                f"| {100 * x['smallest coverage']:.1f} - {100 * x['largest coverage']:.1f} % "
                f"({100 * low:.1f} - {100 * high:.1f}) | {x['median cpu seconds']:.1f} |"
            )
    for case, methods in document["cases"].items():
        if "parameters" not in methods.get("ml", {}):
            continue
        linear = methods.get("linear", {}).get("parameters", {})
        lines += [
            "",
            f"## {case}",
            "",
            "| parameter | truth | bound | clocks | spread | predicted | bias | coverage % "
            "| linear: spread | bias |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        for name, p in methods["ml"]["parameters"].items():
            beside = linear.get(name)
            other = f"{beside['spread / bound']:.3g} | {beside['bias / bound']:.3g}" if beside else "- | -"
            lines.append(
                f"| {name} | {p['truth']:.6g} | {p['bound']:.2g} "
                f"| {p['bound / with clocks that agree']:.3f} | {p['spread / bound']:.3f} "
                f"| {p['predicted / bound']:.3f} | {p['bias / bound']:.3f} | {100 * p['coverage 95 %']:.1f} "
                f"| {other} |"
            )
    return "\n".join(lines) + "\n"
