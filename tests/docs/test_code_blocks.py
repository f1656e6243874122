"""What README and documentation tell a reader to type works, block after block."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.docs.pages import README, Page, pages, read_page
from tests.docs.running import commands, run_page

PAGES = pages()
LANGUAGES = {"python", "sh", "toml", "text", "xml", "csv", "json", "{toctree}", "{eval-rst}"}
SHOWN = {"text", "xml", "csv", "json", "{toctree}", "{eval-rst}"}  # nothing to run
NOT_RUN = 22  # blocks that no test runs, each with its reason in the page


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder after the README's blocks: what the other pages start from."""
    folder = tmp_path_factory.mktemp("readme")
    with pytest.MonkeyPatch.context() as patch:
        run_page(read_page(README), folder, patch)
    return folder


def start(page: Page, folder: Path, flown: Path) -> None:
    """Copy what the page is given."""
    for name in page.given:
        assert (flown / name).exists(), f"{page.name} is given {name}, which the README does not make"
        shutil.copy(flown / name, folder / name)


def test_the_readme_runs_from_top_to_bottom(flown: Path) -> None:
    for name in ("exp1.nc", "exp2.nc", "estimate.json"):
        assert (flown / name).stat().st_size > 1000


@pytest.mark.parametrize("page", [p for p in PAGES if p.path != README], ids=lambda p: p.name)
def test_the_page_runs(page: Page, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start(page, tmp_path, flown)
    run_page(page, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if p.slow], ids=lambda p: p.name)
def test_the_page_runs_with_its_long_blocks(
    page: Page, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start(page, tmp_path, flown)
    run_page(page, tmp_path, monkeypatch, slow=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_block_says_what_it_is(page: Page) -> None:
    for block in page.blocks:
        assert block.language in LANGUAGES, f"{page.name}, line {block.line}: '{block.language}'"
        if block.language in SHOWN:
            assert not re.search(r"^\$? ?smsid ", block.text, re.M), (
                f"{page.name}, line {block.line}: commands belong into a block `sh`, which is run"
            )


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_no_command_hides_in_an_indented_block(page: Page) -> None:
    text = re.sub(r"^( *)```.*?^ *```", "", page.path.read_text(encoding="utf-8"), flags=re.M | re.S)
    assert not re.search(r"^(    |\t)(smsid|python|import|from) ", text, re.M), page.name


def test_what_is_not_run_is_counted_and_has_a_reason() -> None:
    reasons = [b.asked["not run"] for p in PAGES for b in p.blocks if "not run" in b.asked]
    assert all(len(reason) > 10 for reason in reasons)
    assert len(reasons) == NOT_RUN


def test_words_of_commands() -> None:
    assert commands("smsid show a.nc   # look\n\nsmsid \\\n  view 'b c'\n") == [
        ["smsid", "show", "a.nc"],
        ["smsid", "view", "b c"],
    ]
