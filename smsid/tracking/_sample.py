"""One moment of telemetry: a time and what was read or commanded then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import RecordingError
from smsid.recording import Recording


@short_repr
@dataclass(frozen=True, eq=False)
class Sample:
    """Channels read at one time [s]: arrays in the unit and frame of the quantity, as in a recording.

    Not every channel has to be there; one that is not finite counts as missing. Commands are channels, too.
    """

    time: float
    channels: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, time: float, channels: Mapping[str, Sequence[float] | np.ndarray]) -> Sample:
        """Return a sample from anything that looks like numbers, (k,) by channel.

        Raises `RecordingError` when the time is no finite number or a channel holds no numbers.
        """
        try:
            t = float(time)
            arrays = {str(k): np.asarray(v, dtype=float).ravel() for k, v in channels.items()}
        except (TypeError, ValueError) as error:
            raise RecordingError(
                f"A sample holds something that is no number: {error}.",
                advice="Give a time [s] and, by channel, a list of numbers.",
            ) from error
        if not np.isfinite(t):
            raise RecordingError(f"A sample has the time {time}.", advice="Give a finite time [s].")
        return cls(t, arrays)


def samples_of(recording: Recording, channels: Sequence[str] | None = None) -> Iterator[Sample]:
    """Yield the samples of a recording in the order of time, those of one clock tick together.

    ``channels``: which ones; all but the truth and extras when not given.
    """
    names = recording.channels if channels is None else channels
    names = [n for n in names if n.partition(".")[0] not in ("truth", "extra")]
    clocks: dict[float, dict[str, np.ndarray]] = {}
    for name in names:
        values = np.asarray(recording[name], dtype=float).reshape(len(recording.time(name)), -1)
        for t, x in zip(recording.time(name).tolist(), values, strict=True):
            clocks.setdefault(t, {})[name] = x
    for t in sorted(clocks):
        yield Sample(t, clocks[t])
