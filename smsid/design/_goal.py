"""What an experiment is to find out, and one number that says how well it will."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from smsid._listing import did_you_mean
from smsid._short_repr import short_repr
from smsid.errors import ExperimentError
from smsid.likelihood.combinations import Combination, effects_and_mass, inertial
from smsid.likelihood.normal import Normal
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.model.spacecraft import SpacecraftModel

Criterion = Literal["worst", "A", "D"]
CRITERIA: tuple[str, ...] = get_args(Criterion)
SHARP = 8.0  # power of the mean that stands for the worst: within 9 % of it for four parameters
TRANSLATION = {"position", "velocity", "acceleration"}  # quantities of sensors that show it
SYMBOLS = {"b_s": "damping", "k_s": "stiffness", "m_s": "mass"}


@short_repr
@dataclass(frozen=True)
class Goal:
    """Parameters by name, their gradients (k, size) by the step of the parameters, and what counts as 1.

    ``scales`` (k,) are what a standard deviation is compared with: the value, or for a value near zero the
    largest of its kind, else the size of the body.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    scales: np.ndarray
    gradients: np.ndarray
    criterion: Criterion

    def only(self, index: int) -> Goal:
        """Return the goal of one of its parameters."""
        rows = ("names", "units", "values", "scales", "gradients")
        return replace(self, **{key: getattr(self, key)[index : index + 1] for key in rows})

    def by(self, criterion: Criterion) -> Goal:
        """Return the goal by another criterion."""
        return replace(self, criterion=criterion)

    def relative(self, covariance: np.ndarray) -> np.ndarray:
        """Return the relative standard deviations (k,) from a covariance (n, n), parameters first."""
        return np.sqrt(np.diag(self._relative_covariance(covariance)))

    def relative_of(self, information: Normal) -> np.ndarray:
        """Return the relative standard deviations (k,) from an information, parameters first."""
        return np.sqrt(np.diag(information.covariance_of(self._scaled)))

    @property
    def _scaled(self) -> np.ndarray:
        return self.gradients / self.scales[:, None]

    def _relative_covariance(self, covariance: np.ndarray) -> np.ndarray:
        size = self.gradients.shape[1]
        return self._scaled @ covariance[:size, :size] @ self._scaled.T

    def cost(self, covariance: np.ndarray) -> float:
        """Return the logarithm of relative deviations (worst, mean, volume) of a covariance (n, n)."""
        return self.cost_and_weight(covariance)[0]

    def cost_and_weight(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the cost and Q (n, n), its derivative by the covariance (n, n).

        The worst is taken as the mean of power 2 `SHARP`, which has a derivative.
        """
        own = self._relative_covariance(covariance)
        k = len(own)
        if self.criterion == "D":
            sign, log = np.linalg.slogdet(own)
            cost = 0.5 * float(log) / k if sign > 0 else np.inf
            weight = 0.5 / k * np.linalg.pinv(own, hermitian=True)
        else:
            power = SHARP if self.criterion == "worst" else 1.0
            variance = np.diag(own)
            top = float(variance.max())
            shares = (variance / top) ** power
            total = float(shares.mean())
            cost = 0.5 * (np.log(top) + np.log(total) / power)
            weight = np.diag(0.5 * shares / (k * total * variance))
        size = self.gradients.shape[1]
        out = np.zeros_like(covariance)
        out[:size, :size] = self._scaled.T @ weight @ self._scaled
        return cost, out


def goal_of(
    parameters: Parameters, wanted: Sequence[str], criterion: Criterion, motion: Prediction | None
) -> Goal:
    """Return the goal that words stand for.

    A word is a group - ``slosh``, ``panel`` (``appendage``), ``mass``, ``inertia`` -, a symbol of the paper
    (``b_s``, ``k_s``, ``m_s``), the name of an effect, of a parameter as `smsid identify` prints it, or a
    pattern of such names with ``*``. ``motion`` is any free-floating motion that shows all inertial
    combinations that the described sensors can tell; without one they cannot be asked for.

    Raises `ExperimentError` for a word that stands for nothing.
    """
    model, found = parameters.layout.model, effects_and_mass(parameters, parameters)
    rigid: list[Combination] = []
    if motion is not None:
        rigid, _, _ = inertial(parameters, parameters, [motion], translation=measures_translation(model))
    everything = [*found, *rigid]
    chosen: dict[str, Combination] = {}
    for word in wanted:
        own = _matching_combinations(word.strip(), model, found, rigid)
        if not own:
            known = sorted({"slosh", "panel", "mass", "inertia", *SYMBOLS, *(c.name for c in everything)})
            if word.strip() == "inertia":
                raise ExperimentError(
                    "Inertias are asked for, but nothing moves that would show them.",
                    advice="The spacecraft needs arm joints or wheels, and the experiment must float freely.",
                )
            raise ExperimentError(
                f"There is nothing '{word}' to be found out." + did_you_mean(word, known),
                advice="Use slosh, panel, mass, inertia, b_s, k_s, m_s, or names of parameters.",
                known=known,
            )
        chosen.update({c.name: c for c in own})
    picked = list(chosen.values())
    return Goal(
        names=tuple(c.name for c in picked),
        units=tuple(c.unit for c in picked),
        values=np.array([c.value for c in picked]),
        scales=np.array([_scale(c) for c in picked]),
        gradients=np.array([c.gradient for c in picked]),
        criterion=criterion,
    )


def measures_translation(model: SpacecraftModel) -> bool:
    """Return whether a described sensor shows where the spacecraft is, or how it speeds up."""
    measured = {q for s in model.description.effective_sensors() for q in s.quantities}
    return bool(measured & TRANSLATION)


def needs_motion(parameters: Parameters, wanted: Sequence[str]) -> bool:
    """Return whether something is asked for that only a free-floating experiment shows."""
    found = effects_and_mass(parameters, parameters)
    return any(not _matching_combinations(w.strip(), parameters.layout.model, found, []) for w in wanted)


def _matching_combinations(
    word: str, model: SpacecraftModel, found: Sequence[Combination], rigid: Sequence[Combination]
) -> list[Combination]:
    tanks = {s.name for s in model.slosh}
    panels = {a.appendage.name for a in model.appendages}
    owner = {c.name: c.name.partition(".")[0] for c in found}
    if word == "inertia":
        return list(rigid)
    if word == "mass":
        return [c for c in found if c.name == "total.mass"]
    if word == "slosh":
        return [c for c in found if owner[c.name] in tanks]
    if word == "appendage" or (word == "panel" and "panel" not in panels):
        return [c for c in found if owner[c.name] in panels]
    if word in SYMBOLS:
        return [
            c for c in found if owner[c.name] in tanks and c.name.partition(".")[2].startswith(SYMBOLS[word])
        ]
    if word in tanks | panels:
        return [c for c in found if owner[c.name] == word]
    return [c for c in (*found, *rigid) if c.name == word or fnmatch.fnmatchcase(c.name, word)]


def _scale(c: Combination) -> float:
    size = abs(c.value if c.reference is None else c.reference)
    return size if size > 0.0 else float(np.abs(c.gradient).max())
