"""Running a page as a reader would: its blocks in turn, in one folder, Python blocks in one session."""

from __future__ import annotations

import os
import shlex
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from smsid.cli import main
from smsid.effects import base
from tests.docs.pages import ROOT, Block, Page


def commands(text: str) -> list[list[str]]:
    """Return the words of every command of a shell block, without comments and line ends."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def run_page(page: Page, folder: Path, monkeypatch: pytest.MonkeyPatch, *, slow: bool = False) -> None:
    """Run all blocks of a page in ``folder``, where the project's ``urdf`` is as in a checkout.

    The slow blocks run only if ``slow``. A failing block is named by page and line.
    """
    if not (folder / "urdf").exists():
        (folder / "urdf").symlink_to(ROOT / "urdf", target_is_directory=True)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(base, "_CATALOGUE", dict(base._CATALOGUE))  # effects of a page are gone after it
    with session() as names:
        for block in page.blocks:
            if "not run" in block.asked or ("slow" in block.asked and not slow):
                continue
            if "needs" in block.asked and not os.environ.get(block.asked["needs"]):
                continue
            try:
                run_block(block, folder, names, monkeypatch, page)
            except Exception as error:
                raise AssertionError(f"{page.name}, line {block.line}: {error!r}") from error


@contextmanager
def session() -> Iterator[dict[str, Any]]:
    """Give the names of a Python session of its own, as pydantic and pickle need it: those of a module."""
    module = ModuleType("page")
    sys.modules["page"] = module
    try:
        yield module.__dict__
    finally:
        del sys.modules["page"]


def run_block(
    block: Block, folder: Path, names: dict[str, Any], monkeypatch: pytest.MonkeyPatch, page: Page
) -> None:
    """Run one block by its language."""
    if "file" in block.asked:
        (folder / block.asked["file"]).write_text(block.text, encoding="utf-8")
    if block.language == "toml":
        tomllib.loads(block.text)
    elif block.language == "python" and "file" not in block.asked:
        exec(compile("\n" * block.line + block.text, str(page.path), "exec"), names)
    elif block.language == "sh":
        wanted = int(block.asked.get("exit", "0"))
        every = commands(block.text)
        for k, words in enumerate(every):
            code = command(words, monkeypatch)
            assert code == (wanted if k == len(every) - 1 else 0), f"{shlex.join(words)} ended with {code}"


def command(words: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    """Run ``smsid ...`` in this process, which spares importing it anew; returns the exit code."""
    assert words[0] == "smsid", f"{shlex.join(words)}: only smsid is run; mark others as `not run`"
    monkeypatch.setattr(sys, "argv", words)
    try:
        main()
    except SystemExit as left:
        return int(left.code or 0)
    return 0
