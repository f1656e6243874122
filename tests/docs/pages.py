"""The pages a reader sees, and the fenced blocks in them.

A comment on the lines before a block says how it is tested; a reader of the page does not see it:

    <!-- not run: REASON -->    the block is only looked at
    <!-- slow: REASON -->       the block runs with the slow tests
    <!-- file: NAME -->         the block is the content of this file, for the blocks after it
    <!-- needs: VARIABLE -->    the block runs where this variable of the environment is set
    <!-- exit: CODE -->         the last command of the block ends with this exit code

and one for the whole page, files that the README's commands have left:

    <!-- given: exp1.nc estimate.json -->
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
FENCE = re.compile(
    r"^(?P<indent> *)(?P<fence>```+)(?P<language>[^\n`]*)\n(?P<text>.*?)^ *(?P=fence) *$", re.M | re.S
)
COMMENT = re.compile(r"<!-- *(?P<key>not run|slow|file|needs|exit): *(?P<value>.*?) *-->\s*\Z", re.S)
GENERATED = {"api", "measured"}  # written by the build, from docstrings and from results
GIVEN = re.compile(r"<!-- *given: *(.*?) *-->", re.S)


@dataclass(frozen=True)
class Block:
    """A fenced block: ``language``, ``text``, its ``line`` in the page, and what comments ask of its test."""

    language: str
    text: str
    line: int
    asked: dict[str, str]


@dataclass(frozen=True)
class Page:
    """A page with its blocks; ``given`` are the files it starts from."""

    path: Path
    blocks: tuple[Block, ...]
    given: tuple[str, ...]

    @property
    def name(self) -> str:
        """Path from the root of the project."""
        return self.path.relative_to(ROOT).as_posix()

    @property
    def slow(self) -> bool:
        """Whether any block is for the slow tests."""
        return any("slow" in block.asked for block in self.blocks)


def read_page(path: Path) -> Page:
    """Read a page."""
    text = path.read_text(encoding="utf-8")
    blocks, end = [], 0
    for found in FENCE.finditer(text):
        before, asked = text[end : found.start()], {}
        while comment := COMMENT.search(before):
            asked[comment["key"]] = " ".join(comment["value"].split())
            before = before[: comment.start()]
        end = found.end()
        line = text.count("\n", 0, found.start()) + 1
        own = re.sub(rf"^{found['indent']}", "", found["text"], flags=re.M)
        blocks.append(Block(found["language"].strip(), own, line, asked))
    given = [name for names in GIVEN.findall(text) for name in names.split()]
    return Page(path, tuple(blocks), tuple(given))


def pages() -> list[Page]:
    """Return README and all pages of the documentation but those that the build writes."""
    docs = sorted(p for p in (ROOT / "docs").rglob("*.md") if not GENERATED & set(p.relative_to(ROOT).parts))
    return [read_page(path) for path in (README, *docs)]
