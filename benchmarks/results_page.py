"""The page docs/results.md, written from the results of the benchmarks on real recordings.

python benchmarks/results_page.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from _common import RESULTS, ROOT, atomic_write

PAGE = ROOT / "docs" / "results.md"

HEAD = """# Results on real recordings

Nobody of this project made these recordings; `smsid.datasets` says where they come from and under which
licence, and reads them from the folder `SMSID_DATA`. Every figure below stands in `benchmarks/results/`, with
machine and versions; this page is written by `python benchmarks/results_page.py`. Intervals are 95 %.
No parameter was fitted on the part that judges.
"""


def load(name: str, folder: Path = RESULTS) -> dict[str, Any]:
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


def page(folder: Path = RESULTS) -> str:
    """Return the Markdown."""
    parts = [tx40(load("tx40", folder)), silverbox(load("silverbox", folder))]
    parts += [antisloshing(load("antisloshing", folder)), slab(load("cessipy_slab", folder))]
    return "\n".join([HEAD, *parts])


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def interval(p: dict[str, Any], digits: int = 4) -> str:
    low, high = p["interval_95"]
    return f"{p['value']:.{digits}g} [{low:.{digits}g}, {high:.{digits}g}]"


def tx40(r: dict[str, Any]) -> str:
    errors = r["held_out_relative_torque_rmse"]
    seconds, ratio = r["seconds"], r["times_as_long_as_smsid"]
    rows = [[name, f"{x:.3f}"] for name, x in errors.items()]
    friction = [
        [name, f"{x['value']:.3g} ± {1.96 * x['sigma']:.2g}", f"{x['published']:g}", f"{x['ratio']:.2f}"]
        for name, x in r["friction"].items()
    ]
    times = "; ".join(f"{k} {x:g} times as long" for k, x in ratio.items())
    viscous = [x["ratio"] for k, x in r["friction"].items() if k.endswith("viscous")]
    return (
        "## An industrial arm: Staubli TX40\n\n"
        f"`{r['command']}`; identified from {r['data']['train']}, judged on {r['data']['judged']}. From the\n"
        "command line: `smsid lab fetch staubli_tx40 -o data` and `smsid identify data/tx40.toml\n"
        "data/tx40.nc data/tx40_validation.nc --cutoff 100`.\n\n"
        + table(["model", "held-out torque error, relative"], rows)
        + f"\nWanted: below 0.16. One identification takes {seconds['smsid']['median']:.3g} s "
        f"at a load of {r['load_average']:g} on {r['environment']['cores']} cores; "
        f"{times} (in one\n"
        "run, taken in turn; both from joint angles and torques to parameters, FIGAROH 1.0.2 without its\n"
        "report). FIGAROH's example has no wrist coupling; the second line gives it those columns.\n\n"
        + table(["friction at the joint", "identified", "published with the data", "ratio"], friction)
        + f"\nViscous values are within {100 * max(abs(x - 1) for x in viscous):.1f} % of the published ones "
        "(wanted: 10 %). Of joints 5 and 6 they\ninclude the coupled motor's share.\n\n"
        + tx40_diagnosis(r["diagnosis"], r["diagnosis_by_cutoff"])
    )


RELATIVE = "held_out_relative_torque_rmse"


def _at_cutoffs(found: dict[str, Any]) -> str:
    """How the diagnosis depends on where its motion is low-passed."""
    rows = [
        [f"{cutoff} Hz", str(x["causes"]), "yes" if x["coupling"] else "no", f"{x[RELATIVE]:.3f}"]
        for cutoff, x in found.items()
    ]
    return (
        "With `--cutoff` of the motion (torques are compared up to 0.4 times that, 25 Hz at most):"
        "\n\n"
        + table(["cut-off", "causes", "wrist's coupling named", "held-out error, extended"], rows)
        + "\n"
    )


def tx40_diagnosis(d: dict[str, Any], by_cutoff: dict[str, Any]) -> str:
    """What the diagnosis names from the bare URDF."""
    causes = [
        [
            c["effect"].replace("_", " "),
            c["location"],
            c["shape"] or f"{c['family']}, shape open",
            ", ".join(
                f"{p['name'].rpartition('.')[2]} {p['value']:.3g} ± {1.96 * p['sigma']:.2g} {p['unit']}"
                for p in c["parameters"]
            ),
        ]
        for c in d["causes"]
    ]
    viscous = [
        [k, f"{x['value']:.3g} ± {1.96 * x['sigma']:.2g}", f"{x['published']:g}", f"{x['ratio']:.2f}"]
        for k, x in d["viscous"].items()
    ]
    left = [[x["where"], x["dependence"], f"{x['p_value']:.1e}"] for x in d["remaining"]]
    held = d["held_out_relative_torque_rmse"]
    worst = max(abs(x["ratio"] - 1) for k, x in d["viscous"].items() if "coulomb" not in k)
    return (
        "### Diagnosis from the bare URDF\n\n"
        "`smsid diagnose data/tx40_rigid.toml data/tx40.nc --validate data/tx40_validation.nc`:\n"
        "measured angles and torques alone, links identified along. In the order of finding:\n\n"
        + table(["effect", "where", "shape", "values"], causes)
        + "\nFriction with the coupled motor's share beside what is published:\n\n"
        + table(["", "named", "published", "ratio"], viscous)
        + f"\nViscous values and the coupling's are within {100 * worst:.1f} % (wanted: 10 %). Held-out "
        f"torque error: {held['given']:.3f} as\ndescribed, {held['extended']:.3f} extended, in the band in "
        f"which the diagnosis compares torques. It takes {d['seconds_of_cpu']:g} s.\n"
        + _at_cutoffs(by_cutoff)
        + (
            f"The verdict is *{d['verdict']}*: no candidate explains what else depends on something:\n\n"
            + table(["what is left of", "depends on", "p, corrected"], left)
            if left
            else f"The verdict is *{d['verdict']}*.\n"
        )
    )


def _named(d: dict[str, Any]) -> str:
    """A diagnosis in one paragraph."""
    left = "; ".join(f"{x['where']} on {x['dependence']}" for x in d["remaining"])
    names = ", ".join(
        f"*{c['shape']}* ("
        + ", ".join(
            f"{p['name'].rpartition('.')[2].replace('_', ' ')} {p['value']:.4g} ± {1.96 * p['sigma']:.2g} "
            f"{p['unit']}"
            for p in c["parameters"]
        )
        + ")"
        for c in d["causes"]
    )
    return (
        f"\nThe diagnosis names, in this order: {names}. Verdict: *{d['verdict']}*"
        + (f"; still significant: {left}" if left else "")
        + ".\n"
    )


def silverbox(r: dict[str, Any]) -> str:
    rows = [
        [k, f"{m['arrow_free_run_rmse_mV']:.3f}", f"{m['multisines_rmse_mV']:.3f}"]
        for k, m in r["models"].items()
    ]
    best = list(r["models"].values())[-1]["arrow_free_run_rmse_mV"]
    return (
        "## A hardening spring: Silverbox\n\n"
        f"`{r['command']}`; fitted on the ten multisines, judged free-running on the arrow. From "
        "the command\n"
        "line: `smsid lab fetch silverbox -o data` and `smsid lab oscillator data/silverbox.nc "
        "--frequency 68\n"
        "--validate data/silverbox_validation.nc --diagnose diagnosis.json`.\n\n"
        + table(["model", "error on the arrow [mV]", "on the multisines [mV]"], rows)
        + _named(r["diagnosis"])
        + "\nWanted: below 1 mV, at best the 0.3 mV of good published models. "
        "Only the multisines were searched and fitted.\n"
        + (f"{best:.2f} mV is reached; 0.3 mV is not.\n" if best > 0.3 else "Reached.\n")
    )


def antisloshing(r: dict[str, Any]) -> str:
    named = r["models"][r["named"]]["parameters"]
    theory = r["theory"]
    rows = [
        [k, f"{m['ring_down_residual_N']:.4f}", f"{m['moving_residual_N']:.3f}"]
        for k, m in r["models"].items()
    ]
    values = [
        [k.replace("_", " "), interval(p), p["unit"]]
        for k, p in named.items()
        if k in ("frequency", "damping", "slosh_mass", "rigid_mass", "lag", "softening")
    ]
    bound = [f"{k}: {note}.\n" for k, m in r["models"].items() for note in m["notes"] if "at a bound" in note]
    lag = r["lag_by_cross_correlation_s"]
    quiet = r["models"][r["named"]]["before_move_residual_N"]
    off = 100 * (r["frequency_over_theory"] - 1.0), 100 * (r["mass_over_theory"] - 1.0)
    significant = "is" if r["amplitude_dependence_significant"] else "is not"
    return (
        "## Slosh: water in a cylinder carried by a robot\n\n"
        f"`{r['command']}`; or `smsid lab fetch antisloshing -o data` and `smsid lab tank\n"
        "data/antisloshing.nc --force hand.force.y --arm data/antisloshing.toml --frame axes_6.y\n"
        "--diagnose diagnosis.json`.\n\n"
        + table(["model", "force left ringing down [N]", "while moving [N]"], rows)
        + "".join(f"\n{line}" for line in bound)
        + f"\nFrom the rigid start the data ask for *{r['named']}*, each step significant at 1 %:\n\n"
        + table(["parameter", "value", "unit"], values)
        + f"\nTheory (Abramson 1966) says {theory['frequency_Hz']:.3f} Hz and "
        f"{theory['mass_kg']:.4f} kg: off by "
        f"{off[0]:+.2f} % and {off[1]:+.2f} % (wanted:\nwithin 0.5 % and 6 %). The force comes "
        f"{1e3 * named['lag']['value']:.0f} ms behind the motion by the fit, {interval(lag, 3)} s by\n"
        "cross-correlation without a model. That the frequency depends on amplitude "
        f"{significant} significant.\n"
        + _named(r["diagnosis"])
        + f"\nRinging down, {r['models'][r['named']]['ring_down_residual_N']:.3f} N are left, where "
        "before the move, "
        f"with nothing sloshing, {quiet:.3f} N are.\n"
    )


def slab(r: dict[str, Any]) -> str:
    rows = []
    for k, (m, p, agrees) in enumerate(
        zip(r["modes"], r["pyoma2"], r["pyoma2_within_interval"], strict=True), start=1
    ):
        low, high = m["interval_95_Hz"]
        rows.append(
            [
                str(k),
                f"{m['frequency_Hz']:.2f} [{low:.2f}, {high:.2f}]",
                f"{m['damping']:.4f} ± {1.96 * m['damping_sigma']:.4f}",
                f"{p['frequency_Hz']:.2f}",
                f"{p['damping']:.4f}",
                "yes" if agrees else "no",
                f"{m['kurtosis']:.0f}",
            ]
        )
    apart = [interval(s, 3) for s in r["separations_Hz"]]
    decays = [
        [k, f"{100 * x['left']:.1f} %", ", ".join(f"{v:g}" for v in x["parameters"])]
        for k, x in r["free_decays"].items()
        if k != "number"
    ]
    head = ["mode", "frequency [Hz]", "damping", "pyOMA-2 [Hz]", "its damping", "within", "kurtosis"]
    return (
        "## Close modes: a concrete slab\n\n"
        f"`{r['command']}`; or `smsid lab fetch cessipy_slab -o data` and `smsid lab modal\n"
        "data/cessipy_slab.nc --highest 24`.\n\n"
        + table(head, rows)
        + f"\nThe two are {', '.join(apart)} Hz apart: their intervals overlap, but they move "
        "together, and their\n"
        "distance is significant. Harmonics of the excitation: "
        f"{len(r['harmonics_Hz']) or 'none'}. A kurtosis "
        "far above 3 says that a few\nimpacts carry the record, here three hard steps: the "
        "intervals are wide "
        "because the record holds no more.\nThe free decays after them, fitted by themselves:\n\n"
        + table(["model of the decays", "left", "frequency [Hz], damping, ..."], decays)
        + "\nOne linear mode is not enough, and two explain the decays best. Between the hard steps, at a "
        "tenth of\nthe amplitude, SSI-COV finds "
        + " and ".join(
            f"{m['frequency_Hz']:.2f} Hz "
            f"[{m['interval_95_Hz'][0]:.2f}, {m['interval_95_Hz'][1]:.2f}], damping {m['damping']:.3f}"
            for m in r["modes_between_the_hard_steps"]
        )
        + ".\nWhether the slab has two modes or one whose frequency falls with amplitude this record cannot "
        "say for certain.\n"
    )


def main() -> None:
    atomic_write(PAGE, page())
    print(PAGE)


if __name__ == "__main__":
    main()
