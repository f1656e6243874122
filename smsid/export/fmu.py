"""A spacecraft as an FMI 3.0 unit for co-simulation, through pythonfmu3 (extra ``fmu``)."""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from smsid._files import atomic_path
from smsid.description import Description, load_description
from smsid.errors import DescriptionError, require
from smsid.export.folder import export_folder
from smsid.export.linear_plant import LinearPlant, linear_plant
from smsid.identify.estimate import Estimate
from smsid.model import build_model
from smsid.simulate import Constant, Inputs, simulate

CRAFT = "craft"
"""Name of the description within the unit."""

SLAVE = '''"""Runs a spacecraft of smsid; made by `smsid export --fmu`."""
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64
from smsid.export.fmu import Stepper


class Spacecraft(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.modelName = "{name}"
        self.time = 0.0
        self.stepper = Stepper(self.resources)
        self._add("time", Fmi3Causality.independent)
        for name in self.stepper.inputs:
            setattr(self, name, 0.0)
            self._add(name, Fmi3Causality.input, start=0.0)
        for name, value in self.stepper.outputs().items():
            setattr(self, name, value)
            self._add(name, Fmi3Causality.output)

    def _add(self, name, causality, **more):
        kind = Fmi3Variability.continuous
        self.register_variable(Float64(name, causality=causality, variability=kind, **more))

    def do_step(self, current_time, step_size):
        self.stepper.step(current_time, step_size, [getattr(self, name) for name in self.stepper.inputs])
        for name, value in self.stepper.outputs().items():
            setattr(self, name, value)
        self.time = current_time + step_size
        return True
'''


def write_fmu(
    description: Description, path: str | os.PathLike[str], estimate: Estimate | None = None
) -> Path:
    """Write a spacecraft or arm, as described or identified, as an FMU; it appears whole or not at all.

    Inputs are force and torque on the bus and the torques of wheels and joints, held over a step; outputs the
    bus's position and quaternion, joint angles, modes and slosh, and all rates. It starts at home, at rest.
    The unit runs Python: whoever runs it needs smsid and pythonfmu3 in the Python it finds.

    Raises:
        MissingDependencyError: pythonfmu3 is not installed.
        DescriptionError: as `export_folder`.
    """
    require("pythonfmu3", "fmu")
    from pythonfmu3.builder import FmuBuilder

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        # The unit's files stand in one folder, whatever becomes of those it was made of.
        named = description.model_copy(update={"name": CRAFT, "meshes": "ignored"})
        known = None if estimate is None else replace(estimate, description=CRAFT)
        made = export_folder(named, place / "parts", known, mujoco=False)
        script = place / "spacecraft_fmu.py"
        script.write_text(SLAVE.format(name=description.name), encoding="utf-8")
        files = [made.folder / name for name in made.files if not name.endswith(".csv")]
        for file in files:  # the builder loads the script beside its resources
            shutil.copy(file, place / file.name)
        built = FmuBuilder.build_FMU(
            script, dest=place / "out", project_files={place / f.name for f in files}
        )
        with atomic_path(Path(path)) as temporary:
            shutil.copy(built, temporary)
    return Path(path)


class Stepper:
    """What runs within the unit: the spacecraft of a folder, stepped under inputs that are held."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        file = Path(folder) / f"{CRAFT}.toml"
        if not file.is_file():
            raise DescriptionError(f"'{folder}' holds no '{file.name}'.", advice="Export the FMU again.")
        self.model = build_model(load_description(file))
        plant: LinearPlant = linear_plant(self.model.description)
        self.inputs = tuple(_identifier(name) for name in plant.inputs)
        self.names = tuple(_identifier(name) for name in plant.states[: self.model.nv])
        self.q, self.v = np.array(self.model.home), np.zeros(self.model.nv)

    def step(self, time: float, size: float, values: list[float]) -> None:
        """Simulate from ``time`` for ``size`` [s] under inputs in the order of ``inputs``."""
        x = np.asarray(values, dtype=float)
        bus = 6 if self.model.free else 0
        wheels = bus + len(self.model.wheels)
        inputs = Inputs(
            force=Constant(x[:3]) if bus else None,
            torque=Constant(x[3:6]) if bus else None,
            wheel_torque=Constant(x[bus:wheels]) if wheels > bus else None,
            joint_torque=Constant(x[wheels:]) if len(x) > wheels else None,
        )
        run = simulate(self.model, inputs, size, q0=self.q, v0=self.v, start=time)
        end = run.states(np.array([time + size]))
        self.q, self.v = end.q[0], end.v[0]

    def outputs(self) -> dict[str, float]:
        """Return the bus's pose (quaternion x y z w), the other coordinates, and all rates."""
        m, found = self.model, {}
        scale = np.ones(m.nv)
        scale[m.modes.v] = m.mode_scale
        if m.free:
            found |= {f"bus_position_{a}": float(x) for a, x in zip("xyz", self.q[:3], strict=True)}
            found |= {f"bus_quaternion_{a}": float(x) for a, x in zip("xyzw", self.q[3:7], strict=True)}
        for j in range(2 if m.free else 1, m.pin.njoints):
            joint = m.pin.joints[j]
            own = self.q[joint.idx_q : joint.idx_q + joint.nq]
            turns = joint.nq == 2 and joint.nv == 1
            values = [np.arctan2(own[1], own[0])] if turns else own
            for k, value in enumerate(values):
                found[self.names[joint.idx_v + k]] = float(value * scale[joint.idx_v + k])
        found |= {f"{n}_rate": float(x) for n, x in zip(self.names, self.v * scale, strict=True)}
        return found


def _identifier(name: str) -> str:
    """Return a name that Python takes as an attribute."""
    return "".join(c if c.isalnum() else "_" for c in name)
