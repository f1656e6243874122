"""A cable across a joint, as an effect of one's own: it simulates, loads, saves, and is looked for.

The arm of the paper's spacecraft coasts with and without it; `smsid diagnose` tries it at every joint, as it
says by ``candidates``. A package offers its effects to others through the entry point ``smsid.effects``.

python examples/08_add_an_effect.py [folder]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import matplotlib
import numpy as np

from smsid.description import load_description
from smsid.diagnose import Candidate
from smsid.effects import JointEffect, Starting, physical, register
from smsid.model import build_model
from smsid.simulate import Inputs, simulate

matplotlib.use("Agg")
from matplotlib import pyplot as plt

URDF = Path(__file__).resolve().parent.parent / "urdf"


@register
class CableDrag(JointEffect, Starting):
    """A cable that pulls a joint back to ``rest``, the more the further it is bent."""

    summary = "a cable across a joint"
    family = "friction"
    aliases = ("joint_friction",)
    strength = ("pull",)
    kind: Literal["cable_drag"] = "cable_drag"
    pull: float = physical("N m/rad^3", lower=0.0, default=0.0, description="torque per cube of the bend")
    rest: float = physical("rad", default=0.0, description="angle at which it does not pull")

    def attach(self, assembly):
        joint, pull, rest = assembly.joint(self.joint), self.pull, self.rest

        def force(t, q, v, tau):
            tau[joint.idx_v] -= pull * (q[joint.idx_q] - rest) ** 3

        assembly.add_force(force)

    @classmethod
    def candidates(cls, model):
        for joint in model.arm_joints.names:
            effect = cls(name=f"cable_{joint}", joint=joint)
            # one step of the parameter is its typical size
            yield Candidate(
                "cable_drag", joint, cls.family, "cable", effect, (f"{effect.name}.pull",), (1e-2,)
            )


def main(folder: Path) -> None:
    """Fly with and without the cable, and draw the joint's angle."""
    plain = load_description(URDF / "paper_sms.toml")
    cable = CableDrag(name="cable", joint="joint2", pull=4.0, start=5.0)
    print("parameters:", ", ".join(f"{p.name} [{p.unit}]" for p in cable.parameters()))
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    times = np.linspace(0.0, 20.0, 201)
    for name, description in (("without", plain), ("with the cable", plain.with_effects(cable))):
        model = build_model(description)
        angles = model.joint_angles(simulate(model, Inputs(), 20.0).states(times).q)[:, 1]
        print(f"{name}: {angles[40]:.4f} rad at 4 s, {angles[-1]:.4f} rad at 20 s")
        axes.plot(times, angles, label=name)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("angle of joint2 [rad]")
    axes.legend()
    figure.savefig(folder / "cable.png", dpi=120)
    print("looked for at", ", ".join(c.location for c in CableDrag.candidates(build_model(plain))))


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target)
