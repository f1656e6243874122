"""Times that are written as text or in two columns, in seconds."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smsid.recording._columns import Columns

FloatArray = NDArray[np.float64]

DAY = 86400.0
EPOCH = datetime.date(1970, 1, 1).toordinal()
_CLOCK = (
    r"(?P<h>\d{1,2}):?(?P<min>\d\d)(?::?(?P<s>\d\d)(?:[.,:](?P<f>\d+))?)?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?"
)
_DATES = (
    r"(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)",
    r"(?P<y>\d{4})(?P<m>\d\d)(?P<d>\d\d)",
    r"(?P<y>\d{4})[-/:.](?P<doy>\d{3})",
    r"(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}|\d\d)",
    r"(?P<m>\d\d?)[-/](?P<d>\d\d?)[-/](?P<y>\d{4})",
    r"(?P<d>\d\d?)[-/](?P<m>\d\d?)[-/](?P<y>\d{4})",
    r"(?P<d>\d\d?)[- ](?P<name>[A-Za-z]{3,9})\.?[- ](?P<y>\d{4})",
    r"(?:[A-Za-z]{3},? )?(?P<name>[A-Za-z]{3,9})\.? +(?P<d>\d\d?),? +(?P<y>\d{4})",
)
"""Dates as they are written. Where day and month may be either, the order that spans less is taken."""
STAMPS = tuple(re.compile(rf"{date}(?:[T_:/]|\s+){_CLOCK}") for date in _DATES)
DATES = tuple(re.compile(date) for date in _DATES)
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
TIME_OF_DAY = re.compile(
    r"(?:(?P<days>\d{1,4})(?:/|\s*d(?:ays?)?,?\s+|\s+))?(?P<h>\d{1,3}):(?P<min>\d\d):(?P<s>\d\d)"
    r"(?:[.,:](?P<f>\d+))?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
"""Also as a count of days and a time, as mission clocks and durations are written."""
MINUTES = re.compile(r"(?P<min>\d{1,4}):(?P<s>\d\d)[.,](?P<f>\d+)")
SPLIT_SECONDS = re.compile(r"(?i)(.*?)(secs?|seconds|s)")
"""Name of a column of whole seconds; its fellow has the same beginning and ``nsec``, ``usec`` ..."""
FRACTIONS = {
    **dict.fromkeys(("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds", "ns"), 1e-9),
    **dict.fromkeys(("usec", "usecs", "microsec", "microseconds", "us"), 1e-6),
    **dict.fromkeys(("msec", "msecs", "millisec", "milliseconds", "ms"), 1e-3),
}
BLANK = np.iinfo(np.int64).min


def is_time(cell: str) -> bool:
    """Tell whether a cell is a time written as text."""
    return calendar([cell]) is not None or time_of_day([cell]) is not None


def calendar(cells: Sequence[str]) -> NDArray[np.int64] | None:
    """Read dates with times, ISO 8601 or as loggers write them: (N,) [ns] since 1970; None for other text.

    A time zone is taken into account; without one, the times are as they stand. Blank cells are the least
    integer.
    """
    return _parse_cells(cells, STAMPS)


def _parse_cells(cells: Sequence[str], forms: Sequence[re.Pattern[str]]) -> NDArray[np.int64] | None:
    """Read cells by the form that all of them have; by that of the least span where several do."""
    written = [cell.strip() for cell in cells]
    if not any(written):
        return None
    found = []
    for form in forms:
        stamps = _in_form(written, form)
        if stamps is not None:
            known = stamps[stamps > BLANK]
            found.append((int(known.max()) - int(known.min()), len(found), stamps))
    return min(found)[2] if found else None


def _in_form(written: list[str], form: re.Pattern[str]) -> NDArray[np.int64] | None:
    stamps = np.full(len(written), BLANK)
    days: dict[str, int] = {}
    for k, text in enumerate(written):
        if not text:
            continue
        match = form.fullmatch(text)
        if match is None:
            return None
        parts = match.groupdict()
        date = text[: match.start("h")] if "h" in parts else text
        try:
            if date not in days:
                days[date] = _day(parts)
            seconds = _seconds(parts) if "h" in parts else 0
        except ValueError:
            return None
        stamps[k] = (days[date] * 86400 + seconds) * 10**9 + int((parts.get("f") or "").ljust(9, "0")[:9])
    return stamps


def _day(parts: dict[str, str | None]) -> int:
    """Count the days since 1970; raise ValueError for a day that does not exist."""
    year = int(parts["y"] or 0)
    first = datetime.date(year + 2000 if year < 100 else year, 1, 1)
    if parts.get("doy"):
        return (first + datetime.timedelta(int(parts["doy"] or 0) - 1)).toordinal() - EPOCH
    name = parts.get("name")
    month = MONTHS.index(name[:3].lower()) + 1 if name else int(parts["m"] or 0)
    return first.replace(month=month, day=int(parts["d"] or 0)).toordinal() - EPOCH


def _seconds(parts: dict[str, str | None]) -> int:
    """Count the whole seconds of a day, with its zone; raise ValueError for a time that does not exist."""
    hours, minutes, seconds = (int(parts[key] or 0) for key in ("h", "min", "s"))
    if minutes > 59 or seconds > 60:
        raise ValueError(parts)
    half, zone = parts.get("half"), parts.get("zone")
    if half:
        hours = hours % 12 + (12 if half in "Pp" else 0)
    total = (hours * 60 + minutes) * 60 + seconds
    if zone and zone[0] in "+-":
        digits = zone[1:].replace(":", "").ljust(4, "0")
        offset = int(digits[:2]) * 3600 + int(digits[2:]) * 60
        total -= offset if zone[0] == "+" else -offset
    return total


def time_of_day(cells: Sequence[str]) -> FloatArray | None:
    """Read ``hh:mm:ss.fff``, ``mm:ss.fff`` or days and a time: (N,) [s] since midnight of the first day.

    NaN where blank; None for other text. A step back of more than half a day is midnight.
    """
    found = np.full(len(cells), np.nan)
    days, before = 0.0, 0.0
    for k, cell in enumerate(cells):
        text = cell.strip()
        if not text:
            continue
        match = TIME_OF_DAY.fullmatch(text) or MINUTES.fullmatch(text)
        if match is None:
            return None
        parts = {"h": None, "days": None, **match.groupdict()}
        minutes = int(parts["min"] or 0) * 60 + int(parts["s"] or 0) if parts["h"] is None else 0
        now = (_seconds(parts) if parts["h"] else minutes) + float(f"0.{parts['f'] or 0}")
        now += DAY * int(parts["days"] or 0)
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
        elif (date := _parse_cells(cells, DATES)) is not None:
            dates[name] = date
    for (date_name, date), (name, day) in zip(dates.items(), days.items(), strict=False):
        clock = np.mod(day, DAY)  # the date counts the days
        written = np.isfinite(clock)
        written &= date > BLANK
        joined = np.full(day.size, BLANK)
        joined[written] = date[written] + np.round(clock[written] * 1e9).astype(np.int64)
        stamps[f"{date_name} + {name}"] = joined
    stamps = {name: stamp for name, stamp in stamps.items() if (stamp > BLANK).any()}
    if stamps:
        origin = min(int(stamp[stamp > BLANK].min()) for stamp in stamps.values())
        for name, stamp in stamps.items():
            columns[name] = np.where(stamp > BLANK, (stamp - origin) * 1e-9, np.nan)
            columns.units[name] = "s"
            columns.times.add(name)
            _note_blank(columns, name, stamp == BLANK)
    for name, day in days.items():
        columns[name] = day
        columns.units[name] = "s"
        columns.times.add(name)
        _note_blank(columns, name, np.isnan(day))
    _join_fractions(columns)
    return columns


def _note_blank(columns: Columns, name: str, blank: NDArray[np.bool_]) -> None:
    if blank.any():
        columns.blank[name] = blank


def _join_fractions(columns: Columns) -> None:
    for name in list(columns):
        match = SPLIT_SECONDS.fullmatch(name)
        if match is None or columns[name].dtype.kind not in "fiu" or columns[name].ndim != 1:
            continue
        for ending, scale in FRACTIONS.items():
            fellow = f"{match.group(1)}{ending}"
            rest = columns.get(fellow)
            if rest is None or rest.shape != columns[name].shape or rest.dtype.kind not in "fiu":
                continue
            part = rest[np.isfinite(rest)] * scale
            if not ((part >= 0.0).all() and (part < 1.0).all()):
                continue
            whole = columns[name]
            known = whole[np.isfinite(whole)]
            if not known.size:
                continue
            columns[f"{name} + {fellow}"] = (whole - known[0]) + rest * scale
            columns.units[f"{name} + {fellow}"] = "s"
            _note_blank(columns, f"{name} + {fellow}", columns.missing(name) | columns.missing(fellow))
