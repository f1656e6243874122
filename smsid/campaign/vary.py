"""What is drawn anew in every run: parameters of effects, inertias of links, sensor errors."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from smsid._listing import did_you_mean
from smsid.description.schema import Description
from smsid.errors import ExperimentError
from smsid.parameter import Parameter
from smsid.sensing.sensor import Sensor

Generators = Callable[[str], np.random.Generator]
"""Gives the generator of a label."""

CUT = 3.0
"""Normal draws beyond this many standard deviations are drawn again."""

WHITE_NOISE = ("noise_density", "noise_sigma")
RANDOM_TERMS = (
    *WHITE_NOISE,
    "bias_sigma",
    "bias_instability",
    "random_walk",
    "scale_sigma",
    "misalignment_sigma",
)

Patterns = Annotated[tuple[str, ...], Field(min_length=1)]
Positive = Annotated[float, Field(gt=0.0)]


class Variation(BaseModel):
    """One thing drawn anew in every run, around the description.

    Give ``parameters`` or ``links``, and one of ``relative``, ``sigma``, ``range``.

    Attributes:
        parameters: names of effect parameters (``tank.mass``), ``*`` and ``?`` allowed.
        links: names of links of the URDF (``<arm>/<link>`` on a mounted arm), ``*`` and ``?`` allowed. All
            ten inertial parameters are drawn so that the body stays physical (see
            `smsid.campaign._inertias.drawn_inertia`).
        relative: standard deviation relative to the described value [1]; the only one for links.
        sigma: standard deviation in the parameter's unit.
        range: uniform between two values in the parameter's unit.
        together: one draw for all the names matched (an isotropic tank), not one each.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    parameters: Patterns | None = None
    links: Patterns | None = None
    relative: Positive | None = None
    sigma: Positive | None = None
    range: tuple[float, float] | None = None
    together: bool = False

    @model_validator(mode="after")
    def _one_of_each(self) -> Variation:
        if (self.parameters is None) == (self.links is None):
            raise ValueError("give `parameters` or `links`")
        if sum(x is not None for x in (self.relative, self.sigma, self.range)) != 1:
            raise ValueError("give one of `relative`, `sigma`, `range`")
        if self.links is not None and (self.relative is None or self.together):
            raise ValueError("inertias of links are drawn one by one, with `relative`")
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError("`range` needs the smaller value first")
        return self

    def value(self, nominal: float, z: float) -> float:
        """Return the parameter for a standard draw: normal, or uniform in [0, 1] for a ``range``."""
        if self.range is not None:
            return self.range[0] + z * (self.range[1] - self.range[0])
        return nominal + z * (self.sigma if self.sigma is not None else (self.relative or 0.0) * abs(nominal))

    def standard(self, rng: np.random.Generator) -> float:
        """Return a standard draw for `value`."""
        if self.range is not None:
            return float(rng.uniform())
        z = math.inf
        while abs(z) > CUT:
            z = float(rng.standard_normal())
        return z


def matching_names(patterns: Iterable[str], names: Sequence[str], what: str) -> list[str]:
    """Return the names that match any pattern, in their order.

    Raises `ExperimentError` for a pattern that matches nothing, with the closest name.
    """
    found: set[str] = set()
    for pattern in patterns:
        hits = fnmatch.filter(names, pattern)
        if not hits:
            raise ExperimentError(
                f"There is no {what} '{pattern}'." + did_you_mean(pattern, list(names)),
                advice=f"There are: {', '.join(names) or 'none'}.",
                pattern=pattern,
            )
        found.update(hits)
    return [n for n in names if n in found]


def groups(
    variations: Iterable[Variation], parameters: Sequence[Parameter]
) -> list[tuple[Variation, list[Parameter]]]:
    """Return the parameters that are drawn together, with what says how.

    Raises `ExperimentError` for a name that is no parameter, one drawn twice, a relative draw of zero, or a
    range outside the parameter's bounds.
    """
    by_name = {p.name: p for p in parameters}
    out: list[tuple[Variation, list[Parameter]]] = []
    seen: set[str] = set()
    for variation in variations:
        if variation.parameters is None:
            continue
        found = [by_name[n] for n in matching_names(variation.parameters, list(by_name), "parameter")]
        for p in found:
            if p.name in seen:
                raise ExperimentError(f"'{p.name}' is drawn twice.", advice="Name it in one table only.")
            if variation.relative is not None and p.value == 0.0:
                raise ExperimentError(
                    f"'{p.name}' is zero, so it cannot be drawn relative to its value.",
                    advice=f"Give `sigma` [{p.unit}] or `range`.",
                )
            if (
                variation.range is not None
                and not p.lower <= variation.range[0] <= variation.range[1] <= p.upper
            ):
                raise ExperimentError(
                    f"The range of '{p.name}' leaves its bounds [{p.lower:g}, {p.upper:g}] {p.unit}."
                )
            seen.add(p.name)
        out += [(variation, found)] if variation.together else [(variation, [p]) for p in found]
    return out


def drawn_values(
    variations: Iterable[Variation], parameters: Sequence[Parameter], rng: Generators
) -> dict[str, float]:
    """Return the drawn parameters by name, within their bounds.

    Raises `ExperimentError` as `groups`, and when no draw respects the bounds.
    """
    out: dict[str, float] = {}
    for variation, members in groups(variations, parameters):
        names = [p.name for p in members]
        generator = rng("parameters " + " ".join(names))
        for _ in range(1000):
            z = variation.standard(generator)
            values = [variation.value(p.value, z) for p in members]
            if all(p.lower <= v <= p.upper for p, v in zip(members, values, strict=True)):
                break
        else:
            raise ExperimentError(
                f"No draw of {', '.join(names)} in 1000 respects the bounds.", advice="Use a smaller sigma."
            )
        out.update(zip(names, values, strict=True))
    return out


def with_values(description: Description, values: Mapping[str, float]) -> Description:
    """Return the description with effect parameters replaced; raises `DescriptionError`."""
    effects = []
    for effect in description.effect:
        own = {p.name: values[p.name] for p in effect.parameters() if p.name in values}
        if own:
            effects.append(effect.with_values(own))
    return description.with_effects(*effects)


def effect_parameters(description: Description) -> list[Parameter]:
    """Return the parameters of all effects."""
    return [p for effect in description.effect for p in effect.parameters()]


def drawn_factor(factor: float | tuple[float, float], rng: np.random.Generator) -> float:
    """Return a factor, drawn log-uniformly when it is a range."""
    if not isinstance(factor, tuple):
        return float(factor)
    low, high = np.log(factor)
    return float(np.exp(rng.uniform(low, high)))


def scaled_sensor(sensor: Sensor, factor: float, terms: Sequence[str] = RANDOM_TERMS) -> Sensor:
    """Return a sensor with ``terms``, standard deviations of its errors, multiplied by ``factor`` [1]."""
    if factor == 1.0:
        return sensor
    errors = {
        quantity: model.model_copy(update={k: _times(getattr(model, k), factor) for k in terms})
        for quantity, model in sensor.errors.items()
    }
    return sensor.model_copy(update={"errors": errors})


def _times(value: Any, factor: float) -> Any:
    if value is None:
        return None
    return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
