from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

import pytest

from smsid.errors import SmsidError
from smsid.view import build_scene, replay, show
from smsid.view._server import start_server


@pytest.mark.parametrize("plays", [False, True])
def test_live_view_shows_and_plays(model, trajectory, plays, capfd):
    pytest.importorskip("meshcat")
    view = show(replay(model, trajectory, fps=5.0) if plays else build_scene(model))
    try:
        assert view.url.startswith("http")
    finally:
        view.close()
    assert capfd.readouterr().out == ""


def test_show_without_meshcat_gives_the_pip_line(model, trajectory, monkeypatch):
    import sys

    from smsid.errors import MissingDependencyError

    monkeypatch.setitem(sys.modules, "meshcat", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[view\]"):
        show(replay(model, trajectory, fps=5.0))


def listening_addresses(port: int) -> set[str]:
    """Local addresses on which this machine listens on a port, as the kernel tells them."""
    table = Path("/proc/net/tcp")
    if not table.exists():
        pytest.skip("the kernel's table of sockets is not there")
    found = set()
    for name in ("tcp", "tcp6"):
        for line in table.with_name(name).read_text().splitlines()[1:]:
            address, number = line.split()[1].split(":")
            if int(number, 16) == port and line.split()[3] == "0A":
                found.add(address)
    return found


def test_the_live_view_listens_on_the_loopback_only():
    pytest.importorskip("meshcat")
    process, zmq_url, web_url = start_server()
    try:
        for url in (zmq_url, web_url):
            assert listening_addresses(int(urlsplit(url).port or 0)) == {"0100007F"}
    finally:
        process.kill()
        process.wait()


def test_an_address_that_is_not_here_is_refused():
    pytest.importorskip("meshcat")
    with pytest.raises(SmsidError, match=r"cannot listen on '192\.0\.2\.1'"):
        start_server("192.0.2.1")
