"""Table 4 as a page: ours beside the paper's, orderings, ratios, and what the open choices change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smsid.control.table4 import cases


def markdown(result: Mapping[str, Any]) -> str:
    """Return the page for the benchmark's result."""
    models = result["identified_models"]
    main = result["variants"]["main"]
    out = [
        "# Table 4 over draws of uncertainty and noise",
        "",
        "Largest errors of attitude e_b and joints e_i [rad] on the complete nonlinear spacecraft: "
        "median and 95 % interval over draws. "
        f"Case D flies with {models['count']} models identified from another engine's recordings by "
        f"the paper's method, starting "
        f"guesses 30 % off; their H is off by {100 * models['error_of_H']['median']:.2g} % (median), "
        f"their intervals say "
        f"{100 * models['level_from_intervals']['median']:.2g} %. The others draw mass, lever and "
        f"inertia of every body within their "
        "level. Sensors are the `reference` ones (attitude 1e-4 rad, gyro 1e-5 rad/s, joints 1e-5 "
        "rad and 1e-4 rad/s), control at "
        "20 Hz, wheels limited to 2 N m. Written by `benchmarks/table4.py`; "
        "numbers are in `table4.json`.",
        "",
        *_table(main),
        "",
        "`at a limit`: flights in which a wheel asked for more than its torque at least once, by "
        "noise at these gains.",
        "",
        "## Ratios: how much lower (D) is",
        "",
        "| against | controller | e_b here % | paper % | e_i here % | paper % | e_b without noise % "
        "| e_i without noise % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    quiet = {
        (r["against"], r["controller"]): r for r in result["variants"].get("no noise", main)["improvements"]
    }
    for r in main["improvements"]:
        other = quiet.get((r["against"], r["controller"]))
        cells = [f"{x:.1f}" for x in other["lower_percent"]] if other else ["-", "-"]
        b, i = r["lower_percent"]
        out.append(
            f"| {r['against']} | {r['controller']} | {b:.1f} | {r['paper'][0]} | {i:.1f} | "
            f"{r['paper'][1]} | {cells[0]} | {cells[1]} |"
        )
    out += [
        "",
        "## Orderings",
        "",
        "Share of draws in which the left is smaller (same draw on both sides): e_b, e_i.",
        "",
    ]
    names = [n for n in result["variants"]]
    out += ["| smaller | larger | " + " | ".join(names) + " |", "|---|---|" + "---|" * len(names)]
    for claim in main["orderings"]:
        cells = []
        for name in names:
            found = next(
                (
                    o
                    for o in result["variants"][name]["orderings"]
                    if (o["smaller"], o["larger"]) == (claim["smaller"], claim["larger"])
                ),
                None,
            )
            cells.append(
                "-" if found is None else ", ".join(_share(found[k]) for k in ("e_base", "e_joints"))
            )
        out.append(f"| {claim['smaller']} | {claim['larger']} | " + " | ".join(cells) + " |")
    out += [
        "",
        "**bold**: holds (95 % of draws or more); ~~struck~~: the opposite holds; plain: undecided.",
        "",
        "Are the medians in the paper's order, D < C < B < A?",
        "",
        "| variant | PD e_b | PD e_i | H-infinity e_b | H-infinity e_i |",
        "|---|---|---|---|---|",
        *(f"| {name} | " + " | ".join(_ordered(v)) + " |" for name, v in result["variants"].items()),
        "",
        "## What the paper leaves open",
        "",
        "Medians, PD / PD + H-infinity.",
        "",
        "| variant | draws | D e_b | B e_b | A1.6 e_b | D e_i | B e_i | A1.6 e_i |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, variant in result["variants"].items():
        rows = {(r["case"], r["controller"]): r for r in variant["rows"]}
        cells = []
        for key in ("e_base", "e_joints"):
            for case in ("D", "B", "A1.6"):
                pair = [rows.get((case, c)) for c in ("pd", "hinf")]
                cells.append(" / ".join(f"{r[key]['median']:.1e}" if r else "-" for r in pair))
        out.append(f"| {name} | {min(r['draws'] for r in variant['rows'])} | " + " | ".join(cells) + " |")
    out += [
        "",
        "## What the paper's numbers say themselves",
        "",
        "Largest error times K_P, the steady acceleration it stands for [rad/s^2] (PD):",
        "",
        "| case | K_P | e_b K_P | e_i K_P |",
        "|---|---|---|---|",
    ]
    for case in cases():
        if case.paper:
            b, i = case.paper["pd"]
            out.append(
                f"| {case.name} | {case.proportional} | {b * case.proportional:.2e} | "
                f"{i * case.proportional:.2e} |"
            )
    out += [
        "",
        "It is the same within 35 % in every case, so case A's larger errors follow from its smaller "
        "K_P alone (the ratio of gains, "
        "1 - 0.64/4, is 84 %; the print has 87.9 and 86.7 %): nothing resonates there. For the "
        "joints it is 22 to 28 times the wanted "
        "acceleration of 0.001 rad/s^2: 20 % of wrong inertia cannot make it; something else does "
        "that the paper does not describe, "
        "and that the identified model does not remove either (case D).",
        "",
    ]
    return "\n".join(out)


def _table(variant: Mapping[str, Any]) -> list[str]:
    out = [
        "| case | K_P, K_D | controller | draws | e_b | 95 % | paper | e_i | 95 % | paper | at a limit |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in variant["rows"]:
        cells = []
        for key in ("e_base", "e_joints"):
            low, high = r[key]["interval"]
            paper = r.get(f"{key}_paper")
            cells += [f"{r[key]['median']:.2e}", f"{low:.1e} .. {high:.1e}", f"{paper:.2e}" if paper else "-"]
        out.append(
            f"| {r['case']} ({r['note']}) | {r['K_P']:.3g}, {r['K_D']:.3g} | {r['controller']} | "
            f"{r['draws']} | " + " | ".join(cells) + f" | {r['runs_at_a_limit']} |"
        )
    return out


def _share(found: Mapping[str, Any]) -> str:
    text = f"{100 * found['share']:.0f} %"
    return {"holds": f"**{text}**", "fails": f"~~{text}~~"}.get(found["verdict"], text)


def _ordered(variant: Mapping[str, Any]) -> list[str]:
    """Return for PD and H-infinity, e_b and e_i, whether the medians are in order, and where they are not."""
    rows = {(r["case"], r["controller"]): r for r in variant["rows"]}
    out = []
    for controller in ("pd", "hinf"):
        for key in ("e_base", "e_joints"):
            wrong = []
            for a, b in (("D", "C"), ("C", "B"), ("B", "A1.6"), ("B", "A1.0")):
                pair = rows.get((a, controller)), rows.get((b, controller))
                if None not in pair and pair[0][key]["median"] >= pair[1][key]["median"]:
                    wrong.append(f"{a} >= {b}")
            complete = all((c, controller) in rows for c in ("D", "C", "B", "A1.6", "A1.0"))
            out.append(", ".join(wrong) or ("yes" if complete else "not flown"))
    return out
