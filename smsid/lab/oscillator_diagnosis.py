"""What a linear oscillator lacks: a spring that hardens, one that is not even, damping that grows."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from smsid.arm.regression import Projection
from smsid.diagnose.result import Diagnosis, FoundCause, Limit, SignificantTest, Value
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.torque.whitening import robust_p_value
from smsid.diagnose.validation import ChannelGain, Gain
from smsid.diagnose.verdict import describe
from smsid.lab.oscillator import TERMS, Oscillator, OscillatorFit, fit_oscillator, sensitivities

LOGGER = logging.getLogger(__name__)
LEVEL, BLOCK = 0.003, 0.001
"""Significance over all candidates, and over all generic tests, as in `smsid.diagnose.stepwise`."""

NAMES = {
    "quadratic": ("spring", "spring that is not even"),
    "cubic": ("spring", "hardening spring"),
    "quintic": ("spring", "spring of fifth order"),
    "damping_growth": ("damping", "damping that grows with amplitude"),
}
UNIT = {"quadratic": "1/{}", "cubic": "1/{}^2", "quintic": "1/{}^4", "damping_growth": "1/{}^2"}


@dataclass(frozen=True)
class OscillatorDiagnosis:
    """The diagnosis, and the fits it went through by the terms they have, the linear one first."""

    diagnosis: Diagnosis
    fits: dict[tuple[str, ...], OscillatorFit]

    @property
    def best(self) -> OscillatorFit:
        """The fit with every cause in it."""
        return list(self.fits.values())[-1]


@dataclass(frozen=True)
class _Test:
    """``sigma`` is the standard deviation of the first column's coefficient."""

    ratio: float
    p_value: float
    sigma: float
    freedom: int


def diagnose_oscillator(
    drive: np.ndarray,
    output: np.ndarray,
    rate: float,
    start: Oscillator,
    *,
    unit: str = "V",
    pieces: int = 10,
    name: str = "oscillator",
    validation: tuple[str, np.ndarray, np.ndarray] | None = None,
) -> OscillatorDiagnosis:
    """Say whether a linear oscillator explains a record, and if not, which terms it lacks.

    From the linear fit on, the term whose sensitivity explains most of what is left is added and all are
    fitted again, while it is significant. Errors are weighted as the fit weights them: what a lightly damped
    oscillator's model lacks shows at its resonance, where whitening would hide it. Chances allow for
    correlated and uneven errors. Then what is left is tested against output, rate, drive and time.

    Args:
        drive: (N,).
        output: (N,) [``unit``].
        rate: [Hz].
        start: first guess of the linear oscillator.
        unit: of the output.
        pieces: as in `fit_oscillator`.
        name: of the oscillator.
        validation: name, drive and output of a record to judge by, free-running from rest.

    Raises:
        NotIdentifiableError: as `fit_oscillator`.
    """
    begin = time.process_time()
    linear = fit = fit_oscillator(drive, output, rate, start, unit=unit, pieces=pieces, name=name)
    fits: dict[tuple[str, ...], OscillatorFit] = {(): linear}
    terms: tuple[str, ...] = ()
    evidence: dict[str, _Test] = {}
    tried = len(TERMS)
    while True:
        residual, rows, cut = sensitivities(drive, output, rate, fit)
        fitted = _project_terms(rows, terms)
        tests = {t: _score(fitted, rows[t][:, None], residual) for t in TERMS if t not in terms}
        good = {
            t: x for t, x in tests.items() if x.p_value * tried < LEVEL and x.ratio > np.log(len(residual))
        }
        if not good:
            break
        best = max(good, key=lambda t: good[t].ratio)
        LOGGER.info("%s: ratio %.1f", best, good[best].ratio)
        evidence[best] = good[best]
        terms = (*terms, best)
        fit = fit_oscillator(
            drive, output, rate, fit.oscillator, terms=terms, unit=unit, pieces=pieces, name=name
        )
        fits[terms] = fit
    searched = time.process_time()
    left, count = _significant_tests(residual, rows, terms, drive, output, cut)
    named = tuple(_cause(fit, t, evidence[t], name, unit, tried) for t in terms)
    words = "; ".join(describe(c) for c in named)
    if left:
        sentence = f"What is left still depends on {left[0].dependence}; no candidate explains that." + (
            f" Found beside it: {words}." if words else ""
        )
    else:
        sentence = f"The linear oscillator lacks {words}." if named else "A linear oscillator explains it."
    needed = replace(THRESHOLDS, candidate=LEVEL).detectable(tried)
    result = Diagnosis(
        description=name,
        recordings=(name,),
        verdict="unexplained" if left else "explained" if named else "adequate",
        sentence=sentence,
        priors="all parameters of the oscillator fitted freely",
        causes=named,
        gain=None if validation is None else _gain(validation, rate, linear, fit, unit),
        gain_reason="" if validation is not None else "no validation recording was given",
        remaining=tuple(replace(r, p_value=min(1.0, r.p_value * count)) for r in left),
        limits=tuple(
            Limit("oscillator", name, NAMES[t][1], f"{name}.{t}", needed * x.sigma, UNIT[t].format(unit))
            for t, x in tests.items()
        ),
        timing={"search": searched - begin, "tests": time.process_time() - searched},
        notes=("residual: measured minus free-running simulation, errors correlated in time allowed for",),
    )
    return OscillatorDiagnosis(result, fits)


def _project_terms(rows: dict[str, np.ndarray], terms: Sequence[str]) -> Projection:
    return Projection(np.stack([x for n, x in rows.items() if n not in TERMS or n in terms], axis=1))


def _score(fitted: Projection, columns: np.ndarray, residual: np.ndarray) -> _Test:
    """Likelihood ratio of more columns (M, k), everything fitted free to move."""
    basis, left = fitted.beyond(columns, 0.0), fitted.left(residual)
    along = basis.T @ left
    after = left - basis @ along
    level = float(np.mean(after**2))
    ratio = float(along @ along) / level
    p = robust_p_value(basis, after / np.sqrt(level), ratio, len(residual))
    size = float(np.linalg.norm(fitted.left(columns[:, 0])))
    return _Test(ratio, p, float(np.sqrt(level)) / size, basis.shape[1])


def _significant_tests(
    residual: np.ndarray,
    rows: dict[str, np.ndarray],
    terms: Sequence[str],
    drive: np.ndarray,
    output: np.ndarray,
    cut: Sequence[slice],
) -> tuple[list[SignificantTest], int]:
    """Generic tests that are significant, and how many there were: what acts like a force of that kind.

    A force passes through the oscillator; sensitivities by terms of the catalogue that are not in it have
    been, what is tested here acts on the output itself.
    """
    fitted = _project_terms(rows, terms)
    y, u = (np.concatenate([np.asarray(x)[c] for c in cut]) for x in (output, drive))
    y, u = y / np.abs(y).max(), u / max(np.abs(u).max(), 1e-300)
    v = np.gradient(y)
    v = v / np.abs(v).max()
    t = np.linspace(0.0, 1.0, y.size)
    blocks = {
        "its output": [y**2, y**3, y**4, y**5],
        "its rate": [v, v * np.abs(v), v**3],
        "rate and output": [v * y, v * y**2, v**2 * y],
        "the drive": [u, u**2, u**3],
        "time": [np.cos(np.pi * k * t) for k in range(1, 6)],
    }
    found = []
    for what, parts in blocks.items():
        score = _score(fitted, np.stack(parts, axis=1), residual)
        if score.p_value * len(blocks) < BLOCK:
            chi = float(chi2.isf(score.p_value, score.freedom))
            found.append(SignificantTest("simulation error", what, chi, score.freedom, score.p_value))
    return sorted(found, key=lambda r: r.p_value), len(blocks)


def _cause(fit: OscillatorFit, term: str, test: _Test, name: str, unit: str, tried: int) -> FoundCause:
    family, shape = NAMES[term]
    p = fit.estimate[f"{name}.{term}"]
    if term == "cubic" and p.value < 0.0:
        shape = "softening spring"
    chance = float(min(1.0, test.p_value * tried))
    evidence = {"likelihood_ratio": test.ratio, "freedom": 1.0, "p_value": chance}
    values = (Value(p.name, p.value, p.sigma, p.unit),)
    return FoundCause("oscillator", name, family, shape, values, (), evidence)


def _gain(
    validation: tuple[str, np.ndarray, np.ndarray],
    rate: float,
    linear: OscillatorFit,
    fit: OscillatorFit,
    unit: str,
) -> Gain:
    name, drive, output = validation
    errors = {
        n: np.asarray(output) - f.oscillator.simulate(drive, rate)
        for n, f in (("given", linear), ("extended", fit))
    }
    noise = fit.rmse
    rms = {n: float(np.sqrt(np.mean(e**2))) for n, e in errors.items()}
    excess = {n: float(np.sum((e / noise) ** 2)) - e.size for n, e in errors.items()}
    channel = ChannelGain("free-running error", unit, rms["given"], rms["extended"], noise)
    given, extended = rms["given"] / noise, rms["extended"] / noise
    size = int(np.asarray(output).size)
    return Gain(
        name, size, given, given, extended, excess["given"], excess["given"], excess["extended"], (channel,)
    )
