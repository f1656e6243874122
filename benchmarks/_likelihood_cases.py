"""What the benchmarks of maximum likelihood share: recordings of the twin, descriptions, bounds, runs."""

from __future__ import annotations

import json
import pickle
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _common import ROOT

sys.path.insert(0, str(ROOT / "tests"))

from likelihood import twin

from smsid._files import atomic_write
from smsid.description.schema import Description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.likelihood import Nuisance, fisher_information
from smsid.recording import Recording

BUILD = ROOT / "build"
RUNS = BUILD / "likelihood.jsonl"
SENSORS = {"x, imu": ("imu",), "x, imu and pose": ("imu", "pose")}
CASES = ("joint", "exp1", "exp2", "x, imu", "x, imu and pose")


@cache
def clean(name: str) -> Recording:
    """A recording without noise, simulated once."""
    file = BUILD / f"twin_{name}.pickle"
    if not file.is_file():
        made = {"exp1": twin.exp1, "exp2": twin.exp2, "x": lambda: twin.exp1((1, 0, 0))}[name]()
        atomic_write(file, pickle.dumps(made))
    return pickle.loads(file.read_bytes())


def recordings(case: str) -> list[Recording]:
    """The recordings of a case, without noise."""
    if case.startswith("x"):
        return [clean("x")]
    return [clean(name) for name in ("exp1", "exp2") if case in ("joint", name)]


@cache
def described(case: str) -> Description:
    """The true spacecraft with the sensors of the case."""
    d = twin.description()
    names = SENSORS.get(case)
    return d if names is None else d.with_sensors(*(s for s in d.sensor if s.name in names))


def wrong(description: Description, seed: int, off: float, folder: Path) -> Description:
    """Masses with their inertias, slosh and panel properties too high or too low by ``off``, at random."""
    rng = np.random.default_rng([seed, 77])
    tree = ElementTree.parse(description.folder / description.urdf)
    for inertial in tree.getroot().iter("inertial"):
        factor = 1.0 + off * rng.choice([-1.0, 1.0])
        for tag in ("mass", "inertia"):
            node = inertial.find(tag)
            assert node is not None
            for key, text in node.attrib.items():
                node.set(key, repr(float(float(text) * factor)))
    name = f"wrong{seed}.urdf"
    tree.write(folder / name)
    effects = []
    for effect in description.effect:
        values: dict[str, Any] = {}
        if isinstance(effect, Slosh):
            values = {"mass": effect.mass * (1.0 + off * rng.choice([-1.0, 1.0]))}
            for key in ("stiffness", "damping"):
                values[key] = tuple(x * (1.0 + off * rng.choice([-1.0, 1.0])) for x in getattr(effect, key))
        elif isinstance(effect, BeamAppendage):
            for key in ("density", "youngs_modulus", "damping"):
                values[key] = getattr(effect, key) * (1.0 + off * rng.choice([-1.0, 1.0]))
        effects.append(effect.model_copy(update=values))
    return description.model_copy(update={"folder": folder, "urdf": name}).with_effects(*effects)


def bounds(case: str) -> dict[str, Any]:
    """Truth, bound, the prior's share, and the bound with clocks that agree, of every parameter of a case."""
    file = BUILD / f"bound_{case.replace(', ', '_').replace(' ', '_')}.json"
    if not file.is_file():
        bound = fisher_information(described(case), recordings(case))
        synchronised = fisher_information(
            described(case), recordings(case), nuisance=Nuisance(driving_clocks=False)
        ).sigma
        rows = zip(bound.combinations, bound.prior_share, strict=True)
        table = {
            c.name: [c.value, bound.sigma[c.name], float(share), synchronised[c.name]] for c, share in rows
        }
        atomic_write(file, json.dumps(table))
    return json.loads(file.read_text())


def runs() -> list[dict[str, Any]]:
    """The runs so far."""
    return [json.loads(line) for line in RUNS.read_text().splitlines()] if RUNS.is_file() else []
