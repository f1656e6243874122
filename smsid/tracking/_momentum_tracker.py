"""Follow inertial parameters by recursive total least squares of the conserved momentum, (38)-(39)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from smsid._time_text import time_text
from smsid.description.schema import Description
from smsid.errors import EstimateError, RecordingError
from smsid.identify.appendages import linear_appendages
from smsid.identify.estimate import Estimate
from smsid.identify.momentum_rows import CORRELATION_TIME, carried_by_bus
from smsid.identify.paper.hidden_states import HiddenStates, check_on_bus
from smsid.identify.paper.momentum import rows_b, step_a
from smsid.identify.paper.motion import MeasuredMotion, prepare, raw_rates
from smsid.identify.paper.noise_replicates import add_noise_replicate
from smsid.identify.paper.recursive_tls import RecursiveTls
from smsid.identify.paper.rest import check_at_rest
from smsid.identify.paper.square_root_information import ScoreSums
from smsid.identify.stationary_joints import if_all_moved
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.recording import Recording
from smsid.tracking._hidden_state_carrier import Chunk, HiddenStateCarrier
from smsid.tracking._momentum_errors import RowErrors, row_errors, variance_factor
from smsid.tracking._sample import Sample
from smsid.tracking._sample_buffer import EventLog
from smsid.tracking._update import Update
from smsid.tracking.followed_parameters import UNCERTAIN

MARGIN = 5.0  # [s] read on both sides of a window, in which filters settle
WINDOW = 40.0  # [s] of motion taken in together: a few periods of a panel, many of the errors' correlation
CUTOFF, RATE = 2.0, 20.0  # [Hz] as Exp. 2 is prepared
TRACKED_REPLICATES = 3  # of noise once more
FREE = 1e3  # [m] prior of the centre of mass where a recording begins
EQUATIONS = tuple(f"{what} {x}" for what in ("angular momentum", "centre of mass") for x in "xyz")
FORCES = ("command.force", "command.thruster", "command.thruster_force", "command.torque")


class MomentumTracker:
    """The paper's Step B as a tracker: total least squares of a stream, with a prior and forgetting.

    A twin of `Tracker` for a spacecraft that floats freely from rest on wheels and arms alone: it needs no
    torques and no model of friction, and tells combinations of inertial parameters only. Slosh and panels are
    taken as described. Samples are taken in window by window, so results come ``window`` [s] late. Memory
    does not grow.

    Args:
        description: the spacecraft, with slosh and panels as known.
        estimate: of the paper's method, whose Step B is what is known beforehand.
        cad: without one, how far bodies may be off the description, relative to their size.
        memory: time [s] over which equations, and the prior, are forgotten; ``None`` keeps all.
        window: [s] of motion taken in together.

    Raises:
        RecordingError: ``memory`` or ``window`` is not positive.
        EstimateError: the estimate has no Step B of this spacecraft.
    """

    def __init__(
        self,
        description: Description,
        *,
        estimate: Estimate | None = None,
        cad: float = UNCERTAIN,
        memory: float | None = None,
        window: float = WINDOW,
    ) -> None:
        for label, value in (("memory", memory), ("window", window)):
            if value is not None and not value > 0.0:
                raise RecordingError(f"A {label} of {value} s is none.", advice="Give a positive time [s].")
        self.described = description
        self.description = linear_appendages(description)[0]
        self.model = build_model(self.description)
        check_on_bus(self.model)
        self.window, self.memory = round(window * RATE) / RATE, memory
        self.regressor = Regressor(self.model)
        self.base, self.split = if_all_moved(self.model)
        theta = self.regressor.parameters
        self._carried = self.base.matrix @ carried_by_bus(self.model, self.regressor)[self.split.unknown]
        self.nominal = self.base.matrix @ theta[self.split.unknown] + self._carried
        self._mean = self.nominal - self._carried
        self._covariance = self._described_covariance(cad)
        if estimate is not None:
            self._take_estimate(estimate)
        self.log = EventLog()
        self.listener: Callable[[Update], None] | None = None
        self.samples = 0
        self._time = -np.inf
        self._begin()

    def _begin(self) -> None:
        """Begin a recording: what is known of the parameters stays, the rest is its own."""
        self._raw: dict[str, tuple[list[float], list[np.ndarray]]] = {}
        self._first: float | None = None
        self._taken = 0
        self._newest = -np.inf
        self._carrier = HiddenStateCarrier(self.model)
        self._others = [HiddenStateCarrier(self.model) for _ in range(TRACKED_REPLICATES)]
        self._tls: RecursiveTls | None = None
        self._other_tls: list[RecursiveTls] = []
        self._scores: ScoreSums | None = None
        self._errors: RowErrors | None = None
        self._centre = np.zeros(3)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the combinations followed (m,); "bus" includes wheels and undeformed panels."""
        return self.base.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the combinations followed (m,)."""
        return self.base.units

    @property
    def time(self) -> float:
        """Time [s] up to which motion was taken in; minus infinity before the first window."""
        return self._time

    @property
    def values(self) -> np.ndarray:
        """Values (m,) of the combinations followed."""
        return self._mean + self._carried

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations (m,) of the combinations followed."""
        return np.sqrt(np.diag(self._covariance))

    @property
    def parameter_covariance(self) -> np.ndarray:
        """Covariance (m, m) of the combinations followed."""
        return self._covariance.copy()

    def begin_recording(self) -> None:
        """Begin another recording, from rest again; parameters go on from where they are."""
        self.flush()
        self._begin()

    def update(self, sample: Sample) -> tuple[Update, ...]:
        """Take in a sample of any sensors; return what the windows told that are complete.

        Raises `RecordingError` where thrust acts, since momentum is not conserved then,
        `NotIdentifiableError` where the recording does not begin at rest.
        """
        self._receive(sample)
        return tuple(self._ready(final=False))

    def update_all(self, samples: Iterable[Sample]) -> tuple[Update, ...]:
        """Take in samples together; raises as `update`."""
        return tuple(x for sample in samples for x in self.update(sample))

    def flush(self) -> tuple[Update, ...]:
        """Take in the window that is not complete; the recording is over then."""
        return tuple(self._ready(final=True))

    def _receive(self, sample: Sample) -> None:
        for channel, value in sample.channels.items():
            if channel.startswith("command."):
                if channel in FORCES and np.abs(np.nan_to_num(value)).max(initial=0.0) > 1e-9:
                    raise RecordingError(
                        f"'{channel}' acts at {time_text(sample.time)}: momentum is not conserved.",
                        advice="Follow by the filter (smsid.tracking.Tracker), or leave the thrust out.",
                        channel=channel,
                    )
                continue
            if not np.isfinite(value).all():
                self.log.add(sample.time, "not finite", channel, "is not finite; left out")
                continue
            times, values = self._raw.setdefault(channel, ([], []))
            if times and sample.time <= times[-1]:
                self.log.add(sample.time, "late", channel, "came late or twice and is left out")
                continue
            times.append(sample.time)
            values.append(np.asarray(value, dtype=float))
        self._first = sample.time if self._first is None else self._first
        self._newest = max(self._newest, sample.time)

    def _ready(self, *, final: bool) -> list[Update]:
        out: list[Update] = []
        while self._first is not None:
            begin = self._first + self._taken * self.window
            end = begin + self.window
            if self._newest < end + MARGIN:
                break
            out += self._push(*self._motions(begin, end))
            self._taken += 1
        if final and self._first is not None:
            begin = self._first + self._taken * self.window
            if self._newest - begin >= 4.0 * CORRELATION_TIME:
                out += self._push(*self._motions(begin, np.inf))
            out += self._push(None, [None] * TRACKED_REPLICATES)
            self._first = None
        return out

    def _motions(self, begin: float, end: float) -> tuple[MeasuredMotion, list[MeasuredMotion]]:
        """Return the motion from ``begin`` to ``end`` [s], and with noise once more, several times.

        Samples that no later window needs are forgotten.
        """
        channels = {}
        for channel, (times, values) in self._raw.items():
            own = np.array(times)
            shape = (len(own), -1, 3) if self._is_station(channel) else (len(own), -1)
            if len(own):
                channels[channel] = (own, np.array(values).reshape(shape))
            kept = int(np.searchsorted(own, end - MARGIN)) if np.isfinite(end) else 0
            del times[:kept], values[:kept]
        recording = Recording.from_arrays(None, channels, name=self.description.name)
        if self._taken == 0:
            check_at_rest(self.description.name, raw_rates(self.model, recording))
        sensors = self.description.effective_sensors()

        def prepared(of: Recording) -> MeasuredMotion:
            motion = prepare(self.model, of, cutoff=CUTOFF, rate=RATE)
            return motion.only((motion.time > begin - 0.25 / RATE) & (motion.time < end - 0.25 / RATE))

        others = [
            prepared(add_noise_replicate(recording, sensors, np.random.default_rng([k, self._taken])))
            for k in range(TRACKED_REPLICATES)
        ]
        return replace(prepared(recording), again=others[0]), others

    def _is_station(self, channel: str) -> bool:
        kinds = {s.name: s.kind for s in self.description.effective_sensors()}
        return kinds.get(channel.partition(".")[0]) == "accelerometers"

    def _push(self, motion: MeasuredMotion | None, others: Sequence[MeasuredMotion | None]) -> list[Update]:
        chunk = self._carrier.push(motion)
        more = [c.push(m) for c, m in zip(self._others, others, strict=True)]
        if chunk is None or not len(chunk[0]):
            return []
        told = self._take_in(chunk, [x for x in more if x is not None])
        if self.listener is not None:
            self.listener(told)
        return [told]

    def _equations(self, motion: MeasuredMotion, hidden: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (N, 6, m + 3) of the combinations and the centre's offset, right-hand side (N, 6)."""
        full, rhs = rows_b(
            self.model, self.regressor, self.split, motion, hidden, self.model.mass, self._centre
        )
        count = len(self.split.names)
        return full[:, :, [*self.base.independent.tolist(), *range(count, count + 3)]], rhs

    def _take_in(self, chunk: Chunk, others: Sequence[Chunk]) -> Update:
        motion, hidden = chunk
        if self._tls is None:
            self._centre = step_a(self.model, motion, hidden, self.model.mass).position
        rows, rhs = self._equations(motion, hidden)
        again = [self._equations(*other) for other in others]
        expected = np.concatenate([self._mean, np.zeros(3)])
        if self._tls is None or self._errors is None:
            moved = np.concatenate([again[0][0] - rows, (again[0][1] - rhs)[:, :, None]], axis=2)
            self._errors = row_errors(rows, rhs, moved, expected, motion.step)
            self._tls = self._start_recursion(self._errors, motion.step)
            self._other_tls = [self._start_recursion(self._errors, motion.step) for _ in again]
        errors = self._errors
        x, exact = self._solve_equations(self._tls, errors, rows, rhs)
        covariance = self._widen_covariance(exact, errors, rows, rhs - rows @ x)
        moves = [
            self._solve_equations(tls, errors, *equations)[0] - x
            for tls, equations in zip(self._other_tls, again, strict=True)
        ]
        covariance = covariance * variance_factor(covariance[:-3, :-3], [m[:-3] for m in moves])
        left = (rhs - rows @ expected) * errors.weights
        self._mean, own = x[:-3], covariance[:-3, :-3]
        self._covariance = 0.5 * (own + own.T)
        self._time, self.samples = float(motion.time[-1]), self.samples + len(motion)
        fit = np.sqrt(np.mean(((rhs - rows @ x) * errors.weights) ** 2, axis=0))
        before = np.sqrt(np.mean(left**2, axis=0))
        return Update(self._time, self.values, self.sigmas, EQUATIONS, before, fit, float("nan"))

    def _widen_covariance(
        self, covariance: np.ndarray, errors: RowErrors, rows: np.ndarray, left: np.ndarray
    ) -> np.ndarray:
        """Return a covariance (n, n) whose variances are no less than what residuals say.

        The sandwich of `hac_covariance`, with the prior's part: what the model leaves out stays for seconds
        and is not in the sensors' noise. ``rows`` (N, 6, n), ``left`` (N, 6) are of the latest window.
        """
        assert self._scores is not None
        lost = self._forgetting**left.size
        if self._scores.meat is not None:
            self._scores.meat *= lost
        self._prior_scores *= lost
        self._scores.add(rows * errors.weights[:, None] / errors.scale, left * errors.weights)
        assert self._scores.meat is not None
        z = np.append(np.concatenate([self._mean, np.zeros(3)]) * errors.scale, -1.0)
        size = float(z @ errors.noise @ z)  # the variance of a row's error
        scaled = covariance * np.outer(errors.scale, errors.scale)
        inverse = scaled / size
        sandwich = inverse @ (self._scores.meat + size**2 * self._prior_scores) @ inverse
        fit = np.mean((left * errors.weights) ** 2, axis=0)
        factor = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(scaled), max(1.0, float(fit.max()))))
        return covariance * np.outer(factor, factor)

    @staticmethod
    def _solve_equations(
        tls: RecursiveTls, errors: RowErrors, rows: np.ndarray, rhs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take equations in; return unknowns (n,), and their covariance (n, n) if noise is all there is."""
        n = rows.shape[2]
        scaled = (rows * errors.weights[:, None] / errors.scale).reshape(-1, n)
        found = tls.update(scaled, (rhs * errors.weights).reshape(-1)).solution()
        return found.x / errors.scale, found.covariance / found.sigma**2 / np.outer(
            errors.scale, errors.scale
        )

    def _start_recursion(self, errors: RowErrors, step: float) -> RecursiveTls:
        n = len(errors.scale)
        covariance = np.zeros((n, n))
        covariance[:-3, :-3], covariance[-3:, -3:] = self._covariance, FREE**2 * np.eye(3)
        memory = np.inf if self.memory is None else self.memory
        self._forgetting = float(np.exp(-step / (len(EQUATIONS) * memory)))
        self._scores = ScoreSums(max(1, round(CORRELATION_TIME / step)))
        self._prior_scores = np.linalg.inv(covariance * np.outer(errors.scale, errors.scale))
        return RecursiveTls(
            n,
            np.concatenate([self._mean, np.zeros(3)]) * errors.scale,
            covariance * np.outer(errors.scale, errors.scale),
            noise=errors.noise,
            names=[*self.base.names, "centre.x", "centre.y", "centre.z"],
            forgetting=self._forgetting,
        )

    def _described_covariance(self, cad: float) -> np.ndarray:
        """Return the prior covariance (m, m): every body's parameters off by ``cad`` of its size."""
        sigma = np.zeros(self.regressor.columns)
        for k in range(len(self.regressor.bodies)):
            theta = self.regressor.parameters[10 * k : 10 * k + 10]
            turn = 0.5 * abs(theta[4] + theta[6] + theta[9])
            sizes = [abs(theta[0]), *[np.sqrt(abs(theta[0]) * turn)] * 3, *[turn] * 6]
            sigma[10 * k : 10 * k + 10] = cad * np.array(sizes)
        own = self.base.matrix * sigma[self.split.unknown]
        return own @ own.T

    def _take_estimate(self, estimate: Estimate) -> None:
        """Take what Step B found for mean and standard deviations."""
        found = {p.name: p for p in estimate.group("exp2.step_b")}
        used = [(i, found[n]) for i, n in enumerate(self.base.names) if n in found]
        if not used:
            raise EstimateError(
                "The estimate has no Step B of this spacecraft.",
                advice="Give one that `smsid identify --method paper` made from Exp. 2, or none.",
            )
        for i, p in used:
            self._mean[i] = p.value - self._carried[i]
            self._covariance[i, :] = self._covariance[:, i] = 0.0
            self._covariance[i, i] = p.sigma**2
