"""A Monte Carlo campaign: what is repeated, what is varied, and the random generator of every run."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from smsid._explain import validate_tables
from smsid._reading import read_toml
from smsid.campaign.vary import Variation
from smsid.errors import ExperimentError

Positive = Annotated[float, Field(gt=0.0)]
Factor = Positive | tuple[Positive, Positive]


class Noise(BaseModel):
    """How sensor errors vary over the runs.

    Attributes:
        scale: factor on every random error of every sensor (noise, turn-on bias, instability, random walk,
            drawn scale errors and misalignments) [1]; two numbers: drawn log-uniformly between them per run.
            Constants (``bias``, ``scale_error``, ``misalignment``, ``delay``) stay as described.
        sensors: such a factor by sensor, on top of ``scale``.
        known: whether the method is told the scaled errors; otherwise it starts from the described ones.
        seed: of the sensors' draws, the same in every run; without it, every run has noise of its own.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    scale: Factor = 1.0
    sensors: dict[str, Factor] = Field(default_factory=dict)
    known: bool = False
    seed: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _ranges_ascend(self) -> Noise:
        for factor in (self.scale, *self.sensors.values()):
            if isinstance(factor, tuple) and factor[0] > factor[1]:
                raise ValueError(f"the factors {factor[0]:g} to {factor[1]:g} are the wrong way round")
        return self


class Campaign(BaseModel):
    """A Monte Carlo campaign, from its TOML. Every run is a pure function of the campaign and its index.

    Attributes:
        name: of the campaign.
        note: anything to remember; not part of the campaign's identity.
        description: the spacecraft's TOML (or URDF), from the folder of the plan.
        experiments: flown in every run: names (``exp1``, ``exp2``, ...) or TOMLs from the plan's folder.
        runs: how many; a finished campaign can be continued with more.
        seed: root of all randomness.
        method: name of a registered method, or ``module:function`` of one's own.
        options: passed to the method as keywords.
        truth: what is drawn around the description for the spacecraft that flies.
        guess: what is drawn around the description for the one the method starts from.
        noise: how sensor errors vary.
        folder: where relative paths start; not part of the file.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)

    schema_version: Literal[1] = Field(default=1, alias="schema")
    name: Annotated[str, Field(min_length=1)]
    note: str = ""
    description: str
    experiments: tuple[str, ...] = ()
    runs: Annotated[int, Field(gt=0)]
    seed: Annotated[int, Field(ge=0)]
    method: Annotated[str, Field(min_length=1)] = "paper"
    options: dict[str, Any] = Field(default_factory=dict)
    truth: tuple[Variation, ...] = ()
    guess: tuple[Variation, ...] = ()
    noise: Noise = Noise()
    folder: Annotated[Path, Field(exclude=True)] = Path(".")

    def rng(self, run: int, label: str) -> np.random.Generator:
        """Return the generator of one purpose of a run.

        It is a child of the run's seed sequence keyed by ``label``, so what is drawn for one purpose does not
        depend on what else is varied.
        """
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(run, *label_words(label))))

    def with_runs(self, runs: int) -> Campaign:
        """Return the campaign with another number of runs; raises `ExperimentError` unless positive."""
        if runs <= 0:
            raise ExperimentError(f"A campaign of {runs} runs makes no sense.", advice="Ask for 1 or more.")
        return self.model_copy(update={"runs": runs})

    def tables(self) -> dict[str, Any]:
        """Return what makes the campaign what it is, JSON-like: all keys but ``runs`` and ``note``."""
        return self.model_dump(mode="json", by_alias=True, exclude={"runs", "note"})


def label_words(label: str) -> tuple[int, int]:
    """Return two 32-bit words that stand for a label in a ``spawn_key``."""
    digest = hashlib.sha256(label.encode()).digest()
    return int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:8], "little")


def load_campaign(path: str | os.PathLike[str]) -> Campaign:
    """Load a campaign from its TOML; relative paths in it start at the file's folder.

    Raises `ExperimentError` for a missing file, bad TOML, or anything against the schema. What the plan names
    (files, parameters, links, sensors, the method) is checked by `smsid.campaign.prepare`.
    """
    file = Path(path)
    tables = read_toml(file, ExperimentError)
    folder = file.resolve().parent
    return validate_tables(
        Campaign, tables, f"'{file}'", ExperimentError, folder=folder, kind="campaign_plan"
    )
