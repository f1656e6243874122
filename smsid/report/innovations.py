"""What a diagnosis leaves of its recording, before and after; and held-out flights open loop."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from smsid.diagnose.stepwise import Search
from smsid.diagnose.validation import SETTLE, read_like
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.kalman import run_filter
from smsid.estimation.measurements import Measured
from smsid.estimation.parameter_vector import Point
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.report.traces import Trace


def innovation_traces(found: Search, recording: Recording) -> dict[str, tuple[Trace, ...]]:
    """Return measured and predicted a sample ahead by channel, residuals after and before the causes."""
    return _traces(found.last.problem.data, found.last.run, found.nominal.run, recording, whitened=True)


def open_loop_traces(
    given: Point, extended: Point, found: Search, recording: Recording, rate: float
) -> dict[str, tuple[Trace, ...]]:
    """Return measured and simulated open loop by channel, on a recording that was not searched.

    The simulation starts from a state filtered over the first seconds (`SETTLE`) and is never corrected after
    them; residuals before are those of the model as ``given``. Raises what the filter raises.
    """
    like = found.last.problem
    recording = order_columns(recording, given.model())
    runs, data = [], like.data
    with threadpool_limits(limits=1, user_api="blas"):
        for point in (given, extended):
            model, problem = read_like(point, recording, like, rate)
            data = problem.data
            runs.append(run_filter(model, problem, until=float(data.times[0]) + SETTLE))
    return _traces(data, runs[1], runs[0], recording, whitened=False)


def _traces(
    data: Measured, run: FilterRun, before: FilterRun, recording: Recording, *, whitened: bool
) -> dict[str, tuple[Trace, ...]]:
    out: dict[str, tuple[Trace, ...]] = {}
    for block in data.blocks:
        unit = "rad" if block.quantity == "attitude" else recording.units.get(block.channel, "")
        own = []
        for k, row in enumerate(range(block.rows.start, block.rows.stop)):
            error = np.where(run.used[:, row] | (not whitened), run.errors[:, row], np.nan)
            values, simulated = _values(data, block.channel, block.quantity, row, k, error, run)
            sigma = float(data.sigma[row])
            if whitened:
                # what a sample is expected to be off by: its noise and what the state is uncertain by
                used = run.used[:, row] & (np.abs(run.normalised[:, row]) > 1e-12)
                shares = np.abs(run.errors[used, row] / run.normalised[used, row])
                sigma = float(np.median(shares)) if used.any() else sigma
            name = data.names[row].replace(".", " ", 1).replace("_", " ")
            own.append(Trace(name, unit, data.times, values, simulated, error, sigma, before.errors[:, row]))
        out[block.channel] = tuple(own)
    return out


def _values(
    data: Measured, channel: str, quantity: str, row: int, k: int, error: np.ndarray, run: FilterRun
) -> tuple[np.ndarray, np.ndarray | None]:
    """Measured and simulated values; attitudes as rotation vectors from the first sample."""
    if quantity != "attitude":
        return data.values[:, row], run.predicted[:, row]
    samples = data.attitude[channel]
    there = np.isfinite(samples).all(axis=1)
    turned = Rotation.from_quat(samples[there])
    out = np.full(len(samples), np.nan)
    out[there] = (turned[0].inv() * turned).as_rotvec()[:, k]
    return out, None


def whitened_groups(found: Search) -> dict[str, tuple[Trace, ...]]:
    """Return whitened innovations by channel, after and before the causes, for their spectra."""
    data = found.last.problem.data
    out: dict[str, tuple[Trace, ...]] = {}
    for block in data.blocks:
        rows = range(block.rows.start, block.rows.stop)
        settle = len(data.times) // 50
        out[block.channel] = tuple(
            Trace(
                data.names[r],
                "1",
                data.times[settle:],
                found.last.run.innovations[settle:, r],
                None,
                found.last.run.innovations[settle:, r],
                1.0,
                found.nominal.run.innovations[settle:, r],
            )
            for r in rows
        )
    return out
