"""``smsid lab tank``: slosh from force and motion of a container."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.inputs import print_estimate, write_diagnosis, write_page
from smsid.cli.options import EstimateOutput, LabDiagnosis, LabRecording, ReportPath
from smsid.cli.output import say, working
from smsid.errors import RecordingError

if TYPE_CHECKING:
    import numpy as np

    from smsid.recording import Recording


def tank(
    recording: LabRecording,
    force: Annotated[
        str, typer.Option(help="channel of the force on the container, with axis: hand.force.y")
    ],
    position: Annotated[
        str | None, typer.Option(help="channel of its position, with axis: pose.position.y")
    ] = None,
    arm: Annotated[
        Path | None, typer.Option(help="instead of --position: welded arm that carries it (TOML) ...")
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="... the frame of the arm it is at, with axis: tool.y")
    ] = None,
    cutoff: Annotated[float, typer.Option(help="zero-phase low-pass [Hz], above the third harmonic")] = 15.0,
    models: Annotated[
        str, typer.Option(help="models to compare, simplest first")
    ] = "rigid,slosh,softening spring,softening inertia",
    diagnose: LabDiagnosis = None,
    output: EstimateOutput = Path("tank.json"),
    report: ReportPath = None,
) -> Outcome:
    """Slosh from force and motion of a container: frequency, damping, mass, lag, and what is left."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.tank import tank_test
    from smsid.lab.tank_models import MODELS, compare_tank_models
    from smsid.recording import load_recording
    from smsid.report.tank import tank_report

    asked = models.split(",")
    unknown = [m for m in asked if m not in MODELS]
    if unknown:
        raise RecordingError(f"There is no model '{unknown[0]}'.", advice=f"Choose of {', '.join(MODELS)}.")

    log = load_recording(recording)
    if (position is None) == (arm is None) or (arm is None) != (frame is None):
        raise RecordingError(
            "The motion of the container is not stated.", advice="Give --position, or --arm and --frame."
        )
    if position is not None:
        motion = _component(log, position)
    else:
        assert arm is not None and frame is not None
        motion = _carried(log, arm, frame)
    with working("comparing models of the tank"):
        test = tank_test(_component(log, force), motion, cutoff=cutoff)
        found = compare_tank_models(test, [m for m in MODELS if m in asked])
    best = found.fits[found.named]
    save_estimate(best.estimate, output)
    print_estimate(best.estimate)
    low, high = test.lag.interval
    say(f"force behind motion by cross-correlation: {test.lag.value:.4g} s [{low:.4g}, {high:.4g}]")
    quiet = best.quiet(test)
    for model, fit in found.fits.items():
        mark = "named" if model == found.named else ""
        say(f"{model:18s} left: {fit.ring_down:.4g} N ringing down, {fit.moving:.4g} N moving  {mark}")
    if quiet == quiet:  # there are samples before it
        say(f"before the motion {quiet:.4g} N are left")
    written = [output]
    if diagnose is not None:
        from smsid.lab.tank_diagnosis import tank_diagnosis

        written.append(write_diagnosis(tank_diagnosis(test, found, log.name), diagnose))
    written += write_page(report, lambda o: tank_report(log.name, test, found, o), [recording, arm])
    left = {
        model: {"ring_down": fit.ring_down, "moving": fit.moving, "unit": "N"}
        for model, fit in found.fits.items()
    }
    lag = {"value": test.lag.value, "interval": [low, high], "unit": "s"}
    document = {"named": found.named, "lag": lag, "left": left, "left_at_rest": {"value": quiet, "unit": "N"}}
    return Outcome({"estimate": json.loads(best.estimate.to_json()), **document}, written)


def _component(log: Recording, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and samples of one axis of a channel, ``hand.force.y``."""
    channel, _, axis = name.rpartition(".")
    if axis not in ("x", "y", "z") or channel not in log:
        raise RecordingError(
            f"'{name}' is no axis of a channel.",
            advice=f"Write <channel>.x, .y or .z, of {', '.join(log.channels)}.",
            channel=name,
        )
    return log.time(channel), log[channel][:, "xyz".index(axis)]


def _carried(log: Recording, arm: Path, frame: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and position along one axis of the ground of a frame that an arm carries."""
    import numpy as np
    import pinocchio as pin

    from smsid.arm.joints import with_joint_order
    from smsid.arm.motion import measured_channel
    from smsid.description import load_description
    from smsid.effects.assembly import find_frame
    from smsid.model import build_model

    name, _, axis = frame.rpartition(".")
    if axis not in ("x", "y", "z"):
        raise RecordingError(f"'{frame}' names no axis.", advice="Write <frame>.x, .y or .z.")
    model = build_model(load_description(arm))
    index = find_frame(model.pin, name)
    channel = measured_channel(log, "joint_position")
    log = with_joint_order(model, log)
    out = []
    for angles in log[channel]:
        pin.framesForwardKinematics(model.pin, model.data, model.set_joint_angles(model.home, angles))
        out.append(model.data.oMf[index].translation["xyz".index(axis)])
    return log.time(channel), np.array(out)
