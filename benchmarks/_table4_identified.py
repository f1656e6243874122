"""Case D of Table 4: controller's models identified from another engine's recordings, a seed of noise each.

The starting guess of each is off by 30 % in every mass, inertia, slosh value and panel property, so what the
controller knows comes from the estimate.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from _accuracy_cases import Data, noisy, wrong_description
from _common import RESULTS

from smsid.control.identified_model import identified_level, identified_model, inertia_at
from smsid.control.reduced import ReducedDynamics
from smsid.identify.paper.pipeline import identify

STORE = RESULTS / "table4_identified.jsonl"
RECORDINGS = ("exp1_xyz_modal3", "exp2_modal3")


def identify_up_to(count: int, exact: ReducedDynamics, home: np.ndarray, minutes: float) -> None:
    """Identify from seed 0 to count - 1; what is there is not identified again."""
    done = {line["seed"] for line in stored()}
    left = [seed for seed in range(count) if seed not in done]
    if not left:
        return
    data, begin = Data(), time.monotonic()
    root = np.linalg.inv(np.linalg.cholesky(inertia_at(exact, home)))
    with tempfile.TemporaryDirectory() as folder, STORE.open("a", encoding="utf-8") as file:
        for seed in left:
            if time.monotonic() - begin > 60.0 * minutes:
                break
            description = wrong_description(data.description, seed, Path(folder))
            recordings = [noisy(data[r], data.description.sensor, seed) for r in RECORDINGS]
            found = identified_model(description, identify(description, recordings).estimate)
            dynamics = found.dynamics()
            off = root @ inertia_at(dynamics, home) @ root.T - np.eye(len(root))
            line = {
                "seed": seed,
                "error_of_H": float(np.linalg.norm(off, 2)),
                "level": identified_level(found, np.random.default_rng(seed), draws=100),
                "misfit": found.misfit,
                "inertias": {
                    name: [float(f"{x:.9g}") for x in inertia.toDynamicParameters()]
                    for name, inertia in bodies(dynamics)
                },
            }
            file.write(json.dumps(line) + "\n")
            file.flush()


def stored() -> list[dict[str, Any]]:
    """Return what was identified, by line."""
    if not STORE.is_file():
        return []
    return [json.loads(line) for line in STORE.read_text(encoding="utf-8").splitlines() if line]


def identified(exact: ReducedDynamics) -> list[ReducedDynamics]:
    """Return the identified models, by seed."""
    names = list(exact.pin.names)[1:]
    found = []
    for line in sorted(stored(), key=lambda x: x["seed"]):
        inertias = [inertia.copy() for inertia in list(exact.pin.inertias)[1:]]
        for name, theta in line["inertias"].items():
            inertias[names.index(name)] = pin.Inertia.FromDynamicParameters(np.array(theta))
        found.append(exact.with_inertias(inertias))
    return found


def bodies(dynamics: ReducedDynamics) -> list[tuple[str, pin.Inertia]]:
    """Return base and links by name of their joint; wheels are known."""
    wheels = set(dynamics.wheels.joints.tolist())
    pairs = zip(list(dynamics.pin.names)[1:], list(dynamics.pin.inertias)[1:], strict=True)
    return [(n, i) for j, (n, i) in enumerate(pairs, start=1) if j not in wheels]
