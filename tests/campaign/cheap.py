"""A method that costs nothing: `make_plan` copies it beside the plan, as a user would write one."""

from __future__ import annotations

import os
import time

import numpy as np

from smsid.campaign import Case, Findings, Outcome

SIGMA = 0.5


def measure(
    case: Case,
    *,
    pause: float = 0.0,
    failing: tuple[int, ...] = (),
    deadly: tuple[int, ...] = (),
    trace: bool = False,
) -> Findings:
    """Measure the tank's mass with noise; pause [s], fail or die where told."""
    if case.run in failing and not (case.campaign.folder / "mended").exists():
        raise ValueError(f"run {case.run} was told to fail")
    if case.run in deadly:
        os._exit(1)
    if trace:
        (case.campaign.folder / f"pid_{os.getpid()}").touch()
    time.sleep(pause)
    rng = case.rng("noise")
    truth = next(p.value for p in case.truth.get_effect("tank").parameters() if p.name == "tank.mass")
    matrix = rng.standard_normal((120, 120))
    value = truth + SIGMA * rng.standard_normal()
    return Findings(
        outcomes=(
            Outcome(name="mass", value=value, unit="kg", truth=truth, sigma=SIGMA, group="cheap"),
            Outcome(name="blas", value=float(np.linalg.svd(matrix @ matrix)[1].sum())),
            Outcome(name="never", value=float("nan"), truth=1.0, sigma=float("inf")),
        ),
        notes=(f"run {case.run}",),
    )


def wrong(case: Case) -> float:
    """Return what no method may."""
    return 1.0


def refuse(case: Case) -> Findings:
    """Fail with a message that names a file of the case."""
    raise ValueError(f"'{case.truth.urdf}' is refused")
