"""``smsid lab``: tests in the laboratory from the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import Output, writable
from smsid.cli.output import console, working
from smsid.errors import RecordingError

if TYPE_CHECKING:
    from rich.console import Console

    from smsid.description import Description
    from smsid.diagnose import Diagnosis
    from smsid.identify.estimate import Estimate
    from smsid.recording import Recording

lab_app = typer.Typer(
    name="lab",
    help="Tests in the laboratory: a tank that is moved, a structure that vibrates, a driven oscillator.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
RecordingPath = Annotated[Path, typer.Argument(help="recording (.nc of `smsid import` or `smsid lab fetch`)")]


Diagnose = Annotated[
    Path | None,
    typer.Option(
        callback=writable, help="name what the simplest model lacks, and write that as `smsid diagnose` does"
    ),
]


@lab_app.command()
def fetch(
    name: Annotated[str, typer.Argument(help="staubli_tx40, silverbox, antisloshing or cessipy_slab")],
    output: Annotated[Path, typer.Option("--output", "-o", help="folder for recordings and description")],
) -> Outcome:
    """Write a public data set as recordings (and descriptions): from SMSID_DATA, else downloaded."""
    from smsid.description import Description, save_description
    from smsid.recording import save_recording

    out, written = console(), []
    with working(f"fetching {name}"):
        parts = _parts(name)
    output.mkdir(parents=True, exist_ok=True)
    for file, part in parts.items():
        if isinstance(part, Description):
            save_description(part, output / file)
        else:
            save_recording(part, output / file)
        written.append(output / file)
        out.print(f"wrote {output / file}", markup=False, highlight=False, soft_wrap=True)
    return Outcome({"data_set": name}, written)


def _parts(name: str) -> dict[str, Description | Recording]:
    """A data set's descriptions and recordings by file name, cut where the benchmarks cut."""
    from smsid import datasets
    from smsid.arm import with_joint_effects
    from smsid.effects import MotorCoupling

    datasets.data_set(name)
    if name == "silverbox":
        train, held = datasets.silverbox()
        return {"silverbox.nc": train, "silverbox_validation.nc": held}
    if name == "cessipy_slab":
        return {"cessipy_slab.nc": datasets.cessipy_slab()}
    if name == "antisloshing":
        carrier, log = datasets.antisloshing()
        return {"antisloshing.toml": carrier, "antisloshing.nc": log}
    bare, log = datasets.tx40()
    times = log.time()
    kinds = ("joint_friction", "motor_inertia", "torque_offset")
    full = with_joint_effects(bare, log.labels["joint"], *kinds).with_effects(
        MotorCoupling(name="wrist", joints=("joint_5", "joint_6"))
    )
    return {
        "tx40_rigid.toml": bare,
        "tx40.toml": full,
        "tx40.nc": log.window(0.0, float(times[times < 6.0][-1])).with_role("estimation"),
        "tx40_validation.nc": log.window(6.0, float(times[-1])).with_role("validation"),
    }


@lab_app.command()
def tank(
    recording: RecordingPath,
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
    diagnose: Diagnose = None,
    output: Output = Path("tank.json"),
) -> Outcome:
    """Slosh from force and motion of a container: frequency, damping, mass, lag, and what is left."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.tank import tank_test
    from smsid.lab.tank_models import MODELS, compare_tank_models
    from smsid.recording import load_recording

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
    out = console()
    _print(out, best.estimate)
    low, high = test.lag.interval
    out.print(f"force behind motion by cross-correlation: {test.lag.value:.4g} s [{low:.4g}, {high:.4g}]")
    before = test.time < test.time[~test.at_rest][0]
    quiet = float(np.sqrt(np.mean(best.residual[before] ** 2)))
    for model, fit in found.fits.items():
        mark = "named" if model == found.named else ""
        out.print(f"{model:18s} left: {fit.ring_down:.4g} N ringing down, {fit.moving:.4g} N moving  {mark}")
    out.print(f"before the motion {quiet:.4g} N are left")
    written = [output]
    if diagnose is not None:
        from smsid.lab.tank_diagnosis import tank_diagnosis

        written.append(_diagnosed(tank_diagnosis(test, found, log.name), diagnose))
    out.print(f"wrote {', '.join(map(str, written))}", markup=False, highlight=False, soft_wrap=True)
    left = {
        model: {"ring_down": fit.ring_down, "moving": fit.moving, "unit": "N"}
        for model, fit in found.fits.items()
    }
    lag = {"value": test.lag.value, "interval": [low, high], "unit": "s"}
    document = {"named": found.named, "lag": lag, "left": left, "left_at_rest": {"value": quiet, "unit": "N"}}
    return Outcome({"estimate": json.loads(best.estimate.to_json()), **document}, written)


@lab_app.command()
def modal(
    recording: RecordingPath,
    highest: Annotated[float, typer.Option(help="highest frequency sought [Hz]")],
    channel: Annotated[str | None, typer.Option(help="channel of the outputs; default the only one")] = None,
    seed: Annotated[int, typer.Option(help="of the resampling")] = 0,
    output: Output = Path("modes.json"),
) -> Outcome:
    """Modes of a structure from its vibration alone: no order to pick, harmonics told apart."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.modal import ambient_modes
    from smsid.recording import load_recording

    log = load_recording(recording)
    if channel is None and len(log.channels) != 1:
        raise RecordingError(
            f"The recording has {len(log.channels)} channels.",
            advice=f"Choose with --channel one of {', '.join(log.channels)}.",
        )
    name = channel or log.channels[0]
    log.require(name)
    times = log.time(name)
    rate = (times.size - 1) / (times[-1] - times[0])
    even = log.resampled(rate)[name]
    with working("looking for modes"):
        found = ambient_modes(
            even.reshape(len(even), -1), rate, highest_frequency=highest, rng=np.random.default_rng(seed)
        )
    estimate = found.estimate(log.name)
    save_estimate(estimate, output)
    out = console()
    _print(out, estimate)
    for k, mode in enumerate(found.modes, start=1):
        if mode.impulsive:
            out.print(f"mode{k}: kurtosis {mode.kurtosis:.0f}: a few impacts carry the record")
    for f in found.harmonics:
        out.print(f"{f:.4g} Hz is a harmonic of the excitation, no mode")
    out.print(f"wrote {output}", markup=False, highlight=False, soft_wrap=True)
    harmonics = [{"value": float(f), "unit": "Hz"} for f in found.harmonics]
    return Outcome({"estimate": json.loads(estimate.to_json()), "harmonics": harmonics}, [output])


@lab_app.command()
def oscillator(
    recording: RecordingPath,
    frequency: Annotated[float, typer.Option(help="first guess [Hz]")],
    drive: Annotated[str, typer.Option("--input", help="channel of the drive")] = "extra.input",
    answer: Annotated[str, typer.Option("--output-channel", help="channel of the output")] = "extra.output",
    terms: Annotated[str, typer.Option(help="beyond linear: quadratic,cubic,quintic,damping_growth")] = "",
    damping: Annotated[float, typer.Option(help="first guess")] = 0.05,
    validate: Annotated[Path | None, typer.Option(help="recording to judge by, free-running")] = None,
    diagnose: Diagnose = None,
    output: Output = Path("oscillator.json"),
) -> Outcome:
    """Driven oscillator with a spring that need not be linear, by the error of its simulation."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.oscillator import Oscillator, fit_oscillator
    from smsid.recording import load_recording

    log = load_recording(recording)
    log.require(drive, answer)
    times = log.time(drive)
    rate = (times.size - 1) / (times[-1] - times[0])
    chosen = tuple(t for t in terms.split(",") if t)
    unit = log.unit(answer)
    run_in = 8.0 / (2 * np.pi * frequency * damping) * rate
    pieces = int(np.clip(times.size / (5.0 * run_in), 1, 10))
    u, y, start = log[drive], log[answer], Oscillator(frequency, damping, 1.0)
    written = [output]
    with working("fitting the oscillator"):
        if diagnose is not None:
            from smsid.lab.oscillator_diagnosis import diagnose_oscillator

            held = None
            if validate is not None:
                judge = load_recording(validate)
                held = judge.name, judge[drive], judge[answer]
            told = diagnose_oscillator(u, y, rate, start, unit=unit, pieces=pieces, validation=held)
            found = told.best
            written.append(_diagnosed(told.diagnosis, diagnose))
        else:
            found = fit_oscillator(u, y, rate, start, unit=unit, pieces=pieces)
        if chosen and diagnose is None:
            found = fit_oscillator(u, y, rate, found.oscillator, terms=chosen, unit=unit, pieces=pieces)
    save_estimate(found.estimate, output)
    out = console()
    _print(out, found.estimate)
    out.print(f"simulation error {found.rmse:.5g} {unit} on '{log.name}'")
    errors = {"simulation": {"recording": log.name, "value": found.rmse, "unit": unit}}
    if validate is not None:
        other = load_recording(validate)
        error = other[answer] - found.oscillator.simulate(other[drive], rate)
        free = float(np.sqrt(np.mean(error**2)))
        out.print(f"free-running error {free:.5g} {unit} on '{other.name}'")
        errors["free_running"] = {"recording": other.name, "value": free, "unit": unit}
    out.print(f"wrote {', '.join(map(str, written))}", markup=False, highlight=False, soft_wrap=True)
    return Outcome({"estimate": json.loads(found.estimate.to_json()), "errors": errors}, written)


def _diagnosed(diagnosis: Diagnosis, path: Path) -> Path:
    """Write and print a diagnosis; return where it is."""
    from smsid.cli.diagnose import diagnosis_tables
    from smsid.diagnose.result import save_diagnosis

    save_diagnosis(diagnosis, path)
    for part in diagnosis_tables(diagnosis):
        console().print(part)
    return path


def _print(out: Console, estimate: Estimate) -> None:
    from smsid.cli.tables import parameter_table

    out.print(parameter_table(f"{estimate.description}: {estimate.method}", estimate.parameters))
    for note in estimate.notes:
        out.print(f"note: {note}", markup=False, highlight=False)


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
    import pinocchio as pin

    from smsid.arm.joints import recorded_joints
    from smsid.arm.motion import measured_channel
    from smsid.description import load_description
    from smsid.model import build_model
    from smsid.model.assembly import find_frame

    name, _, axis = frame.rpartition(".")
    if axis not in ("x", "y", "z"):
        raise RecordingError(f"'{frame}' names no axis.", advice="Write <frame>.x, .y or .z.")
    model = build_model(load_description(arm))
    index = find_frame(model.pin, name)
    channel = measured_channel(log, "joint_position")
    _, place = recorded_joints(model, log)
    order = np.argsort(place)
    out = []
    for angles in log[channel][:, order]:
        pin.framesForwardKinematics(model.pin, model.data, model.set_joint_angles(model.home, angles))
        out.append(model.data.oMf[index].translation["xyz".index(axis)])
    return log.time(channel), np.array(out)
