# /// script
# dependencies = ["smsid[plot]"]
# ///
"""Follow a spacecraft's last link from telemetry that a server sends line by line, sample by sample.

The server, here a thread of this program on the loopback, plays a flight that smsid simulates: any program
that writes such lines of JSON to a socket takes its place.

python examples/12_follow_telemetry.py [folder]
"""

from __future__ import annotations

import json
import socketserver
import sys
import threading
from pathlib import Path
from socket import create_connection

import matplotlib
import numpy as np

from smsid import load_spacecraft
from smsid.experiments import fly, fourier_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.recording import Recording
from smsid.tracking import Stream
from smsid.tracking.json_lines import lines_of

matplotlib.use("Agg")
from matplotlib import pyplot as plt

LOOPBACK = "127.0.0.1"
FOLLOWED = {"link3.*": 0.0}  # the last link's ten parameters, constant in time
SECONDS = 40.0


def flown() -> Recording:
    """Return a flight of the paper's spacecraft: its arm and wheels move."""
    rng = np.random.default_rng(12)
    model = build_model(load_spacecraft(urdf_folder() / "paper_sms.toml"))
    experiment = fourier_experiment(model, rng, duration=SECONDS, candidates=1).experiment
    return fly(model, experiment, rng).recording.resampled(20.0)


def serve(recording: Recording) -> socketserver.TCPServer:
    """Return a server on a free port of the loopback that sends every client the recording's lines."""

    class Telemetry(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for _, line in lines_of(recording):
                self.wfile.write(line.encode() + b"\n")

    server = socketserver.TCPServer((LOOPBACK, 0), Telemetry)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def main(folder: Path) -> None:
    """Follow the last link's parameters, print what is believed at the end, draw how it came about."""
    server = serve(flown())
    described = load_spacecraft(urdf_folder() / "paper_sms.toml")
    stream = Stream(described, follow=FOLLOWED, begin=10.0, every=0.5)
    times, values, sigmas = [], [], []
    with create_connection(server.server_address[:2]) as connection, connection.makefile() as lines:
        for line in stream.follow(lines):
            told = json.loads(line)
            if "parameters" in told:
                times.append(told["time"])
                values.append(list(told["parameters"].values()))
                sigmas.append(list(told["sigmas"].values()))
    server.shutdown()
    server.server_close()
    value, sigma = np.array(values), np.array(sigmas)
    for name, x, s in zip(told["parameters"], value[-1], sigma[-1], strict=True):
        print(f"{name:14s} {x:9.4f} +- {1.96 * s:.4f}")
    figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
    axes.semilogy(times, sigma / sigma[0])
    axes.legend(list(told["parameters"]), ncols=2, fontsize="small")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("standard deviation over the first")
    figure.savefig(folder / "tracked.png", dpi=120)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
