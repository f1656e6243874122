from dataclasses import replace

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose.channels import measured
from smsid.diagnose.filter import Noise, Problem, Timing
from smsid.diagnose.fit import evaluate
from smsid.diagnose.nominal import nominal
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder


@pytest.fixture(scope="package")
def description():
    return load_description(urdf_folder() / "paper_sms.toml")


@pytest.fixture(scope="package")
def recording(description):
    """Six seconds of the second experiment, noisy."""
    model = build_model(description)
    plan = named_experiment("exp2", model).model_copy(update={"duration": 6.0})
    return fly(model, plan, np.random.default_rng(3)).recording


@pytest.fixture(scope="package")
def known(description):
    return nominal(description, None)


@pytest.fixture(scope="package")
def problem(known, recording):
    data = measured(known.point.base, recording, description_sensors(known))
    return Problem(recording, data, np.array([], dtype=int), Timing("linear", "right"), Noise())


def description_sensors(known):
    return known.point.description.effective_sensors()


@pytest.fixture(scope="package")
def calm(problem):
    """Slosh and modes start at rest, and that is known."""
    return replace(problem, noise=Noise(hidden=(1e-9, 1e-9)))


@pytest.fixture(scope="package")
def plain(known, calm):
    return evaluate(known.point, known.unknowns[:1], calm)
