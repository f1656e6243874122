"""Joint friction: viscous, Coulomb, Stribeck's, and what depends on direction, load, angle, temperature."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Literal

import numpy as np
from pydantic import Field

from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, JointEffect, Starting, physical, register
from smsid.effects.force_laws import ForceLaw
from smsid.effects.friction_law import (
    BY_FIELD,
    SMOOTHING,
    TERMS,
    TURNED,
    Law,
    closest_friction,
    friction_columns,
    sliding_state,
)
from smsid.effects.joint_state import Counterpart, JointStateOf, TorqueColumns

ON_REQUEST = ("direction", "quadratic", "cubic", "temperature")
"""Laws that no estimator takes up unless they are named, or have a value or a prior."""
LOAD = 7  # of a friction's numbers


class FrictionTorque(ForceLaw):
    """The torque of some laws of a `JointFriction`, of given sizes, on one degree of freedom.

    Its ``numbers`` (13,) are viscous, Coulomb, both by direction, quadratic, cubic, Stribeck's, by load, by
    cosine and sine of the angle; the width of the sign; rate and exponent of Stribeck's curve.
    """

    law = "friction"

    def __init__(
        self, effect: JointFriction, dof: int, place: int, turns: bool, sizes: Mapping[str, float]
    ) -> None:
        self.effect, self.turns = effect, turns
        self.by_place = "position_cos" in sizes or "position_sin" in sizes
        self.terms = [(size, BY_FIELD[field].column) for field, size in sizes.items()]
        warmer = effect.temperature - effect.reference_temperature
        own = {f: sizes.get(f, 0.0) for f in BY_FIELD}
        for law in ("viscous", "coulomb"):
            own[law] += warmer * own.pop(f"{law}_temperature")
        shape = effect.smoothing, effect.stribeck_rate, effect.stribeck_exponent
        super().__init__([dof], [place], np.array([*own.values(), *shape]))

    def by_load(self) -> float:
        """Return how much of it goes by the torque that drives the joint."""
        return float(self.numbers[LOAD])

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add it to tau (nv,); what goes by the load finds that there."""
        if t < self.start:
            return
        (k,), (place,) = self.rows, self.places
        angle = q[place] if self.turns else np.arctan2(q[place + 1], q[place])
        at = sliding_state(self.effect, v[k], angle=angle, load=tau[k])
        tau[k] -= sum(size * column(at) for size, column in self.terms)


@register
class JointFriction(JointEffect, Starting):
    """Friction torque on one joint of an arm or wheel, against its rate qd.

    With ``s = tanh(qd / smoothing)``, T the temperature above the reference, and tau the torque that drives
    the joint (where its motion is prescribed, nothing drives it, and the load takes no part):

    ``-(viscous + viscous_direction s + quadratic |qd| + cubic qd^2 + viscous_temperature T) qd``
    ``-(coulomb + coulomb_direction s + stribeck exp(-|qd/stribeck_rate|^stribeck_exponent) + load |tau|
    + position_cos cos q + position_sin sin q + coulomb_temperature T) s``

    The terms are those of `smsid.effects.friction_law`. ``viscous + viscous_direction`` is the friction of
    positive rates, ``viscous - viscous_direction`` that of negative ones.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, whose Stribeck curve has
    the exponent of Bo and Pavelescu, Wear 82 (1982) 277: 2 is Gauss's curve, 1 Tustin's; load-dependent
    harmonic drives: Taghirad and Belanger, J. Dyn. Syst. Meas. Control 120 (1998) 311; temperature:
    Bittencourt and Gunnarsson, J. Dyn. Syst. Meas. Control 134 (2012) 051013.
    """

    summary = (
        "friction of one joint: viscous, Coulomb, quadratic, Stribeck, by direction, load, angle and "
        "temperature; the Coulomb torque as `tanh(rate / smoothing)`"
    )
    family = "friction"
    open_shape = ("smoothing",)
    aliases = ("actuator_delay", "torque_gain", "torque_offset")
    strength = tuple(
        t.field
        for t in TERMS
        if t.law != "temperature"  # nothing at the reference temperature
    )
    # of a strong one all other laws are special cases
    strong = {"viscous": (1.0, 30.0), "coulomb": (1.0, 30.0)}
    changes = {
        "viscous": ("its drag has grown", "its drag has fallen"),
        "coulomb": ("its friction has grown", "its friction has fallen"),
    }
    in_words = "{place} has {shape} friction that the description lacks"
    kind: Literal["joint_friction"] = "joint_friction"
    viscous: float = physical(
        "N m s/rad", lower=0.0, may_vanish=True, default=0.0, description="torque per rate"
    )
    coulomb: float = physical("N m", lower=0.0, may_vanish=True, default=0.0, description="torque at speed")
    viscous_direction: float = physical(
        "N m s/rad",
        default=0.0,
        description="what `viscous` is larger by at positive rates, and smaller at negative ones",
    )
    coulomb_direction: float = physical("N m", default=0.0, description="the same of `coulomb`")
    quadratic: float = physical(
        "N m s^2/rad^2", default=0.0, description="torque per rate squared; negative where drag flattens"
    )
    cubic: float = physical("N m s^3/rad^3", default=0.0, description="torque per cube of the rate")
    stribeck: float = physical(
        "N m", lower=0.0, default=0.0, description="torque beyond `coulomb` on breaking loose"
    )
    stribeck_rate: float = physical(
        "rad/s", lower=1e-6, default=0.05, description="rate at which `stribeck` has fallen to 37 %"
    )
    stribeck_exponent: float = physical(
        "1",
        lower=0.5,
        upper=4.0,
        default=2.0,
        description="how sharply `stribeck` falls about that rate: 2 is a Gaussian, 1 an exponential",
    )
    load: float = physical(
        "1",
        lower=0.0,
        may_vanish=True,
        default=0.0,
        description="Coulomb torque per torque that drives the joint",
    )
    position_cos: float = physical(
        "N m", default=0.0, description="Coulomb torque that goes with the cosine of the joint's angle"
    )
    position_sin: float = physical("N m", default=0.0, description="the same, with the sine")
    viscous_temperature: float = physical(
        "N m s/(rad K)", default=0.0, description="what `viscous` grows by per kelvin above the reference"
    )
    coulomb_temperature: float = physical("N m/K", default=0.0, description="the same of `coulomb`")
    reference_temperature: float = Field(
        default=20.0, description="temperature that `viscous` and `coulomb` are of [degC]"
    )
    temperature: float = Field(default=20.0, description="of the joint, where none is measured [degC]")
    laws: tuple[Law, ...] = Field(
        default=(),
        description='terms to identify beside viscous and Coulomb, as in `["direction"]`; those with a value '
        "are anyway",
    )
    smoothing: float = physical(
        "rad/s", lower=1e-6, default=SMOOTHING, description="rate at which the Coulomb torque reaches 76 %"
    )

    def asked(self) -> tuple[str, ...]:
        """Return the terms to identify: viscous, Coulomb, those with a value and those of a named law."""
        return tuple(
            t.field for t in TERMS if not t.law or t.law in self.laws or getattr(self, t.field) != 0.0
        )

    def held(self) -> dict[str, str]:
        """Return why parameters are not estimated; laws that nobody named are not."""
        asked = {*self.asked(), *self.prior}
        idle = {
            f"{self.name}.{t.field}": f"its law is not named in `laws` ({t.law})"
            for t in TERMS
            if t.law in ON_REQUEST and t.field not in asked
        }
        known = (
            {} if "smoothing" in self.prior else {f"{self.name}.smoothing": "known unless a prior is given"}
        )
        return super().held() | idle | known

    def with_laws(self, *laws: Law) -> JointFriction:
        """Return it with more laws to identify."""
        return self.model_copy(update={"laws": tuple(dict.fromkeys((*self.laws, *laws)))})

    def why_unresolved(self, fields: Collection[str]) -> str:
        """Return that Stribeck's curve falls before the sign has turned: what it does is the sign's shape."""
        least = TURNED * self.smoothing
        if "stribeck" not in fields or not self.stribeck or self.stribeck_rate >= least:
            return ""
        return (
            f"{self.name}.stribeck_rate = {self.stribeck_rate:.3g} is within the width of the sign, which "
            f"has turned at {least:.3g}"
        )

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return the terms that are `asked`. Raises `DescriptionError` where one needs what is not known."""
        s, laws = of(self.joint), {BY_FIELD[f].law for f in self.asked()}
        at = sliding_state(
            self,
            s.rate,
            angle=s.known("angle", self.name) if "position" in laws else 0.0,
            load=s.known("load", self.name) if "load" in laws else 0.0,
            temperature=s.known("temperature", self.name) if "temperature" in laws else None,
        )
        return {f: {self.joint: x} for f, x in friction_columns(self, self.asked(), at).items()}

    def torque_shapes(self) -> tuple[str, ...]:
        """Return the width of the sign, and Stribeck's rate where it is `asked`."""
        return ("smoothing", "stribeck_rate") if "stribeck" in self.asked() else ("smoothing",)

    def attach(self, assembly: Assembly) -> None:
        """Add the friction torque; a viscous part that is always there is a linear damper."""
        joint = assembly.joint(self.joint)
        index, place, turns = joint.idx_v, joint.idx_q, joint.nq == 1
        sizes = {f: float(getattr(self, f)) for f in BY_FIELD if getattr(self, f)}
        if self.start is None and "viscous" in sizes:
            assembly.add_springs(assembly.joint_id(self.joint), (0.0,), (sizes.pop("viscous"),))
        by_load = sizes.pop("load", 0.0)
        if sizes:
            assembly.add_force(FrictionTorque(self, index, place, turns, sizes))
        if by_load:
            assembly.add_load_force(FrictionTorque(self, index, place, turns, {"load": by_load}))

    def urdf_dynamics(self) -> dict[str, tuple[float, float]]:
        """Return viscous and Coulomb friction; of one that begins midway, nothing."""
        return {self.joint: (self.viscous, self.coulomb) if self.start is None else (0.0, 0.0)}

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart | str:
        """Return dry friction and what it adds to the viscous damper; see `closest_friction`."""
        if self.start is not None:
            return "it begins midway (start)"
        weights = {self.joint: 1.0}
        other = [t.field for t in TERMS if getattr(self, t.field) and t.field not in ("viscous", "coulomb")]
        if not other:
            return Counterpart(weights, dry=self.coulomb)
        dry, damping, note = closest_friction(self, limits[self.joint])
        dropped = ", without its part by load" if self.load else ""
        said = f"friction '{self.name}' has {', '.join(other)}, which others have not: {note}{dropped}."
        return Counterpart(weights, damping=damping, dry=dry, note=said)


def frictions_of(effects: Iterable[Effect]) -> dict[str, JointFriction]:
    """Return the friction by joint, of effects."""
    return {e.joint: e for e in effects if isinstance(e, JointFriction)}


def depends_on_load(effects: Iterable[Effect]) -> bool:
    """Return whether friction among effects goes with the torque that drives its joint."""
    return any("load" in e.asked() for e in effects if isinstance(e, JointFriction))
