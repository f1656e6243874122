"""What this experiment can tell: the test's own Fisher information, from simulations of the true world.

Output error with known inputs and without process noise, so the Fisher information of a hidden parameter is
that of the noise-free channels: the squared distance, in sigmas of the noise, between channels with and
without it, after everything the nominal parameters (with their priors) and the initial state could explain is
projected out. Sensor biases are hidden effects themselves and no nuisance.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from .catalogue import hidden_effects, nameable_effects
from .effect import Hidden
from .experiment import Commands, commands
from .flight import fly
from .limits import strength_one
from .numbers import WORLDS, Numbers, moved, nominal
from .plant import Plant, simulate
from .sensors import NOISE, channels, whitened

Array = np.ndarray
DETECTION = 5.4
"""Distance in sigmas that is found with 95 % power at level 0.01 / 60."""

SEPARATION = 3.29
"""Distance in sigmas at which two hypotheses are told apart, 5 % errors of either kind."""

CACHE = Path(__file__).resolve().parents[2] / "build" / "hidden"
STEP = 0.002  # of a nominal sigma, for central differences; what is all but a nuisance shows their errors
FLAT = 1e3  # prior of the start [m, rad, m/s, rad/s]: none to speak of
LONG = 500.0  # raw distance beyond which what is projected out may not be linear
LINEAR = 0.3  # raw distance of a step that counts as small
SEED = 20  # of the chance in an effect, for its limit


LAW_FILES = (
    "effect", "joint_effects", "body_effects", "structure_effects", "signal_effects", "plant", "sensors",
    "shortening",
)  # fmt: skip


def _laws() -> str:
    """Digest of what the sources of the effects say, comments and layout apart."""
    digest = hashlib.sha256()
    for name in LAW_FILES:
        text = (Path(__file__).resolve().parent / f"{name}.py").read_text(encoding="utf-8")
        digest.update(ast.dump(ast.parse(text)).encode())
    return digest.hexdigest()[:12]


LAWS = _laws()  # on import: what is loaded, not what the files say later


@dataclass(frozen=True)
class Limit:
    """The value of a hidden parameter at strength 1, and how it was found.

    sigma: Cramer-Rao standard deviation [unit], limit / 5.4. raw: distance per limit without projecting.
    """

    effect: str
    value: float
    sigma: float
    unit: str
    raw: float
    runs: int
    rule: str


class Experiment:
    """One world's experiment: its noise-free channels, nuisance directions and hidden effects."""

    def __init__(self, world: str, number: int = 0, duration: float = 80.0) -> None:
        self.world, self.number, self.duration = world, number, duration
        self.numbers = WORLDS[world]
        self.commands: Commands = commands(world, number, duration)
        c = self.commands
        self._motion = simulate(self.numbers, c.time, c.values, c.columns)
        self.nominal = channels(self._motion)
        self._directions: Array | None = None
        self._limits: dict[str, Limit] | None = None

    @cached_property
    def key(self) -> str:
        """Name of the cached files: it changes with what the nominal channels are."""
        digest = hashlib.sha256()
        for name, x in self.nominal.items():
            # to a thousandth of the noise, which another build of MuJoCo does not reach
            digest.update(np.round(x / (1e-3 * NOISE[name])).astype(np.int64).tobytes())
        digest.update(repr((STEP, LINEAR, LONG)).encode())
        return f"{self.world}-{self.number}-{self.duration:g}-{digest.hexdigest()[:12]}"

    def distance_vector(self, other: Mapping[str, Array]) -> Array:
        """Channels minus the nominal ones, whitened: one vector."""
        return whitened(other, self.nominal)

    def directions(self) -> Array:
        """Orthonormal directions (rows, k) that nuisances explain, shrunk by their priors; cached."""
        if self._directions is None:
            path = CACHE / f"{self.key}.npy"
            found = np.load(path) if path.is_file() else _shrunk(*self.nuisances())
            if not path.is_file():
                _save(path, found)
            self._directions = found
            return found
        return self._directions

    def project(self, vector: Array) -> Array:
        """The whitened vector (rows,) that stands for what the nuisances leave of it.

        Its length is the distance; inner products of such vectors are those after projection.
        """
        q = self.directions()
        # (I - Q1 Q1^T) is a covariance with eigenvalues in [0, 1]; its square root keeps inner products
        return vector - q @ _root(q, vector)

    def signal(self, effect: Hidden, value: float, onset: float | None = None) -> Array:
        """What a hidden value changes from a time on, projected, (rows,); by its derivative where its trace
        is long.
        """
        vector = self._raw(effect, value, onset)
        raw = float(np.linalg.norm(vector))
        if raw > LONG and effect.rule is None and effect.power == 1:  # how it bends is none
            vector = self._raw(effect, value * LINEAR / raw, onset) * (raw / LINEAR)
        return self.project(vector)

    def _raw(self, effect: Hidden, value: float, onset: float | None = None) -> Array:
        change = effect.make(value, onset, np.random.default_rng(SEED))
        if change.only_sensors:
            return self.distance_vector(channels(self._motion, [change]))
        return self.distance_vector(fly(self.numbers, self.commands, [change]))

    def limit(self, name: str) -> Limit:
        """The value of strength 1 of an effect; cached."""
        path = CACHE / f"{self.key}-{LAWS}.json"
        if self._limits is None:
            self._limits = {}
            if path.is_file():
                self._limits = {k: Limit(**v) for k, v in json.loads(path.read_text()).items()}
        if name not in self._limits:
            self._limits[name] = self._search(hidden_effects(self.world)[name])
            text = json.dumps({k: asdict(v) for k, v in self._limits.items()}, indent=1)
            _save(path, text)
        return self._limits[name]

    def _search(self, effect: Hidden) -> Limit:
        if effect.rule is not None:
            sigma = effect.rule / DETECTION
            return Limit(effect.name, effect.rule, sigma, effect.unit, DETECTION, 0, "counted")
        value, runs = min(effect.guess, effect.cap), 0
        while True:
            vector = self._raw(effect, value)
            raw, left, runs = (
                float(np.linalg.norm(vector)),
                float(np.linalg.norm(self.project(vector))),
                runs + 1,
            )
            if not left > 0.0:
                return Limit(effect.name, np.inf, np.inf, effect.unit, 0.0, runs, "no trace")
            # what is projected out must stay linear: the nearer to all of it, the smaller the step
            if runs == 2 or (raw < LONG and left > 0.02 * raw):
                found = value * (DETECTION / left) ** (1 / effect.power)
                share = raw * DETECTION / left
                return Limit(effect.name, found, found / DETECTION, effect.unit, share, runs, "distance")
            value = min(value * (LINEAR / raw) ** (1 / effect.power), effect.cap)

    def nuisances(self) -> tuple[Array, Array]:
        """Derivatives (rows, k) of the channels in sigmas; prior standard deviations (k,)."""
        columns, sigmas = [], []
        for p in nominal(self.numbers):
            pair = [
                fly(moved(self.numbers, {p.name: sign * STEP * p.sigma}), self.commands) for sign in (1, -1)
            ]
            columns.append((self.distance_vector(pair[0]) - self.distance_vector(pair[1])) / (2 * STEP))
            sigmas.append(1.0)
        for direction in _initial_directions(self.numbers):
            pair = [self._started(sign * 1e-4 * direction) for sign in (1, -1)]
            columns.append((self.distance_vector(pair[0]) - self.distance_vector(pair[1])) / 2e-4)
            sigmas.append(FLAT)
        return np.array(columns).T, np.array(sigmas)

    def _started(self, offset: Array) -> dict[str, Array]:
        c, nv = self.commands, len(offset) // 2
        initial = (offset[:nv], offset[nv:])
        return channels(simulate(self.numbers, c.time, c.values, c.columns, initial=initial))


@cache
def experiment(world: str, number: int = 0, duration: float = 80.0) -> Experiment:
    """The experiment, made once."""
    return Experiment(world, number, duration)


def correlation(a: Array, b: Array) -> float:
    """Correlation of two projected signals (rows,)."""
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def distance_after(signal: Array, others: Array) -> float:
    """What is left of a projected signal (rows,) when other ones (rows, k) explain what they can."""
    size = np.linalg.norm(others, axis=0)
    if not (size > 0.0).any():
        return float(np.linalg.norm(signal))
    scaled = others[:, size > 0.0] / size[size > 0.0]  # one without a trace explains nothing
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    u = u[:, s > 1e-6 * s[0]]
    return float(np.sqrt(max(signal @ signal - np.sum((u.T @ signal) ** 2), 0.0)))


@dataclass(frozen=True)
class Named:
    """What a diagnosis names: a kind, where (anywhere with `None`) and which shape of it (any)."""

    kind: str
    location: str | None = None
    shape: str | None = None

    def means(self, effect: Hidden) -> bool:
        """Whether a hidden effect is of what is named."""
        kind = self.kind in (effect.kind, *effect.others)
        place = self.location is None or self.location in (effect.location, *effect.also)
        return kind and place and (self.shape is None or not effect.shapes or self.shape in effect.shapes)


def cannot_separate(
    exp: Experiment, truth: Hidden, value: float, named: Named, onset: float | None = None
) -> bool:
    """Whether this experiment cannot tell the hidden value from what is named.

    What begins midway is compared with what begins then.
    """
    signal = exp.signal(truth, value, onset)
    columns = []
    for other in nameable_effects(exp.world).values():
        if not named.means(other) or other.rule is not None:
            continue
        size = min(strength_one(exp.world, other.name) or other.guess, other.cap)
        for make in (other.make, *other.beside):
            own = replace(other, make=make)
            columns.append(exp.signal(own, size, onset if other.onset else None))
    if not columns:
        return False
    return distance_after(signal, np.array(columns).T) < SEPARATION


def _initial_directions(n: Numbers) -> list[Array]:
    """Unit displacements and velocities (2 nv,) of everything but the wheels' angles."""
    plant = Plant(n)
    nv = plant.model.nv
    wheels = [] if n.wheel_inertia is None else [plant.v_of(f"wheel_{a}") for a in "xyz"]
    return [np.eye(2 * nv)[i] for i in range(2 * nv) if i not in wheels]


def _shrunk(jacobian: Array, sigma: Array) -> Array:
    """Q1 (rows, k): upper part of an orthonormal basis of [J; 1 / sigma], scaled so that it is well posed."""
    size = np.sqrt(np.sum(jacobian**2, axis=0) + sigma**-2)
    stacked = np.vstack([jacobian / size, np.diag(1.0 / sigma / size)])
    return np.linalg.qr(stacked)[0][: len(jacobian)]


def _root(q: Array, vector: Array) -> Array:
    """Coefficients c with vector - Q c of squared length vector^2 - |Q^T vector|^2, and so for products.

    With Q^T Q = V diag(s) V^T, the square root of I - Q Q^T acts on the range of Q by sqrt(1 - s).
    """
    s, v = np.linalg.eigh(q.T @ q)
    inside = v.T @ (q.T @ vector)
    s = np.clip(s, 0.0, 1.0)
    factor = np.where(s > 1e-14, (1.0 - np.sqrt(1.0 - s)) / np.where(s > 1e-14, s, 1.0), 0.5)
    return v @ (factor * inside)


def _save(path: Path, content: Array | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    if isinstance(content, str):
        part.write_text(content)
    else:
        with part.open("wb") as file:
            np.save(file, content)
    part.replace(path)
