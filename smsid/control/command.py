"""``smsid control``: design a controller for a description and an estimate, or repeat the paper's Table 4."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from smsid.control.robust_term import RobustTerm
from smsid.errors import ControlError

console = Console()


def control_command(
    description: Annotated[Path, typer.Argument(help="description of the spacecraft: a TOML")],
    estimate: Annotated[
        Path | None, typer.Argument(help="estimate (JSON) that `smsid identify` wrote")
    ] = None,
    gains: Annotated[str, typer.Option(help="K_P,K_D, the same for all coordinates [1/s^2, 1/s]")] = "4,4",
    uncertainty: Annotated[
        float | None, typer.Option(help="stated uncertainty level, 0.05 for 5 %, instead of the estimate's")
    ] = None,
    crossover: Annotated[
        float, typer.Option(help="where delay and unmodelled dynamics take over [rad/s]")
    ] = 10.0,
    rate: Annotated[float, typer.Option(help="of the controller [Hz]")] = 100.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="file to write, whole or not at all")] = Path(
        "controller.json"
    ),
    study: Annotated[
        str | None, typer.Option(help="table4: fly the paper's cases instead of designing")
    ] = None,
    draws: Annotated[int, typer.Option(help="flights per case of the study")] = 5,
) -> None:
    """Design model-based PD with an H-infinity term from what is identified, or repeat Table 4."""
    if study is not None:
        if study != "table4":
            raise ControlError(f"There is no study '{study}'.", advice="Use --study table4.")
        _study(description, estimate, draws, output)
        return
    from smsid.control.controller_file import save_controller
    from smsid.control.disturbance import left_out, sensor_noise
    from smsid.control.gains import gains as make_gains
    from smsid.control.reduced import ReducedDynamics
    from smsid.control.robust_term import design_robust_term
    from smsid.control.trajectory import PAPER_ACCELERATION, Reference, check_joints, trapezoid
    from smsid.control.weights import weights_from_level
    from smsid.description import load_description
    from smsid.model import build_model

    proportional, derivative = _pair(gains)
    level = _level(estimate, uncertainty)
    model = build_model(load_description(description))
    size = ReducedDynamics(model).size
    k = make_gains(size, proportional, derivative)
    motion = trapezoid(model.joint_angles(model.home))
    check_joints(motion, model)
    angle, speed = sensor_noise(model.description.sensor, size - 3, rate, crossover)
    weights = weights_from_level(
        level,
        np.concatenate([np.zeros(3), np.full(size - 3, PAPER_ACCELERATION)]),
        left_out=left_out(model, k, Reference(motion), rate=rate),
        angle_noise=angle,
        rate_noise=speed,
        crossover=crossover,
    )
    term = design_robust_term(k, weights)
    names = ("roll", "pitch", "yaw", *model.arm_joints.names)
    save_controller(term, output, model.description.name, names)
    console.print(_report(term, names))
    for line in weights.origin:
        console.print(line)
    console.print(f"wrote {output}")


def _pair(text: str) -> tuple[float, float]:
    try:
        proportional, derivative = (float(x) for x in text.split(","))
    except ValueError as error:
        raise ControlError(
            f"'{text}' is no pair of gains.", advice="Give K_P,K_D, for instance --gains 4,4."
        ) from error
    return proportional, derivative


def _level(estimate: Path | None, stated: float | None) -> float:
    """Return the stated uncertainty level, or that of the estimate."""
    from smsid.control.weights import level_of_estimate
    from smsid.identify.estimate import load_estimate

    if stated is not None:
        return stated
    if estimate is None:
        raise ControlError(
            "Neither an estimate nor an uncertainty is given.",
            advice="Pass the JSON that `smsid identify` wrote, or --uncertainty 0.05.",
        )
    return level_of_estimate(load_estimate(estimate))


def _report(term: RobustTerm, names: tuple[str, ...]) -> Table:
    table = Table(
        "coordinates", "gamma", "bound on e [rad]", "S peak", "T peak", "gain margin", "phase margin"
    )
    for b in term.blocks:
        low, high = b.gain_margin
        table.add_row(
            ", ".join(names[k] for k in b.coordinates),
            f"{b.synthesis.norm:.4f}",
            f"{b.error.max():.2e}",
            f"{b.sensitivity:.2f}",
            f"{b.complementary:.2f}",
            f"{low:.2f} to {high:.2f}",
            f"{b.phase_margin:.0f} deg",
        )
    return table


def _study(description: Path, estimate: Path | None, draws: int, output: Path) -> None:
    from smsid._files import atomic_write
    from smsid.control.table4 import (
        CONTROLLERS,
        IDENTIFIED_LEVEL,
        Study,
        Variant,
        cases,
        improvements,
        orderings,
        summarise,
    )
    from smsid.description import load_description
    from smsid.model import build_model

    if draws < 1:
        raise ControlError(f"{draws} draws are no study.", advice="Give at least one.")
    level = IDENTIFIED_LEVEL if estimate is None else _level(estimate, None)
    chosen = cases(level)
    study = Study(build_model(load_description(description)), Variant())
    runs = []
    with console.status("flying") as status:
        for draw in range(draws):
            for case in chosen:
                for controller in CONTROLLERS:
                    status.update(f"draw {draw + 1} of {draws}, case {case.name}, {controller}")
                    runs.append(study.fly(case, controller, draw))
    rows = summarise(runs, chosen)
    table = Table("case", "controller", "e_b [rad]", "95 %", "paper", "e_i [rad]", "95 %", "paper")
    for row in rows:
        cells = [str(row["case"]), str(row["controller"])]
        for name in ("base", "joints"):
            found = row[f"e_{name}"]
            assert isinstance(found, dict)
            low, high = found["interval"]
            printed = row.get(f"e_{name}_paper")
            cells += [
                f"{found['median']:.2e}",
                f"{low:.1e} .. {high:.1e}",
                f"{printed:.2e}" if printed else "-",
            ]
        table.add_row(*cells)
    console.print(table)
    for claim in orderings(runs):
        console.print(
            f"{claim['smaller']} < {claim['larger']}: e_b {_verdict(claim['e_base'])}, "
            f"e_i {_verdict(claim['e_joints'])}"
        )
    result = {
        "identified_level": level,
        "rows": rows,
        "orderings": orderings(runs),
        "improvements": improvements(runs),
    }
    atomic_write(output, json.dumps(result, indent=1, allow_nan=False) + "\n")
    console.print(f"wrote {output}")


def _verdict(found: object) -> str:
    assert isinstance(found, dict)
    share, ratio = 100.0 * found["share"], found["median_ratio"]
    return f"{found['verdict']} ({share:.0f} % of draws, median ratio {ratio:.2f})"
