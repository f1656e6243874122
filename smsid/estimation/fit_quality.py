"""Does the model explain the recordings? Innovations against stated noise, whiteness, spread of the slope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import chdtrc

from smsid.estimation._prior_conflict import PriorConflict, prior_conflict

if TYPE_CHECKING:
    from smsid.estimation._normal_equations import InnovationSums, NormalEquations
    from smsid.estimation._scale_conflict import ScaleConflict

LOUD_RATIO = 1.5  # times its stated noise that a channel may leave: data sheets are no better
WRONG_RATIO = 3.0  # times beyond which the model does not explain a channel
CORRELATED_FROM = 0.3  # autocorrelation from which a channel's innovations are no noise, whatever its size
DISPERSED_FROM = 1.5  # spread of the slope, in what it should be, above which a fit explains roughly at best
WHITENESS_LEVEL = 1e-4  # probability below which innovations are not white
Judgement = Literal["explained", "roughly", "not explained"]
BEST_FIRST: tuple[Judgement, ...] = ("explained", "roughly", "not explained")


@dataclass(frozen=True)
class ChannelFit:
    """How one channel of one recording is explained.

    ``ratio`` is the root mean square of its innovations over their predicted size (of the worst component,
    ``component``), ``p_white`` the Ljung-Box probability of their correlation, ``correlation`` the largest of
    their autocorrelations (both NaN where it was not tested). ``judgement`` is about the channel.
    """

    recording: str
    channel: str
    component: str
    ratio: float
    correlation: float
    p_white: float
    judgement: Judgement


@dataclass(frozen=True)
class FitQuality:
    """The verdict on a fit: channel by channel, and by how much standard deviations had to be widened.

    ``dispersion`` is the spread of the slope of the likelihood over parts of the recordings, in standard
    deviations of what it is if the model is right. ``conflict``: with what was known beforehand, priors or
    the scale of what drives the motion, if any. ``model_error``: share of what drives the motion that the
    model errs by likeliest, where the estimate counts it.
    """

    channels: tuple[ChannelFit, ...]
    dispersion: float
    conflict: PriorConflict | ScaleConflict | None = None
    model_error: float = 0.0

    @property
    def judgement(self) -> Judgement:
        """The verdict on the whole: of channels, spread of the slope and agreement with priors, the worst."""
        worst = max((BEST_FIRST.index(c.judgement) for c in self.channels), default=0)
        worst = max(worst, 1 if self.dispersion > DISPERSED_FROM or self.model_error else 0)
        if self.conflict is not None:
            worst = max(worst, 2 if self.conflict.size > WRONG_RATIO else 1)
        return BEST_FIRST[worst]

    @property
    def widening(self) -> float:
        """Factor on standard deviations: spread of the slope, misfit of channels or priors, the largest."""
        worst = max((c.ratio for c in self.channels if c.judgement == "not explained"), default=1.0)
        return max(1.0, self.dispersion, worst, 1.0 if self.conflict is None else self.conflict.size)

    @property
    def quiet(self) -> bool:
        """Whether no channel leaves more than its noise: what a model errs by is slow, if anything."""
        return all(c.ratio <= LOUD_RATIO for c in self.channels) and self.conflict is None

    @property
    def reason(self) -> str:
        """Why nothing is identifiable where the judgement is ``not explained``."""
        if any(c.judgement == "not explained" for c in self.channels):
            return "the model does not explain the recordings"
        return "the recordings contradict what was known beforehand"

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        spread = (
            f"it errs slowly, by about {100.0 * self.model_error:.1g} % of what drives the motion, which "
            "intervals count"
            if self.model_error
            else "parts of the recordings disagree by more than noise, "
            f"as if it were {self.dispersion:.3g} times as large"
        )
        if self.conflict is not None and all(c.judgement != "not explained" for c in self.channels):
            return self.conflict.sentence
        if self.judgement == "roughly" and all(c.judgement == "explained" for c in self.channels):
            return f"The model explains the recordings roughly: {spread}."
        bad = sorted((c for c in self.channels if c.judgement != "explained"), key=lambda c: -c.ratio)
        if not bad:
            white = ", and white" if all(np.isfinite(c.p_white) for c in self.channels) else ""
            return f"The model explains the recordings: what is left is the sensors' noise{white}."
        c = bad[0]
        more = f", and {len(bad) - 1} more channels" if len(bad) > 1 else ""
        left = f"{c.component} in '{c.recording}' is left at {c.ratio:.3g} times its stated noise"
        if c.ratio <= LOUD_RATIO:
            left = f"what is left of {c.component} in '{c.recording}' is not white"
            left += f" (correlation {c.correlation:.2f})"
        if self.judgement == "roughly":
            return f"The model explains the recordings roughly: {left}{more}."
        return f"The model does not explain the recordings: {left}{more}."


def fit_quality(found: NormalEquations) -> FitQuality:
    """Return how well the recordings are explained at a point."""
    channels = [c for t in found.recordings for c in _channels(t.label, t.innovations)]
    return FitQuality(tuple(channels), _dispersion(found), prior_conflict(found))


def _channels(label: str, sums: InnovationSums) -> list[ChannelFit]:
    out = []
    for channel in dict.fromkeys(sums.channels):
        rows = [i for i, c in enumerate(sums.channels) if c == channel and sums.count[i] > 0]
        if not rows:
            continue
        mean = sums.squares[rows] / sums.count[rows]
        ratio = np.sqrt(mean)
        scale = np.where(mean > 0.0, mean, 1.0)[:, None]
        correlation = sums.products[rows] / np.maximum(sums.pairs[rows], 1.0) / scale
        q = np.sum(sums.pairs[rows] * correlation**2, axis=1)
        p_white = chdtrc(sums.products.shape[1], q)
        strongest = np.abs(correlation).max(axis=1)
        coloured = (p_white < WHITENESS_LEVEL) & (strongest > CORRELATED_FROM) & (ratio > 1.0)
        level = np.where(ratio > WRONG_RATIO, 2, np.where((ratio > LOUD_RATIO) | coloured, 1, 0))
        k = int(np.lexsort((ratio, level))[-1])
        judgement = BEST_FIRST[int(level[k])]
        out.append(
            ChannelFit(
                label,
                channel,
                sums.names[rows[k]],
                float(ratio[k]),
                float(strongest[k]),
                float(p_white.min()),
                judgement,
            )
        )
    return out


def _dispersion(found: NormalEquations) -> float:
    """Return the spread of the slope over parts of the recordings, 1 where the model is right.

    Of all directions that the data tell, the root of the mean; not below what chance allows, of noise with
    tails as heavy as the innovations'. Source: the
    sandwich covariance of White, Econometrica 50 (1982) 1, with parts of the recordings as clusters.
    """
    information = found.information
    scatter = np.sum([t.scatter for t in found.terms], axis=0)
    size, basis = np.linalg.eigh(information / _norm(information))
    told = size > 1e-9 * size[-1]
    root = basis[:, told] / np.sqrt(size[told])
    shares = np.einsum("ij,ik,kj->j", root, scatter / _norm(information), root)
    count = max(1, sum(t.innovations.parts for t in found.terms) * int(told.sum()))
    mean, excess = float(np.mean(shares)), max(t.innovations.excess for t in found.terms)
    return float(np.sqrt(mean)) if mean > 1.0 + 4.0 * np.sqrt((2.0 + excess) / count) else 1.0


def _norm(information: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.outer(size, size)
