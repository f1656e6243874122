"""Cost against degrees of freedom: ``python benchmarks/degrees_of_freedom.py``.

A rigid satellite (6), the paper's craft (18) and that with seven tanks more (39). CPU time of a step of fifth
order under inputs held at 100 Hz, and of a sample of the filter over all states at 100 Hz without parameters,
medians of rounds taken in turn; and the exponent of each between neighbours, which should be 3 at most.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from _common import environment, spread, write_result
from _exp2 import URDF

from smsid.description import load_description
from smsid.description.schema import Description
from smsid.kernel.jit import SWITCH
from smsid.model import build_model
from smsid.sensing import observe
from smsid.simulate import Inputs, Sampled, Trajectory, simulate, truth_of
from smsid.tracking import track_recordings

SECONDS, RATE, ROUNDS = 20.0, 100.0, 5
BUS = """<robot name="bus"><link name="base"><inertial><mass value="1800"/>
<inertia ixx="900" iyy="1200" izz="1100" ixy="10" ixz="-20" iyz="15"/></inertial></link></robot>"""


def crafts(folder: str) -> list[Description]:
    """Return the crafts, all sensors at the rate of the inputs."""
    paper = load_description(URDF / "paper_sms.toml")
    sensors = tuple(s.model_copy(update={"rate": RATE}) for s in paper.effective_sensors())
    paper = paper.with_sensors(*sensors)
    with open(f"{folder}/bus.urdf", "w", encoding="utf-8") as file:
        file.write(BUS)
    with open(f"{folder}/bus.toml", "w", encoding="utf-8") as file:
        file.write('schema = 1\nname = "bus"\nurdf = "bus.urdf"\n')
    own = tuple(s for s in sensors if s.kind in ("pose", "imu"))
    satellite = load_description(f"{folder}/bus.toml").model_copy(update={"sensor": own})
    tank = paper.get_effect("tank")
    assert tank is not None
    more = [
        tank.model_copy(update={"name": f"tank{k}", "position": (0.1 * k, 0.2, -0.05 * k)}) for k in range(7)
    ]
    return [satellite, paper, paper.with_effects(*more)]


def flown(d: Description) -> Trajectory:
    """Return a flight under torques and forces that are drawn anew at every sample."""
    model, rng, times = build_model(d), np.random.default_rng(3), np.arange(round(SECONDS * RATE) + 1) / RATE
    drawn = {"force": 3}
    drawn |= {"wheel_torque": len(model.wheels)} if len(model.wheels) else {"torque": 3}
    drawn |= {"joint_torque": len(model.arm_joints)} if len(model.arm_joints) else {}
    given: dict[str, Any] = {
        name: Sampled.from_samples(times, 0.1 * rng.standard_normal((len(times), n)), degree=0)
        for name, n in drawn.items()
    }
    return simulate(model, Inputs(**given), SECONDS)


def measured(described: list[Description]) -> list[dict[str, Any]]:
    """Return CPU microseconds of a step and of a sample by craft."""
    actions: list[tuple[Callable[[], object], int]] = []
    for d in described:
        motion, sensors = flown(d), d.effective_sensors()
        truth = truth_of(motion, sensors)
        exact = [c for c in truth(np.zeros(1)) if c.startswith("command.")]
        recording = observe(
            truth, sensors, start=0.0, stop=SECONDS, rng=np.random.default_rng(1), exact=exact, rate=RATE
        )

        track = partial(track_recordings, d, [recording], follow={}, warm_up=0.0)
        actions += [(partial(flown, d), motion.steps), (track, len(recording.time()))]
    taken = np.empty((ROUNDS + 1, len(actions)))  # the first compiles, or loads what is compiled
    for row in taken:
        for k, (action, count) in enumerate(actions):
            begin = time.process_time()
            action()
            row[k] = 1e6 * (time.process_time() - begin) / count
    return [
        {"degrees of freedom": build_model(d).nv, "step [us]": spread(own[0]), "sample [us]": spread(own[1])}
        for d, own in zip(described, taken[1:].T.reshape(-1, 2, ROUNDS), strict=True)
    ]


def main() -> None:
    """Measure, tell and write."""
    os.environ.setdefault(SWITCH, "1")
    with tempfile.TemporaryDirectory() as folder:
        rows = measured(crafts(folder))
    for before, row in pairwise(rows):
        grown = row["degrees of freedom"] / before["degrees of freedom"]
        for what in ("step [us]", "sample [us]"):
            row[f"exponent, {what}"] = round(
                float(np.log(row[what]["median"] / before[what]["median"]) / np.log(grown)), 2
            )
    for row in rows:
        print(row)
    write_result("degrees_of_freedom", {"environment": environment("pin", "numpy", "numba"), "rows": rows})


if __name__ == "__main__":
    main()
