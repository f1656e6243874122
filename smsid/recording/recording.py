"""The recording: labelled channels with unit, frame and clock, which nothing can change."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smsid._by_name import ByName
from smsid._listing import did_you_mean
from smsid._short_repr import ShortRepr
from smsid._time_text import stamp_text
from smsid.errors import RecordingError
from smsid.recording import _layout, channel_checks, resampling
from smsid.recording.channels import split_channel
from smsid.recording.clock import Gap, check_order, find_gaps

if TYPE_CHECKING:
    import xarray as xr

    from smsid.recording.channel_checks import Contradictions

FloatArray = NDArray[np.float64]
Role = Literal["estimation", "validation", "unspecified"]


class Recording(ByName[FloatArray], ShortRepr):
    """Measured or simulated channels ``<source>.<quantity>`` in the units and frames of the catalogue.

    The channels share the clock ``time`` [s], except for a source that has its own, ``<source>.time``. All
    arrays are read-only float64; every method that changes something gives a new recording. The constructor
    verifies names, shapes and units; `check` verifies the samples.

    Args:
        dataset: one variable per channel, as `dataset` gives it back; it is copied, unless it is the layout
            of a recording. Use `from_arrays` to start from arrays.

    Raises:
        RecordingError: a channel, unit, shape, clock, role or provenance is not as it should be.
    """

    __slots__ = ("_contradictions", "_data")
    _data: _layout.ArrayLayout
    _contradictions: Contradictions | None

    def __init__(self, dataset: xr.Dataset | _layout.ArrayLayout) -> None:
        if not isinstance(dataset, _layout.ArrayLayout):
            stored = {
                str(k): (tuple(map(str, x.dims)), x.values, x.attrs) for k, x in dataset.variables.items()
            }
            dataset = _layout.layout_of_dataset(stored, dataset.attrs)
        object.__setattr__(self, "_data", dataset)
        object.__setattr__(self, "_contradictions", None)

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike | None,
        channels: Mapping[str, Any],
        *,
        labels: Mapping[str, Sequence[str]] | None = None,
        units: Mapping[str, str] | None = None,
        provenance: Mapping[str, Any] | None = None,
        role: str = "unspecified",
        name: str = "",
    ) -> Recording:
        """Build a recording from arrays, which are copied.

        Args:
            time: (N,) shared clock [s]; None when every source has its own.
            channels: by channel name, an array (N, ...) in the unit and frame of the quantity, or
                ``(time, array)`` for a source with its own clock.
            labels: names along ``joint``, ``wheel``, ``mode`` or ``station``; ``<source>.station`` (likewise
                the others) for one source only.
            units: of the channels ``extra.<anything>``; for others it must be the catalogue's.
            provenance: where the data come from; what JSON can hold.
            role: 'estimation', 'validation' or 'unspecified'.
            name: of the recording.

        Raises:
            RecordingError: unknown quantity, wrong unit or shape, lengths that differ, clocks that
                contradict.
        """
        if not channels:
            raise RecordingError("The recording has no channels.", advice="Give at least one.")
        attributes = _layout.header(name, role, provenance or {})
        return cls(
            _layout.build(time, channels, labels=labels or {}, units=units or {}, attributes=attributes)
        )

    def __getitem__(self, name: str) -> FloatArray:
        """Give the samples of a channel, (N, ...), read-only; raise `RecordingError` if it is not there."""
        self.require(name)
        return _freeze(self._data.channels[name][1])

    def keys(self) -> tuple[str, ...]:
        """Return the names of the channels, so that `dict` knows what to do with a recording."""
        return self.channels

    def __contains__(self, name: object) -> bool:
        return name in self._data.channels

    @property
    def dataset(self) -> xr.Dataset:
        """A dataset of xarray that shares the read-only arrays."""
        import xarray as xr

        stored = self._data.stored()
        coordinates = {k: x for k, x in stored.items() if x[0] == (k,)}
        variables = {k: x for k, x in stored.items() if k not in coordinates}
        return xr.Dataset(variables, coords=coordinates, attrs=dict(self._data.header))

    @property
    def layout(self) -> _layout.ArrayLayout:
        """What it holds."""
        return self._data

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(self._data.channels)

    @property
    def clocks(self) -> tuple[str, ...]:
        """Names of the clocks: ``time`` and ``<source>.time``."""
        return tuple(self._data.clocks)

    @property
    def labels(self) -> dict[str, tuple[str, ...]]:
        """Names along joints, wheels, modes and stations, as `from_arrays` takes them."""
        return self._data.own_labels

    @property
    def units(self) -> dict[str, str]:
        """Unit of every channel."""
        return dict(self._data.units)

    @property
    def name(self) -> str:
        """Name of the recording, perhaps empty."""
        return self._data.header["name"]

    @property
    def role(self) -> Role:
        """What the data may be used for: 'estimation', 'validation' or 'unspecified'."""
        return self._data.header["role"]  # type: ignore[return-value]

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the data come from; a fresh dictionary that JSON can hold."""
        return json.loads(self._data.header["provenance"])

    def channel(self, name: str) -> xr.DataArray:
        """Give a channel with its coordinates, unit and frame; raise `RecordingError` if it is not there."""
        self.require(name)
        return self.dataset[name]

    def columns(self, name: str) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of a channel behind its clock, each with its labels, if it has any.

        Raises `RecordingError` if it is not there.
        """
        self.require(name)
        return {dim: self._data.labels.get(dim, ()) for dim in self._data.channels[name][0][1:]}

    def unit(self, name: str) -> str:
        """Give the unit of a channel; raise `RecordingError` if it is not there."""
        self.require(name)
        return self._data.units[name]

    def time(self, name: str | None = None) -> FloatArray:
        """Give the times [s], (N,), of a channel or source; without a name, the shared clock.

        Raises:
            RecordingError: no such channel or source, or there is no shared clock.
        """
        if name is None:
            clock = "time"
        elif name in self:
            clock = self.clock_of(name)
        elif any(channel.startswith(f"{name}.") for channel in self.channels):
            clock = self._data.clock_of(name)
        else:
            self.require(name)
            raise AssertionError(name)
        if clock not in self._data.clocks:
            raise RecordingError(
                "The recording has no shared clock.",
                advice=f"Ask for one of {', '.join(self.clocks)} by time('<source>'), or resample.",
                clocks=self.clocks,
            )
        return _freeze(self._data.clocks[clock])

    def clock_of(self, name: str) -> str:
        """Name the clock of a channel; raise `RecordingError` if it is not there."""
        self.require(name)
        return self._data.channels[name][0][0]

    def times(self) -> dict[str, FloatArray]:
        """Give the times [s], (N,), of every clock."""
        return {clock: _freeze(times) for clock, times in self._data.clocks.items()}

    def require(self, *names: str) -> None:
        """Raise `RecordingError` naming the channels that are missing and those that are there."""
        missing = [name for name in names if name not in self]
        if not missing:
            return
        hints = "".join(dict.fromkeys(did_you_mean(name, self.channels) for name in missing))
        raise RecordingError(
            f"The recording{f' {self.name!r}' if self.name else ''} has no {', '.join(missing)}; "
            f"it has {', '.join(self.channels)}.",
            advice=f"Record or import what is missing.{hints}",
            missing=tuple(missing),
            present=self.channels,
        )

    def check(self, *, consistency: bool = True, sensors_may_pause: bool = False) -> Recording:
        """Verify the samples and give the recording back.

        Without ``consistency`` channels are not compared with each other. Where ``sensors_may_pause`` only
        commands have to be without gaps and missing samples (NaN): what drove the motion meanwhile is not
        known.

        Raises:
            RecordingError: a time that is not finite or does not increase, NaN or infinity in a channel, a
                gap, a quaternion whose norm is off, or channels that contradict each other by a clear unit
                factor; `InconsistentChannelsError` for components that contradict each other beyond doubt.
                A recording that is `unchecked` is not asked whether its channels contradict each other.
        """
        channel_checks.check_clocks(self)
        channel_checks.check_finite(self, sensors_may_pause=sensors_may_pause)
        commands = [c for c in self.channels if c.startswith("command.")]
        channel_checks.check_gaps(
            self, {self.clock_of(c) for c in commands} if sensors_may_pause else self.clocks
        )
        channel_checks.check_quaternions(self)
        if consistency:
            self.check_consistency()
        return self

    def check_consistency(self) -> tuple[str, ...]:
        """Refuse channels that contradict each other beyond doubt, and say what else is doubtful.

        Samples that are missing and gaps are left out. Of a recording that is `unchecked` all is only said.

        Raises:
            RecordingError: a clock that does not increase; `InconsistentChannelsError` for a contradiction.
        """
        found = self.contradictions()
        if not self.provenance.get("unchecked"):
            found.refuse()
            return found.doubts
        return found.sentences

    def contradictions(self) -> Contradictions:
        """Tell which channels contradict each other or themselves; it is worked out once.

        Raises:
            RecordingError: a clock that does not increase.
        """
        if self._contradictions is None:
            object.__setattr__(self, "_contradictions", channel_checks.contradictions_of(self))
        assert self._contradictions is not None
        return self._contradictions

    def unchecked(self) -> Recording:
        """Let `check` pass channels that contradict each other; the provenance says so from now on."""
        return self.with_provenance({"unchecked": True})

    def gaps(self) -> tuple[Gap, ...]:
        """Find the steps longer than five median steps, on every clock."""
        return tuple(gap for clock, times in self.times().items() for gap in find_gaps(times, clock))

    def suspicious(self) -> list[str]:
        """Say in sentences which channels contradict each other as if a unit, sign or convention were wrong.

        Each channel is compared with the derivative of another (as increments against integrals, so noise is
        not amplified). Pairs with too little motion or a correlation below 0.9 are not judged.

        Raises:
            RecordingError: a clock that does not increase.
        """
        return list(self.contradictions().sentences)

    def window(self, t0: float, t1: float) -> Recording:
        """Cut out ``t0 <= t <= t1`` [s] on every clock; an end may be infinite.

        Raises:
            RecordingError: a clock does not increase, or has no sample in the window.
        """
        kept: dict[str, slice] = {}
        for clock, times in self.times().items():
            check_order(times, clock)
            inside = np.flatnonzero((times >= t0) & (times <= t1))
            if not inside.size:
                raise RecordingError(
                    f"Clock '{clock}' has no sample between {stamp_text(t0)} and {stamp_text(t1)} s; it runs "
                    f"from {stamp_text(times[0])} to {stamp_text(times[-1])} s.",
                    advice="Choose a window inside, in the stamps of the recording.",
                    clock=clock,
                    start=float(times[0]),
                    end=float(times[-1]),
                )
            kept[clock] = slice(int(inside[0]), int(inside[-1]) + 1)
        ends = [float(t) if np.isfinite(t) else None for t in (t0, t1)]
        return Recording(self._data.cut(kept))._with_step({"window": ends})

    def shifted(self, by: float) -> Recording:
        """Let every clock show so much more [s]."""
        clocks = {clock: times + by for clock, times in self._data.clocks.items()}
        return Recording(replace(self._data, clocks=clocks))

    def resampled(self, rate_or_times: float | ArrayLike) -> Recording:
        """Bring all channels to one clock, linearly between samples, quaternions by slerp.

        Nothing is extrapolated, and nothing is filtered: low-pass first when going to a lower rate. Commands
        are held where the recording says so (``inputs`` in its provenance), or where they step; whether they
        still are between the new samples is said no more where a sample of theirs is lost.

        Args:
            rate_or_times: a rate [Hz], from the first to the last time that all clocks cover; or (M,) times
                [s].

        Raises:
            RecordingError: times outside a clock or inside a gap, not increasing, or samples that are not
                finite.
        """
        times = resampling.new_times(self, rate_or_times)
        channels = resampling.interpolate_channels(self, times)
        built = self._rebuilt(times, channels, self.labels, self.units)
        if not resampling.keeps_knots(self, times):
            kept = {key: value for key, value in self.provenance.items() if key != "inputs"}
            built = built._with_header(provenance=kept)
        return built._with_step({"resampled": {"start": float(times[0]), "samples": int(times.size)}})

    def with_channels(
        self,
        channels: Mapping[str, Any],
        *,
        labels: Mapping[str, Sequence[str]] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> Recording:
        """Add or replace channels; a plain array runs on the clock that its source already has.

        Args:
            channels: as `from_arrays` takes them.
            labels: of new dimensions; the present ones are kept.
            units: of new channels ``extra.<anything>``.

        Raises:
            RecordingError: as `from_arrays`.
        """
        clocks, present, known = self._data.clocks, self._data.parts(), self.labels
        for name, value in channels.items():
            own = f"{split_channel(name)[0]}.time"
            present[name] = (clocks[own], value) if own in clocks and not isinstance(value, tuple) else value
        kept = {name: unit for name, unit in self.units.items() if name not in (units or {})}
        return self._rebuilt(
            clocks.get("time"), present, {**known, **(labels or {})}, {**kept, **(units or {})}
        )

    def without(self, *names: str) -> Recording:
        """Leave channels out; raise `RecordingError` if one is not there or none is left."""
        self.require(*names)
        return Recording(self._data.without(names))

    def at_rows(self, rows: Mapping[str, NDArray[np.int_]]) -> Recording:
        """Keep the ``rows`` (M,) of clocks by name; those of other clocks are all kept."""
        return Recording(self._data.cut(rows))

    def with_role(self, role: str) -> Recording:
        """Give the recording another role; raise `RecordingError` if it is none."""
        return self._with_header(role=role)

    def with_name(self, name: str) -> Recording:
        """Give the recording another name."""
        return self._with_header(name=name)

    def with_provenance(self, notes: Mapping[str, Any]) -> Recording:
        """Add notes to the provenance, replacing those of the same key; raise `RecordingError` if no JSON."""
        return self._with_header(provenance={**self.provenance, **notes})

    def equals(self, other: object) -> bool:
        """Compare everything: samples (NaN equals NaN), clocks, labels, units, role, name, provenance."""
        if not isinstance(other, Recording) or self.provenance != other.provenance:
            return False
        return self._data.same(other._data)

    def _rebuilt(self, time: Any, channels: Any, labels: Any, units: Any) -> Recording:
        header = {"provenance": self.provenance, "role": self.role, "name": self.name}
        return Recording.from_arrays(time, channels, labels=labels, units=units, **header)

    def _with_step(self, step: Mapping[str, Any]) -> Recording:
        return self.with_provenance({"steps": [*self.provenance.get("steps", []), dict(step)]})

    def _with_header(self, **changes: Any) -> Recording:
        header = {"name": self.name, "role": self.role, "provenance": self.provenance, **changes}
        return Recording(replace(self._data, header=_layout.header(**header)))

    def __setattr__(self, key: str, value: object) -> None:
        raise AttributeError(f"A recording is frozen; '{key}' cannot be set. Use with_channels or with_role.")

    def __delattr__(self, key: str) -> None:
        raise AttributeError(f"A recording is frozen; '{key}' cannot be deleted.")

    def __reduce__(self) -> tuple[Any, ...]:
        return (Recording, (self._data,))

    def _title_and_rows(self) -> tuple[str, list[tuple[str, str]]]:
        title = f"recording{f' {self.name!r}' if self.name else ''} for {self.role}"
        rows = []
        for clock, times in self.times().items():
            rows.append((f"{clock} [s]", f"{times.size} samples, {times[0]:.6g} to {times[-1]:.6g}"))
        for name in self.channels:
            shape = " x ".join(map(str, self[name].shape))
            rows.append((name, f"{shape} [{self.unit(name)}]"))
        return title, rows


def _freeze(values: Any) -> FloatArray:
    array = np.asarray(values, dtype=np.float64).view()
    array.setflags(write=False)
    return array
