"""Forces that few coordinates decide, each by a law that compiled code knows too (`smsid.kernel._forces`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import pinocchio as pin

Depends = tuple[Sequence[int], Sequence[int]]
"""What a force depends on: places and rates, as indices among the nv coordinates of the tangent space."""


class ForceLaw:
    """A generalised force on the degrees of freedom ``rows`` (n,) of v, from ``start`` [s] on.

    ``places`` (n,) are theirs in q; ``numbers`` are those of the law, in the order in which they are given.
    """

    law: ClassVar[str]
    by_place = by_rate = True  # whether it depends on where its degrees of freedom are, and how they move

    def __init__(self, rows: Sequence[int], places: Sequence[int], *numbers: float | np.ndarray) -> None:
        self.rows, self.places = list(rows), list(places)
        self.numbers = np.concatenate([np.ravel(x) for x in numbers]).astype(float)
        self.start = -np.inf

    @property
    def depends(self) -> Depends:
        """Places and rates it depends on."""
        return self.rows if self.by_place else (), self.rows if self.by_rate else ()

    def by_load(self) -> float:
        """Return how much of it goes by the applied force: nothing."""
        return 0.0

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add it to tau (nv,)."""
        if t >= self.start:
            tau[self.rows] += self._force(t, q, v)


class ConstantForce(ForceLaw):
    """The same force (n,) always."""

    law = "constant"
    by_place = by_rate = False

    def __init__(self, rows: Sequence[int], force: Sequence[float] | np.ndarray) -> None:
        super().__init__(rows, (), np.asarray(force))

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return self.numbers


class InertialWrench(ForceLaw):
    """A force (3,) [N] at a ``point`` (3,) [m] of the bus, and a torque (3,) [N m], in inertial axes."""

    law = "inertial"

    def __init__(self, force: np.ndarray, torque: np.ndarray, point: np.ndarray) -> None:
        super().__init__(range(6), (), force, torque, point)

    @property
    def depends(self) -> Depends:
        """The attitude."""
        return (3, 4, 5), ()

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        to_body = pin.Quaternion(q[3:7]).toRotationMatrix().T
        f, m = to_body @ self.numbers[:3], to_body @ self.numbers[3:6]
        return np.r_[f, m + np.cross(self.numbers[6:], f)]


class TransmittedForce(ForceLaw):
    """The applied force of another degree of freedom acts on this one as well."""

    law = "transmitted"
    by_place = by_rate = False

    def __init__(self, row: int, giver: int) -> None:
        super().__init__([row, giver], (), np.zeros(0))

    def by_load(self) -> float:
        """Return how much of it goes by the applied force: all."""
        return 1.0

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """Add it to tau (nv,), which holds the applied forces alone."""
        row, giver = self.rows
        if t >= self.start:
            tau[row] += tau[giver]


class Spring(ForceLaw):
    """``-stiffness (q - rest)``."""

    law = "spring"
    by_rate = False

    def __init__(self, row: int, place: int, stiffness: float, rest: float) -> None:
        super().__init__([row], [place], stiffness, rest)

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        stiffness, rest = self.numbers
        return -stiffness * (q[self.places] - rest)


class DriftOfSpring(ForceLaw):
    """What a spring has more where its frequency is ``1 + rate (t - since)`` times what it was."""

    law = "drift"
    by_rate = False

    def __init__(self, row: int, place: int, stiffness: float, rate: float, since: float) -> None:
        super().__init__([row], [place], stiffness, rate, since)

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        stiffness, rate, since = self.numbers
        change = rate * max(t - since, 0.0)
        return -stiffness * change * (2.0 + change) * q[self.places]


class CentralForce(ForceLaw):
    """On a mass displaced by r: ``-cubic |r|^2 r - quadratic |r'| r'``, and beyond ``gap`` a wall's
    ``-stiffness (|r| - gap)`` along r. With ``apart`` every axis has the first two by itself.
    """

    law = "central"

    def __init__(
        self,
        rows: Sequence[int],
        places: Sequence[int],
        *,
        apart: bool = False,
        cubic: float = 0.0,
        quadratic: float = 0.0,
        gap: float = np.inf,
        stiffness: float = 0.0,
    ) -> None:
        super().__init__(rows, places, float(apart), cubic, quadratic, gap, stiffness)

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        apart, cubic, quadratic, gap, stiffness = self.numbers
        r, dr = q[self.places], v[self.rows]
        far = np.sqrt(r @ r)
        stretch, speed = (r * r, np.abs(dr)) if apart else (far**2, np.sqrt(dr @ dr))
        wall = stiffness * (1.0 - gap / far) if far > gap else 0.0
        return -(cubic * stretch + wall) * r - quadratic * speed * dr


class SharedFriction(ForceLaw):
    """On a sum s of coordinates with ``weights`` (n,): ``-(viscous s' + coulomb tanh(s' / smoothing))``."""

    law = "shared"
    by_place = False

    def __init__(
        self, rows: Sequence[int], weights: np.ndarray, viscous: float, coulomb: float, smoothing: float
    ) -> None:
        super().__init__(rows, (), viscous, coulomb, smoothing, weights)

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        viscous, coulomb, smoothing = self.numbers[:3]
        weights = self.numbers[3:]
        rate = weights @ v[self.rows]
        return -weights * (viscous * rate + coulomb * np.tanh(rate / smoothing))


class BacklashForce(ForceLaw):
    """Teeth that touch at ``half`` the gap on either side: a spring and a damper beyond it."""

    law = "play"

    def __init__(self, row: int, place: int, half: float, stiffness: float, damping: float) -> None:
        super().__init__([row], [place], half, stiffness, damping)

    def _force(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        half, stiffness, damping = self.numbers
        x = q[self.places]
        if abs(x[0]) <= half:
            return np.zeros(1)
        return -stiffness * (x - half * np.sign(x)) - damping * v[self.rows]
