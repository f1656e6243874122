"""A body grasped between two flights is found with all it has; flights of before and after contradict.

    python benchmarks/grasped_body.py [--draws 20] [--pairs 100] [--twice 20]

The paper's craft, its two experiments at 25 Hz. Each draw: a box of 1 to 300 kg (log-uniform) at the tool,
between the flights before and those after; both are identified, `compare` says what changed. Exp. 1 of before
is identified together with Exp. 2 of after: do they contradict? Exp. 1 tells total mass and centre in one
pose only, which a light body hardly changes: so Exp. 2 of before is identified with Exp. 2 of after, too
(``twice``). Pairs of flights of one craft must not contradict. Rows are written to
``results/grasped_body.json`` as they come; a row that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import cache
from typing import Any

import numpy as np
from _common import RESULTS, ROOT, environment, write_result

from smsid.comparison import compare
from smsid.description import Description, load_description
from smsid.effects import GraspedBody
from smsid.errors import SmsidError
from smsid.estimation.identify import IdentificationRun, identify_spacecraft
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.recording import Recording

NAME = "grasped_body"
RATE = 25.0  # [Hz] of all sensors
TOOL = np.array([2.0, 0.0, 0.0])  # in the frame of link3's joint [m]
DENSITY = 300.0  # [kg/m^3] of the box
AXES = ("xx", "xy", "yy", "xz", "yz", "zz")
NAMES = ("mass", *(f"first_moment.{a}" for a in "xyz"), *(f"inertia.{a}" for a in AXES))
NULL = 10  # flights of each experiment whose pairs must not contradict


@cache
def craft() -> Description:
    """Return the craft, with all sensors at one rate."""
    found = load_description(ROOT / "urdf" / "paper_sms.toml")
    return found.with_sensors(*(s.model_copy(update={"rate": RATE}) for s in found.effective_sensors()))


def box(seed: int) -> GraspedBody:
    """Draw a box that the tool holds somewhere at its surface, turned anyhow."""
    rng = np.random.default_rng([seed, 12])
    mass = float(np.exp(rng.uniform(0.0, np.log(300.0))))
    sides = rng.uniform(0.5, 1.5, 3)
    sides *= (mass / DENSITY / np.prod(sides)) ** (1.0 / 3.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    inertia = turn @ np.diag(mass / 12.0 * (np.sum(sides**2) - sides**2)) @ turn.T
    toward = rng.normal(size=3)
    centre = TOOL + 0.5 * sides.max() * toward / np.linalg.norm(toward)
    rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
    return GraspedBody.model_validate(
        {
            "name": "target",
            "frame": "link3",
            "mass": mass,
            "centre": tuple(centre.tolist()),
            "central_inertia": tuple(inertia[rows, columns].tolist()),
        }
    )


def flown(name: str, seed: int, body: GraspedBody | None = None) -> Recording:
    """Fly an experiment, perhaps with a body at the tool."""
    model = build_model(craft() if body is None else craft().with_effects(body))
    made = fly(model, named_experiment(name, build_model(craft())), np.random.default_rng([seed, 7]))
    return made.recording


@cache
def before(name: str, seed: int) -> Recording:
    """Fly an experiment of the craft as described."""
    return flown(name, seed)


@cache
def estimated(seed: int) -> IdentificationRun:
    """Identify the craft from both experiments before."""
    return identify_spacecraft(craft(), [before(n, seed) for n in ("exp1", "exp2")])


def draw(seed: int) -> dict[str, Any]:
    """Return what is found of a body that was grasped."""
    body, began = box(seed), time.process_time()
    after = [flown(n, 100 + seed, body) for n in ("exp1", "exp2")]
    row: dict[str, Any] = {"draw": seed, "mass": round(body.mass, 3)}
    found = identify_spacecraft(craft(), after)
    row["judgement"] = found.quality.judgement if found.quality else ""
    told = compare(estimated(seed % 4).estimate, found.estimate, craft())
    row["findings"] = [(f.kind, f.subject, *f.others) for f in told.findings]
    own = [f for f in told.findings if f.kind == "body_grasped"]
    true = dict(zip(NAMES, body.inertial_parameters(), strict=True))
    if own:
        numbers = {n: own[0][n] for n in NAMES}
        row["off"] = {n: round(float((q.value - true[n]) / q.sigma), 2) for n, q in numbers.items() if q.told}
        row["inside"] = sum(
            bool(q.interval[0] <= true[n] <= q.interval[1]) for n, q in numbers.items() if q.told
        )
        row["relative_sigma_of_mass"] = round(float(numbers["mass"].sigma) / body.mass, 5)
    row["mixed"] = mixed([before("exp1", seed % 4), after[1]])
    return row | {"seconds": round(time.process_time() - began, 1)}


def mixed(recordings: list[Recording]) -> dict[str, Any]:
    """Identify flights together; do they contradict each other?"""
    try:
        found = identify_spacecraft(craft(), recordings)
    except SmsidError as error:
        named = error.evidence.get("contradictions", [])
        return {"named": bool(named), "refused": " ".join(named or [str(error)])[:300]}
    return {
        "named": bool(found.contradictions),
        "p": min((float(c.p_value) for c in found.contradictions), default=None),
        "parameters": [p[0] for c in found.contradictions for p in c.parameters][:3],
        "judgement": found.quality.judgement if found.quality else "",
    }


def twice(seed: int) -> dict[str, Any]:
    """Identify Exp. 2 of before together with Exp. 2 of after, and with another of before."""
    began = time.process_time()
    after, again = flown("exp2", 100 + seed, box(seed)), before("exp2", 4 + seed)
    first = before("exp2", seed % 4)
    row = {"twice": seed, "mass": round(box(seed).mass, 3), "mixed": mixed([first, after])}
    row["seconds"] = round(time.process_time() - began, 1)
    return row | {"same": mixed([first, again])}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return coverage, and how many contradictions are named."""
    draws, pairs, exp2 = ([r for r in rows if key in r] for key in ("draw", "pair", "twice"))
    off = [x for r in draws for x in r.get("off", {}).values()]
    mass = {named: [r["mass"] for r in draws if _said(r) == named] for named in (True, False)}
    return {
        "draws": len(draws),
        "grasped_at_the_link": sum(
            list(r["findings"][0][:2]) == ["body_grasped", "link3"] for r in draws if r["findings"]
        ),
        "parameters": len(off),
        "coverage": round(float(sum(r.get("inside", 0) for r in draws)) / max(len(off), 1), 4),
        "largest": max(map(abs, off), default=None),
        "contradictions_named": len(mass[True]),
        "lightest_named_kg": min(mass[True], default=None),
        "heaviest_not_named_kg": max(mass[False], default=None),
        "pairs": len(pairs),
        "false_contradictions": sum(map(_said, pairs)),
        "twice": len(exp2),
        "twice_named": sum(r["mixed"]["named"] for r in exp2),
        "twice_lightest_kg": min((r["mass"] for r in exp2), default=None),
        "twice_same_craft_named_or_refused": sum(
            bool(r["same"]["named"] or "refused" in r["same"]) for r in exp2
        ),
    }


def _said(row: dict[str, Any]) -> bool:
    return bool(row["mixed"].get("named") or "refused" in row["mixed"])


def main() -> None:
    """Run what is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--twice", type=int, default=20)
    asked = parser.parse_args()
    path = RESULTS / f"{NAME}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    there = {(key, r[key]) for r in rows for key in ("draw", "pair", "twice") if key in r}
    plan = [("draw", k) for k in range(asked.draws)] + [("pair", k) for k in range(asked.pairs)]
    plan += [("twice", k) for k in sorted(range(asked.twice), key=lambda k: box(k).mass)]  # the hardest first
    for key, k in plan:
        if (key, k) in there:
            continue
        if key == "draw":
            rows.append(draw(k))
        elif key == "twice":
            rows.append(twice(k))
        else:
            first, second = before("exp1", k % NULL), before("exp2", NULL + k // NULL)
            rows.append({"pair": k, "mixed": mixed([first, second])})
        here = environment("smsid")
        rows[-1]["date"] = here["date"]
        print(json.dumps(rows[-1]), flush=True)
        write_result(NAME, {"environment": here, "summary": summary(rows), "rows": rows})
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
