"""The mapping file: which column of a log is which channel, in which unit, frame and convention."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from smsid._explain import toml_kind, validate_tables
from smsid._reading import read_toml
from smsid.errors import RecordingError
from smsid.recording._units import check_unit, convert, same_dimension
from smsid.recording.channels import EXTRA, SLIDING, Quantity, quantity_of
from smsid.recording.readers import CsvFormat

Sign = Literal[-1, 1]
Text = Annotated[str, Field(min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=False)


class RecordingTable(_Table):
    """``[recording]``: name, role, a note for the provenance, and whether commands were held from sample to
    sample or went on in straight lines, where that is known: else estimates have to tell by likelihood.
    """

    name: str = ""
    role: Literal["estimation", "validation", "unspecified"] = "unspecified"
    note: str = ""
    inputs: Literal["held", "linear"] | None = None


class ClockTable(_Table):
    """``[time]`` or ``[clock.<source>]``: a column of times with unit, or a rate [Hz] from ``start`` [s]."""

    column: Text | None = None
    unit: Text | None = None
    rate: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    start: Annotated[float, Field(allow_inf_nan=False)] = 0.0

    @model_validator(mode="after")
    def _one_kind(self) -> ClockTable:
        if (self.column is None) == (self.rate is None):
            raise ValueError("state either column (with unit) or rate")
        if self.column is not None and self.unit is None:
            raise ValueError("state the unit of the times, such as unit = 's'")
        if self.column is None and self.unit is not None:
            raise ValueError("a rate is in Hz and start in s; leave out unit")
        if self.column is not None and self.start != 0.0:
            raise ValueError("start belongs to a rate; a column has its own")
        return self


class ChannelTable(_Table):
    """``[channel."imu.acceleration"]``: where a channel comes from and how it is written there.

    Attributes:
        columns: columns of a CSV file, one per component; or the name of one array.
        index: of the components to take from one array (N, k).
        time_axis: axis of the array that is time.
        unit: of the file; converted. Not for attitudes. Of joints one for all columns, or one for each: those
            that slide in m, mm, N, those that turn in rad, degree, N m.
        frame: 'inertial' or 'body': the axes that vectors are given in, if not those of the catalogue.
        attitude: channel that turns a vector from ``frame`` to the frame of the catalogue.
        quaternion: order of the components, for attitudes.
        direction: what the quaternion turns into what, for attitudes.
        sign: for all or for each component, in the axes of the file.
        labels: of joints, wheels, modes or stations.
        optional: the channel is left out when its columns are missing; the provenance says so.
    """

    columns: Annotated[tuple[Text, ...], Field(min_length=1)]
    index: tuple[Annotated[int, Field(ge=0)], ...] | None = None
    time_axis: Annotated[int, Field(ge=0)] = 0
    unit: Text | Annotated[tuple[Text, ...], Field(min_length=1)] | None = None
    frame: Literal["inertial", "body"] | None = None
    attitude: Text | None = None
    quaternion: Literal["wxyz", "xyzw"] | None = None
    direction: Literal["body_to_inertial", "inertial_to_body"] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    labels: tuple[Text, ...] | None = None
    optional: bool = False

    @model_validator(mode="after")
    def _columns_fit(self) -> ChannelTable:
        if len(set(self.columns)) != len(self.columns):
            raise ValueError("a column is named twice")
        if isinstance(self.unit, tuple) and len(self.unit) != self.components:
            raise ValueError(f"{len(self.unit)} units for {self.components} columns")
        if self.index is not None and len(self.columns) > 1:
            raise ValueError("index takes components from one array; name only that")
        return self

    @property
    def components(self) -> int:
        """Columns, or components taken from one array."""
        return len(self.columns) if self.index is None else len(self.index)

    @property
    def units(self) -> tuple[str, ...]:
        """The stated unit, or units of the columns."""
        return () if self.unit is None else (self.unit,) if isinstance(self.unit, str) else self.unit

    @property
    def one_unit(self) -> str | None:
        """The unit of all columns; ``None`` when none is stated, or several."""
        return self.unit if isinstance(self.unit, str) else None

    def quantity(self, name: str) -> Quantity:
        """Return what it is as the channel ``name``; raises `RecordingError` as `quantity_of`."""
        return quantity_of(name, unit=self.one_unit if name.startswith(f"{EXTRA}.") else None)


class ImportMapping(_Table):
    """A whole mapping file."""

    recording: RecordingTable = RecordingTable()
    time: ClockTable | None = None
    clock: dict[str, ClockTable] = Field(default_factory=dict)
    csv: CsvFormat = CsvFormat()
    channel: Annotated[dict[str, ChannelTable], Field(min_length=1)]


def bundled_mappings() -> dict[str, Path]:
    """Give the mapping files that come with smsid, by name."""
    folder = Path(str(files("smsid.recording") / "maps"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_mapping(source: str | os.PathLike[str] | ImportMapping) -> ImportMapping:
    """Read a mapping file, or the one of `bundled_mappings` when ``source`` is a name without suffix.

    Raises:
        RecordingError: no such file, no TOML, an unknown or missing key, a value that does not fit, or a
            channel whose unit, frame or convention contradicts the catalogue.
    """
    if isinstance(source, ImportMapping):
        check_mapping(source, "The mapping")
        return source
    path = mapping_path(source)
    return parse_mapping(read_toml(path, RecordingError), str(path))


def mapping_path(source: str | os.PathLike[str]) -> Path:
    """Find the file of a mapping given by path or bundled name, or raise `RecordingError`."""
    path = Path(source)
    if isinstance(source, str) and path.suffix == "" and path.name == source:
        bundled = bundled_mappings()
        if source not in bundled:
            raise RecordingError(
                f"smsid has no mapping '{source}'.",
                advice=f"It has {', '.join(bundled)}; your own are given as a path ending in .toml.",
                known=tuple(bundled),
            )
        return bundled[source]
    return path


def parse_mapping(tree: dict[str, Any], where: str = "The mapping") -> ImportMapping:
    """Validate a mapping given as a dictionary; raise `RecordingError` as `load_mapping`."""
    if not tree.get("channel") and toml_kind(tree) in ("mapping", None):
        raise RecordingError(
            f"{where}: no channel is mapped.",
            advice="In a draft, take away the '# ' of the tables you have checked.",
        )
    mapping = validate_tables(
        ImportMapping, tree, where, RecordingError, advice="Mend the mapping.", kind="mapping"
    )
    check_mapping(mapping, where)
    return mapping


def check_mapping(mapping: ImportMapping, where: str) -> None:
    """Raise `RecordingError` unless every channel fits the catalogue."""
    for name, table in mapping.channel.items():
        place = f"{where}, channel '{name}'"
        try:
            quantity = table.quantity(name)
        except RecordingError as error:
            quoted = "" if "." in name else f'In TOML: [channel."{name}.<quantity>"], with the quotes.'
            raise error.at(where, more_advice=quoted) from error
        wrong = _contradiction(table, quantity)
        if wrong:
            raise RecordingError(f"{place}: {wrong[0]}.", advice=wrong[1], channel=name)
        for unit in () if quantity.is_quaternion else table.units:
            check_unit(unit, place)
            if quantity.dims:
                convert(np.zeros(1), unit, target_unit(unit, quantity, place), place)
        if table.attitude and table.attitude not in mapping.channel:
            raise RecordingError(
                f"{place}: the attitude '{table.attitude}' is not mapped.",
                advice=f"Map it, or choose one of {', '.join(mapping.channel)}.",
                channel=name,
            )
    sources = {name.partition(".")[0] for name in mapping.channel}
    for source in mapping.clock:
        if source not in sources:
            raise RecordingError(
                f"{where}: [clock.{source}] belongs to no channel.",
                advice=f"Sources are {', '.join(sorted(sources))}.",
                clock=source,
            )
    lone = sorted(sources - set(mapping.clock))
    if mapping.time is None and lone:
        raise RecordingError(
            f"{where}: no [time], and no [clock.{lone[0]}].",
            advice="State [time] column = '...' and unit = 's', or rate = 100.0 in Hz.",
        )


def target_unit(unit: str, quantity: Quantity, where: str) -> str:
    """Return the unit that a column of a quantity is converted to: of joints that slide, metres and newtons.

    Raises:
        RecordingError: ``unit`` is unknown.
    """
    sliding = SLIDING.get(quantity.unit)
    if sliding is None or "joint" not in {d for choice in quantity.dims for d in choice}:
        return quantity.unit
    return sliding if same_dimension(unit, sliding, where) else quantity.unit


def _contradiction(table: ChannelTable, quantity: Quantity) -> tuple[str, str] | None:
    if quantity.is_quaternion:
        if table.quaternion is None or table.direction is None:
            return (
                "the convention of the quaternion is not stated",
                "State quaternion = 'wxyz' or 'xyzw', and direction = 'body_to_inertial' or "
                "'inertial_to_body'.",
            )
        if table.unit not in (None, "1") or table.frame or table.attitude or table.sign != 1:
            return (
                "an attitude has no unit, frame, attitude or sign",
                "Leave them out; direction inverts a quaternion.",
            )
        return None
    if table.quaternion or table.direction:
        return ("quaternion and direction belong to attitudes", "Leave them out.")
    if table.unit is None:
        return ("the unit is not stated", f"State the unit of the file, such as unit = '{quantity.unit}'.")
    if table.frame and not quantity.is_vector:
        return (
            f"'{quantity.name}' is in the frame '{quantity.frame}' and cannot be turned",
            "Leave out frame.",
        )
    turned = table.frame is not None and table.frame != quantity.frame
    if turned and not table.attitude:
        return (
            f"it is given in the {table.frame} frame, '{quantity.name}' is in the {quantity.frame} frame",
            "Name the attitude that turns it: attitude = 'pose.attitude'.",
        )
    if table.attitude and not turned:
        return ("an attitude is named, but there is nothing to turn", "Leave out attitude, or state frame.")
    if table.attitude and not table.attitude.endswith(".attitude"):
        return (f"'{table.attitude}' is not an attitude", "Name a channel '<source>.attitude'.")
    return None
