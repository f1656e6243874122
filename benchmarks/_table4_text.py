"""Table 4 as a page: ours beside the paper's, orderings, ratios, and what the open choices change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smsid.control.trajectory import PAPER_ACCELERATION
from smsid.paper.table4 import PRINTED_UNITS, cases

GYRO = "integrated gyro"


def markdown(result: Mapping[str, Any]) -> str:
    """Return the page for the benchmark's result."""
    models = result["identified_models"]
    main = result["variants"]["main"]
    out = [
        "# Table 4 over draws of uncertainty and noise",
        "",
        "Largest errors of attitude e_b and joints e_i [rad] on the complete nonlinear spacecraft: "
        "median and 95 % interval over draws. The paper's numbers have no unit in print; they are taken for "
        "degrees here, and converted: the next section says why. "
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
        *_units(result),
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
    ]
    return "\n".join(out)


def _units(result: Mapping[str, Any]) -> list[str]:
    """Return both readings of the printed numbers beside ours: printed over ours, cell by cell."""
    wanted = [name for name in (GYRO, "no noise", "main") if name in result["variants"]]
    out = [
        "## Degrees or radians?",
        "",
        "Table 4 is printed without a unit. Ours over the paper's, medians, both readings: a ratio near "
        "one is a reading that fits. `integrated gyro` has attitude noise of 2e-6 rad and a "
        "gyro of 1e-6 rad/s: the "
        "paper has no star tracker, its attitude is an integrated gyro's.",
        "",
        "| variant | case | controller | e_b, deg | e_b, rad | e_i, deg | e_i, rad |",
        "|---|---|---|---|---|---|---|",
    ]
    of, spread = {c.name: c for c in cases()}, {u: [] for u in PRINTED_UNITS}
    for name in wanted:
        for r in result["variants"][name]["rows"]:
            if r["controller"] not in of[r["case"]].paper:
                continue
            cells = []
            for k, key in enumerate(("e_base", "e_joints")):
                for unit, scale in PRINTED_UNITS.items():
                    ratio = r[key]["median"] / (scale * of[r["case"]].paper[r["controller"]][k])
                    cells.append(f"{ratio:.2g}")
                    if name == GYRO:
                        spread[unit].append(ratio)
            out.append(f"| {name} | {r['case']} | {r['controller']} | " + " | ".join(cells) + " |")
    told = [
        f"within {min(x):.2g} to {max(x):.2g} times the paper's when it is read in {unit}"
        for unit, x in spread.items()
        if x
    ]
    largest = [
        max(c.proportional * scale * c.paper["pd"][1] for c in cases() if c.paper) / PAPER_ACCELERATION
        for scale in PRINTED_UNITS.values()
    ]
    out += ["", f"With `{GYRO}`, all of ours lie {'; '.join(told)}." if told else ""]
    out += [
        "",
        "Radians contradict the described experiment by themselves: e_i K_P, the steady acceleration that an "
        f"error stands for, would be up to {largest[1]:.0f} times the wanted 0.001 rad/s^2, in case D as in "
        "B; no error of the inertia makes that. In degrees it is up to "
        f"{largest[0]:.2g} times: what wrong inertia of some 20 %, noise and the panel can "
        "make. What stays apart in degrees: e_i of (D) hardly differs "
        "from (C) and (B) in print (21 %), here it is a quarter, so the paper's joints have noise or a "
        "disturbance that ours have not; and its H-infinity term leaves a third of what ours "
        "leaves of e_b. With the noise of "
        "`main`, e_b under H-infinity is near the print in radians; PD's, of the same flights, is not.",
        "",
        "The printed e K_P is the same within 35 % in cases A and B, in either unit: case A's larger errors "
        "are those of a smaller K_P (1 - 0.64/4 is 84 %; the print has 87.9 and 86.7 %), and ours are so too "
        "without any resonance.",
        "",
    ]
    return out


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
