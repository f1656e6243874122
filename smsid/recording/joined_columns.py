"""One log that was written to several files, one quantity each: their columns together."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from smsid.errors import RecordingError
from smsid.recording.columns import Columns
from smsid.recording.readers import CsvFormat, read_columns


def read_joined(
    file: str | os.PathLike[str], also: Sequence[str | os.PathLike[str]], csv_format: CsvFormat | None = None
) -> Columns:
    """Return the columns of a file and of others that go on with it.

    A column that several files have, such as their clock, must hold the same in all of them.

    Raises:
        RecordingError: as `read_columns`, or a column of the same name differs.
    """
    joined = read_columns(file, csv_format)
    for other in also:
        more = read_columns(other, csv_format)
        for name in sorted(set(joined) & set(more)):
            if not _alike(joined[name], more[name]):
                raise RecordingError(
                    f"'{name}' of {other} is not that of {file}: {joined[name].shape} and {more[name].shape} "
                    "samples, or other values.",
                    advice="Files are joined that share their clock; import the others by themselves.",
                    column=name,
                )
        blank, units = {**more.blank, **joined.blank}, {**more.units, **joined.units}
        times = joined.times | more.times
        joined = Columns(
            {**joined, **{n: x for n, x in more.items() if n not in joined}}, blank=blank, units=units
        )
        joined.times |= times
    return joined


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    if a.shape != b.shape or a.dtype.kind != b.dtype.kind:
        return False
    return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
