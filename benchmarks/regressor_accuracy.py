"""Are the regressors right, on spacecraft of all kinds, and how long do they take?

    python benchmarks/regressor_accuracy.py [--states 50] [--rounds 51]

Y theta against Pinocchio's direct quantities, MuJoCo and Drake at random states, with gravity; microseconds
per sample, and against FIGAROH's regressor of the same robot on a fixed base with the same samples.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from _common import ROOT, environment, interleaved, relative_error, spread, write_result
from _mjcf import UnsupportedError, mujoco_twin

from smsid.description.files import load_description
from smsid.description.robots import robot_urdf
from smsid.description.schema import Arm, Description, Mount
from smsid.errors import SmsidError
from smsid.model.build import build_model
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

SEED = 20
GRAVITY = (0.3, -0.2, -9.81)  # [m/s^2]
MOUNT = Mount(frame="left_base", xyz=(0.1, -0.2, 0.3), rpy=(0.3, -0.4, 0.5))
TIMED_STATES = 200
URDF = ROOT / "urdf"
SPACECRAFT = ("paper_sms", "two_arm_sms")
ROBOTS = (
    *("ur3", "ur5", "ur10", "panda", "kinova", "xarm7", "z1", "so100", "so101", "talos_left_arm", "tiago"),
    *("tiago_pro", "baxter", "pr2", "icub", "simple_humanoid", "solo12", "anymal_c_simple/anymal", "b1-z1"),
    *("centauro", "allegro_right_hand", "romeo", "hyq", "g1_29dof_rev_1_0", "double_pendulum_continuous"),
    *("hextilt_flying_arm_5", "talos_reduced"),
)
Quantity = tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]  # momentum (q, v) and torque (q, v, a)


def describe(name: str) -> Description:
    """Return a spacecraft of the repository, or the bus with a robot of example-robot-data."""
    if name in SPACECRAFT:
        return load_description(URDF / f"{name}.toml").model_copy(update={"gravity": GRAVITY})
    arm = Arm(name="arm", robot=name, mount=MOUNT)
    return Description(name=name, urdf="bus.urdf", folder=URDF, arm=(arm,), gravity=GRAVITY, meshes="ignored")


def random_states(model: pin.Model, n: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return q (n, nq), v (n, nv), a (n, nv): joints, rates and accelerations of order 1."""
    neutral = pin.neutral(model)
    q = np.array([pin.integrate(model, neutral, rng.normal(size=model.nv)) for _ in range(n)])
    return q, rng.normal(size=(n, model.nv)), rng.normal(size=(n, model.nv))


def pinocchio_direct(model: SpacecraftModel) -> Quantity:
    """Centroidal momentum moved to the bus origin, and rnea."""
    data = model.pin.createData()

    def momentum(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        found = pin.computeCentroidalMomentum(model.pin, data, q, v)
        return _to_bus(q, found.linear, found.angular, data.com[0])

    return momentum, lambda q, v, a: pin.rnea(model.pin, data, q, v, a)


def mujoco_direct(model: SpacecraftModel) -> Quantity:
    """mj_subtreeVel and mj_inverse."""
    import mujoco

    twin = mujoco_twin(model.pin)
    m, d = twin.model, twin.data

    def set_state(q: np.ndarray, v: np.ndarray) -> None:
        d.qpos[:], d.qvel[:] = twin.position(q), twin.velocity(q, v)
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)

    def momentum(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        set_state(q, v)
        mujoco.mj_subtreeVel(m, d)
        linear = m.body_subtreemass[1] * d.subtree_linvel[1]
        return _to_bus(q, linear, d.subtree_angmom[1], d.subtree_com[1])

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        set_state(q, v)
        d.qacc[:] = twin.acceleration(q, v, a)
        mujoco.mj_inverse(m, d)
        return twin.force(q, d.qfrc_inverse.copy())

    return momentum, torque


def drake_direct(model: SpacecraftModel) -> Quantity:
    """CalcSpatialMomentumInWorldAboutPoint and CalcInverseDynamics, from the URDFs."""
    if model.description.name in SPACECRAFT:
        raise UnsupportedError("Wheels, slosh and panel modes are not in the URDF that Drake would read.")
    from _drake import DrakeTwin

    placement = pin.SE3(pin.rpy.rpyToMatrix(*MOUNT.rpy), np.asarray(MOUNT.xyz))
    robot, _ = robot_urdf(model.description.name)
    twin = DrakeTwin(model.pin, URDF / "bus.urdf", robot, str(MOUNT.frame), placement)
    return twin.momentum, twin.torque


def _to_bus(q: np.ndarray, linear: np.ndarray, angular: np.ndarray, centre: np.ndarray) -> np.ndarray:
    rotation = pin.Quaternion(*q[[6, 3, 4, 5]]).toRotationMatrix()
    about = angular + np.cross(centre - q[:3], linear)
    return np.concatenate([rotation.T @ linear, rotation.T @ about])


PEERS = {"pinocchio": pinocchio_direct, "mujoco": mujoco_direct, "drake": drake_direct}


def accuracy(model: SpacecraftModel, states: int) -> dict[str, Any]:
    """Return worst relative errors of Y theta against every peer, or why there is none."""
    q, v, a = random_states(model.pin, states, np.random.default_rng(SEED))
    regressor = Regressor(model)
    theta = regressor.parameters
    momentum, torque = regressor.momentum(q, v) @ theta, regressor.torque(q, v, a) @ theta
    general = regressor.generalised_momentum(q, v) @ theta
    direct = [_symmetric(pin.crba(model.pin, model.data, x)) @ y for x, y in zip(q, v, strict=True)]
    result: dict[str, Any] = {"crba": {"generalised_momentum": _worst(general, np.array(direct))}}
    for name, peer in PEERS.items():
        try:
            find_momentum, find_torque = peer(model)
        except (UnsupportedError, RuntimeError, ValueError, ImportError) as error:
            result[name] = {"not_compared": _brief(error)}
            continue
        expected = np.array([find_momentum(x, y) for x, y in zip(q, v, strict=True)])
        forces = np.array([find_torque(x, y, z) for x, y, z in zip(q, v, a, strict=True)])
        result[name] = {
            "linear_momentum": _worst(momentum[:, :3], expected[:, :3]),
            "angular_momentum": _worst(momentum[:, 3:], expected[:, 3:]),
            "torque": _worst(torque, forces),
        }
    return result


def timing(model: SpacecraftModel, rounds: int) -> dict[str, Any]:
    """Return microseconds per sample of both regressors."""
    q, v, a = random_states(model.pin, TIMED_STATES, np.random.default_rng(SEED))
    regressor = Regressor(model)
    taken = interleaved(
        {"momentum": lambda: regressor.momentum(q, v), "torque": lambda: regressor.torque(q, v, a)}, rounds
    )
    return {f"{name}_us": spread(1e6 * t / TIMED_STATES) for name, t in taken.items()}


def against_figaroh(name: str, rounds: int) -> dict[str, Any]:
    """Return times of both torque regressors of the robot alone, base fixed, and how they differ."""
    from figaroh.tools.regressor import build_regressor_basic

    path, _ = robot_urdf(name)
    model = build_model(
        Description(name=name, urdf=str(path), root="fixed", gravity=GRAVITY, meshes="ignored")
    )
    q, v, a = random_states(model.pin, TIMED_STATES, np.random.default_rng(SEED))
    robot = pin.RobotWrapper(model.pin)
    options = {"is_joint_torques": True, "act_idxv": []}
    regressor = Regressor(model)
    theirs = build_regressor_basic(robot, q, v, a, options)
    ours = regressor.torque(q, v, a)
    stacked = theirs.reshape(model.nv, TIMED_STATES, -1).transpose(1, 0, 2)
    taken = interleaved(
        {
            "smsid": lambda: regressor.torque(q, v, a),
            "figaroh": lambda: build_regressor_basic(robot, q, v, a, options),
        },
        rounds,
    )
    return {
        "degrees_of_freedom": model.nv,
        "largest_difference": relative_error(stacked[..., : ours.shape[2]], ours),
        "smsid_us": spread(1e6 * taken["smsid"] / TIMED_STATES),
        "figaroh_us": spread(1e6 * taken["figaroh"] / TIMED_STATES),
        "figaroh_over_smsid": spread(taken["figaroh"] / taken["smsid"]),
    }


def _worst(found: np.ndarray, expected: np.ndarray) -> float:
    worst = max(relative_error(f, e) for f, e in zip(found, expected, strict=True))
    return float(f"{worst:.2e}")


def _symmetric(upper: np.ndarray) -> np.ndarray:
    return np.triu(upper) + np.triu(upper, 1).T


def _brief(error: Exception) -> str:
    folder = str(Path(robot_urdf("ur5")[0]).parents[2])
    return str(error).replace(folder, "<example-robot-data>").strip().splitlines()[0][:300]


def main() -> None:
    """Measure every spacecraft and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=51)
    options = parser.parse_args()
    systems, refused = {}, {}
    for name in (*SPACECRAFT, *ROBOTS):
        try:
            model = build_model(describe(name))
        except SmsidError as error:
            refused[name] = _brief(error)
            print(f"{name:28s} refused: {refused[name]}")
            continue
        row = {
            "degrees_of_freedom": model.nv,
            "bodies": model.pin.njoints - 1,
            "worst_relative_error": accuracy(model, options.states),
            "time": timing(model, options.rounds),
        }
        if name not in SPACECRAFT:
            row["figaroh_fixed_base"] = against_figaroh(name, options.rounds)
        systems[name] = row
        errors = {
            k: max(v.values()) if "not_compared" not in v else v["not_compared"]
            for k, v in row["worst_relative_error"].items()
        }
        figaroh = row.get("figaroh_fixed_base", {}).get("figaroh_over_smsid", {}).get("median")
        print(f"{name:28s}{model.nv:3d} {errors} figaroh/smsid {figaroh}", flush=True)
    found = [row["worst_relative_error"] for row in systems.values()]
    compared = {peer: [r[peer] for r in found if "torque" in r[peer]] for peer in PEERS}
    alone = [row["figaroh_fixed_base"] for row in systems.values() if "figaroh_fixed_base" in row]
    ratios = [row["figaroh_over_smsid"]["median"] for row in alone]
    write_result(
        "regressor_accuracy",
        {
            "what": "worst relative error of Y theta, largest deviation over largest magnitude in each "
            "state's vector; microseconds per sample, medians and quartiles of interleaved rounds",
            "states": options.states,
            "rounds": options.rounds,
            "samples_timed": TIMED_STATES,
            "seed": SEED,
            "gravity": GRAVITY,
            "notes": [
                "robots are mounted on the 2000 kg bus, turned, shifted; mimic joints move on their own",
                "MuJoCo's model is converted from the Pinocchio model, Drake reads the URDFs itself",
                "FIGAROH: build_regressor_basic on the same Pinocchio model, base fixed, since its "
                "joint-torque regressor has 10 columns per velocity, not per body: no free-flyer",
                "both call Pinocchio's computeJointTorqueRegressor; the ratio is what is around it",
                "refused: smsid refuses to build the spacecraft; such robots are not measured",
            ],
            "environment": environment("pin", "mujoco", "drake", "figaroh", "numpy", "example-robot-data"),
            "summary": {
                peer: {
                    "systems": len(rows),
                    **{k: max(r[k] for r in rows) for k in ("linear_momentum", "angular_momentum", "torque")},
                }
                for peer, rows in compared.items()
            }
            | {"figaroh_over_smsid_medians": {"smallest": min(ratios), "largest": max(ratios)}},
            "systems": systems,
            "refused": refused,
        },
    )


if __name__ == "__main__":
    main()
