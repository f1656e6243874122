"""The bus with a robot in Drake, read by Drake's own URDF parser: momentum and inverse dynamics."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces


class DrakeTwin:
    """A robot mounted on the bus; states are those of the Pinocchio model of the same spacecraft."""

    def __init__(self, model: pin.Model, bus: Path, robot: Path, frame: str, mount: pin.SE3) -> None:
        self.pin = model
        self.plant = plant = MultibodyPlant(0.0)
        bus_text, self.base = _text(bus)
        robot_text, root = _text(robot)
        parser = Parser(plant)
        (bus_model,) = parser.AddModelsFromString(bus_text, "urdf")
        parser.SetAutoRenaming(True)
        (robot_model,) = parser.AddModelsFromString(robot_text, "urdf")
        plant.WeldFrames(
            plant.GetFrameByName(frame, bus_model),
            plant.GetFrameByName(root, robot_model),
            RigidTransform(RotationMatrix(mount.rotation), mount.translation),
        )
        plant.mutable_gravity_field().set_gravity_vector(model.gravity.linear)
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.body = plant.GetBodyByName(self.base, bus_model)
        self.joints = []
        for j in range(2, model.njoints):
            joint = plant.GetJointByName(model.names[j].partition("/")[2], robot_model)
            self.joints.append((model.joints[j], joint, joint.velocity_start()))
        if plant.num_velocities() != model.nv:
            raise ValueError(f"Drake has {plant.num_velocities()} velocities, Pinocchio {model.nv}.")
        self.first = plant.GetJointByName(self.base, bus_model).velocity_start()

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return (p, h) (6,) about the bus origin in bus axes."""
        rotation = self._set(q, v)
        found = self.plant.CalcSpatialMomentumInWorldAboutPoint(self.context, q[:3])
        return np.concatenate([rotation.T @ found.translational(), rotation.T @ found.rotational()])

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the generalised forces (nv,) that cause a = vdot, gravity included."""
        rotation = self._set(q, v)
        rates = np.empty(self.plant.num_velocities())
        k = self.first
        rates[k : k + 3] = rotation @ a[3:6]
        rates[k + 3 : k + 6] = rotation @ (a[:3] + np.cross(v[3:6], v[:3]))
        for joint, _, index in self.joints:
            rates[index] = a[joint.idx_v]
        force = self.plant.CalcInverseDynamics(self.context, rates, MultibodyForces(self.plant))
        force = force - self.plant.CalcGravityGeneralizedForces(self.context)
        out = np.empty(self.pin.nv)
        out[:3], out[3:6] = rotation.T @ force[k + 3 : k + 6], rotation.T @ force[k : k + 3]
        for joint, _, index in self.joints:
            out[joint.idx_v] = force[index]
        return out

    def _set(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        rotation = pin.Quaternion(*q[[6, 3, 4, 5]]).toRotationMatrix()
        pose = RigidTransform(RotationMatrix(rotation), q[:3])
        self.plant.SetFloatingBaseBodyPoseInWorldFrame(self.context, self.body, pose)
        spatial = SpatialVelocity(rotation @ v[3:6], rotation @ v[:3])
        self.plant.SetFreeBodySpatialVelocity(self.body, spatial, self.context)
        positions, velocities = self.plant.GetPositions(self.context), self.plant.GetVelocities(self.context)
        for joint, there, index in self.joints:
            at = q[joint.idx_q :]
            positions[there.position_start()] = np.arctan2(at[1], at[0]) if joint.nq == 2 else at[0]
            velocities[index] = v[joint.idx_v]
        self.plant.SetPositions(self.context, positions)
        self.plant.SetVelocities(self.context, velocities)
        return rotation


def _text(path: Path) -> tuple[str, str]:
    """Return a URDF without geometry and mimic, and its root link, which Drake may not find named 'world'."""
    tree = ET.parse(path).getroot()
    children = {
        joint.find("child").get("link") for joint in tree.iter("joint") if joint.find("child") is not None
    }
    (root,) = {link.get("name") for link in tree.findall("link")} - children
    for link in tree.findall("link"):
        for kind in ("visual", "collision"):
            for part in link.findall(kind):
                link.remove(part)
    for joint in tree.findall("joint"):
        for kind in ("mimic", "dynamics", "limit", "safety_controller"):
            for part in joint.findall(kind):
                joint.remove(part)
    for transmission in tree.findall("transmission"):
        tree.remove(transmission)
    text = ET.tostring(tree, encoding="unicode")
    return (text.replace('"world"', '"world_link"'), "world_link") if root == "world" else (text, root)
