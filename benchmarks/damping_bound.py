"""How well the slosh damping b_s can be known at all: the Cramer-Rao bound by sensors and length of record.

    python benchmarks/damping_bound.py

The thrust (48) along x, of 40 s within 120 s; longer records watch the slosh ring on, attitude held. Noise
of preset `reference`. Sensors: the accelerometer (IMU) alone, with the pose sensor, and all of them. No
estimator takes part; that smsid's reaches the bound is `likelihood.py`, that a designed force does better
`experiment_design.py`.
"""

from __future__ import annotations

from _common import environment, write_result
from rich.console import Console

from smsid.description import load_description
from smsid.experiments import named_experiment
from smsid.likelihood import fisher_information
from smsid.model import build_model
from smsid.paths import urdf_folder

SENSORS = {"imu": ("imu",), "imu and pose": ("imu", "pose"), "all": None}
LENGTHS = (80.0, 120.0, 240.0, 480.0, 960.0)  # [s]
NAME = "tank.damping.x"


def main() -> None:
    """Find the bounds."""
    console = Console()
    described = load_description(urdf_folder() / "paper_sms.toml")
    plan = named_experiment("exp1_x", build_model(described))
    table: dict[str, dict[str, float]] = {}
    for sensors, names in SENSORS.items():
        chosen = [s for s in described.sensor if names is None or s.name in names]
        for length in LENGTHS:
            flown = plan.model_copy(update={"duration": length})
            bound = fisher_information(described, flown, chosen)
            combination = next(c for c in bound.combinations if c.name == NAME)
            relative = bound.sigma[NAME] / abs(combination.value)
            table.setdefault(sensors, {})[f"{length:g} s"] = float(relative)
            console.print(f"{sensors}, {length:g} s: {100.0 * relative:.2f} %")
    write_result(
        "damping_bound",
        {
            "environment": environment("smsid", "pin", "numpy", "scipy"),
            "thrust": f"{plan.name} (48), planned for {plan.duration:g} s",
            "relative standard deviation of b_s, x": table,
        },
    )


if __name__ == "__main__":
    main()
