from dataclasses import replace

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose.priors import nominal
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder

from .search_stubs import world  # noqa: F401 (a fixture)


@pytest.fixture(scope="package")
def description():
    return load_description(urdf_folder() / "paper_sms.toml")


@pytest.fixture(scope="package")
def flown(description):
    """Return the noisy recording of some seconds of an experiment, by its name and a seed."""

    def fly_it(experiment, seconds, seed):
        model = build_model(description)
        plan = named_experiment(experiment, model).model_copy(update={"duration": seconds})
        return fly(model, plan, np.random.default_rng(seed)).recording

    return fly_it


@pytest.fixture(scope="package")
def recording(flown):
    """Six seconds of the second experiment, noisy."""
    return flown("exp2", 6.0, 3)


@pytest.fixture(scope="package")
def known(description):
    return nominal(description, None)


@pytest.fixture(scope="package")
def problem(known, recording):
    data = measurements_of(known.point.base, recording, description_sensors(known))
    return Problem(recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise())


def description_sensors(known):
    return known.point.description.effective_sensors()


@pytest.fixture(scope="package")
def calm(problem):
    """Slosh and modes start at rest, and that is known."""
    return replace(problem, noise=ProcessNoise(hidden=(1e-9, 1e-9)))


@pytest.fixture(scope="package")
def plain(known, calm):
    return evaluate(known.point, known.unknowns[:1], calm)
