"""Exceptions of smsid. Each carries its evidence and says what to do."""

from __future__ import annotations

from typing import Any, Self


class SmsidError(Exception):
    """Base of all smsid errors.

    ``message`` says what is wrong and where, ``advice`` how to mend it, ``evidence`` holds the data.
    """

    def __init__(self, message: str, *, advice: str = "", **evidence: Any) -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice
        self.evidence = evidence

    def __str__(self) -> str:
        return f"{self.message} {self.advice}".strip()

    def at(self, where: object, *, more_advice: str = "") -> Self:
        """Return the same error with the place it is about in front: a file, a table of a TOML."""
        advice = f"{self.advice} {more_advice}".strip()
        return type(self)(f"{where}: {self.message}", advice=advice, **self.evidence)


class DescriptionError(SmsidError):
    """The URDF or TOML of a spacecraft is wrong: unknown key, missing frame, unphysical inertia."""


class RecordingError(SmsidError):
    """A recording cannot be read or used: missing channel, NaN, gap, wrong unit, time going backwards."""


class InconsistentChannelsError(RecordingError):
    """Channels of a recording contradict each other beyond doubt.

    The evidence holds ``channel``, ``components``, ``numbers`` and ``mend`` of the first finding, and all
    ``findings``.
    """


class ExperimentError(SmsidError):
    """An experiment cannot be flown, or breaks a limit."""


class NotIdentifiableError(SmsidError):
    """The recording cannot identify what is asked."""


class SimulationError(SmsidError):
    """The simulation cannot go on: not finite, or the step size collapsed."""


class EstimateError(SmsidError):
    """An estimate contradicts itself: two parameters of one name, a covariance of other parameters."""


class ControlError(SmsidError):
    """A controller cannot be designed or used: infeasible or ill-posed, wrong dimensions, singular layout."""


class OutputError(SmsidError):
    """A file cannot be written, or is refused because writing it would replace what must not be lost."""


class MissingDependencyError(SmsidError):
    """An optional dependency is not installed."""


def require(module: str, extra: str) -> Any:
    """Import ``module`` or raise `MissingDependencyError` with the pip line that is missing."""
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(
            f"{module} is not installed.",
            advice=f"Install it with: pip install 'smsid[{extra}]'",
            module=module,
        ) from error
