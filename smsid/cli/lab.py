"""``smsid lab``: tests in the laboratory, and public data sets as recordings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import print_estimate, write_diagnosis, write_page
from smsid.cli.options import EstimateOutput, LabDiagnosis, LabRecording, ReportPath
from smsid.cli.output import say, show_spinner
from smsid.cli.places import Writes
from smsid.errors import NotIdentifiableError, RecordingError

if TYPE_CHECKING:
    import numpy as np

    from smsid.description import Description
    from smsid.recording import Recording
    from smsid.report import Provenance, Report


def fetch(
    name: Annotated[str, typer.Argument(help="staubli_tx40, silverbox, antisloshing or cessipy_slab")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="folder for recordings and description"),
        Writes(folder=True),
    ],
) -> CommandResult:
    """Write a public data set as recordings (and descriptions): from SMSID_DATA, else downloaded."""
    from smsid.description import Description, save_description
    from smsid.recording import save_recording

    with show_spinner(f"fetching {name}"):
        parts = _parts(name)
    output.mkdir(parents=True, exist_ok=True)
    for file, part in parts.items():
        if isinstance(part, Description):
            save_description(part, output / file)
        else:
            save_recording(part, output / file)
    return CommandResult({"data_set": name}, [output / file for file in parts])


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
) -> CommandResult:
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
        motion = _frame_motion(log, arm, frame)
    with show_spinner("comparing models of the tank"):
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
        from smsid.lab.tank_models import tank_diagnosis

        written.append(write_diagnosis(tank_diagnosis(test, found, log.name), diagnose))
    written += write_page(report, lambda o: tank_report(log.name, test, found, o), [recording, arm])
    left = {
        model: {"ring_down": fit.ring_down, "moving": fit.moving, "unit": "N"}
        for model, fit in found.fits.items()
    }
    lag = {"value": test.lag.value, "interval": [low, high], "unit": "s"}
    document = {"named": found.named, "lag": lag, "left": left, "left_at_rest": {"value": quiet, "unit": "N"}}
    return CommandResult({"estimate": json.loads(best.estimate.to_json()), **document}, written)


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


def _frame_motion(log: Recording, arm: Path, frame: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and position along one axis of the ground of a frame that an arm carries."""
    import numpy as np
    import pinocchio as pin

    from smsid.arm.joints import with_joint_order
    from smsid.arm.readings import measured_channel
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


def modal(
    recording: LabRecording,
    highest: Annotated[float, typer.Option(min=1e-9, help="highest frequency sought [Hz]")],
    channel: Annotated[
        list[str] | None, typer.Option(help="channel of the outputs, several times; default: all, if alike")
    ] = None,
    free: Annotated[
        bool,
        typer.Option(
            "--free-decay",
            help="let go and left alone: of one channel; taken anyway where nothing else is found",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="of the resampling")] = 0,
    output: EstimateOutput = Path("modes.json"),
    report: ReportPath = None,
) -> CommandResult:
    """Modes of a structure from its vibration alone: no order to pick, harmonics told apart."""
    import numpy as np

    from smsid.identify.estimate import save_estimate
    from smsid.lab.modal import ambient_modes
    from smsid.recording import load_recording
    from smsid.recording.pieces import even_with_gaps

    log = load_recording(recording)
    names = tuple(channel or _require_one_quantity(log))
    log.require(*names)
    outputs, rate = even_with_gaps(log, names)
    missing = ~np.isfinite(outputs).all(axis=1)
    runs = [outputs[kept] for kept in np.ma.clump_unmasked(np.ma.masked_where(missing, missing))]
    one = outputs.shape[1] == 1
    if free and not one:
        raise RecordingError(
            f"{', '.join(names)}: {outputs.shape[1]} columns.",
            advice="A free decay is of one; cut the others off.",
        )
    found, why = None, "no mode is stable over model orders and correlation windows."
    with show_spinner("looking for modes"):
        try:
            if not free:
                rng = np.random.default_rng(seed)
                found = ambient_modes(outputs, rate, highest_frequency=highest, rng=rng)
        except NotIdentifiableError as error:
            if not one:
                raise
            why = error.message
    if found is None or not (found.modes or found.harmonics or not one):
        return _free_decay(max(runs, key=len)[:, 0], rate, highest, log.name, output, "" if free else why)
    estimate = found.estimate(log.name)
    save_estimate(estimate, output)

    def page(origin: Provenance) -> Report:
        from smsid.report.modal import modal_report

        return modal_report(log.name, ", ".join(names), max(runs, key=len), rate, highest, found, origin)

    written = [output, *write_page(report, page, [recording], seed=seed)]
    print_estimate(estimate)
    for k, mode in enumerate(found.modes, start=1):
        if mode.impulsive:
            say(f"mode{k}: kurtosis {mode.kurtosis:.0f}: a few impacts carry the record")
    for f in found.harmonics:
        say(f"{f:.4g} Hz is a harmonic of the excitation, no mode")
    for f in found.faint:
        say(f"{f:.4g} Hz is stable too, but faint: less than a tenth of the covariance")
    if not found.modes:
        say("no mode: none is stable over model orders and correlation windows")
    if found.drift > 0.5:
        say(
            f"{100 * found.drift:.0f} % of the variance moves fewer than 20 times in the record: a drift, "
            "which hides modes; high-pass it"
        )
    if gaps := len(runs) - 1:
        say(f"{gaps} {'gap' if gaps == 1 else 'gaps'} left out; no correlation reaches across")
    harmonics = [{"value": float(f), "unit": "Hz"} for f in found.harmonics]
    faint = [{"value": float(f), "unit": "Hz"} for f in found.faint]
    told = {"harmonics": harmonics, "faint": faint, "drift": found.drift, "gaps": gaps}
    return CommandResult({"estimate": json.loads(estimate.to_json()), **told}, written)


def _free_decay(
    signal: np.ndarray, rate: float, highest: float, name: str, output: Path, why: str
) -> CommandResult:
    """Take one channel for a free decay; ``why`` it is not ambient vibration, empty where that was asked."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.decay import free_decay

    try:
        found = free_decay(signal, rate, highest=highest)
    except NotIdentifiableError as error:
        reason = f"As ambient vibration: {why} As a free decay: {error.message}" if why else error.message
        raise NotIdentifiableError(reason, advice=error.advice) from error
    estimate = found.estimate(name)
    save_estimate(estimate, output)
    print_estimate(estimate)
    amplitudes = ", ".join(f"{m.amplitude:.3g}" for m in found.modes)
    say(f"free decay; noise {found.noise:.3g}, amplitude {amplitudes}")
    return CommandResult({"estimate": json.loads(estimate.to_json()), "harmonics": []}, [output])


def _require_one_quantity(log: Recording) -> tuple[str, ...]:
    """Return all channels, if they are one quantity on one clock; else raise `RecordingError`."""
    names = log.channels
    units = {log.unit(name) for name in names}
    if len(names) == 1 or (len(units) == 1 and len({len(log.time(name)) for name in names}) == 1):
        return tuple(names)
    raise RecordingError(
        f"The recording has {len(names)} channels of several kinds.",
        advice=f"Choose with --channel one or more of {', '.join(names)}.",
    )


def oscillator(
    recording: LabRecording,
    frequency: Annotated[
        float | None, typer.Option(min=1e-9, help="first guess [Hz]; of a free decay the largest if left out")
    ] = None,
    drive: Annotated[
        str, typer.Option("--input", help="channel of the drive; if there is none, it was let go")
    ] = "extra.input",
    answer: Annotated[str, typer.Option("--output-channel", help="channel of the output")] = "extra.output",
    terms: Annotated[str, typer.Option(help="beyond linear: quadratic,cubic,quintic,damping_growth")] = "",
    damping: Annotated[float, typer.Option(help="first guess")] = 0.05,
    validate: Annotated[Path | None, typer.Option(help="recording to judge by, free-running")] = None,
    diagnose: LabDiagnosis = None,
    output: EstimateOutput = Path("oscillator.json"),
) -> CommandResult:
    """Oscillator, driven or let go, with a spring that need not be linear, by the error of its simulation."""
    import numpy as np

    from smsid.identify.estimate import save_estimate
    from smsid.lab.decay import free_decay
    from smsid.lab.oscillator import Oscillator, fit_oscillator
    from smsid.recording import load_recording

    log = load_recording(recording)
    log.require(answer)
    free = drive == "extra.input" and drive not in log.channels
    log.require(*(() if free else (drive,)))
    times = log.time(answer)
    rate = (times.size - 1) / (times[-1] - times[0])
    chosen = tuple(t for t in terms.split(",") if t)
    unit = log.unit(answer)
    y = np.asarray(log[answer], dtype=float).reshape(times.size, -1)
    if y.shape[1] != 1:
        raise RecordingError(f"'{answer}' has {y.shape[1]} columns; one oscillates.", advice="Cut it.")
    y = y[:, 0]
    u = None if free or not np.any(log[drive]) else np.asarray(log[drive], dtype=float).reshape(times.size)
    if u is None and (diagnose is not None or validate is not None):
        raise RecordingError(
            "The oscillator was let go, not driven.", advice="Leave --diagnose and --validate out."
        )
    if u is None:
        modes = free_decay(y, rate).modes
        guess = frequency or max(modes, key=lambda m: m.amplitude).frequency
        near = min(modes, key=lambda m: abs(m.frequency / guess - 1.0))
        frequency, damping, pieces = near.frequency, near.damping, 1
    elif frequency is None:
        raise RecordingError("A driven oscillator takes a first guess.", advice="Give --frequency.")
    else:
        memory = 8.0 / (2 * np.pi * frequency * damping) * rate  # samples
        pieces = int(np.clip(times.size / (5.0 * memory), 1, 10))
    start = Oscillator(frequency, damping, 1.0)
    written = [output]
    with show_spinner("fitting the oscillator"):
        if diagnose is not None and u is not None:
            from smsid.lab.oscillator_diagnosis import diagnose_oscillator

            held = None
            if validate is not None:
                judge = load_recording(validate)
                held = judge.name, judge[drive], judge[answer]
            told = diagnose_oscillator(u, y, rate, start, unit=unit, pieces=pieces, validation=held)
            found = told.best
            written.append(write_diagnosis(told.diagnosis, diagnose))
        else:
            found = fit_oscillator(u, y, rate, start, unit=unit, pieces=pieces)
        if chosen and diagnose is None:
            found = fit_oscillator(u, y, rate, found.oscillator, terms=chosen, unit=unit, pieces=pieces)
    save_estimate(found.estimate, output)
    print_estimate(found.estimate)
    say(f"simulation error {found.rmse:.5g} {unit} on '{log.name}'")
    errors = {"simulation": {"recording": log.name, "value": found.rmse, "unit": unit}}
    if validate is not None:
        other = load_recording(validate)
        error = other[answer] - found.oscillator.simulate(other[drive], rate)
        free = float(np.sqrt(np.mean(error**2)))
        say(f"free-running error {free:.5g} {unit} on '{other.name}'")
        errors["free_running"] = {"recording": other.name, "value": free, "unit": unit}
    return CommandResult({"estimate": json.loads(found.estimate.to_json()), "errors": errors}, written)


lab_app = typer.Typer(
    name="lab",
    help="Tests in the laboratory: a tank that is moved, a structure that vibrates, a driven oscillator.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for _command in (fetch, tank, modal, oscillator):
    lab_app.command()(_command)
