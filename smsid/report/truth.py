"""True values of what an estimate holds, where the world that made the recordings is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from smsid.description.schema import Description
from smsid.export.bodies import urdf_bodies
from smsid.identify.combination_name import parse_combination
from smsid.identify.estimate import ParameterEstimate
from smsid.model import build_model
from smsid.model.regressor import INERTIAL_NAMES, body_names


@dataclass(frozen=True)
class TrueWorld:
    """Single parameters of a world by name, beside what the description said of its bodies.

    ``bodies`` are the true inertial parameters of the URDF's bodies, ``described`` the description's, by
    ``<body>.<symbol>``; ``values`` other true values by the names that estimates use. Nothing is said of
    combinations with a body in ``unsaid``: one whose appendages differ, too, say.
    """

    bodies: Mapping[str, float]
    described: Mapping[str, float]
    values: Mapping[str, float] = field(default_factory=dict)
    unsaid: tuple[str, ...] = ()

    def value(self, p: ParameterEstimate) -> float | None:
        """Return the true value of a parameter or of a combination of inertial ones; ``None`` if not known.

        A combination is taken apart: its described value, and for every term by how much the world differs.
        That two groups of an estimate may give one name to different things does no harm.
        """
        if p.name in self.values:
            return self.values[p.name]
        terms = parse_combination(p.name)
        if terms is None or p.nominal is None:
            return None
        known = self.bodies.keys() & self.described.keys()
        if any(n not in known or n.split(".")[0] in self.unsaid for n in terms):
            return None
        return p.nominal + sum(f * (self.bodies[n] - self.described[n]) for n, f in terms.items())

    def values_of(self, parameters: Iterable[ParameterEstimate]) -> dict[str, float]:
        """Return the true values by the parameters' names, of those that are known."""
        found = {p.name: self.value(p) for p in parameters}
        return {name: value for name, value in found.items() if value is not None}


def described_bodies(description: Description) -> dict[str, float]:
    """Return the inertial parameters of the URDF's bodies by ``<body>.<symbol>``, as they stand there."""
    model = build_model(description)
    names = dict(zip(list(model.pin.names)[1:], body_names(model.pin), strict=True))
    return {
        f"{names[joint]}.{symbol}": float(x)
        for joint, theta in urdf_bodies(description).items()
        for symbol, x in zip(INERTIAL_NAMES, theta, strict=True)
    }
