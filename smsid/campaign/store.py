"""The results of a campaign: one JSON line per finished run, appended and synced, safe against any crash."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pinocchio as pin
from pydantic import BaseModel, ConfigDict, ValidationError

from smsid._version import __version__
from smsid.campaign._case import PreparedCampaign
from smsid.campaign.outcome import RunRecord
from smsid.errors import SmsidError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

logger = logging.getLogger(__name__)

SCHEMA_VERSION = 1


class StoreHeader(BaseModel):
    """The first line of a store: which campaign its runs belong to."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str = "campaign"
    schema_version: int = SCHEMA_VERSION
    digest: str
    plan: dict[str, Any]
    inputs: dict[str, str]
    versions: dict[str, str]

    @classmethod
    def of(cls, prepared: PreparedCampaign) -> StoreHeader:
        """Return the header of a campaign's store."""
        return cls(
            digest=prepared.digest,
            plan=prepared.campaign.tables(),
            inputs=prepared.inputs,
            versions={
                "smsid": __version__,
                "pinocchio": pin.__version__,
                "numpy": np.__version__,
                "python": platform.python_version(),
            },
        )


class CampaignStore:
    """An open store. Only one process writes it at a time; workers hand their results to that process.

    Use as a context manager, or close it. Opening a store mends a torn last line.
    """

    def __init__(self, path: str | os.PathLike[str], prepared: PreparedCampaign) -> None:
        """Open the store of a campaign, or create it.

        Raises `SmsidError` when the file cannot be opened, is no store, belongs to another campaign, is
        damaged other than in its last line, or is being written by another process.
        """
        self.path = Path(path)
        wanted = StoreHeader.of(prepared)
        self._status: dict[int, bool] = {}
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0))
        except OSError as cause:
            raise SmsidError(
                f"Cannot write {self.path}: {cause.strerror}.", advice="Name a file in a folder that exists."
            ) from cause
        try:
            self._lock()
            first = wanted.model_dump_json().encode() + b"\n"
            with self.path.open("rb") as stream:
                if first.startswith(stream.read()):  # new, or torn while it was created
                    os.ftruncate(self._file, 0)
                    self._append(first)
                    _sync_folder(self.path.resolve().parent)
            header, records = read_store(self.path)
            _check_same(header, wanted, self.path)
            self._status = {r.run: r.ok for r in records}
            self._size = self._mend()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> CampaignStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; another process may then write it."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    @property
    def failed(self) -> tuple[int, ...]:
        """Runs that ended in an error."""
        return tuple(sorted(run for run, ok in self._status.items() if not ok))

    def pending_runs(self, runs: int, *, retry_failed: bool = False) -> list[int]:
        """Return which of ``range(runs)`` are still to be done."""
        return [i for i in range(runs) if i not in self._status or (retry_failed and not self._status[i])]

    def add(self, record: RunRecord) -> bool:
        """Append a finished run and sync it to disk; a run that has a result already is left as it is.

        Returns whether it was written. Raises `SmsidError` when it cannot be written (a full disk); what was
        there before stays good.
        """
        if self._status.get(record.run, False):
            logger.warning("Run %d has a result already; the new one is dropped.", record.run)
            return False
        line = record.model_dump_json().encode() + b"\n"
        try:
            self._append(line)
        except OSError as cause:
            with suppress(OSError):
                os.ftruncate(self._file, self._size)
            raise SmsidError(
                f"Run {record.run} cannot be written to '{self.path}': {cause}.",
                advice="Make room and start the same campaign again: it goes on where it stopped.",
                path=str(self.path),
            ) from cause
        self._size += len(line)
        self._status[record.run] = record.ok
        return True

    def _append(self, line: bytes) -> None:
        left = memoryview(line)
        while left:
            left = left[os.write(self._file, left) :]
        os.fsync(self._file)

    def _lock(self) -> None:
        if fcntl is None:
            logger.warning("No file locks here: take care that one process only writes '%s'.", self.path)
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as cause:
            raise SmsidError(
                f"'{self.path}' is being written by another process.",
                advice="Wait for that campaign to end, or name another output.",
                path=str(self.path),
            ) from cause

    def _mend(self) -> int:
        """Cut a torn last line off; return the size of the file [bytes]."""
        size, number, last = 0, 0, b""
        with self.path.open("rb") as stream:
            for number, last in enumerate(stream, start=1):  # noqa: B007
                size += len(last)
        if number == 1 or _record(last) is not None:
            return size
        logger.warning("The last line of '%s' was torn by a crash; its run is done again.", self.path)
        size -= len(last)
        os.ftruncate(self._file, size)
        os.fsync(self._file)
        return size


def read_store(path: str | os.PathLike[str]) -> tuple[StoreHeader, Iterator[RunRecord]]:
    """Return header and runs of a store, also of one that is being written.

    Each run comes once: its first success, or else its last failure. The runs are read as they are asked
    for. Raises `SmsidError` when the file does not exist, is no store, or (from the iterator) is damaged
    other than in its last line.
    """
    file = Path(path)
    if not file.is_file():
        raise SmsidError(f"The file '{file}' does not exist.", advice="Run `smsid campaign` to make it.")
    with file.open("rb") as stream:
        first = stream.readline()
    try:
        header = StoreHeader.model_validate_json(first)
    except ValidationError as cause:
        raise SmsidError(
            f"'{file}' is no store of a campaign.", advice="Name another file.", path=str(file)
        ) from cause
    if header.kind != "campaign" or header.schema_version != SCHEMA_VERSION:
        raise SmsidError(
            f"'{file}' is no store of a campaign of schema {SCHEMA_VERSION}.",
            advice="Was it made by another version?",
            path=str(file),
        )
    return header, _records(file)


def _records(path: Path) -> Iterator[RunRecord]:
    done: set[int] = set()
    failed: dict[int, RunRecord] = {}
    damaged = 0
    with path.open("rb") as stream:
        for number, line in enumerate(stream, start=1):
            if damaged:
                raise SmsidError(
                    f"Line {damaged} of '{path}' is damaged.",
                    advice="A crash tears the last line only. Remove that line, and its run is done again.",
                    path=str(path),
                    line=damaged,
                )
            if number == 1:
                continue
            record = _record(line)
            if record is None:
                damaged = number  # unless it is the last
                continue
            if record.run in done:
                continue
            if not record.ok:
                failed[record.run] = record
                continue
            done.add(record.run)
            failed.pop(record.run, None)
            yield record
    yield from failed.values()


def _record(line: bytes) -> RunRecord | None:
    """Return the run of a line; ``None`` when the line was not written to its end, or is something else."""
    if line.endswith(b"\n"):
        with suppress(ValidationError):
            return RunRecord.model_validate_json(line)
    return None


def _check_same(found: StoreHeader, wanted: StoreHeader, path: Path) -> None:
    if found.digest != wanted.digest:
        keys = {*found.plan, *wanted.plan}
        changed = sorted(k for k in keys if found.plan.get(k) != wanted.plan.get(k))
        files = {*found.inputs, *wanted.inputs}
        changed += sorted(f for f in files if found.inputs.get(f) != wanted.inputs.get(f))
        raise SmsidError(
            f"'{path}' holds the runs of a different campaign; these differ: {', '.join(changed)}.",
            advice="Name another output, or go back to the plan and files it was made with.",
            path=str(path),
            changed=changed,
        )
    for name, version in wanted.versions.items():
        before = found.versions.get(name)
        if before != version:
            logger.warning("'%s' was begun with %s %s, not %s: runs may differ.", path, name, before, version)


def _sync_folder(folder: Path) -> None:
    """Make the name of a new file survive a power cut, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
