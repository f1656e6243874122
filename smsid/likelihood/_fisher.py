"""The Cramer-Rao bound: how well an experiment can determine each parameter, before or after it is flown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from smsid._short_repr import short_repr
from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.errors import ExperimentError
from smsid.likelihood._knots import resolved_information
from smsid.likelihood.combinations import Combination
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import piece_of
from smsid.likelihood.refine import gradient_matrix, prior_shares, seen_in
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor

if TYPE_CHECKING:
    from smsid.experiments import Experiment


@short_repr
@dataclass(frozen=True)
class FisherInformation:
    """Predicted uncertainty of what the refinement reports.

    ``combinations`` with their values, ``covariance`` (n, n) by them, ``prior_share`` (n,): which part of a
    variance is the prior's - near one the experiment does not see the parameter.
    """

    combinations: tuple[Combination, ...]
    covariance: np.ndarray
    prior_share: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, as in a `Refinement`."""
        return tuple(c.name for c in self.combinations)

    @property
    def sigma(self) -> dict[str, float]:
        """The bound of the standard deviation by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def relative_sigma(self) -> dict[str, float]:
        """The bound relative to the value, or for a small parameter to the largest of its kind."""
        out = {}
        for c, s in zip(self.combinations, self.sigma.values(), strict=True):
            size = abs(c.value if c.reference is None else c.reference)
            out[c.name] = s / size if size > 0.0 else float("inf")
        return out


@single_threaded
def fisher_information(
    description: Description,
    flown: Experiment | Recording | Sequence[Experiment | Recording],
    sensors: Sequence[Sensor] | None = None,
    *,
    nuisance: Nuisance | None = None,
) -> FisherInformation:
    """Return the Cramer-Rao bound of experiments, for a spacecraft as described.

    Noise is what the sensors' error models state (description's sensors when not given); biases and initial
    pose are nuisance parameters, joint motion is as uncertain as encoders leave it, the priors count. An
    experiment is simulated without noise; of a recording, joint motion and thrust are used.

    Raises `ExperimentError` without sensors or for a channel without noise (its bound would be zero), and
    what simulating an experiment raises.
    """
    if sensors is not None:
        description = description.with_sensors(*sensors)
    for sensor in description.effective_sensors():
        for quantity in sensor.quantities:
            if not np.all(np.asarray(sensor.error(quantity).white_sigma(sensor.rate)) > 0.0):
                raise ExperimentError(
                    f"'{sensor.name}.{quantity}' is described without noise: there is no bound.",
                    advice="Give it `errors`, or a preset.",
                )
    model = build_model(description)
    several = list(flown) if isinstance(flown, Sequence) else [flown]
    recordings = [x if isinstance(x, Recording) else _simulate_perfectly(description, x) for x in several]
    pairs = [piece_of(model, r, nuisance or Nuisance(), described_noise=True) for r in recordings]
    at = Parameters.of(model)
    point = SearchPoint(at, tuple(local for _, local in pairs))
    pieces = []
    for piece, local in pairs:
        # the whitening by what measured wheels add, as the refinement has it
        own = piece.following()
        pieces.append(own.with_input_noise(at, own.predict(at, local)))
    combinations, _ = seen_in(pieces, Evaluation.at(pieces, point), at)
    rows = np.array([c.gradient for c in combinations])
    normal = resolved_information(pieces, point, Prior(at), rows)
    covariance = normal.covariance()
    jacobian = gradient_matrix(combinations, len(covariance), at.size, ())
    return FisherInformation(
        tuple(combinations), normal.covariance_of(jacobian), prior_shares(normal, jacobian, covariance)
    )


def _simulate_perfectly(description: Description, experiment: Experiment) -> Recording:
    """The experiment as perfect sensors would record it."""
    if not description.sensor:
        raise ExperimentError(
            f"'{description.name}' has no sensors.", advice="Add [[sensor]] tables, or pass sensors."
        )
    perfect = [s.model_copy(update={"errors": {}, "preset": None}) for s in description.sensor]
    model = build_model(description.with_sensors(*perfect))
    from smsid.experiments.fly import fly  # what simulates takes time to load

    return fly(model, experiment, np.random.default_rng(0)).recording
