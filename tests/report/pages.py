"""Read a report back: as a parser sees it, and as a browser runs it."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

VOID = {"meta", "link", "br", "input", "path", "hr", "img"}

needs_chromium = pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser chromium")


class Page(HTMLParser):
    """A page: its anchors, links, texts by tag, and whether every element that opens closes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.open: list[str] = []
        self.faults: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        if named.get("id"):
            self.ids.append(str(named["id"]))
        self.addresses += [
            str(v) for k, v in attrs if k in ("src", "href", "action", "data", "poster", "srcset")
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> at {self.getpos()}")

    def handle_data(self, data: str) -> None:
        if self.open and data.strip():
            self.texts.setdefault(self.open[-1], []).append(data.strip())

    @property
    def external(self) -> list[str]:
        """Addresses that are neither in the page nor data."""
        return [a for a in self.addresses if not a.startswith(("#", "data:"))]


def check_page(text: str, sections: set[str]) -> Page:
    """Assert that a report parses, has its sections, unlike names, and needs nothing else."""
    page = Page(text)
    assert page.faults == [] and page.open == []
    assert sections <= set(page.ids), sections - set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert page.external == []
    fetches = r"@import|url\(|\bfetch\(|XMLHttpRequest|WebSocket|sendBeacon|import\(|EventSource"
    assert re.search(fetches, text) is None
    assert not [a for a in re.findall(r"https?://[^\s\"'<]+", text) if "w3.org" not in a]
    return page


WATCH = """<script>
const faults = [];
addEventListener("error", e => faults.push("error: " + e.message));
addEventListener("unhandledrejection", e => faults.push("rejected: " + e.reason));
for (const kind of ["error", "warn"]) console[kind] = (...told) => faults.push(kind + ": " + told.join(" "));
</script>"""


def run_page(page: Path, script: str, folder: Path, *, size: str = "1200,900") -> Any:
    """Open a page from disk without network, run the body of an async function in it, return its result.

    The test fails where the page reports any error or warning, to its console or otherwise.
    """
    probe = f"""<script>setTimeout(async () => {{
      let found = null;
      try {{ found = await (async () => {{{script}}})(); }} catch (e) {{ faults.push(String(e)); }}
      const told = document.createElement("pre");
      told.id = "probe";
      told.textContent = btoa(unescape(encodeURIComponent(JSON.stringify({{ found, faults }}))));
      document.body.appendChild(told);
    }}, 100);</script></body>"""
    watched = folder / "watched.html"
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{WATCH}", 1)
    watched.write_text(text.replace("</body>", probe), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    options += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}"]
    options += [f"--window-size={size}", "--virtual-time-budget=3000", "--dump-dom"]
    done = subprocess.run(
        ["chromium", *options, watched.as_uri()], capture_output=True, text=True, timeout=240
    )
    told = re.search(r'<pre id="probe">([^<]+)</pre>', done.stdout)
    assert told is not None, done.stderr[-2000:]
    result = json.loads(base64.b64decode(told.group(1)))
    assert result["faults"] == []
    return result["found"]
