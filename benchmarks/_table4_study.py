"""What flights of Table 4 tell: medians, orderings and ratios beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from _table4 import CONTROLLERS, PRINTED_UNIT, PRINTED_UNITS, Case, Run

FEWEST = 5
"""Draws below which no ordering is decided."""


def summarise(runs: Sequence[Run], wanted: Sequence[Case]) -> list[dict[str, object]]:
    """Return a row per case and controller: medians and 95 % intervals of e_b, e_i, the paper's beside.

    All in [rad]; the paper's are taken for `PRINTED_UNIT`.
    """
    rows: list[dict[str, object]] = []
    for case in wanted:
        for controller in CONTROLLERS:
            found = [r for r in runs if (r.case, r.controller) == (case.name, controller)]
            if not found:
                continue
            row: dict[str, object] = {
                "case": case.name,
                "note": case.note,
                "K_P": case.proportional,
                "K_D": case.derivative,
                "controller": controller,
                "draws": len(found),
                "runs_at_a_limit": sum(bool(r.saturated) for r in found),
            }
            for name in ("base", "joints"):
                values = np.array([getattr(r, name) for r in found])
                low, middle, high = np.percentile(values, [2.5, 50.0, 97.5])
                row[f"e_{name}"] = {"median": float(middle), "interval": [float(low), float(high)]}
            rows.append(row | printed(case, controller))
    return rows


def printed(case: Case, controller: str) -> dict[str, float]:
    """Return the paper's e_b and e_i of a row [rad], read in `PRINTED_UNIT`; nothing where it has none."""
    found = case.paper.get(controller)
    scale = PRINTED_UNITS[PRINTED_UNIT]
    return {} if found is None else {"e_base_paper": scale * found[0], "e_joints_paper": scale * found[1]}


def orderings(runs: Sequence[Run]) -> list[dict[str, object]]:
    """Return the paper's orderings, each with the share of draws in which it holds and the median ratio.

    Pairs share the draw, so noise and pattern of errors are the same on both sides. ``holds`` where the share
    is at least 0.95, ``fails`` at most 0.05, else ``undecided``; so are fewer than `FEWEST` draws (sign test:
    five out of five by chance is 3 %).
    """
    table = {(r.case, r.controller, r.draw): r for r in runs}
    claims = [
        ((a, c), (b, c))
        for c in CONTROLLERS
        for a, b in (("D", "C"), ("C", "B"), ("B", "A1.6"), ("B", "A1.0"))
    ]
    claims += [((case, "hinf"), (case, "pd")) for case in ("D", "C", "B", "A1.6", "A1.0")]
    out: list[dict[str, object]] = []
    for better, worse in claims:
        draws = [d for (c, k, d) in table if (c, k) == better and (*worse, d) in table]
        if not draws:
            continue
        entry: dict[str, object] = {
            "smaller": " ".join(better),
            "larger": " ".join(worse),
            "draws": len(draws),
        }
        for name in ("base", "joints"):
            ratio = np.array(
                [getattr(table[*better, d], name) / getattr(table[*worse, d], name) for d in draws]
            )
            share = float((ratio < 1.0).mean())
            verdict = "holds" if share >= 0.95 else "fails" if share <= 0.05 else "undecided"
            verdict = verdict if len(draws) >= FEWEST else "undecided"
            entry[f"e_{name}"] = {"share": share, "median_ratio": float(np.median(ratio)), "verdict": verdict}
        out.append(entry)
    return out


def improvements(runs: Sequence[Run]) -> list[dict[str, object]]:
    """Return how much lower the medians of (D) are than of (B) and (A) [%], the paper's ratios beside."""
    paper = {
        ("pd", "B"): (12.4, 21.1),
        ("hinf", "B"): (5.2, 15.2),
        ("pd", "A1.6"): (87.9, 86.7),
        ("pd", "A1.0"): (87.9, 86.7),
        ("hinf", "A1.6"): (14.0, 22.2),
        ("hinf", "A1.0"): (14.0, 22.2),
    }
    out: list[dict[str, object]] = []
    for (controller, case), printed in paper.items():
        pair = [[r for r in runs if (r.case, r.controller) == (c, controller)] for c in ("D", case)]
        if not all(pair):
            continue
        lower = [
            100.0
            * (
                1.0
                - np.median([getattr(r, n) for r in pair[0]]) / np.median([getattr(r, n) for r in pair[1]])
            )
            for n in ("base", "joints")
        ]
        out.append(
            {
                "controller": controller,
                "against": case,
                "lower_percent": [float(x) for x in lower],
                "paper": printed,
            }
        )
    return out
