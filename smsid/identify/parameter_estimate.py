"""One identified parameter: value, unit, standard deviation, status."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from smsid._statistics import NORMAL95

IDENTIFIABLE_BELOW = 0.10
"""A parameter is identifiable when its predicted relative standard deviation is below this."""

Status = Literal["identifiable", "not_identifiable", "known", "by_product"]
SECOND_VIEW = "the same as "  # begins the note of what another name stands for as well: it is not printed


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated parameter.

    ``sigma`` is one predicted standard deviation; ``reference`` what it is judged against: the value itself,
    or for a parameter near zero the largest of its kind on the same body (then ``small`` is true).
    ``nominal`` is the description's value. ``group`` names the step it comes from. ``profile``: the 95 %
    interval of the profile likelihood, where the Gaussian one does not hold.
    """

    name: str
    value: float
    unit: str
    sigma: float
    status: Status
    group: str
    nominal: float | None = None
    reference: float | None = None
    small: bool = False
    note: str = ""
    profile: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval: that of the profile likelihood if there is one, else Gaussian."""
        if self.profile is not None:
            return self.profile
        return self.value - NORMAL95 * self.sigma, self.value + NORMAL95 * self.sigma

    @property
    def relative_sigma(self) -> float:
        """Standard deviation relative to the reference."""
        scale = abs(self.reference if self.reference is not None else self.value)
        return self.sigma / scale if scale > 0.0 else math.inf

    def relative_error(self, truth: float, reference: float | None = None) -> float:
        """Return |value - truth| relative to the truth, or to ``reference`` for a small parameter.

        Not a number where that is zero: nothing is a share of zero.
        """
        scale = abs(truth if reference is None else reference)
        return abs(self.value - truth) / scale if scale > 0.0 else math.nan


def classify(
    name: str,
    value: float,
    unit: str,
    sigma: float,
    group: str,
    *,
    nominal: float | None = None,
    reference: float | None = None,
    note: str = "",
) -> ParameterEstimate:
    """Return a parameter with its status from the predicted relative standard deviation."""
    scale = abs(value if reference is None else reference)
    good = bool(math.isfinite(value) and math.isfinite(sigma) and sigma < IDENTIFIABLE_BELOW * scale)
    if not good and not note:
        share = 100 * sigma / scale if scale > 0 else math.inf
        note = (
            f"predicted standard deviation {share:.0f} % of its size: fly a richer or longer experiment"
            if math.isfinite(sigma)
            else "its standard deviation cannot be told"
        )
    return ParameterEstimate(
        name,
        float(value),
        unit,
        float(sigma),
        "identifiable" if good else "not_identifiable",
        group,
        nominal,
        reference,
        reference is not None,
        note,
    )


_TERM = re.compile(r"^(?:(?P<factor>[\d.]+(?:e[+-]?\d+)?) )?(?P<name>\S+)$")


def parse_combination(text: str) -> dict[str, float] | None:
    """Return factors by parameter of a combination such as ``bus.mx - 2 link1.m``; None if it is none."""
    out: dict[str, float] = {}
    parts = re.split(r" ([+-]) ", text)
    for sign, term in zip(["+", *parts[1::2]], parts[::2], strict=True):
        found = _TERM.match(term)
        if found is None:
            return None
        size = float(found["factor"] or 1.0)
        out[found["name"]] = out.get(found["name"], 0.0) + (size if sign == "+" else -size)
    return out
