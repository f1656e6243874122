"""One run of a campaign: the spacecraft that flies, the one the method starts from, and its generators."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from smsid.campaign._inertias import link_sigmas, urdf_parts, with_drawn_inertias
from smsid.campaign._methods import check_options, import_method, reference_of, source_of
from smsid.campaign._plan import Campaign, label_words
from smsid.campaign.vary import (
    Variation,
    drawn_factor,
    drawn_values,
    effect_parameters,
    groups,
    matching_names,
    scaled_sensor,
    with_values,
)
from smsid.description import Description, load_description
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, fly, named_experiment
from smsid.model import build_model
from smsid.recording import Recording

PREFIX = "smsid-campaign-"


@dataclass(frozen=True)
class Case:
    """One run.

    ``truth`` is the spacecraft that flies, ``guess`` the one the method may know, ``description`` the one
    both were drawn around. Files they name exist only while the run lasts.
    """

    campaign: Campaign
    run: int
    description: Description
    truth: Description
    guess: Description
    experiments: tuple[Experiment, ...]

    def rng(self, label: str) -> np.random.Generator:
        """Return a generator for the method's own draws, one stream per label."""
        return self.campaign.rng(self.run, f"method {label}")

    def sensor_rng(self, number: int) -> np.random.Generator:
        """Return the generator of sensor errors of recording ``number``."""
        label, fixed = f"sensors {number}", self.campaign.noise.seed
        if fixed is None:
            return self.campaign.rng(self.run, label)
        return np.random.default_rng(np.random.SeedSequence(fixed, spawn_key=label_words(label)))

    def fly(self) -> list[Recording]:
        """Fly the experiments with the true spacecraft; raises what `smsid.experiments.fly` raises."""
        model = build_model(self.truth)
        return [fly(model, e, self.sensor_rng(k)).recording for k, e in enumerate(self.experiments)]


@dataclass(frozen=True)
class PreparedCampaign:
    """A campaign with what its plan names loaded and checked; made by `prepare`, sent to workers.

    ``inputs`` holds the SHA-256 of every file the results depend on, ``reference`` is the method's
    ``module:function``.
    """

    campaign: Campaign
    description: Description
    experiments: tuple[Experiment, ...]
    reference: str
    inputs: dict[str, str]

    @property
    def digest(self) -> str:
        """SHA-256 of the plan (without ``runs`` and ``note``) and of the files it names."""
        text = json.dumps({"plan": self.campaign.tables(), "inputs": self.inputs}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @contextmanager
    def case(self, run: int, folder: Path | None = None) -> Iterator[Case]:
        """Draw a run; its files are in a temporary folder (or in ``folder``) until the block ends.

        Raises `DescriptionError` when the draw is impossible.
        """
        campaign, noise = self.campaign, self.campaign.noise
        sensors = []
        for sensor in self.description.sensor:
            common = drawn_factor(noise.scale, campaign.rng(run, "noise"))
            own = drawn_factor(noise.sensors.get(sensor.name, 1.0), campaign.rng(run, f"noise {sensor.name}"))
            sensors.append(scaled_sensor(sensor, common * own))
        with TemporaryDirectory(prefix=PREFIX, dir=folder) as name:
            truth = self._drawn(campaign.truth, run, "truth", Path(name)).with_sensors(*sensors)
            guess = self._drawn(campaign.guess, run, "guess", Path(name))
            if noise.known:
                guess = guess.with_sensors(*sensors)
            yield Case(campaign, run, self.description, truth, guess, self.experiments)

    def _drawn(self, variations: tuple[Variation, ...], run: int, what: str, folder: Path) -> Description:
        def rng(label: str) -> np.random.Generator:
            return self.campaign.rng(run, f"{what} {label}")

        place = folder / what
        place.mkdir()
        values = drawn_values(variations, effect_parameters(self.description), rng)
        drawn = with_values(self.description, values) if values else self.description
        return with_drawn_inertias(drawn, variations, rng, place)


def prepare(campaign: Campaign) -> PreparedCampaign:
    """Load and check everything a campaign names, before the first run.

    Raises:
        DescriptionError: the description cannot be loaded or built.
        ExperimentError: an experiment, parameter, link, sensor, method or option that does not exist.
    """
    path = campaign.folder / campaign.description
    description = load_description(path)
    model = build_model(description)
    reference = reference_of(campaign.method)
    method = import_method(reference, campaign.folder)
    check_options(method, campaign.method, campaign.options)
    parts = urdf_parts(description)
    for variations in (campaign.truth, campaign.guess):
        groups(variations, effect_parameters(description))
        link_sigmas(variations, parts)
    matching_names(campaign.noise.sensors, [s.name for s in description.sensor], "sensor")
    files = {campaign.description: path.read_bytes()}
    for part in parts:
        files[f"urdf of {part.arm.name}" if part.arm else "urdf"] = part.path.read_bytes()
    experiments = []
    for name in campaign.experiments:
        file = campaign.folder / name
        own = Path(name).suffix == ".toml"
        experiments.append(named_experiment(str(file) if own else name, model))
        if own:
            files[name] = file.read_bytes()
    if len(set(campaign.experiments)) != len(campaign.experiments):
        raise ExperimentError("An experiment is listed twice.", advice="List each once.")
    if campaign.method == reference:
        files[f"source of {reference}"] = source_of(method)
    inputs = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    return PreparedCampaign(campaign, description, tuple(experiments), reference, inputs)
