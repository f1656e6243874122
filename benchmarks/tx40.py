"""Staubli TX40: held-out torques and time of smsid and FIGAROH on the same data and split.

Both train on the first two thirds of the record and predict the torques of the last third; both are asked for
the published cut-off of 100 Hz. FIGAROH is judged on motion and torque low-passed there, smsid on its own
smoothed motion and the mean torque about each of its instants. FIGAROH runs as its own example for this arm
does (decimation by 10, weighted least squares), once without and once with the wrist's coupling columns that
its example defines. Neither its report nor plots are timed. It does less in its time: cut-off and motion are
not found from the data, friction's sign has no width, clocks are taken to agree, and its standard deviations
are those of white errors. On a busy machine only the ratio of times says something: the load is told. The
diagnosis starts from the bare URDF and has to name friction and coupling by itself. Needs SMSID_DATA, or the
extra `data` to download.

    python benchmarks/tx40.py
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _common import environment, interleaved, spread, write_result

from smsid._statistics import NORMAL95
from smsid.arm import (
    ArmIdentification,
    ArmMotion,
    identify_arm,
    joint_motion,
    torque_errors,
    with_joint_effects,
)
from smsid.datasets import tx40
from smsid.description import Description
from smsid.diagnose import diagnose
from smsid.effects import MotorCoupling
from smsid.effects.gear import gear_matrix
from smsid.recording import Recording

CUTOFF = 100.0  # [Hz], published with the data
CUTOFFS = (20.0, 25.0, 30.0, 40.0, 50.0, 75.0, 100.0, 150.0, 200.0)  # [Hz] of the diagnosis
SPLIT = 6.0  # [s] of 9
ROUNDS = 7
DOCUMENTED = {
    "viscous": (8.05, 5.53, 1.97, 1.11, 1.86, 0.65),
    "coulomb": (7.14, 8.26, 6.34, 2.48, 3.03, 0.282),
    "wrist.viscous": 0.616,
    "wrist.coulomb": 1.95,
}


def descriptions(bare: Description, joints: tuple[str, ...]) -> dict[str, Description]:
    friction = with_joint_effects(bare, joints, "joint_friction", "motor_inertia", "torque_offset")
    wrist = MotorCoupling(name="wrist", joints=("joint_5", "joint_6"))
    return {
        "rigid": bare,
        "friction, motor inertia, offsets": friction,
        "and wrist coupling": friction.with_effects(wrist),
    }


def at_joints(description: Description, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles and torques (N, 6) that FIGAROH is given: its example converts them the same way."""
    joints = recording.labels["joint"]
    gears = [e for e in description.effect if e.kind == "gear"]
    matrix, _ = gear_matrix(gears, joints)  # type: ignore[arg-type]
    zero = {e.joint: e.angle for e in description.effect if e.kind == "joint_offset"}  # type: ignore[attr-defined]
    q = np.linalg.solve(matrix, recording["motor.joint_position"].T).T + [zero.get(j, 0.0) for j in joints]
    return q, recording["motor.joint_torque"] @ matrix


def figaroh_config(folder: Path) -> Path:
    import yaml

    joints = [f"joint_{k}" for k in range(1, 7)]
    zeros = [0.0] * 6
    mechanics = {
        "reduction_ratios": [32.0, 32.0, 45.0, -48.0, 45.0, 32.0],
        "friction_coefficients": {"viscous": zeros, "static": zeros},
        "actuator_inertias": zeros,
        "joint_offsets": zeros,
    }
    components = ("friction", "joint_offset", "actuator_inertia", "static_regressor", "inertia_regressor")
    config = {
        "robot": {
            "name": "tx40",
            "properties": {"joints": {"active_joints": joints}, "mechanics": mechanics},
        },
        "tasks": {
            "identification": {
                "enabled": True,
                "problem": {
                    "use_joint_torques": True,
                    "wls": True,
                    "model_components": dict.fromkeys(components, True),
                },
                "signal_processing": {
                    "sampling_frequency": 5000.0,
                    "cutoff_frequency": CUTOFF,
                    "filter_type": "butterworth",
                    "filter_order": 4,
                },
            }
        },
    }
    path = folder / "tx40.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


def figaroh_runner(
    urdf: Path, folder: Path, q: np.ndarray, torque: np.ndarray, *, wrist: bool
) -> tuple[Callable[[], Any], Callable[[Any, ArmMotion], np.ndarray]]:
    """Return FIGAROH's run (from joint angles and torques to base parameters) and its prediction."""
    from figaroh.identification.base_identification import BaseIdentification
    from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced
    from figaroh.tools.robot import load_robot

    bare = folder / "bare.urdf"  # its loader asks for the meshes
    bare.write_text(re.sub(r"<(visual|collision)>.*?</\1>", "", urdf.read_text(), flags=re.S))
    config = figaroh_config(folder)
    border = 20  # five times the order of the filter, as its example cuts

    def coupling(v: np.ndarray, a: np.ndarray) -> np.ndarray:
        both = np.sign(v[:, 4] + v[:, 5])
        fifth, sixth = np.column_stack([a[:, 5], v[:, 5], both]), np.column_stack([a[:, 4], v[:, 4], both])
        return np.vstack([np.zeros((4 * len(v), 3)), fifth, sixth])

    class Arm(BaseIdentification):
        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
            times = (np.arange(len(q)) / 5000.0).reshape(-1, 1)
            derived = {"velocities": None, "accelerations": None}
            return {"timestamps": times, "positions": q, "torques": torque, **derived}

        def process_torque_data(self, **_: Any) -> np.ndarray:
            for key in ("timestamps", "positions", "velocities", "accelerations"):
                self.processed_data[key] = self.processed_data[key][border:-border]
            return self.raw_data["torques"][border:-border]

        def initialize_standard_parameters(self) -> None:
            super().initialize_standard_parameters()
            if wrist:
                self.standard_parameter.update({"Iam6": 0.0, "fvm6": 0.0, "fsm6": 0.0})
                extra = coupling(self.processed_data["velocities"], self.processed_data["accelerations"])
                self.dynamic_regressor = np.hstack([self.dynamic_regressor, extra])

        def _store_results(self, identif_results: Any) -> None:
            self.result = {}  # no provenance, validation and archive: the estimate alone is timed

        def print_quality_report(self) -> None:
            pass

    def run() -> Any:
        robot = load_robot(str(bare), package_dirs=str(folder))
        found = Arm(robot, str(config))
        ids = [found.model.getJointId(f"joint_{k}") for k in range(1, 7)]
        members = [found.model.joints[i] for i in ids]
        found.identif_config |= {
            "act_Jid": ids,
            "act_J": members,
            "act_idxq": [j.idx_q for j in members],
            "act_idxv": [j.idx_v for j in members],
            "idx_act_joints": [i - 1 for i in ids],
        }
        filters = {"nbutter": 4, "f_butter": CUTOFF, "f_sample": 5000.0}
        found.filter_config = {"differentiation_method": "gradient", "filter_params": filters}
        with contextlib.redirect_stdout(io.StringIO()):
            found.initialize()
            found.solve(decimate=True, plotting=False, wls=True)
        return found

    def predict(found: Any, motion: ArmMotion) -> np.ndarray:
        rows = build_regressor_basic(found.robot, motion.q, motion.v, motion.a, found.identif_config)
        if wrist:
            rows = np.hstack([rows, coupling(motion.v, motion.a)])
        rows = build_regressor_reduced(rows, found._idx_eliminated)[:, found._base_indices]
        return (rows @ found.phi_base).reshape(6, -1).T

    return run, predict


def compared(found: ArmIdentification) -> dict[str, Any]:
    """Identified friction beside the published; theirs of joints 5 and 6 includes the coupled motor's
    share.
    """
    rows: dict[str, Any] = {}
    for field in ("viscous", "coulomb"):
        shared = found.estimate[f"wrist.{field}"]
        for k, published in enumerate(DOCUMENTED[field], start=1):  # type: ignore[arg-type]
            own = found.estimate[f"friction_joint_{k}.{field}"]
            total = own.value + (shared.value if k >= 5 and field == "viscous" else 0.0)
            rows[f"joint_{k}.{field}"] = {
                "value": round(total, 4),
                "sigma": round(own.sigma, 4),
                "published": published,
                "ratio": round(total / published, 3),
            }
        rows[f"wrist.{field}"] = {
            "value": round(shared.value, 4),
            "sigma": round(shared.sigma, 4),
            "published": DOCUMENTED[f"wrist.{field}"],
            "ratio": round(shared.value / DOCUMENTED[f"wrist.{field}"], 3),  # type: ignore[operator]
        }
    return rows


def halves(full: Description, log: Recording) -> list[int]:
    """Return how many parameters of two halves differ by more than their combined 95 %, and of how many."""
    end = float(log.time()[-1])
    ends = (
        log.window(0.0, end / 2).with_role("estimation"),
        log.window(end / 2, end).with_role("estimation"),
    )
    one, two = (identify_arm(full, half).estimate for half in ends)
    z = [(p.value - two[p.name].value) / np.hypot(p.sigma, two[p.name].sigma) for p in one.parameters]
    return [int(np.sum(np.abs(z) > NORMAL95)), int(np.sum(np.isfinite(z)))]


def diagnosed(bare: Description, train: Recording, held: Recording) -> dict[str, Any]:
    """What the diagnosis names from the bare URDF, beside what is published with the data."""
    found = diagnose(bare, [train], validation=[held]).diagnosis
    values = {p.name.partition("_")[2]: (p.value, p.sigma) for c in found.causes for p in c.parameters}
    none = (0.0, 0.0)
    wrist = values.get("coupling_joint_5_joint_6.viscous", none)
    viscous = {}
    for k, published in enumerate(DOCUMENTED["viscous"], start=1):  # type: ignore[arg-type]
        own = values.get(f"friction_joint_{k}.viscous", none)
        total = own[0] + (wrist[0] if k >= 5 else 0.0)
        viscous[f"joint_{k}"] = {
            "value": round(total, 4),
            "sigma": round(float(np.hypot(own[1], wrist[1] if k >= 5 else 0.0)), 4),
            "published": published,
            "ratio": round(total / published, 3),
        }
    coupled = values.get("coupling_joint_5_joint_6.coulomb", none)
    for key, (value, sigma) in {"wrist": wrist, "wrist.coulomb": coupled}.items():
        published = DOCUMENTED[key if "." in key else f"{key}.viscous"]
        viscous[key] = {
            "value": round(value, 4),
            "sigma": round(sigma, 4),
            "published": published,
            "ratio": round(value / published, 3),  # type: ignore[operator]
        }
    document = json.loads(found.to_json())
    assert found.gain is not None
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "causes": [
            {k: c[k] for k in ("effect", "location", "family", "shape", "parameters", "evidence")}
            for c in document["causes"]
        ],
        "viscous": viscous,
        "remaining": document["remaining"],
        "held_out_relative_torque_rmse": {
            name: round(next(getattr(c, name) for c in found.gain.channels if "relative" in c.channel), 4)
            for name in ("given", "extended")
        },
        "seconds_of_cpu": round(sum(found.timing.values()), 1),
        "notes": list(found.notes),
    }


def by_cutoff(bare: Description, train: Recording, held: Recording) -> dict[str, Any]:
    """What the diagnosis finds and predicts where its motion is low-passed elsewhere than by default [Hz]."""
    out: dict[str, Any] = {}
    for cutoff in CUTOFFS:
        found = diagnose(bare, [train], validation=[held], cutoff=cutoff).diagnosis
        assert found.gain is not None, found.sentence
        relative = next(c for c in found.gain.channels if "relative" in c.channel)
        out[f"{cutoff:g}"] = {
            "causes": len(found.causes),
            "coupling": any(c.effect == "motor_coupling" for c in found.causes),
            "held_out_relative_torque_rmse": round(relative.extended, 4),
        }
    return out


def main() -> None:
    bare, log = tx40()
    joints = log.labels["joint"]
    times = log.time()
    train = log.window(0.0, float(times[times < SPLIT][-1])).with_role("estimation")
    held = log.window(SPLIT, float(times[-1])).with_role("validation")
    models = descriptions(bare, joints)
    full = models["and wrist coupling"]
    with tempfile.TemporaryDirectory() as name:
        q, torque = at_joints(bare, train)
        urdf = bare.folder / bare.urdf
        plain, plain_predict = figaroh_runner(urdf, Path(name), q, torque, wrist=False)
        wrist, wrist_predict = figaroh_runner(urdf, Path(name), q, torque, wrist=True)
        seconds = interleaved(
            {
                "smsid": lambda: identify_arm(full, train, cutoff=CUTOFF),
                "figaroh": plain,
                "figaroh with wrist columns": wrist,
            },
            ROUNDS,
        )
        found = {label: identify_arm(d, train, cutoff=CUTOFF) for label, d in models.items()}
        last = found["and wrist coupling"]
        motion = joint_motion(last.model, held, CUTOFF)
        errors = {f"smsid, {label}": f.judge(held) for label, f in found.items()}
        for label, run, predict in (
            ("figaroh", plain, plain_predict),
            ("figaroh with wrist columns", wrist, wrist_predict),
        ):
            errors[label] = torque_errors(last.model, predict(run(), motion), motion.torque)
    ratio = {k: round(float(np.median(s / seconds["smsid"])), 1) for k, s in seconds.items() if k != "smsid"}
    result = {
        "claim": "better held-out torques than FIGAROH, and friction as published",
        "command": "python benchmarks/tx40.py",
        "environment": environment("pin", "numpy", "scipy", "figaroh"),
        "data": {"set": "staubli_tx40", "train": f"0 to {SPLIT:g} s", "judged": f"{SPLIT:g} to 9 s"},
        "held_out_relative_torque_rmse": {k: round(e.relative, 4) for k, e in errors.items()},
        "by_joint": {k: {j: round(x, 4) for j, x in e.by_joint.items()} for k, e in errors.items()},
        "rmse_by_joint_Nm": {k: {j: round(x, 3) for j, x in e.rmse.items()} for k, e in errors.items()},
        "seconds": {k: spread(s) for k, s in seconds.items()},
        "times_as_long_as_smsid": ratio,
        "load_average": round(os.getloadavg()[0], 1),
        "seconds_of_smsid_by_stage": {k: round(x, 2) for k, x in last.estimate.timing.items()},
        "friction": compared(last),
        "halves_beyond_1.96_sigma": halves(full, log),
        "diagnosis": diagnosed(bare, train, held),
        "diagnosis_by_cutoff": by_cutoff(bare, train, held),
        "notes": list(last.estimate.notes),
    }
    print(write_result("tx40", result))
    for key in ("held_out_relative_torque_rmse", "times_as_long_as_smsid", "friction"):
        print(key, result[key])


if __name__ == "__main__":
    main()
