"""What one run found: parameters with truth, value and interval, or the error that ended it."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from smsid.identify.estimate import ParameterEstimate


class _Record(BaseModel):
    # NaN and infinity are no JSON numbers; as strings they survive, and the line stays strict JSON.
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Outcome(_Record):
    """One number a run found.

    Attributes:
        name: of the parameter, the same in every run.
        value: estimate, in ``unit``.
        unit: of value, sigma, truth and interval.
        truth: true value in this run; ``None`` when there is none or it is not known.
        sigma: predicted standard deviation; ``None`` for a number that has none (a settling time).
        interval: 95 % interval; by default the Gaussian one of ``sigma``.
        status: what the method says about it, as in `ParameterEstimate`.
        group: step it comes from.
    """

    name: str
    value: float
    unit: str = ""
    truth: float | None = None
    sigma: float | None = None
    interval: tuple[float, float] | None = None
    status: str = ""
    group: str = ""

    @classmethod
    def of(cls, parameter: ParameterEstimate, truth: float | None) -> Outcome:
        """Return the outcome of an estimated parameter of known truth, with the estimate's own interval."""
        low, high = parameter.interval
        return cls(
            name=parameter.name,
            value=float(parameter.value),
            unit=parameter.unit,
            truth=None if truth is None else float(truth),
            sigma=float(parameter.sigma),
            interval=(float(low), float(high)),
            status=parameter.status,
            group=parameter.group,
        )


class Findings(_Record):
    """What a method returns for one run."""

    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...] = ()


class RunError(_Record):
    """The error that ended a run: its class, its message, and the innermost place it was raised."""

    type: str
    message: str
    place: str = ""


class RunRecord(_Record):
    """A finished run: a line of the store. Only ``seconds`` is not a function of the plan."""

    run: int
    status: Literal["ok", "failed"]
    outcomes: tuple[Outcome, ...] = ()
    notes: tuple[str, ...] = ()
    error: RunError | None = None
    seconds: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether the run has a result."""
        return self.status == "ok"
