"""Curves, points and bands over two axes, as paths that stretch with the page while lines and text do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid._short_repr import short_repr
from smsid.report.axes import Axis

SIZE = 1000.0  # of the box that paths are drawn in
Style = Literal["line", "thin", "broad", "dash", "points", "rings", "ticks"]


@short_repr
@dataclass(frozen=True)
class Curve:
    """Points (N,), (N,) joined or not; not-a-number breaks the line. ``colour``: number in the palette."""

    label: str
    x: np.ndarray
    y: np.ndarray
    colour: int = 0
    style: Style = "line"


@short_repr
@dataclass(frozen=True)
class Band:
    """The area between two curves (N,) over x (N,)."""

    label: str
    x: np.ndarray
    low: np.ndarray
    high: np.ndarray
    colour: int = 0


@dataclass(frozen=True)
class Rule:
    """A line across at one value of x (``upright``) or y, named beside it."""

    label: str
    value: float
    upright: bool = True
    colour: int = 0


@dataclass(frozen=True)
class Plot:
    """Marks over two axes. ``height`` in pixels; ``alt`` says in words what is to be seen."""

    x: Axis
    y: Axis
    marks: Sequence[Curve | Band | Rule]
    alt: str
    height: int = 280

    @property
    def legend(self) -> tuple[tuple[str, int, str], ...]:
        """Label, colour and style of every named curve and band."""
        out = {}
        for m in self.marks:
            if not isinstance(m, Rule) and m.label:
                out[m.label] = (m.label, m.colour, "band" if isinstance(m, Band) else m.style)
        return tuple(out.values())

    def shapes(self) -> list[tuple[str, int, str]]:
        """Return style, colour and path of everything to be drawn, bands first."""
        out = [("band", m.colour, self._area(m)) for m in self.marks if isinstance(m, Band)]
        out += [("rule", m.colour, self._across(m)) for m in self.marks if isinstance(m, Rule)]
        for c in (m for m in self.marks if isinstance(m, Curve)):
            if c.style in ("points", "rings", "ticks"):
                dots = self._dots(c)
                out.append(("tickmarks" if c.style == "ticks" else "points", c.colour, dots))
                if c.style == "rings":
                    out.append(("holes", c.colour, dots))
            else:
                out.append((c.style, c.colour, path(*self._points(c.x, c.y))))
        return [s for s in out if s[2]]

    def labels(self) -> list[tuple[str, float, bool]]:
        """Return the rules' names with where they stand in per cent."""
        out = []
        for r in self.marks:
            if isinstance(r, Rule) and r.label:
                where = float((self.x if r.upright else self.y).at(r.value))
                if 0.0 <= where <= 1.0:
                    out.append((r.label, round(100.0 * where, 2), r.upright))
        return out

    def _points(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return SIZE * self.x.at(x), SIZE * (1.0 - self.y.at(y))

    def _area(self, b: Band) -> str:
        x = np.concatenate([b.x, b.x[::-1]])
        edge = np.concatenate([b.low, b.high[::-1]])
        drawn = path(*self._points(x, np.clip(edge, self.y.low, self.y.high)))
        return f"{drawn}Z" if drawn else ""

    def _across(self, r: Rule) -> str:
        where = float((self.x if r.upright else self.y).at(r.value))
        if not 0.0 <= where <= 1.0:
            return ""
        at = SIZE * (where if r.upright else 1.0 - where)
        return f"M{at:.1f} 0V{SIZE:g}" if r.upright else f"M0 {at:.1f}H{SIZE:g}"

    def _dots(self, c: Curve) -> str:
        x, y = self._points(c.x, c.y)
        inside = np.isfinite(x) & np.isfinite(y) & (x >= 0) & (x <= SIZE) & (y >= 0) & (y <= SIZE)
        return "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[inside], y[inside], strict=True))


def path(x: np.ndarray, y: np.ndarray, digits: int = 1) -> str:
    """Return the path of a line through points x (N,), y (N,), broken where one is not finite."""
    out, pen = [], False
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not (np.isfinite(a) and np.isfinite(b)):
            pen = False
            continue
        # far outside of the box nothing is seen, and numbers would only get long
        b = min(max(b, -SIZE), 2.0 * SIZE)
        out.append(f"{'L' if pen else 'M'}{a:.{digits}f} {b:.{digits}f}")
        pen = True
    return "".join(out)
