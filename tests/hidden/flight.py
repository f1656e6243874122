"""One run: a world with drawn numbers, what it hides, and the files a diagnosis gets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from smsid.recording import Recording

from .description import write_description, write_estimate
from .experiment import Commands, commands
from .numbers import JOINTS, WHEELS, WORLDS, Numbers, draw
from .plant import Change, simulate
from .sensors import channels, measured, phases_of

Array = np.ndarray


def fly(numbers: Numbers, c: Commands, changes: Sequence[Change] = ()) -> dict[str, Array]:
    """Noise-free channels of a world flown through commands."""
    period = float(c.time[1] - c.time[0])
    phases = [phase for _, phase in phases_of(changes, period).values()]
    motion = simulate(numbers, c.time, c.values, c.columns, changes, phases)
    return channels(motion, changes)


def recording(
    numbers: Numbers,
    c: Commands,
    rng: np.random.Generator,
    changes: Sequence[Change] = (),
    *,
    name: str,
    role: str = "estimation",
    noise: Mapping[str, float] | None = None,
) -> Recording:
    """What the sensors record of a world; `noise` replaces levels by channel."""
    found = measured(fly(numbers, c, changes), c.time, rng, changes, noise)
    groups: dict[str, tuple[str, ...]] = {"command.joint_torque": JOINTS}
    if numbers.free:
        groups["command.force"] = ("thruster",)
    if numbers.wheel_inertia is not None:
        groups["command.wheel_torque"] = WHEELS
    for channel, names in groups.items():
        found[channel] = np.array(c.values)[:, [i for n in names for i in c.columns_of(n)]]
    labels: dict[str, list[str]] = {"joint": list(JOINTS)}
    if numbers.wheel_inertia is not None:
        labels["wheel"] = list(WHEELS)
    return Recording.from_arrays(
        c.time,
        found,
        labels=labels,
        provenance={"inputs": "held", "simulated_by": "MuJoCo", "acceleration": "limit from the left"},
        role=role,
        name=name,
    )


@dataclass(frozen=True)
class Files:
    """What a diagnosis gets."""

    description: Path
    estimate: Path
    recording: Path
    validation: Path


def write_run(
    world: str,
    folder: Path,
    seed: int | Sequence[int],
    changes: Sequence[Change] = (),
    *,
    duration: float = 80.0,
    noise_factor: float = 1.0,
) -> Files:
    """Draw a world's true numbers and noise from `seed`, hide the changes, write the files.

    `noise_factor`: true noise levels over those the description states.
    """
    from .sensors import NOISE

    folder.mkdir(parents=True, exist_ok=True)
    n = WORLDS[world]
    root = np.random.default_rng(seed)
    true = draw(n, root)
    levels = {k: noise_factor * v for k, v in NOISE.items()}
    paths = []
    for k, role in enumerate(("estimation", "validation")):
        c = commands(world, k, duration)
        made = recording(true, c, root.spawn(1)[0], changes, name=f"{world}-{role}", role=role, noise=levels)
        paths.append(folder / f"{role}.nc")
        _save(made, paths[-1])
    description = write_description(n, folder)
    return Files(description, write_estimate(n, folder / "estimate.json"), paths[0], paths[1])


def _save(made: Recording, path: Path) -> None:
    from smsid.recording import save_recording

    save_recording(made, path)
