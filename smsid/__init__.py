"""smsid: identify the dynamics of space manipulator systems from measured data.

The spacecraft is a URDF with a free-flyer root; Pinocchio computes, and slosh masses and bending modes are
joints of the same model. ``import smsid`` is light: a name is loaded when it is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from smsid._lazy import lazy_names
from smsid._version import __version__ as __version__

_CALLED = ("simulate", "identify", "diagnose", "report", "view", "export")  # subpackages that can be called

__all__ = [
    "ControlError",
    "Description",
    "DescriptionError",
    "Diagnosis",
    "Estimate",
    "EstimateError",
    "Experiment",
    "ExperimentError",
    "MissingDependencyError",
    "NotIdentifiableError",
    "Recording",
    "RecordingError",
    "SimulationError",
    "SmsidError",
    "build_model",
    "compare",
    "design_controller",
    "design_experiment",
    "diagnose",
    "export",
    "identify",
    "import_recording",
    "load_estimate",
    "load_recording",
    "load_recordings",
    "load_spacecraft",
    "report",
    "save_estimate",
    "save_recording",
    "simulate",
    "track",
    "view",
]

if TYPE_CHECKING:
    from smsid.api import (
        design_controller,
        diagnose,
        export,
        identify,
        load_recordings,
        load_spacecraft,
        report,
        simulate,
        track,
        view,
    )
    from smsid.comparison import compare
    from smsid.description import Description
    from smsid.design import design_experiment
    from smsid.diagnose import Diagnosis
    from smsid.errors import (
        ControlError,
        DescriptionError,
        EstimateError,
        ExperimentError,
        MissingDependencyError,
        NotIdentifiableError,
        RecordingError,
        SimulationError,
        SmsidError,
    )
    from smsid.experiments import Experiment
    from smsid.identify.estimate import Estimate, load_estimate, save_estimate
    from smsid.model import build_model
    from smsid.recording import Recording, import_recording, load_recording, save_recording


_MODULES, _load = lazy_names(__name__)


def __getattr__(name: str) -> Any:
    return importlib.import_module(f"smsid.{name}") if name in _CALLED else _load(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
