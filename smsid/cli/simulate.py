"""``smsid simulate``: fly an experiment and record it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.options import DescriptionPath, RecordingOutput, Seed, ShowAll
from smsid.cli.output import print_parts, say, show_progress, warn
from smsid.cli.places import Writes
from smsid.errors import SmsidError


def simulate_command(
    description: DescriptionPath,
    experiment: Annotated[
        str,
        typer.Argument(
            help="exp1, exp1_x, exp1_z, exp1_xyz, exp2, exp2val, or a TOML; with --controller also trapezoid"
        ),
    ],
    output: RecordingOutput = Path("recording.nc"),
    seed: Seed = 1,
    role: Annotated[
        Literal["estimation", "validation"], typer.Option(help="what the recording may be used for")
    ] = "estimation",
    save_experiment_to: Annotated[
        Path | None,
        typer.Option("--save-experiment", help="also write the experiment as a TOML"),
        Writes((".toml",)),
    ] = None,
    controller: Annotated[
        Path | None,
        typer.Option(
            help="JSON that `smsid control` wrote: by it wheels hold the attitude, joints follow the motion"
        ),
    ] = None,
    show_all: ShowAll = False,
) -> CommandResult:
    """Fly an experiment in simulation and record it with the description's sensors."""
    import numpy as np

    from smsid.cli.tables import cut_tables, limits_table
    from smsid.description import load_description
    from smsid.experiments import Experiment, fly, momentum_condition, named_experiment, save_experiment
    from smsid.model import build_model
    from smsid.recording import save_recording

    model = build_model(load_description(description))
    if experiment == "trapezoid" and controller is None:
        raise SmsidError(
            "'trapezoid' is a motion that a controller follows.",
            advice="Give --controller, the JSON that `smsid control` wrote.",
        )
    path = tracking = None
    if experiment == "trapezoid":
        from smsid.control.trajectory import design_motion

        path = design_motion(model)
        plan = Experiment(name=experiment, duration=path.duration)
    else:
        plan = named_experiment(experiment, model)
    with show_progress(f"simulating {plan.name}", plan.duration, "s") as tell:
        how: dict[str, Any] = {"role": role, "progress": tell}
        if controller is None:
            flight = fly(model, plan, np.random.default_rng(seed), **how)
        else:
            from smsid.control.controller_file import load_controller
            from smsid.control.recorded_flight import fly_controlled

            saved, rng = load_controller(controller), np.random.default_rng(seed)
            flown = fly_controlled(model, saved, plan, rng, path=path, **how)
            flight, tracking = flown.flight, flown.tracking
    audit = flight.trajectory.audit()
    recording = flight.recording.with_provenance({"seed": seed})
    save_recording(recording, output)
    written = [output]
    if save_experiment_to is not None:
        save_experiment(plan, save_experiment_to)
        written.append(save_experiment_to)
    # what is nearest to its limit comes first
    used = sorted(flight.limits, key=lambda u: -(abs(u.value) / u.limit if u.limit else 0.0))
    print_parts(cut_tables([limits_table(used)], show_all))
    say(
        f"momentum drift {audit.momentum_drift:.1e} (largest {audit.momentum_scale:.3g}), energy drift "
        f"{audit.energy_drift:.1e} J (of {audit.energy_scale:.3g} J), {flight.trajectory.steps} steps"
    )
    document = {
        "experiment": plan.name,
        "duration": {"value": plan.duration, "unit": "s"},
        "seed": seed,
        "limits": [{**asdict(use), "exceeded": use.exceeded} for use in flight.limits],
        "audit": asdict(audit),
    }
    if tracking is not None:
        say(f"largest errors: attitude {tracking.base:.2e} rad, joints {tracking.joints:.2e} rad")
        document["errors"] = {"attitude": tracking.base, "joints": tracking.joints, "unit": "rad"}
        document["saturated"] = tracking.saturated
        for name in ("wheel_torque", "joint_torque"):
            if getattr(plan, name) is not None:
                warn(f"{name} of '{plan.name}' is left out: the controller drives what it would drive")
        for name, count in tracking.saturated.items():
            warn(f"{name} at its limit in {count} of {len(tracking.time) - 1} calls of the controller")
    if plan.force is None and len(model.arm_joints):
        times = np.arange(flight.trajectory.start, flight.trajectory.stop, 0.1)
        states = flight.trajectory.states(times)
        condition = momentum_condition(model, states.q, states.v)
        say(f"condition number of the column-scaled momentum regressor: {condition:.0f}")
        document["condition"] = {"value": condition, "unit": "1"}
    for use in flight.exceeded:
        warn(f"{use} exceeded")
    return CommandResult(document, written)
