"""How much smaller the H-infinity term makes errors, by design: ``python benchmarks/hinf_benefit.py``.

The paper's Table 4 has e_b 6.2 and e_i 4.6 times smaller in case D, 44 and 27 times in case A. Which of the
things it leaves open reaches that: the rate of the controller, the crossover (the gain allowed at high
frequency), the corner below which the error weighs more, how much noise is allowed for, a filtered gyro?
Each is flown on the complete spacecraft with an integrated gyro's noise (attitude 2e-6 rad, gyro 1e-6 rad/s),
case D with models identified from another engine's recordings, and told beside what it costs: torque, wheels
at their limit, margins, the damping that slosh and panel keep. Resumable: a row is a line of
``build/hinf_benefit.jsonl``. Some 8 minutes of processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402
from _table4_identified import identified  # noqa: E402

from smsid.control._robust import flexible_plant, least_damping, named_poles  # noqa: E402
from smsid.control.closed_loop import (  # noqa: E402
    left_out,
    sensor_noise,
    track_many,
)
from smsid.control.gains import gains  # noqa: E402
from smsid.control.identified_model import inertia_at  # noqa: E402
from smsid.control.pd import ModelBasedController  # noqa: E402
from smsid.control.reduced import ReducedDynamics  # noqa: E402
from smsid.control.robust_term import (  # noqa: E402
    RobustTerm,
    design_robust_term,
    guarded_term,
)
from smsid.control.trajectory import PAPER_ACCELERATION  # noqa: E402
from smsid.control.weights import weights_from_level  # noqa: E402
from smsid.description import load_description  # noqa: E402
from smsid.errors import SmsidError  # noqa: E402
from smsid.model import build_model  # noqa: E402
from smsid.paper.table4 import DESIGN_LEVEL, Study, Variant, cases  # noqa: E402

STORE = ROOT / "build" / "hinf_benefit.jsonl"
ATTITUDE, GYRO = 2e-6, 1e-6  # [rad], [rad/s] of a sample
PAPER = {"D": {"e_b": 6.2, "e_i": 4.6}, "A1.6": {"e_b": 44.0, "e_i": 27.0}}
DEGREE = 180.0 / np.pi


@dataclass(frozen=True)
class Design:
    """A design: ``rate`` [Hz], ``crossover``, ``integral`` [rad/s], share of the ``noise`` allowed for.

    ``quieter``: of the sensors' noise, for a gyro that is filtered or samples that are averaged; ``density``:
    noise per sample grows with the root of the rate, as that of sensors with a fixed noise density.
    ``guarded``: slosh and panel keep their damping, as `smsid control` designs.
    """

    name: str
    rate: float = 20.0
    crossover: float = 10.0
    integral: float = 0.05
    noise: float = 1.0
    quieter: float = 1.0
    delay: int = 0
    density: bool = False
    guarded: bool = False


DESIGNS = (
    Design("as Table 4 was flown"),
    Design("20 Hz, error weighs more below 0.3 rad/s", integral=0.3),
    Design("20 Hz, crossover 20 rad/s", crossover=20.0),
    Design("20 Hz, a third of the noise allowed for", noise=0.3),
    Design("20 Hz, gyro averaged over 5 samples, a call late", quieter=5.0**-0.5, delay=1),
    Design("50 Hz", rate=50.0),
    Design("100 Hz", rate=100.0),
    Design("100 Hz, crossover 40 rad/s", rate=100.0, crossover=40.0),
    Design("100 Hz, crossover 40 rad/s, half the noise", 100.0, 40.0, quieter=0.5),
    Design("100 Hz, crossover 40 rad/s, the same noise density", 100.0, 40.0, density=True),
    Design("100 Hz, crossover 40 rad/s, modes keep their damping", 100.0, 40.0, guarded=True),
    Design("100 Hz, error weighs more below 0.3 rad/s", rate=100.0, integral=0.3),
    Design("100 Hz, crossover 40 rad/s, a third of the noise allowed for", 100.0, 40.0, noise=0.3),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop starting flights after this long")
    parser.add_argument("--store", type=Path, default=STORE)
    options = parser.parse_args()
    begin = time.monotonic()
    options.store.parent.mkdir(parents=True, exist_ok=True)
    read = options.store.read_text(encoding="utf-8").splitlines() if options.store.is_file() else []
    rows = [row for row in map(json.loads, read) if row["draws"] == options.draws]
    model = build_model(load_description(ROOT / "urdf" / "paper_sms.toml"))
    models = identified(ReducedDynamics(model))
    with options.store.open("a", encoding="utf-8") as file:
        for design in DESIGNS:
            for case in ("D", "A1.6"):
                asked = {**asdict(design), "case": case, "draws": options.draws}
                if any(all(row[k] == v for k, v in asked.items()) for row in rows):
                    continue
                if time.monotonic() - begin > 60.0 * options.minutes:
                    continue
                row = asked | flown(model, models, design, case, options.draws)
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()
                print(told(row), flush=True)
    order = {d.name: i for i, d in enumerate(DESIGNS)}
    rows = sorted((r for r in rows if r["name"] in order), key=lambda r: (r["case"] != "D", order[r["name"]]))
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "seed": "draw number",
        "attitude_noise": ATTITUDE,
        "gyro_noise": GYRO,
        "paper_ratios": PAPER,
        "errors_in": "deg, median over draws of the largest error of a flight",
        "not_flown": [
            f"{c}, {d.name}"
            for d in DESIGNS
            for c in ("D", "A1.6")
            if (d.name, c) not in {(r["name"], r["case"]) for r in rows}
        ],
        "rows": rows,
    }
    print(write_result("hinf_benefit", result))


def flown(model, models, design: Design, case: str, draws: int) -> dict[str, Any]:
    """Return errors of PD and H-infinity, their ratios, and what the H-infinity term costs."""
    chosen = next(c for c in cases() if c.name == case)
    louder = np.sqrt(design.rate / 20.0) if design.density else 1.0
    factor = design.quieter * louder
    variant = Variant(
        "gyro",
        noise=louder,  # of the encoders
        rate=design.rate,
        delay=design.delay,
        attitude_noise=ATTITUDE * factor / louder,
        gyro_noise=GYRO * factor / louder,
    )
    study = Study(model, variant, identified=models)
    try:
        term = designed(study, chosen, design)
    except SmsidError as error:
        return {"failed": str(error)}
    pd, robust = fly(study, chosen, None, draws), fly(study, chosen, term, draws)
    quiet = [fly(study, chosen, t, 1, quiet=True) for t in (None, term)]
    home = model.joint_angles(model.home)
    plant, inertia = flexible_plant(model, home), inertia_at(study.dynamics, home)
    poles = named_poles(plant, inertia, term.gains, term.controller)
    own = least_damping(plant)
    kept = min((p.damping / own[p.name] for p in poles if p.name in own and p.value.imag > 0.0), default=None)
    out: dict[str, Any] = {
        "crossovers": [round(b.crossover, 1) for b in term.blocks],
        "damping_kept": None if kept is None else round(float(kept), 3),
        "phase_margin": round(min(b.phase_margin for b in term.blocks), 1),
        "sensitivity_peak": round(max(b.sensitivity for b in term.blocks), 2),
    }
    for label, runs in (
        ("pd", pd),
        ("hinf", robust),
        ("pd, no noise", quiet[0]),
        ("hinf, no noise", quiet[1]),
    ):
        out[label] = {
            "e_b": digits(np.median([r.base for r in runs]) * DEGREE),
            "e_i": digits(np.median([r.joints for r in runs]) * DEGREE),
            "wheel_torque_rms": digits(np.median([r.torques[:, :3].std() for r in runs])),
            "wheel_torque_largest": digits(np.median([np.abs(r.torques[:, :3]).max() for r in runs])),
            "joint_torque_largest": digits(np.median([np.abs(r.torques[:, 3:]).max() for r in runs])),
            "flights_at_a_limit": sum(bool(r.saturated) for r in runs),
        }
    for suffix in ("", ", no noise"):
        a, b = out["pd" + suffix], out["hinf" + suffix]
        out["ratio" + suffix] = {k: digits(a[k] / b[k], 3) for k in ("e_b", "e_i")}
    return out


def designed(study: Study, case, design: Design) -> RobustTerm:
    """Return the H-infinity term of a design for a case's gains."""
    k = gains(study.dynamics.size, case.proportional, case.derivative)
    wanted = np.concatenate([np.zeros(3), np.full(k.size - 3, PAPER_ACCELERATION)])
    angle, rate = sensor_noise(study.sensors, k.size - 3, design.rate, design.crossover)
    weights = weights_from_level(
        DESIGN_LEVEL,
        wanted,
        left_out=left_out(study.model, k, study.reference, rate=design.rate),
        angle_noise=design.noise * angle,
        rate_noise=design.noise * rate,
        crossover=design.crossover,
        integral=design.integral,
    )
    if not design.guarded:
        return design_robust_term(k, weights)
    home = study.model.joint_angles(study.model.home)
    return guarded_term(flexible_plant(study.model, home), inertia_at(study.dynamics, home), k, weights)[0]


def fly(study: Study, case, term: RobustTerm | None, draws: int, *, quiet: bool = False):
    """Return flights of the first draws."""
    rate = study.variant.rate
    k = gains(study.dynamics.size, case.proportional, case.derivative)
    laws = [
        ModelBasedController(
            study._law(case, "pd", d).dynamics, k, study.reference, robust=term, period=1.0 / rate
        )
        for d in range(draws)
    ]
    return track_many(
        study.model,
        laws,
        rate=rate,
        delay=study.variant.delay,
        sensors=None if quiet else study.sensors,
        generators=None if quiet else [np.random.default_rng([d, 2]) for d in range(draws)],
    )


def told(row: dict[str, Any]) -> str:
    if "failed" in row:
        return f"{row['case']}, {row['name']}: {row['failed']}"
    r, q, h = row["ratio"], row["ratio, no noise"], row["hinf"]
    return (
        f"{row['case']}, {row['name']}: e_b {r['e_b']}, e_i {r['e_i']} times smaller (no noise {q['e_b']}, "
        f"{q['e_i']}); wheels {h['wheel_torque_rms']} N m rms, {h['flights_at_a_limit']} at a limit, damping "
        f"kept {row['damping_kept']}"
    )


def digits(x: float, count: int = 4) -> float:
    return float(f"{float(x):.{count}g}")


if __name__ == "__main__":
    main()
