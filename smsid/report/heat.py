"""A map of rows by columns in steps of colour, each cell with its number, so that colour is never alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

STEPS = 8  # of colour, from calm to loud


@dataclass(frozen=True)
class HeatCell:
    """One cell: step of colour 0 ... 7 (-1: not applicable), what is written in it, what a pointer is told.

    ``marked`` cells have a frame, whatever their colour.
    """

    step: int = -1
    text: str = ""
    tip: str = ""
    marked: bool = False


@dataclass(frozen=True)
class HeatMap:
    """Cells (rows, columns). ``scale`` names the steps of colour in the legend, from the calm end."""

    rows: Sequence[str]
    columns: Sequence[str]
    cells: Sequence[Sequence[HeatCell]]
    alt: str
    scale: Sequence[tuple[int, str]] = ()
    corner: str = ""
    square: bool = False

    def table(self) -> list[tuple[str, Sequence[HeatCell]]]:
        """Return every row's name with its cells."""
        return list(zip(self.rows, self.cells, strict=True))


def step_of(x: float, edges: tuple[float, ...]) -> int:
    """Return how many of the ascending edges ``x`` reaches, at most the last step."""
    return min(sum(x >= e for e in edges), STEPS - 1)


SIMILAR = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97)
ALIKE = 0.9  # correlation from which on two things are marked as hardly told apart


def correlation_map(names: Sequence[str], labels: Sequence[str], r: np.ndarray, alt: str) -> HeatMap:
    """Return the map of correlations r (n, n) of what has these ``names``, numbered behind its ``labels``."""
    cells = []
    for i, one in enumerate(names):
        values = [float(x) for x in r[i]]
        row = [
            HeatCell(
                step_of(abs(x), SIMILAR),
                f"{x:.2f}".replace("-", "−"),
                f"{one} and {other}: {x:.3f}",
                abs(x) >= ALIKE,
            )
            for x, other in zip(values, names, strict=True)
        ]
        row[i] = HeatCell(0, "1", f"{one} and {one}: 1.000")
        cells.append(row)
    numbers = [str(k) for k in range(1, len(names) + 1)]
    numbered = [f"{label}  {k}" for label, k in zip(labels, numbers, strict=True)]
    scale = ((0, "below 0.1"), (3, "0.5"), (5, "0.8"), (6, "0.9"), (7, "0.97"), (-1, "0.9 and above"))
    return HeatMap(numbered, numbers, cells, alt, scale, square=True)
