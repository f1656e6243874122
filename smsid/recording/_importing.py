"""From a log file and a mapping to a recording."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid._files import sha256
from smsid._listing import did_you_mean
from smsid._time_text import stamp_text
from smsid.errors import RecordingError
from smsid.recording._name_order import order_doubts
from smsid.recording._repeats import without_repeats
from smsid.recording._units import convert
from smsid.recording.attitude import conjugate, rotate, slerp
from smsid.recording.channels import EXTRA, LABELLED_DIMS, SLIDING, Quantity
from smsid.recording.clock import check_order
from smsid.recording.mapping import (
    ChannelTable,
    ClockTable,
    ImportMapping,
    load_mapping,
    mapping_path,
    target_unit,
)
from smsid.recording.readers import Columns, parse_number, read_joined
from smsid.recording.recording import Recording

logger = logging.getLogger(__name__)

FloatArray = NDArray[np.float64]


def import_recording(
    file: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | ImportMapping,
    *,
    check: bool = True,
    also: Sequence[str | os.PathLike[str]] = (),
) -> Recording:
    """Bring a log file in: CSV (also gzipped), NPZ, MATLAB, HDF5, netCDF-4, ROS bags, MCAP or Parquet.

    Args:
        file: the log.
        mapping: a TOML file, the name of one of `bundled_mappings`, or an `ImportMapping`.
        check: run `Recording.check` on the result. Without it, NaN, gaps and contradictions come in as they
            are.
        also: files with more columns of the same log, see `read_joined`.

    Raises:
        RecordingError: file or mapping cannot be read, a column is missing or not numeric, lengths differ, a
            unit is of the wrong dimension, or what `Recording.check` finds.
    """
    rules = load_mapping(mapping)
    columns = read_joined(file, also, rules.csv)
    job = _Import(Path(file), rules, columns)
    provenance: dict[str, Any] = {
        "imported": {
            "file": Path(file).name,
            "sha256": _sum(Path(file)),
            "mapping": rules.model_dump(mode="json", exclude_defaults=True),
        }
    }
    if also:
        provenance["imported"]["also"] = {Path(f).name: _sum(Path(f)) for f in also}
    if not isinstance(mapping, ImportMapping):
        provenance["imported"]["mapping_file"] = mapping_path(mapping).name
    if rules.recording.note:
        provenance["note"] = rules.recording.note
    if rules.recording.inputs:
        provenance["inputs"] = rules.recording.inputs
    absent = [name for name in rules.channel if job.is_absent(name)]
    if absent:
        provenance["imported"]["absent"] = absent
    provenance["imported"] |= job.joint_kinds()
    recording, repeated = without_repeats(job.run(provenance))
    if repeated:
        for clock, count in repeated.items():
            logger.warning(
                "%s: %s of clock '%s' left out that repeat the row before, stamp and values.",
                file,
                "1 row" if count == 1 else f"{count} rows",
                clock,
            )
        recording = recording.with_provenance(
            {"imported": {**recording.provenance["imported"], "repeated_rows": repeated}}
        )
    if check:
        try:
            recording.check()
        except RecordingError as error:
            more = "To bring it in as it is: `--unchecked`, in Python `check=False`."
            raise error.at(file, more_advice=more) from error
    return recording


def columns_to_recording(path: Path, rules: ImportMapping, columns: Columns) -> Recording:
    """Make a recording of columns that are read already, without provenance or checks.

    Raises:
        RecordingError: as `import_recording`, but for what `Recording.check` finds.
    """
    return without_repeats(_Import(path, rules, columns).run({}))[0]


def _combined_error(faults: Sequence[RecordingError]) -> RecordingError:
    """Return one error of all faults: each once, with its own advice."""
    said = list(dict.fromkeys(map(str, faults)))
    if len(said) == 1:
        return faults[0]
    return RecordingError(
        f"{len(said)} faults. " + " ".join(f"({k}) {text}" for k, text in enumerate(said, 1)), faults=said
    )


class _Import:
    """One file on its way in."""

    def __init__(self, file: Path, rules: ImportMapping, columns: Columns) -> None:
        self.file, self.rules, self.columns = file, rules, columns
        self._clocks: dict[str, FloatArray] = {}
        self._turn_round()

    def run(self, provenance: dict[str, Any]) -> Recording:
        present = {name: table for name, table in self.rules.channel.items() if not self.is_absent(name)}
        if not present:
            raise RecordingError(
                f"{self.file} has none of the mapped channels.", advice="Is it the right mapping?"
            )
        channels: dict[str, Any] = {}
        plain: list[str] = []
        faults: list[RecordingError] = []
        for name, table in present.items():
            try:
                channels[name] = self._channel(name, table)
            except RecordingError as error:
                faults.append(error)
        if faults:
            raise _combined_error(faults)
        for doubt in order_doubts(present):
            logger.warning("%s: %s", self.file, doubt)
        for name, values in channels.items():
            source = name.partition(".")[0]
            kept = self._sampled_rows(source, present)
            if not kept.all():
                channels[name] = (self._clock(name)[kept], values[kept])
            elif source in self.rules.clock:
                channels[name] = (self._clock(name), values)
            else:
                plain.append(name)
        shared = self._clock(plain[0]) if plain else None
        try:
            return Recording.from_arrays(
                shared,
                channels,
                labels=self._labels(present),
                units={
                    name: table.one_unit or "1"
                    for name, table in present.items()
                    if name.startswith(f"{EXTRA}.")
                },
                provenance=provenance,
                role=self.rules.recording.role,
                name=self.rules.recording.name,
            )
        except RecordingError as error:
            raise error.at(self.file) from error

    def _fault(self, channel: str, text: str, advice: str, **evidence: Any) -> RecordingError:
        """Return the error of a channel that cannot be taken from the file."""
        where = f"{self.file}, channel '{channel}'"
        return RecordingError(f"{where}: {text}", advice=advice, channel=channel, **evidence)

    def _turn_round(self) -> None:
        """Put the oldest sample first where a clock only decreases, with all columns that run on it."""
        turned: dict[str, NDArray[Any]] = {}
        blank = dict(self.columns.blank)
        for name, table in self.rules.channel.items():
            clock = self.rules.clock.get(name.partition(".")[0], self.rules.time)
            times = None if clock is None or clock.column is None else self.columns.get(clock.column)
            if times is None or times.ndim != 1 or times.dtype.kind not in "fiu" or times.size < 3:
                continue
            assert clock is not None and clock.column is not None
            if not (np.diff(times[~self.columns.missing(clock.column)].astype(np.float64)) < 0.0).all():
                continue
            if clock.column not in turned:
                logger.warning("%s: '%s' runs backwards; the rows are turned round.", self.file, clock.column)
            for column in (clock.column, *table.columns):
                axis = 0 if column == clock.column else table.time_axis
                if column in self.columns and column not in turned and axis < self.columns[column].ndim:
                    turned[column] = np.flip(self.columns[column], axis)
                    if column in blank:
                        blank[column] = blank[column][::-1]
        if turned:
            self.columns = Columns(
                {**self.columns, **turned},
                blank=blank,
                units=self.columns.units,
                times=self.columns.times,
            )

    def joint_kinds(self) -> dict[str, list[str]]:
        """Return the labels of joints that slide, in metres or newtons, and of those that surely turn.

        Radians say neither: many logs state them for all joints. Degrees do.
        """
        found: dict[str, dict[str, None]] = {"sliding": {}, "turning": {}}
        for name, table in self.rules.channel.items():
            quantity = table.quantity(name)
            if quantity.is_quaternion or not table.labels or quantity.unit not in SLIDING:
                continue
            units = table.units * (len(table.labels) if len(table.units) == 1 else 1)
            for label, unit in zip(table.labels, units, strict=False):
                if target_unit(unit, quantity, name) != quantity.unit:
                    found["sliding"][label] = None
                elif "deg" in unit or "rpm" in unit:
                    found["turning"][label] = None
        return {kind: list(labels) for kind, labels in found.items() if labels}

    def is_absent(self, name: str) -> bool:
        """Tell whether an optional channel has none of its columns; having some is an error, found later."""
        table = self.rules.channel[name]
        return table.optional and not any(column in self.columns for column in table.columns)

    def _rows(self, table: ChannelTable) -> NDArray[np.bool_]:
        """Tell the rows in which a channel has a sample: those where not all of its cells are blank."""
        kept = [~self.columns.missing(column) for column in table.columns if column in self.columns.blank]
        if len(kept) < len(table.columns):
            return np.ones(1, dtype=bool)  # broadcasts: a column without blank cells
        rows = np.any(kept, axis=0)
        return np.ones(1, dtype=bool) if rows.all() else rows

    def _sampled_rows(self, source: str, present: dict[str, ChannelTable]) -> NDArray[np.bool_]:
        """Tell the rows in which a source has samples, or raise `RecordingError` if its channels differ."""
        first, rows = "", np.ones(1, dtype=bool)
        for name, table in present.items():
            if name.partition(".")[0] != source:
                continue
            own = self._rows(table)
            if not first:
                first, rows = name, own
                continue
            if own.size != rows.size or not np.array_equal(own, rows):
                raise RecordingError(
                    f"{self.file}: '{first}' and '{name}' have their samples in different rows; elsewhere "
                    "their cells are blank.",
                    advice=f"Name two sources, so that each gets its own clock: not '{name}' but "
                    f"'{source}2.{name.partition('.')[2]}'.",
                    channel=name,
                )
        if not rows.any():
            raise RecordingError(
                f"{self.file}: the cells of '{first}' are all blank.",
                advice="Leave the channel out of the mapping.",
                channel=first,
            )
        return rows

    def _channel(self, name: str, table: ChannelTable) -> FloatArray:
        quantity = table.quantity(name)
        values = self._gather_columns(name, table, quantity)
        if quantity.is_quaternion:
            values = np.roll(values, -1, axis=1) if table.quaternion == "wxyz" else values
            return conjugate(values) if table.direction == "inertial_to_body" else values
        if quantity.dims:
            values = self._convert_units(name, table, quantity, values)
        values = self._apply_signs(name, table, values)
        if table.attitude is not None:
            values = self._turn_vectors(name, table, values)
        return values

    def _convert_units(
        self, name: str, table: ChannelTable, quantity: Quantity, values: FloatArray
    ) -> FloatArray:
        """Convert values to the catalogue's unit, column by column where they state their own."""
        where = f"{self.file}, channel '{name}'"
        assert table.units
        if len(table.units) == 1:
            return convert(values, table.units[0], target_unit(table.units[0], quantity, where), where)
        out = np.array(values, dtype=np.float64)
        for k, unit in enumerate(table.units):
            out[..., k] = convert(out[..., k], unit, target_unit(unit, quantity, where), where)
        return out

    def _gather_columns(self, name: str, table: ChannelTable, quantity: Quantity) -> FloatArray:
        """Collect the columns of a channel into (N, ...)."""
        arrays = [self._numbers(column, f"channel '{name}'") for column in table.columns]
        if len(arrays) > 1:
            self._one_length(name, table, arrays)
            values = np.stack(arrays, axis=1)
        else:
            values = self._pick_components(name, table, arrays[0])
        if values.ndim == 1 and quantity.dims:
            values = values[:, None]
        stations = ("station", "axis") in quantity.dims and values.ndim == 2
        if stations and values.shape[1] != 3 and values.shape[1] % 3 == 0:
            values = values.reshape(values.shape[0], -1, 3)
        elif stations and values.shape[1] == 3 and table.labels:
            values = values[:, None, :]
        if quantity.dims_of(values.shape[1:]) is None:
            raise self._fault(
                name,
                f"{', '.join(table.columns)} make {values.shape}; expected {quantity.shapes()}.",
                "Name one column per component, or state index or time_axis.",
                shape=values.shape,
            )
        samples = self._clock(name, values.shape[0]).size
        if values.shape[0] != samples:
            raise self._fault(
                name,
                f"{', '.join(table.columns)} has {values.shape[0]} samples, its clock has {samples}.",
                "Give its source its own clock, [clock.<source>], or state time_axis.",
                samples=values.shape[0],
                expected=samples,
            )
        return values

    def _one_length(self, name: str, table: ChannelTable, arrays: list[FloatArray]) -> None:
        flat = [column for column, array in zip(table.columns, arrays, strict=True) if array.ndim != 1]
        if flat:
            raise self._fault(
                name, f"'{flat[0]}' is not a single column.", "Name one array, or single columns."
            )
        lengths = {column: array.size for column, array in zip(table.columns, arrays, strict=True)}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{column} {size}" for column, size in lengths.items())
            advice = "Export them together, or map them to sources with clocks of their own."
            raise self._fault(name, f"its columns have different lengths: {listed}.", advice, lengths=lengths)

    def _pick_components(self, name: str, table: ChannelTable, values: FloatArray) -> FloatArray:
        if table.time_axis >= max(values.ndim, 1):
            text = f"time_axis = {table.time_axis}, but '{table.columns[0]}' has shape {values.shape}."
            raise self._fault(name, text, f"Choose an axis below {values.ndim}.")
        values = np.moveaxis(values, table.time_axis, 0) if values.ndim else values
        if table.index is None:
            return values
        if values.ndim != 2 or max(table.index) >= values.shape[1]:
            text = f"index {list(table.index)} does not fit '{table.columns[0]}' of shape {values.shape}."
            raise self._fault(name, text, "It picks columns of a two-dimensional array, counted from 0.")
        return values[:, list(table.index)]

    def _apply_signs(self, name: str, table: ChannelTable, values: FloatArray) -> FloatArray:
        if isinstance(table.sign, int):
            return values * float(table.sign) if table.sign != 1 else values
        if values.ndim < 2 or values.shape[-1] != len(table.sign):
            text = f"{len(table.sign)} signs for shape {values.shape}."
            raise self._fault(name, text, "Give one sign, or one per component.")
        return values * np.array(table.sign, dtype=np.float64)

    def _turn_vectors(self, name: str, table: ChannelTable, values: FloatArray) -> FloatArray:
        assert table.attitude is not None
        if self.is_absent(table.attitude):
            text = f"the attitude '{table.attitude}' that turns it is absent."
            raise self._fault(name, text, "Leave the channel out of the mapping too.")
        # Gathering first: a clock of fixed rate is as long as its first channel.
        attitude = self.rules.channel[table.attitude]
        q = self._channel(table.attitude, attitude)
        own, times = self._clock(table.attitude), self._clock(name)
        with_attitude = np.broadcast_to(self._rows(attitude), own.shape)
        with_values = np.broadcast_to(self._rows(table), times.shape)
        q, own = q[with_attitude], own[with_attitude]
        times = times[with_values]
        norms = np.linalg.norm(q, axis=1)
        if not (np.isfinite(norms).all() and norms.min() > 0.5):
            index = int(np.flatnonzero(~(norms > 0.5) | ~np.isfinite(norms))[0])
            raise RecordingError(
                f"{self.file}: '{table.attitude}' is no attitude at index {index} (norm {norms[index]}); it "
                f"cannot turn '{name}'.",
                advice="Mend the attitude, or give the vector in the frame of the catalogue.",
                channel=table.attitude,
                index=index,
            )
        if not np.array_equal(own, times):
            check_order(own, f"{table.attitude.partition('.')[0]}.time")
            if times.min() < own[0] or times.max() > own[-1]:
                raise RecordingError(
                    f"{self.file}: '{table.attitude}' runs from {stamp_text(own[0])} to "
                    f"{stamp_text(own[-1])} s and does not cover '{name}', {stamp_text(times.min())} to "
                    f"{stamp_text(times.max())} s.",
                    advice="Nothing is extrapolated: cut the log to the attitude's span.",
                    channel=name,
                )
            q = slerp(own, q, times)
        turned = np.full(values.shape, np.nan)
        turned[with_values] = rotate(q if table.frame == "body" else conjugate(q), values[with_values])
        return turned

    def _clock(self, name: str, samples: int | None = None) -> FloatArray:
        """Give the times (N,) [s] of a channel; a fixed rate takes N from the first channel that uses it."""
        source = name.partition(".")[0]
        key = source if source in self.rules.clock else ""
        if key not in self._clocks:
            table: ClockTable | None = self.rules.clock.get(source, self.rules.time)
            assert table is not None
            where = f"[clock.{key}]" if key else "[time]"
            if table.rate is not None:
                assert samples is not None
                self._clocks[key] = table.start + np.arange(samples) / table.rate
            else:
                assert table.column is not None and table.unit is not None
                times = np.squeeze(self._numbers(table.column, where))
                if times.ndim != 1:
                    raise RecordingError(
                        f"{self.file}, {where}: '{table.column}' has shape {times.shape}, not (N,).",
                        advice="Name the column of times.",
                    )
                self._clocks[key] = convert(times, table.unit, "s", f"{self.file}, {where}")
                if table.column in self.columns.times and not np.array_equal(
                    self._clocks[key], times, equal_nan=True
                ):
                    raise RecordingError(
                        f"{self.file}, {where}: '{table.column}' holds dates or times of the day, which are "
                        f"read in s, not in {table.unit}.",
                        advice="State unit = 's'.",
                        column=table.column,
                    )
        return self._clocks[key]

    def _numbers(self, column: str, where: str) -> FloatArray:
        if column not in self.columns:
            meant = did_you_mean(column, self.columns).strip()
            raise RecordingError(
                f"{self.file} has no '{column}', asked for by {where}; it has {', '.join(self.columns)}.",
                advice=meant or "Correct the mapping, or mark it optional.",
                column=column,
                present=tuple(self.columns),
            )
        values = self.columns[column]
        if values.dtype.kind in "fiu":
            return values.astype(np.float64)
        if values.dtype.kind == "U" and values.ndim == 1:
            for row, cell in enumerate(values):
                if self.columns.missing(column)[row] or is_number(str(cell)):
                    continue
                raise RecordingError(
                    f"{self.file}, column '{column}', row {row + 1} after the header: '{cell}' is not a "
                    "number.",
                    advice="Correct it; for a missing sample leave the cell blank, or state "
                    f'[csv] missing = ["{cell}"].',
                    column=column,
                    row=row + 1,
                )
        raise RecordingError(
            f"{self.file}: '{column}' holds {values.dtype}, not numbers.",
            advice="Map a numeric column.",
            column=column,
        )

    def _labels(self, present: dict[str, ChannelTable]) -> dict[str, tuple[str, ...]]:
        labels: dict[str, tuple[str, ...]] = {}
        for name, table in present.items():
            if table.labels is None:
                continue
            named = [d for choice in table.quantity(name).dims for d in choice if d in LABELLED_DIMS]
            if not named:
                raise RecordingError(
                    f"Channel '{name}' has nothing to label.",
                    advice=f"Labels go to {', '.join(LABELLED_DIMS)}.",
                    channel=name,
                )
            source = name.partition(".")[0]
            key = f"{source}.station" if named[0] == "station" else named[0]
            known = labels.get(key, table.labels)
            if len(known) != len(table.labels) or not set(known) & set(table.labels):
                key = f"{source}.{named[0]}"  # another set of joints, wheels or modes
            if labels.setdefault(key, table.labels) != table.labels:
                raise RecordingError(
                    f"Channel '{name}' labels '{key}' {list(table.labels)}, another {list(labels[key])}.",
                    advice="Channels that share joints, wheels or modes list them alike.",
                    channel=name,
                )
        return labels


def is_number(cell: str) -> bool:
    """Tell whether a cell is a number, with a point or a comma."""
    for decimal in (".", ","):
        try:
            parse_number(cell, decimal)
        except ValueError:
            continue
        return True
    return False


def _sum(path: Path) -> str:
    """Sum of a file; of a folder, that of its files' names and sums."""
    if path.is_dir():
        listed = "".join(f"{p.name} {_sum(p)}\n" for p in sorted(path.iterdir()) if p.is_file())
        return hashlib.sha256(listed.encode()).hexdigest()
    return sha256(path)
