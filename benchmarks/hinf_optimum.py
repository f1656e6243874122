"""Least gamma of the H-infinity synthesis beside two independent ones: an LMI, and SLICOT through slycot.

    python benchmarks/hinf_optimum.py

Needs cvxpy with clarabel for the LMI (Gahinet and Apkarian, 1994: no Riccati equation, no assumption on the
plant beyond stabilisable and detectable), slycot and python-control for the other; what is missing is told
and left out. The norm of every loop is computed again by SLICOT's ab13dd and by a frequency sweep.
"""

from __future__ import annotations

import os
import warnings

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import ctrlsys  # noqa: E402
import numpy as np  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402
from scipy.linalg import null_space  # noqa: E402

from smsid.control._hinfinity import Plant, synthesize  # noqa: E402
from smsid.control._statespace import StateSpace, hinf_norm, lower_lft  # noqa: E402
from smsid.control.gains import gains  # noqa: E402
from smsid.control.robust_term import design_robust_term, error_plant  # noqa: E402
from smsid.control.weights import DesignWeights  # noqa: E402
from smsid.description import load_description  # noqa: E402
from smsid.model import build_model  # noqa: E402
from smsid.paper.table4 import Study, Variant, cases  # noqa: E402

SEEDS = 16


def general_plant(seed: int) -> Plant:
    """Random, with nonzero D11, D12 and D21; 4 states, w of 3, u of 1, z of 3, y of 2."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((4, 4))
    d = np.zeros((5, 4))
    d[:3, :3] = 0.3 * rng.standard_normal((3, 3))
    d[:3, 3:] = rng.standard_normal((3, 1))
    d[3:, :3] = rng.standard_normal((2, 3))
    return Plant(StateSpace(a, rng.standard_normal((4, 4)), rng.standard_normal((5, 4)), d), 1, 2)


def plants() -> dict[str, Plant]:
    found = {f"random {seed}": general_plant(seed) for seed in range(SEEDS)}
    study = Study(build_model(load_description(ROOT / "urdf" / "paper_sms.toml")), Variant())
    for case in (c for c in cases() if c.name in ("C", "A1.6")):
        w = study.robust_term(case).weights
        k = gains(6, case.proportional, case.derivative)
        term = design_robust_term(k, w)
        for block, what in ((term.blocks[0], "roll"), (term.blocks[3], "joint1")):
            one, slower = block.coordinates, block.crossover / w.crossover
            part = DesignWeights(
                w.disturbance[one],
                np.sqrt(slower) * w.angle_noise[one],
                np.sqrt(slower) * w.rate_noise[one],
                w.uncertainty,
                block.crossover,
                w.integral,
            )
            square = np.ix_(one, one)
            plant = error_plant(k.proportional[square], k.derivative[square], part, block.error)
            found[f"design {case.name}, {what}"] = plant
    return found


def lmi_optimum(plant: Plant) -> float | None:
    try:
        import cvxpy as cp
    except ImportError:
        return None
    s, nu, ny = plant.system, plant.controls, plant.measurements
    (p, m), n = s.d.shape, s.order
    nw, nz = m - nu, p - ny
    a, b1, b2, c1, c2 = s.a, s.b[:, :nw], s.b[:, nw:], s.c[:nz], s.c[nz:]
    d11, d12, d21 = s.d[:nz, :nw], s.d[:nz, nw:], s.d[nz:, :nw]
    x, y = (cp.Variable((n, n), symmetric=True) for _ in range(2))
    g = cp.Variable()

    def projected(a, b, c, d, v, kernel):
        rows, columns = d.shape
        matrix = cp.bmat(
            [[a @ v + v @ a.T, v @ c.T, b], [c @ v, -g * np.eye(rows), d], [b.T, d.T, -g * np.eye(columns)]]
        )
        side = np.block(
            [
                [kernel, np.zeros((len(kernel), columns))],
                [np.zeros((columns, kernel.shape[1])), np.eye(columns)],
            ]
        )
        found = side.T @ matrix @ side
        return 0.5 * (found + found.T) << 0

    problem = cp.Problem(
        cp.Minimize(g),
        [
            projected(a, b1, c1, d11, x, null_space(np.hstack([b2.T, d12.T]))),
            projected(a.T, c1.T, b1.T, d11.T, y, null_space(np.hstack([c2, d21]))),
            cp.bmat([[x, np.eye(n)], [np.eye(n), y]]) >> 0,
        ],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is none
        try:
            problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            return None
    return float(g.value) if problem.status == "optimal" else None


def slycot_optimum(plant: Plant) -> tuple[float, float] | None:
    """Return the gamma that slycot names and the norm of the loop its controller closes."""
    try:
        import control
        import slycot  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    s = plant.system
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            k, _, gamma, _ = control.hinfsyn(
                control.ss(s.a, s.b, s.c, s.d), plant.measurements, plant.controls
            )
        except (ValueError, ArithmeticError, control.ControlArgument) as error:
            print("slycot:", error)
            return None
    a, b, c, d = (np.atleast_2d(x) for x in (k.A, k.B, k.C, k.D))
    loop = lower_lft(s, StateSpace(a, b, c, d))
    return float(gamma), float(hinf_norm(loop)[0])


def independent_norms(s: StateSpace) -> tuple[float, float]:
    f = [np.asfortranarray(x) for x in (s.a, np.eye(s.order), s.b, s.c, s.d)]
    gain, _, info = ctrlsys.ab13dd(
        "C", "I", "N", "D", s.order, *s.d.shape[::-1], np.array([0.0, 1.0]), *f, 1e-12
    )
    assert info == 0
    # coarse over ten decades, then fine around the peak
    omega = np.logspace(-6, 6, 20001)
    swept = np.linalg.svd(s.response(omega), compute_uv=False)[:, 0]
    best = omega[int(np.argmax(swept))]
    fine = np.linalg.svd(s.response(best * np.linspace(0.999, 1.001, 4001)), compute_uv=False)[:, 0]
    ends = np.linalg.svd(s.response(np.array([0.0])), compute_uv=False)[0, 0], np.linalg.norm(s.d, 2)
    return float(gain[0] / gain[1]), float(max(swept.max(), fine.max(), *ends))


def main() -> None:
    rows = []
    for name, plant in plants().items():
        found = synthesize(plant, tolerance=1e-5)
        slicot, swept = independent_norms(found.closed_loop)
        row = {
            "plant": name,
            "optimum": found.optimum,
            "norm": found.norm,
            "norm_by_ab13dd": slicot,
            "norm_by_sweep": swept,
            "optimum_by_lmi": lmi_optimum(plant),
        }
        other = slycot_optimum(plant)
        if other is not None:
            gamma, reached = other
            row |= {"gamma_of_slycot": gamma, "norm_of_its_loop": reached if np.isfinite(reached) else None}
        rows.append(row)
        print(row, flush=True)

    def apart(key: str) -> float | None:
        given = [abs(r[key] / r["optimum"] - 1.0) for r in rows if r.get(key) is not None]
        return float(max(given)) if given else None

    kept = [r for r in rows if r.get("gamma_of_slycot") is not None]
    false = [r for r in kept if (r["norm_of_its_loop"] or 0.0) > 1.01 * r["gamma_of_slycot"]]
    result = {
        "environment": environment("numpy", "scipy", "ctrlsys", "slycot", "control", "cvxpy", "clarabel"),
        "largest_difference": {
            "optimum, to the LMI": apart("optimum_by_lmi"),
            "norm, to ab13dd": max(abs(r["norm_by_ab13dd"] / r["norm"] - 1.0) for r in rows),
            "norm, to the sweep": max(abs(r["norm_by_sweep"] / r["norm"] - 1.0) for r in rows),
            "optimum, to slycot where its controller keeps its gamma or sits at the optimum": max(
                (abs(r["gamma_of_slycot"] / r["optimum"] - 1.0) for r in kept if r not in false), default=None
            ),
        },
        "slycot_names_a_gamma_that_its_controller_misses": [r["plant"] for r in false],
        "note": "null norm_of_its_loop: slycot's loop, at the very optimum, is numerically not stable; "
        "null optimum_by_lmi: clarabel did not solve it to its tolerance",
        "plants": rows,
    }
    print(write_result("hinf_optimum", result))
    print(result["largest_difference"], [r["plant"] for r in false])


if __name__ == "__main__":
    main()
