"""The columns of a log file by name, with what the file says about them beside the numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError

DAMAGED = "It is cut short, damaged, or of another format: copy it again, or correct its suffix."


class Columns(dict[str, NDArray[Any]]):
    """Arrays of a log by name, as the readers give them.

    Attributes:
        blank: by column, (N,) True where the cell was left blank: there is no sample, and the number is NaN.
            A column that has no blank cell is not listed.
        times: columns that were written as dates or times of the day, so that they are clocks whatever
            their names.
        units: by column, the unit that a row of units under the header states, in the words of a mapping.
    """

    def __init__(
        self,
        arrays: Mapping[str, NDArray[Any]] | None = None,
        *,
        blank: Mapping[str, NDArray[np.bool_]] | None = None,
        units: Mapping[str, str] | None = None,
        times: Collection[str] = (),
    ) -> None:
        super().__init__(arrays or {})
        self.blank: dict[str, NDArray[np.bool_]] = dict(blank or {})
        self.units: dict[str, str] = dict(units or {})
        self.times: set[str] = set(times)

    def missing(self, name: str) -> NDArray[np.bool_]:
        """Tell the rows in which a column has no sample: (N,) bool."""
        return self.blank.get(name, np.zeros(self[name].shape[:1], dtype=bool))


def unreadable(path: Path, kind: str, error: Exception, advice: str = DAMAGED) -> RecordingError:
    """Return the error of a file that a reader of a ``kind`` gave up on."""
    size = path.stat().st_size if path.is_file() else 0
    text = f"{path} ({size} bytes) cannot be read as {kind}: {error}."
    return RecordingError(text, advice=advice, path=str(path), size=size)


def without_samples(path: Path, what: str, advice: str = "Is it the right file?") -> RecordingError:
    """Return the error of a file in which there is nothing to read."""
    return RecordingError(f"{path} has no {what}.", advice=advice, path=str(path))
