"""Sensors that spoil single samples: coarse steps, outliers, a stuck channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from pydantic import model_validator

from smsid.effects.base import physical, register
from smsid.effects.sensor import OF_QUANTITY, ComponentEffect
from smsid.errors import DescriptionError
from smsid.parameter import Parameter
from smsid.sensing.component import ComponentError
from smsid.sensing.error_model import COARSEST_ATTITUDE, ErrorModel

OF_NOISE = "a property of the readings that no motion depends on; `smsid diagnose` finds it"


@register
class Quantisation(ComponentEffect):
    """Readings rounded to a step coarser than stated; an attitude's is of its quaternion's components."""

    summary = "readings rounded to coarser steps than stated"
    strength = ("step",)
    not_estimated = dict.fromkeys(("step",), OF_NOISE)
    in_words = "{place} is read in coarse steps"
    kind: Literal["quantisation"] = "quantisation"
    step: float = physical(
        OF_QUANTITY,
        lower=0.0,
        default=0.0,
        description="of the output; of an attitude that of its quaternion's components [1]",
    )

    @model_validator(mode="after")
    def _of_the_whole_attitude(self) -> Quantisation:
        if self.quantity == "attitude" and (self.component is not None or self.station is not None):
            raise ValueError(
                "an attitude's quaternion is rounded as a whole: leave out `component` and `station`"
            )
        if self.quantity == "attitude" and self.step >= COARSEST_ATTITUDE:
            raise ValueError(f"the step of a quaternion's components is below {COARSEST_ATTITUDE}")
        return self

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the step, of an attitude without unit."""
        found = super().parameters()
        return tuple(replace(p, unit="1") for p in found) if self.quantity == "attitude" else found

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the coarser step."""
        return {"quantisation": self.step} if self.step > error.quantisation else {}


@register
class Outliers(ComponentEffect):
    """A share of samples with a large error on top, drawn for every component apart."""

    summary = "single samples far off"
    strength = ("share", "size")
    not_estimated = dict.fromkeys(("share", "size"), OF_NOISE)
    in_words = "{place} has outliers"
    kind: Literal["outliers"] = "outliers"
    share: float = physical("1", lower=0.0, upper=1.0, default=0.0, description="of the samples")
    size: float = physical(
        OF_QUANTITY, lower=0.0, default=0.0, description="standard deviation of what is added to them"
    )

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the outliers; raises `DescriptionError` when there are some."""
        if not (self.share and self.size):
            return {}
        if error.outlier_rate and error.outlier_size:
            raise DescriptionError(
                f"[[effect]] '{self.name}': {self.sensor}.{self.quantity} has outliers already.",
                advice="Describe them once.",
            )
        return {"outlier_rate": self.share, "outlier_size": self.size}


@register
class Stuck(ComponentEffect):
    """A channel that repeats its last value from ``start`` on; it never sticks when that is not given."""

    summary = "channel that repeats its last value from some time on"
    not_estimated = dict.fromkeys(("start",), OF_NOISE)
    in_words = "{place} is stuck for a while"
    kind: Literal["stuck"] = "stuck"
    start: float | None = physical("s", default=None, description="time from which it is stuck")

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the time from which it is stuck; the earliest counts."""
        if self.start is None:
            return {}
        return {"stuck_from": self.start if error.stuck_from is None else min(self.start, error.stuck_from)}
