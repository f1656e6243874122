"""The server of a live view: meshcat's own, listening where it is told instead of on every interface.

Meshcat lets tornado listen on all interfaces and prints 127.0.0.1. This file is run as a process of its own.
"""

from __future__ import annotations

import subprocess
import sys

LOOPBACK = "127.0.0.1"


def start_server(host: str = LOOPBACK) -> tuple[subprocess.Popen[str], str, str]:
    """Start the server as a process; return it, the URL that scenes are sent to and the browser's URL.

    ``host``: address that browsers connect to; scenes are taken from this machine alone in any case.

    Raises:
        SmsidError: the server does not start, for instance as the machine has no such address.
    """
    from smsid.errors import SmsidError

    # -P: this file's folder is not where modules are looked for
    process = subprocess.Popen(
        [sys.executable, "-P", "-u", __file__, host],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    found = {}
    for line in process.stdout:
        key, _, value = line.strip().partition("=")
        found[key] = value
        if "web_url" in found:
            return process, found["zmq_url"], found["web_url"]
    process.wait()
    raise SmsidError(
        f"The live view cannot listen on '{host}'.",
        advice=f"Give --host an address of this machine, or leave it out for {LOOPBACK}.",
        host=host,
    )


def main(host: str) -> None:
    """Serve until killed."""
    import tornado.web
    from meshcat.servers.zmqserver import ZMQWebSocketBridge

    class Application(tornado.web.Application):
        def listen(self, port: int, address: str | None = None, **options: object):  # type: ignore[override]
            return super().listen(port, address or host, **options)  # type: ignore[arg-type]

    class Bridge(ZMQWebSocketBridge):
        def make_app(self) -> tornado.web.Application:
            app = super().make_app()
            app.__class__ = Application
            return app

    bridge = Bridge()
    bridge.web_url = str(bridge.web_url).replace(LOOPBACK, host)
    print(f"zmq_url={bridge.zmq_url}")
    print(f"web_url={bridge.web_url}")
    bridge.run()


if __name__ == "__main__":
    main(sys.argv[1])
