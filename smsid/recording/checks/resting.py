"""Components that rest at one value while the related channel moves: stuck, or saturated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smsid.recording.checks import sample_faults
from smsid.recording.checks.finding import Finding
from smsid.recording.checks.increments import integral
from smsid.recording.checks.pair_check import PairCheck

FloatArray = NDArray[np.float64]
CONSTANT_SHARE = 0.1
"""Share of a recording that a component must be constant to count as stuck."""


def resting_findings(check: PairCheck) -> list[Finding]:
    """Name components that rest at one value while the related channel moves."""
    found: list[Finding] = []
    if check.pair.kind != "plain":
        sides = ((check.v, check.pair.times, check.pair.v, None, check.pair.t, check.pair.x),)
    else:
        sides = (
            (check.v, check.pair.times, check.pair.v, None, check.pair.t, check.pair.x),
            (check.x, check.pair.t, check.pair.x, check.pair.v, check.pair.times, check.pair.v),
        )
    for name, t, values, rate, others_t, others in sides:
        if name.startswith("command."):
            continue
        for k, label in enumerate(check.labels):
            if not check.usable[k]:
                continue
            component = values[:, k]
            begin, end = sample_faults.longest_constant_run(component)
            kind = "stuck"
            marked = np.zeros(component.size, dtype=bool)
            if end - begin >= max(20, CONSTANT_SHARE * component.size):
                marked[begin:end] = True
            else:
                marked = sample_faults.clipped_samples(component)
                kind = "saturated"
                if rate is not None:
                    driven = np.interp(t, others_t, integral(others_t, others)[:, k])
                    marked = sample_faults.beyond_the_end(marked, component, driven)
            if np.count_nonzero(marked) < 20:
                continue
            contradiction = _motion(check, k, t, marked, component, rate is not None, others_t, others)
            if contradiction is None:
                continue
            share = float(np.mean(marked))
            other = check.x if name == check.v else check.v
            value = float(component[np.flatnonzero(marked)[0]])
            verb = "is stuck" if kind == "stuck" else "is saturated"
            at = float(t[np.flatnonzero(marked)[0]])
            found.append(
                Finding(
                    name, (label,), kind, other, (value, share, contradiction), True,
                    f"'{name}' {label} {verb} at {value:.4g} for {100 * share:.1f} % of the samples, "
                    f"from t = {at:.6g} s, while '{other}' moves by {contradiction:.2g} times its noise.",
                    "Leave the channel out, or cut the log with window(t0, t1).",
                )
            )  # fmt: skip
    return found


def _motion(
    check: PairCheck,
    k: int,
    t: FloatArray,
    marked: NDArray[np.bool_],
    component: FloatArray,
    integrates: bool,
    others_t: FloatArray,
    others: FloatArray,
) -> float | None:
    """Say how far the other channel moves, in units of its noise, where this one rests, or None.

    The rate of a resting angle must be zero; the change of what a resting rate drives must be uniform.
    """
    if check.free_gain:
        return None
    clock = np.interp(others_t, t, marked.astype(float)) >= 1.0
    if np.count_nonzero(clock) < 20:
        return None
    if integrates:
        y = others[clock, k]
        noise = 1.4826 * float(np.median(np.abs(np.diff(others[:, k], n=2))))
        rest = float(np.median(np.abs(y)))
        usual = float(np.sqrt(np.mean(others[:, k] ** 2)))
        if rest * float(others_t[-1] - others_t[0]) < _floor(check):
            return None
        return rest / max(noise, 1e-12) if rest > 10.0 * noise and rest > 0.1 * usual else None
    # While a rate rests, what it drives must grow by the rate times the span.
    fine = None
    mask_sum = np.concatenate([[0.0], np.cumsum(~marked)])
    for s in check.pair.spans:
        a, residual = s.increments[:, k], s.increments[:, k] - s.integrals[:, k]
        if fine is None:
            fine = float(np.median(np.abs(np.diff(a)))) + _floor(check)
        first, last = np.searchsorted(t, s.begins), np.searchsorted(t, s.begins + s.span, side="right")
        inside = (mask_sum[last] - mask_sum[first] == 0.0) & (last > first)
        if np.count_nonzero(inside) < 8:
            continue
        spread, whole = float(np.std(residual[inside])), float(np.std(a))
        if spread > max(0.1 * whole, 5.0 * fine):
            return spread / fine
    return None


def _floor(check: PairCheck) -> float:
    """Give the size below which increments are the last digits of the numbers and times."""
    last = float(np.spacing(np.abs(check.pair.times).max()))  # [s] 2e-7 of seconds since 1970
    turned = 4.0 * last * float(np.nanmax(np.abs(check.pair.v), initial=0.0))
    return 1e-10 * (1.0 + float(np.abs(check.pair.x).max())) + turned
