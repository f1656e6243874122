"""Steps of a fit: Gauss and Newton's within the parameters' bounds, damped where the likelihood bends."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

import numpy as np
from scipy.optimize import brentq, lsq_linear

from smsid.errors import SmsidError
from smsid.estimation._retraction import retract
from smsid.estimation.parameter_vector import Point, Unknown

LOGGER = logging.getLogger(__name__)
WEAK, GOOD = 0.25, 0.75  # shares of the promised gain below which steps are shortened, above which they grow
LONGER, LONGEST = 1.5, 10.0  # times as long as a step may be tried: less is not worth a look
GROWTH = 3.0  # times as far the next step may go after one that gained what it promised
LEAST, MOST = -12.0, 12.0  # logarithms of the damping: none to speak of, and no step to speak of
SHORTENING = (0.05, 0.5)  # of a step that led up, what the next may be: at least, at most
REGULARISATION = 1e-12  # share of a parameter's squares that is added: what does nothing stays where it is


class Quadratic(Protocol):
    """Normal equations at a point: Gram matrix (m, m) and slope (m,) in units of `Unknown.scale`."""

    @property
    def point(self) -> Point:
        """Where they were taken."""
        ...

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The parameters, in order."""
        ...

    @property
    def gram(self) -> np.ndarray:
        """Second derivatives (m, m) of minus the log-posterior, after Gauss."""
        ...

    @property
    def slope(self) -> np.ndarray:
        """First derivatives (m,) of the log-posterior."""
        ...

    @property
    def objective(self) -> float:
        """Minus the log-posterior."""
        ...

    @property
    def scales(self) -> np.ndarray:
        """`Unknown.scale` of the parameters (m,)."""
        ...


Q = TypeVar("Q", bound=Quadratic)


def descend(
    found: Q,
    radius: float,
    tries: int,
    look: Callable[[Point], tuple[float, Callable[[], Q]]],
    *,
    lengthen: bool = False,
) -> tuple[Q | None, float]:
    """Return the normal equations a step on, within ``radius`` and leading down, and the next radius.

    ``look`` gives the objective at a point and what makes the normal equations there. ``None`` where no step
    of the ``tries`` leads down to where every body can exist. A step that gains more than it promised is
    tried longer if asked to ``lengthen``: where normal equations cost many times what a look does.
    """
    for attempt in range(tries):
        step = bounded_step(found, damping_within(found, radius))
        length, gained = float(np.linalg.norm(sizes(found) * step)), -np.inf
        try:
            point = retract(found.point, found.unknowns, step * found.scales)
            if point.physical():
                objective, equations = look(point)
                gained = found.objective - objective
                promised = predicted_gain(found, step)
                share = gained / promised if promised > 0.0 else 0.0
                if share < WEAK and not attempt and not lengthen:
                    beyond = _step_back_into_valley(equations(), length, look)
                    if beyond is not None and beyond.objective < min(objective, found.objective):
                        return beyond, max(radius, length)
                if gained > 0.0:
                    grown = max(radius, GROWTH * length) if share > GOOD else radius
                    radius = 0.5 * length if share < WEAK else grown
                    longer = _lengthen_step(found, step, gained) if lengthen else None
                    if longer is not None and longer.physical():
                        further, there = look(longer)
                        if further < objective:
                            return there(), radius
                    return equations(), radius
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("step refused: %s", error)
        radius = next_radius(length, float(found.slope @ step), -gained)
    return None, radius


def _step_back_into_valley(
    aside: Q, length: float, look: Callable[[Point], tuple[float, Callable[[], Q]]]
) -> Q | None:
    """Return the normal equations a step on from a point that a long step led to, ``None`` where there are
    none.

    Along a bent valley every long step leads up its side: one more from there leads down to its floor again,
    further on than any short step does. Source: the watchdog technique of Chamberlain et al., Math. Program.
    Stud. 16 (1982) 1.
    """
    try:
        step = bounded_step(aside, damping_within(aside, length))
        point = retract(aside.point, aside.unknowns, step * aside.scales)
        return look(point)[1]() if point.physical() else None
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("step back refused: %s", error)
        return None


def _lengthen_step(found: Quadratic, step: np.ndarray, gained: float) -> Point | None:
    """Return where the parabola through a step that ``gained`` has its lowest point, ``None`` for not beyond.

    Where curvatures are taken too large, steps are too short in every round, and a search creeps.
    """
    slope = float(found.slope @ step)
    curvature = 2.0 * (slope - gained)
    times = slope / curvature if curvature > slope / LONGEST else LONGEST
    if times < LONGER:
        return None
    low, high = room_within_bounds(found.point, found.unknowns)
    return retract(found.point, found.unknowns, np.clip(times * step, low, high) * found.scales)


def predicted_gain(found: Quadratic, step: np.ndarray) -> float:
    """Return what a step (m,) gains by the normal equations."""
    return float(found.slope @ step - 0.5 * step @ found.gram @ step)


def bounded_step(found: Quadratic, damping: float = 0.0) -> np.ndarray:
    """Return the step (m,), in scales, to the lowest point of the quadratic form within the bounds.

    With ``damping``, of the form to which that share of every parameter's squares is added: what the data
    tell least of, which bends soonest, moves least. Source: Marquardt, J. SIAM 11 (1963) 431; bounds as
    quadratic programme: Stark and Parker, Comput. Stat. 10 (1995) 129, by scipy's ``lsq_linear``.
    """
    size = sizes(found)
    share, basis = np.linalg.eigh(found.gram / np.outer(size, size))
    share = np.maximum(share, 0.0) + damping + REGULARISATION
    root = np.sqrt(share)[:, None] * basis.T
    aim = basis.T @ (found.slope / size) / np.sqrt(share)
    low, high = (bound * size for bound in room_within_bounds(found.point, found.unknowns))
    step = basis @ (aim / np.sqrt(share))
    if (step < low).any() or (step > high).any():
        step = lsq_linear(root, aim, (low, high), method="bvls").x
    return step / size


def room_within_bounds(point: Point, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray]:
    """Return how far parameters may go down and up from a point, in scales: (m,) each."""
    ends = np.array([np.array(point.bounds(u)) - point.value(u) for u in unknowns]).reshape(-1, 2)
    ends /= np.array([[u.scale] for u in unknowns])
    still = ends[:, 1] - ends[:, 0] < REGULARISATION  # no room at all is none that a solver accepts
    ends[still, 1] = ends[still, 0] + REGULARISATION
    return ends[:, 0], ends[:, 1]


def sizes(found: Quadratic) -> np.ndarray:
    """Return what a step of one scale in each parameter changes the whitened predictions by (m,)."""
    size = np.sqrt(np.diag(found.gram))
    return np.where(size > 0.0, size, 1.0)


def damping_within(found: Quadratic, radius: float) -> float:
    """Return the least damping with which `bounded_step` is no longer than ``radius``, in `sizes`.

    Source: Moré, Lecture Notes in Mathematics 630 (1978) 105. A parameter that its bound holds takes no part
    in the length, however far beyond it is wanted.
    """

    def beyond(exponent: float) -> float:
        damping = 0.0 if exponent == LEAST else 10.0**exponent
        return float(np.linalg.norm(sizes(found) * bounded_step(found, damping))) - radius

    if not np.isfinite(radius) or beyond(LEAST) <= 0.0:
        return 0.0
    if beyond(MOST) > 0.0:
        return 10.0**MOST
    return 10.0 ** float(brentq(beyond, LEAST, MOST, xtol=0.01))  # pyright: ignore[reportArgumentType]


def next_radius(length: float, slope: float, up: float) -> float:
    """Return how far the next step may go after one of a length that led ``up``, where its slope led down.

    To the lowest point of the parabola through both.
    """
    share = 0.5 * slope / (slope + up) if np.isfinite(up) and slope + up > 0.0 else 0.0
    return length * float(np.clip(share, *SHORTENING))
