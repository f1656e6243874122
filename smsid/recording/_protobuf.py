"""MCAP files whose messages are protobuf, as Foxglove writes them (extra ``protobuf``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from smsid.errors import require
from smsid.recording._topics import Topic, columns_of
from smsid.recording.columns import Columns, unreadable

TAIL = 1 << 16
"""Bytes at either end of a file in which the encodings of its schemas stand."""


def is_protobuf(path: Path) -> bool:
    """Tell whether the messages of an MCAP file are protobuf."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    with path.open("rb") as stream:
        ends = stream.read(TAIL)
        stream.seek(max(path.stat().st_size - TAIL, 0))
        ends += stream.read()
    return b"\x08\x00\x00\x00protobuf" in ends and b"\x07\x00\x00\x00ros2msg" not in ends


def read_protobuf(path: Path) -> Columns:
    """Read the numbers of every topic of an MCAP file of protobuf messages; columns are called as in bags.

    A field of type Timestamp is the message's own time, ``<topic>.stamp``. Elements of a repeated message
    that have a ``name`` come by it, as ``/joints.position.elbow``.

    Raises:
        MissingDependencyError: mcap or mcap-protobuf-support is not installed.
        RecordingError: cut short, damaged, without messages.
    """
    reader = require("mcap.reader", "protobuf")
    decoder = require("mcap_protobuf.decoder", "protobuf")
    topics: dict[str, Topic] = {}
    start: int | None = None
    try:
        with path.open("rb") as stream:
            file = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
            for _, channel, message, content in file.iter_decoded_messages():
                begin = int(message.log_time) if start is None else start
                start = begin
                topic = topics.setdefault(channel.topic, Topic(channel.topic))
                if not topic.skipped:
                    values: dict[str, Any] = {}
                    stamp, names = _walk("", content, values)
                    own = None if stamp is None else (stamp - begin) * 1e-9
                    topic.add((message.log_time - begin) * 1e-9, own, values, names)
    except Exception as error:  # mcap raises its own errors, struct.error, DecodeError, ...
        raise unreadable(path, "MCAP", error, "It is cut short or damaged (try `mcap recover`).") from error
    return columns_of(topics.values(), path)


def _walk(prefix: str, message: Any, into: dict[str, Any]) -> tuple[int | None, tuple[str, ...]]:
    """Add the numbers of a message by dotted name; return its stamp [ns] and the names of array elements."""
    stamp: int | None = None
    names: tuple[str, ...] = ()
    for field in message.DESCRIPTOR.fields:
        value: Any = getattr(message, field.name)
        name = f"{prefix}{field.name}"
        if not isinstance(value, int | float | bool | str | bytes) and hasattr(value, "append"):
            rows: list[Any] = list(value)
            if rows and field.message_type is not None:
                each: list[dict[str, Any]] = [{} for _ in rows]
                for row, own in zip(rows, each, strict=True):
                    _walk("", row, own)
                if all(isinstance(getattr(row, "name", None), str) for row in rows):
                    names = tuple(row.name for row in rows)
                into |= {f"{prefix}{k}" if names else f"{name}.{k}": np.array([own[k] for own in each])
                         for k in each[0] if all(k in own for own in each)}  # fmt: skip
            elif rows and isinstance(rows[0], str):
                names = tuple(map(str, rows)) if field.name in ("name", "names") else names
            elif rows and isinstance(rows[0], int | float | bool):
                into[name] = np.array(rows, dtype=np.float64)
        elif field.message_type is not None:
            if field.message_type.full_name == "google.protobuf.Timestamp":
                if message.HasField(field.name) and stamp is None:
                    stamp = int(value.seconds) * 10**9 + int(value.nanos)
            else:
                inner, _ = _walk(f"{name}.", value, into)
                stamp = inner if stamp is None else stamp
        elif isinstance(value, int | float | bool) and field.enum_type is None:
            into[name] = float(value)
    return stamp, names
