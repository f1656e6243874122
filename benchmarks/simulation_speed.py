"""Seconds of computing per simulated second at equal accuracy: the Exp. 2 spacecraft in five engines.

    python benchmarks/simulation_speed.py [--rounds 9]

Three cases: `free` (no torque, from a moving start), `smooth` (Fourier torques), `held` (the same torques
sampled at 100 Hz and held). In each, every engine gets the coarsest setting, found by bisection, whose error
over the run is at most 5e-9, once for the body rate omega and once for the worst channel of the whole state.
Errors are at 1, 2, ... 80 s, relative to each channel's largest magnitude, against smsid at tolerance 1e-13.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from _closed_loops import closed_loops
from _common import environment, spread, write_result
from _engines import Basilisk, Case, Engine, MujocoRollout, PinocchioRk4, Smsid, SmsidFixedStep
from _exp2 import DURATION, FREQUENCY, RATE, moving_start, paper_model, smooth_inputs

from smsid.inputs.signals import sample
from smsid.simulate import Inputs, Sampled

TARGET = 5e-9
PATIENCE = 30.0  # [s] an engine that has taken longer in one case sits out the remaining rounds
SAMPLED = "smsid, sampled at 100 Hz"  # tuned as "smsid"
CRITERIA = ("omega", "state")
REFERENCE, CHECK = 13 * 8, 2000  # settings of the reference (smsid) and of the check (MuJoCo)


def held_inputs(inputs: Inputs) -> Inputs:
    """Return the torques sampled at 100 Hz and held."""
    times = np.arange(round(DURATION * RATE) + 1) / RATE
    held = {
        name: Sampled.from_samples(times, sample(getattr(inputs, name), times), degree=0)
        for name in ("wheel_torque", "joint_torque")
    }
    return Inputs(**held)


def cases() -> dict[str, tuple[Case, dict[str, Callable[[Case], Engine]], dict[str, str]]]:
    """Return, by name: the case, its engines, and what is left out with the reason."""
    model = paper_model()
    start, rest = moving_start(model), np.zeros(model.nv)
    ours: dict[str, Callable[[Case], Engine]] = {
        "smsid": Smsid,
        SAMPLED: lambda case: Smsid(case, RATE),
    }
    no_source = (
        "Basilisk has no Fourier source in C++; a Python module called at every stage would be measured"
    )
    stops = "not done; it would have to be stopped every 10 ms to write its torque messages from Python"
    free = {
        "MuJoCo rollout RK4": lambda case: MujocoRollout(case, "none"),
        "Basilisk MJScene RK4": lambda case: Basilisk(case, "svIntegratorRK4"),
        "Basilisk MJScene RKF78": lambda case: Basilisk(case, "svIntegratorRKF78"),
        "Pinocchio RK4 in Python": PinocchioRk4,
    }
    smooth = {
        "MuJoCo rollout RK4, torque by a C callback": lambda case: MujocoRollout(case, "callback"),
        "MuJoCo rollout RK4, torque of mid-step held": lambda case: MujocoRollout(case, "held"),
        "Pinocchio RK4 in Python": PinocchioRk4,
    }
    held = {
        "smsid fixed step (simulate_closed_loop)": SmsidFixedStep,
        "MuJoCo rollout RK4": lambda case: MujocoRollout(case, "held"),
        "Pinocchio RK4 in Python": PinocchioRk4,
    }
    return {
        "free": (Case(model, Inputs(), start), ours | free, {}),
        "smooth": (Case(model, smooth_inputs(), rest), ours | smooth, {"Basilisk MJScene": no_source}),
        "held": (
            Case(model, held_inputs(smooth_inputs()), rest, 100),
            ours | held,
            {"Basilisk MJScene": stops},
        ),
    }


def errors(found: np.ndarray, expected: np.ndarray, nq: int) -> dict[str, float]:
    """Return the errors of omega and of the worst channel, over the run and at its end."""
    size = np.abs(expected).max(axis=0)
    relative = np.abs(found - expected) / size
    omega = relative[:, nq + 3 : nq + 6]
    return {
        "omega": float(omega.max()),
        "omega_end": float(omega[-1].max()),
        "state": float(relative.max()),
        "state_end": float(relative[-1].max()),
    }


def tune(engine: Engine, case: Case, expected: np.ndarray, criterion: str) -> tuple[int, dict[str, float]]:
    """Return the coarsest setting that reaches the target, or the finest, by bisection, and its errors."""
    settings = [s for s in engine.settings if not engine.fixed_step or s % case.steps_multiple == 0]
    low, high = -1, len(settings) - 1
    nq = case.model.nq
    best = errors(engine.run(settings[high])[1], expected, nq)
    while high - low > 1 and best[criterion] <= TARGET:
        middle = (low + high) // 2
        now = errors(engine.run(settings[middle])[1], expected, nq)
        if now[criterion] <= TARGET:
            high, best = middle, now
        else:
            low = middle
    return settings[high], best


def measure(name: str, rounds: int) -> dict[str, Any]:
    """Tune all engines of one case and time them in turn."""
    case, makers, left_out = cases()[name]
    present = {label for label in makers if not label.startswith("Basilisk") or find_spec("Basilisk")}
    left_out = {**left_out, **{label: "not installed" for label in makers if label not in present}}
    engines = {label: make(case) for label, make in makers.items() if label in present}
    expected = engines["smsid"].run(REFERENCE)[1]
    checker = next(engine for label, engine in engines.items() if label.startswith("MuJoCo"))
    result: dict[str, Any] = {"not_measured": left_out}
    result["reference_against_mujoco"] = errors(checker.run(CHECK)[1], expected, case.model.nq)
    for criterion in CRITERIA:
        tuned = {
            label: tune(engine, case, expected, criterion)
            for label, engine in engines.items()
            if label != SAMPLED
        }
        tuned[SAMPLED] = tuned["smsid"]
        taken: dict[str, list[float]] = {label: [] for label in engines}
        for _ in range(rounds):
            for label, engine in engines.items():
                if sum(taken[label]) * DURATION < PATIENCE:
                    taken[label].append(engine.run(tuned[label][0])[0] / DURATION)
        ours = np.array(taken["smsid"])
        result[f"equal_{criterion}"] = {
            label: {
                "setting": tuned[label][0],
                "setting_means": "steps a second"
                if engines[label].fixed_step
                else "tolerance 10^(-setting/8)",
                "reached": tuned[label][1][criterion] <= TARGET,
                "errors": {k: float(f"{v:.3g}") for k, v in tuned[label][1].items()},
                "seconds_per_simulated_second": spread(np.array(taken[label])),
                "time_over_smsid": spread(np.array(taken[label]) / ours[: len(taken[label])]),
                "rounds": len(taken[label]),
            }
            for label in engines
        }
        for label, row in result[f"equal_{criterion}"].items():
            ratio, error = row["time_over_smsid"]["median"], row["errors"][criterion]
            print(
                f"{name:7s}{criterion:6s}{label:44s}{row['setting']:6d} error {error:.1e} time {ratio:7.2f}",
                flush=True,
            )
    return result


def main() -> None:
    """Run every case and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--cases", nargs="+", default=["free", "smooth", "held"], help="has its own result")
    options = parser.parse_args()
    rounds, chosen = options.rounds, options.cases
    write_result(
        "simulation_speed" if len(chosen) == 3 else f"simulation_speed_{'_'.join(chosen)}",
        {
            "what": "seconds of computing per simulated second at equal accuracy; ratios are against smsid "
            "in the same round; medians and quartiles over interleaved rounds in one process, one thread",
            "system": "paper spacecraft, 18 degrees of freedom: bus, 3 wheels, 3 joints, slosh, 3 modes",
            "target_error": TARGET,
            "duration_s": DURATION,
            "base_frequency_hz": FREQUENCY,
            "rounds": rounds,
            "seed": "none: torques and start are fixed numbers in _exp2.py",
            "notes": [
                "smsid: adaptive, 8th order; 'sampled' adds states, accelerations, torques at 8001 instants",
                "MuJoCo and Pinocchio RK4: the states of every step (Pinocchio: of every second) are kept",
                "MuJoCo's rollout holds torques over a step. In 'smooth' it therefore runs twice: with the "
                "torque of mid-step held, and with the torque computed at every stage by a C callback that "
                "is not part of MuJoCo's rollout interface",
                "'held': simulate goes from sample to sample in compiled steps of fifth order, "
                "simulate_closed_loop in compiled steps of fourth order, its controller a table in Python; a "
                "fixed step must divide 10 ms, which is coarse for tuning",
                "'closed_loops': the paper's flight under the H-infinity controller with sensors, 80 s, and "
                "the same flight with its torques held, at the default tolerance; 'plain' is without numba",
                "'reached' false: the target was not reached at the finest setting tried",
                "Basilisk: MJScene, that is MuJoCo's dynamics under Basilisk's integrators, stopped and read "
                "once a second; its own state effectors cannot mount a three-joint arm, point slosh mass and "
                "modal panel exactly as here and were not measured",
            ],
            "environment": environment("pin", "mujoco", "bsk", "numpy", "scipy", "numba"),
            "closed_loops": closed_loops(paper_model(), rounds),
            "cases": {name: measure(name, rounds) for name in chosen},
        },
    )


if __name__ == "__main__":
    main()
