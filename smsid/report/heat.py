"""A map of rows by columns in steps of colour, each cell with its number, so that colour is never alone."""

from __future__ import annotations

from dataclasses import dataclass

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

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    cells: tuple[tuple[HeatCell, ...], ...]
    alt: str
    scale: tuple[tuple[int, str], ...] = ()
    corner: str = ""
    square: bool = False

    @property
    def kind(self) -> str:
        """Name of its template."""
        return "heat"

    def table(self) -> tuple[tuple[str, tuple[HeatCell, ...]], ...]:
        """Return every row's name with its cells."""
        return tuple(zip(self.rows, self.cells, strict=True))


def step_of(x: float, edges: tuple[float, ...]) -> int:
    """Return how many of the ascending edges ``x`` reaches, at most the loudest step."""
    return min(sum(x >= e for e in edges), STEPS - 1)
