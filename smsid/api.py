"""What most users need, in one place: load, simulate, identify, diagnose, track, design, report,
view, export.

Everything here is offered by ``smsid`` itself: ``smsid.identify(spacecraft, recordings)``. A spacecraft, a
recording, an estimate or an experiment may be given as the path of its file, too. Where a function
shares its name with a subpackage, the subpackage can be called: ``smsid.identify.estimate`` is there as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from smsid._given import (
    PathLike,
    estimate_if_given,
    given_experiment,
    given_generator,
    given_path,
    given_recordings,
    given_spacecraft,
)
from smsid.description import Description, load_description
from smsid.errors import DescriptionError, RecordingError
from smsid.identify.estimate import Estimate
from smsid.recording import Recording, load_recording

if TYPE_CHECKING:
    from smsid.control.design import ControllerDesign
    from smsid.diagnose.diagnose import DiagnosisRun
    from smsid.experiments import Experiment
    from smsid.export.folder import Export
    from smsid.tracking.followed_parameters import Rate
    from smsid.tracking.history import TrackHistory

Spacecraft = Description | PathLike
Recordings = Recording | PathLike | Iterable[Recording | PathLike]
Method = Literal["ml", "filter", "paper"]


def load_spacecraft(path: PathLike) -> Description:
    """Load the description of a spacecraft or arm, a TOML or a bare URDF.

    Raises:
        DescriptionError: as `smsid.description.load_description`.
    """
    return load_description(given_path(path, DescriptionError))


def load_recordings(*paths: PathLike) -> tuple[Recording, ...]:
    """Load recordings in the order given.

    Raises:
        RecordingError: a file is missing or no recording.
    """
    return tuple(load_recording(given_path(path, RecordingError)) for path in paths)


def simulate(
    spacecraft: Spacecraft,
    experiment: Experiment | PathLike = "exp2",
    *,
    seed: int = 1,
    role: str = "estimation",
) -> Recording:
    """Fly an experiment in simulation and record it with the description's sensors.

    Args:
        spacecraft: as `load_spacecraft` gives it.
        experiment: an experiment, the name of one (``exp1``, ``exp2`` ...), or the path of its TOML.
        seed: of sensor noise and turn-on biases.
        role: what the data may be used for: ``estimation`` or ``validation``.

    Raises:
        ExperimentError: it cannot be flown.
        SimulationError: the motion cannot be integrated.
    """
    from smsid.experiments import fly, named_experiment
    from smsid.model import build_model

    model = build_model(given_spacecraft(spacecraft))
    named = isinstance(experiment, str | os.PathLike)
    plan = named_experiment(given_path(experiment), model) if named else given_experiment(experiment)
    return fly(model, plan, given_generator(seed), role=role).recording.with_provenance({"seed": seed})


def identify(
    spacecraft: Spacecraft,
    recordings: Recordings,
    *,
    method: Method = "ml",
    cad: float | None = None,
    cutoff: float | None = None,
) -> Estimate:
    """Identify a spacecraft from flights of any kind, or a welded arm from recordings of its torques.

    An arm whose description lists an effect that does not enter torques linearly (a delay, backlash, an
    encoder's error) is identified by its motion under the commanded torques, as with method ``filter``.

    Args:
        spacecraft: its values are the starting guess, its geometry is taken as known.
        recordings: in the role estimation.
        method: ``ml``, ``filter`` or ``paper``, see `smsid.estimation.identify.identify_spacecraft`; of a
            welded arm ``ml`` fits equations of torques, ``filter`` the motion under commanded torques.
        cad: by maximum likelihood of motion: how well bodies are known beforehand, a standard deviation
            relative to the body's size.
        cutoff: of a welded arm by its torques: low-pass of angles and torques [Hz].

    Raises:
        RecordingError: a recording is missing something, or its labels are not the spacecraft's.
        NotIdentifiableError: the recordings cannot identify what is asked.
        DescriptionError: the spacecraft cannot be modelled, or an option is for another kind of it.
    """
    spacecraft, given = given_spacecraft(spacecraft), given_recordings(recordings)
    if spacecraft.root == "fixed":
        from smsid.estimation.arm_motion import identify_arm_motion, why_by_motion

        if method == "paper":
            raise DescriptionError(
                "The paper's method is for free-flying spacecraft.", advice='Use "ml" or "filter" for an arm.'
            )
        if reason := why_by_motion(spacecraft, method):
            if cutoff is not None:
                raise DescriptionError(
                    f"cutoff is for equations of torques; the arm is identified by its motion: {reason}.",
                    advice="Leave it out.",
                )
            return identify_arm_motion(spacecraft, given, reason=reason, cad=cad).estimate
        from smsid.arm import identify_arm

        if cad is not None:
            raise DescriptionError(
                "Equations of torques take no prior of an arm's bodies.",
                advice='Leave cad out, or use method "filter".',
            )
        return identify_arm(spacecraft, given, cutoff=cutoff).estimate
    if cutoff is not None:
        raise DescriptionError("cutoff is for welded arms.", advice='Leave it out, or set root = "fixed".')
    from smsid.estimation.identify import identify_spacecraft

    return identify_spacecraft(spacecraft, given, method=method, cad=cad).estimate


def diagnose(
    spacecraft: Spacecraft,
    recordings: Recordings,
    *,
    estimate: Estimate | PathLike | None = None,
    validation: Recordings = (),
) -> DiagnosisRun:
    """Say what the simulation gets wrong and why: ``.diagnosis`` names the cause, ``.extended`` has it.

    Args:
        spacecraft: the model, its values as identified.
        recordings: what was measured, with the commands that drove it.
        estimate: how well the nominal parameters are known.
        validation: recordings on which the gain is measured.

    Raises:
        SmsidError: no recording is given.
    """
    from smsid.diagnose.diagnose import diagnose as explained

    spacecraft, given = given_spacecraft(spacecraft), given_recordings(recordings)
    known, others = estimate_if_given(estimate), given_recordings(validation)
    return explained(spacecraft, given, estimate=known, validation=others)


def track(
    spacecraft: Spacecraft,
    recordings: Recordings,
    *,
    estimate: Estimate | PathLike | None = None,
    follow: Mapping[str, Rate] | Sequence[str] | None = None,
    hold: Sequence[str] = (),
    changes: bool = False,
    smooth: bool = False,
) -> TrackHistory:
    """Follow parameters through recordings, each as a random walk; ``.estimate()`` is what is known last.

    Args:
        spacecraft: as described.
        recordings: in the order they were made.
        estimate: what is known beforehand.
        follow: how far each of these wanders, in its unit per square root of a second, by name or pattern
            (``tank.*``); ``None``, or names alone: 1 % of its size in an hour. A pair of that and a trend
            [unit/s]: it also changes steadily, about so fast. All unknown parameters if left out.
        hold: parameters that are not followed.
        changes: also seek what jumps, with at most one false alarm in ten hours: among ``.events``.
        smooth: also say what is known of each time from all that was read, before and after: ``.smoothed``.

    Raises:
        RecordingError: no recording, or one that cannot be used.
        DescriptionError: there is no such parameter.
        SimulationError: the filter loses the motion.
    """
    from smsid.tracking.history import FALSE_ALARMS
    from smsid.tracking.track_recordings import track_recordings

    spacecraft, given = given_spacecraft(spacecraft), given_recordings(recordings)
    alarms = FALSE_ALARMS if changes else None
    return track_recordings(
        spacecraft,
        given,
        estimate=estimate_if_given(estimate),
        follow=follow,
        hold=hold,
        false_alarms=alarms,
        smooth=smooth,
    )[0]


def design_controller(
    spacecraft: Spacecraft,
    estimate: Estimate | PathLike | None = None,
    *,
    gains: tuple[float, float] | None = None,
    uncertainty: float | None = None,
    samples: int = 1000,
    seed: int = 0,
) -> ControllerDesign:
    """Design model-based PD with an H-infinity term from what is identified.

    Args:
        spacecraft: as described.
        estimate: of it; or state the ``uncertainty``.
        gains: K_P and K_D of all coordinates [1/s^2, 1/s]; without, clear of the identified frequencies.
        uncertainty: a level (0.05: 5 %) instead of the estimate's.
        samples: plants drawn for the robust analysis.
        seed: of what is drawn.

    Raises:
        ControlError: neither estimate nor uncertainty is given, or no controller can be designed.
    """
    from smsid.control.design import DesignRequest, design
    from smsid.errors import ControlError

    spacecraft, known = given_spacecraft(spacecraft), estimate_if_given(estimate)
    if known is None and (uncertainty is None or gains is None):
        raise ControlError(
            "Without an estimate nothing says how sure the model is, or which frequencies to keep clear of.",
            advice="Pass an estimate, or gains and uncertainty.",
        )
    request = DesignRequest(gains=gains, uncertainty=uncertainty, samples=samples)
    return design(spacecraft, known, request, given_generator(seed))


def report(
    spacecraft: Spacecraft,
    recordings: Recordings,
    path: PathLike,
    *,
    method: Method = "ml",
) -> Estimate:
    """Identify a spacecraft and write the report: one self-contained HTML; return the estimate.

    Args:
        spacecraft: as in `identify`.
        recordings: as in `identify`.
        path: of the HTML.
        method: as in `identify`.

    Raises:
        SmsidError: as `identify`, or the file cannot be written.
    """
    from smsid.estimation.identify import identify_spacecraft
    from smsid.report import provenance, write_report
    from smsid.report.identify import flights_report, identify_report

    spacecraft, given = given_spacecraft(spacecraft), given_recordings(recordings)
    target = Path(given_path(path))
    found = identify_spacecraft(spacecraft, given, method=method)
    if found.linear is None:
        page = flights_report(spacecraft, found, provenance([]))
    else:
        page = identify_report(spacecraft, given, found.linear, found.refined, provenance([]))
    write_report(page, target)
    return found.estimate


def view(
    spacecraft: Spacecraft,
    recordings: Recordings = (),
    path: PathLike = "view.html",
    *,
    simulated: bool = False,
) -> Path:
    """Write the spacecraft in 3-D as one HTML, at rest or replaying recordings; return its path.

    Args:
        spacecraft: as described.
        recordings: the first as it is, the others laid over it.
        path: of the HTML.
        simulated: also what the description makes of the first recording's commands.

    Raises:
        MissingDependencyError: meshcat is not installed.
        SmsidError: ``simulated`` without a recording.
        RecordingError: a recording tells nothing of the motion, or its labels are not the spacecraft's.
    """
    from smsid.view import build_replay, export_html

    spacecraft, given = given_spacecraft(spacecraft), given_recordings(recordings)
    return Path(export_html(build_replay(spacecraft, given, simulated=simulated), given_path(path)))


def export(spacecraft: Spacecraft, folder: PathLike, estimate: Estimate | PathLike | None = None) -> Export:
    """Write URDF, TOML, parameters as CSV and MuJoCo XML, as identified or as described.

    Args:
        spacecraft: as described.
        folder: to make, whole or not at all.
        estimate: of the spacecraft.

    Raises:
        SmsidError: the estimate is of another spacecraft, or the folder cannot be made.
    """
    from smsid.export.folder import export_folder

    return export_folder(given_spacecraft(spacecraft), Path(given_path(folder)), estimate_if_given(estimate))
