"""A designed experiment with what it is predicted to find out, and what it uses of the limits."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from smsid._short_repr import short_repr
from smsid.design.goal import Goal
from smsid.experiments import Experiment, LimitUse


@short_repr
@dataclass(frozen=True)
class Design:
    """A designed experiment.

    ``sigma`` (k,) are the Cramer-Rao bounds of the goal's parameters, ``before`` (k,) those of ``reference``:
    the paper's excitation of the same duration within the same limits. ``limits`` are what the simulated
    motion uses of every limit. ``evaluations`` counts experiments tried; ``interrupted``: the search was
    stopped, this is the best it had.
    """

    experiment: Experiment
    goal: Goal
    sigma: np.ndarray
    reference: Experiment
    before: np.ndarray
    limits: tuple[LimitUse, ...]
    evaluations: int
    interrupted: bool = False
    notes: tuple[str, ...] = ()

    @property
    def relative(self) -> np.ndarray:
        """The bounds relative to the goal's scales (k,)."""
        return self.sigma / self.goal.scales

    @property
    def relative_before(self) -> np.ndarray:
        """Those of the reference (k,)."""
        return self.before / self.goal.scales

    def document(self) -> dict[str, Any]:
        """Return the design as plain data."""
        rows = zip(self.goal.names, self.goal.units, self.goal.values, self.sigma, self.before, strict=True)
        return {
            "experiment": self.experiment.model_dump(mode="json", by_alias=True, exclude_none=True),
            "criterion": self.goal.criterion,
            "parameters": [
                {"name": n, "unit": u, "value": float(v), "sigma": float(s), "sigma_before": float(b)}
                for n, u, v, s, b in rows
            ],
            "relative": self.relative.tolist(),
            "relative_before": self.relative_before.tolist(),
            "before": self.reference.note,
            "limits": [asdict(u) for u in self.limits],
            "evaluations": self.evaluations,
            "interrupted": self.interrupted,
            "notes": list(self.notes),
        }

    @property
    def gain(self) -> float:
        """By how much the worst parameter is better known than after the reference experiment."""
        return float(self.relative_before.max() / self.relative.max())
