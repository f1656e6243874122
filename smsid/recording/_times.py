"""Times that are written as text or in two columns, in seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smsid.recording.columns import Columns

FloatArray = NDArray[np.float64]

DAY = 86400.0
_CLOCK = r"(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,](\d+))?)?"
_ZONE = r"\s*(Z|UTC|[+-]\d\d:?\d\d)?"
ISO = re.compile(rf"(\d{{4}})[-/](\d\d)[-/](\d\d)(?:T|\s+){_CLOCK}{_ZONE}")
DAY_OF_YEAR = re.compile(rf"(\d{{4}})-(\d{{3}})(?:T|\s+){_CLOCK}{_ZONE}")
TIME_OF_DAY = re.compile(r"(\d{1,3}):(\d\d):(\d\d)(?:[.,:](\d+))?")
DATE = re.compile(r"(\d{4})[-/.](\d\d)[-/.](\d\d)")
SPLIT_SECONDS = re.compile(r"(?i)(.*?)(secs?|seconds|s)")
"""Name of a column of whole seconds; its fellow has the same beginning and ``nsec``, ``nanosec``, ..."""
NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds", "ns")


def calendar(cells: Sequence[str]) -> NDArray[np.int64] | None:
    """Read ISO 8601 dates with times, also by day of the year: (N,) [ns] since 1970; None for other text.

    A time zone is taken into account; without one, the times are as they stand. Blank cells are the least
    integer.
    """
    found = np.full(len(cells), np.iinfo(np.int64).min)
    for k, cell in enumerate(cells):
        text = cell.strip()
        if not text:
            continue
        match = ISO.fullmatch(text)
        if match is not None:
            year, month, day, *rest = match.groups()
            date = f"{year}-{month}-{day}"
        else:
            match = DAY_OF_YEAR.fullmatch(text)
            if match is None:
                return None
            year, day, *rest = match.groups()
            date = str(np.datetime64(f"{year}-01-01") + (int(day) - 1))
        hours, minutes, seconds, fraction, zone = rest
        try:
            days = int(np.datetime64(date, "D").astype(np.int64))
        except ValueError:
            return None
        total = ((days * 24 + int(hours)) * 60 + int(minutes)) * 60 + int(seconds or 0)
        if zone and zone not in ("Z", "UTC"):
            offset = int(zone[1:3]) * 3600 + int(zone[-2:]) * 60
            total -= offset if zone[0] == "+" else -offset
        found[k] = total * 10**9 + int((fraction or "").ljust(9, "0")[:9])
    return found if len(cells) and found.max() > np.iinfo(np.int64).min else None


def time_of_day(cells: Sequence[str]) -> FloatArray | None:
    """Read ``hh:mm:ss.fff``: (N,) [s] since midnight of the first day, NaN where blank; None for other text.

    A step back of more than half a day is midnight.
    """
    found = np.full(len(cells), np.nan)
    days, before = 0.0, 0.0
    for k, cell in enumerate(cells):
        text = cell.strip()
        if not text:
            continue
        match = TIME_OF_DAY.fullmatch(text)
        if match is None:
            return None
        hours, minutes, seconds, fraction = match.groups()
        now = int(hours) * 3600 + int(minutes) * 60 + int(seconds) + float(f"0.{fraction or 0}")
        days += DAY if now < before - 0.5 * DAY else 0.0
        before = now
        found[k] = days + now
    return found if np.isfinite(found).any() else None


def read_times(columns: Columns) -> Columns:
    """Turn columns of calendar times into seconds, and join times that are split over two columns.

    Text becomes float64 (N,) [s]: calendar times count from the earliest of the file, times of the day from
    midnight. A date and a time of the day give the column ``<date> + <time>``; whole seconds and nanoseconds
    ``<sec> + <nanosec>``, since the first second.
    """
    stamps: dict[str, NDArray[np.int64]] = {}
    days: dict[str, FloatArray] = {}
    dates: dict[str, NDArray[np.int64]] = {}
    for name, values in columns.items():
        if values.dtype.kind != "U" or values.ndim != 1 or not values.size:
            continue
        cells = [str(cell) for cell in values]
        if (stamp := calendar(cells)) is not None:
            stamps[name] = stamp
        elif (day := time_of_day(cells)) is not None:
            days[name] = day
        elif (date := _dates(cells)) is not None:
            dates[name] = date
    for (date_name, date), (name, day) in zip(dates.items(), days.items(), strict=False):
        clock = np.mod(day, DAY)  # the date counts the days
        written = np.isfinite(clock)
        joined = np.full(day.size, np.iinfo(np.int64).min)
        joined[written] = date[written] * 86400 * 10**9 + np.round(clock[written] * 1e9).astype(np.int64)
        stamps[f"{date_name} + {name}"] = joined
    least = np.iinfo(np.int64).min
    if stamps:
        origin = min(int(stamp[stamp > least].min()) for stamp in stamps.values())
        for name, stamp in stamps.items():
            columns[name] = np.where(stamp > least, (stamp - origin) * 1e-9, np.nan)
            columns.units[name] = "s"
            _note_blank(columns, name, stamp == least)
    for name, day in days.items():
        columns[name] = day
        columns.units[name] = "s"
        _note_blank(columns, name, np.isnan(day))
    _join_nanoseconds(columns)
    return columns


def _note_blank(columns: Columns, name: str, blank: NDArray[np.bool_]) -> None:
    if blank.any():
        columns.blank[name] = blank


def _dates(cells: Sequence[str]) -> NDArray[np.int64] | None:
    found = np.zeros(len(cells), dtype=np.int64)
    for k, cell in enumerate(cells):
        match = DATE.fullmatch(cell.strip())
        if match is None:
            return None
        try:
            found[k] = np.datetime64("-".join(match.groups()), "D").astype(np.int64)
        except ValueError:
            return None
    return found


def _join_nanoseconds(columns: Columns) -> None:
    for name in list(columns):
        match = SPLIT_SECONDS.fullmatch(name)
        if match is None or columns[name].dtype.kind not in "fiu" or columns[name].ndim != 1:
            continue
        for ending in NANOSECONDS:
            fellow = f"{match.group(1)}{ending}"
            rest = columns.get(fellow)
            if rest is None or rest.shape != columns[name].shape or rest.dtype.kind not in "fiu":
                continue
            if not ((rest[np.isfinite(rest)] >= 0).all() and (rest[np.isfinite(rest)] < 1e9).all()):
                continue
            whole = columns[name]
            known = whole[np.isfinite(whole)]
            if not known.size:
                continue
            columns[f"{name} + {fellow}"] = (whole - known[0]) + rest * 1e-9
            columns.units[f"{name} + {fellow}"] = "s"
            _note_blank(columns, f"{name} + {fellow}", columns.missing(name) | columns.missing(fellow))
