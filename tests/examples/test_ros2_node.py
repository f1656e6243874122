"""The ROS 2 node of the examples against stand-ins of ROS's own classes, which no wheel brings along."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from smsid.description import save_description
from tests.tracking.craft import craft, flight

NODE = Path(__file__).resolve().parents[2] / "examples" / "ros2" / "tracker_node.py"


@dataclass
class Publisher:
    messages: list = field(default_factory=list)

    def publish(self, message) -> None:
        self.messages.append(message)


class Node:
    """What of ``rclpy.node.Node`` the example uses."""

    def __init__(self, name: str) -> None:
        self.name, self.parameters_given, self.publishers, self.heard = name, {}, {}, {}
        self.errors = []

    def declare_parameter(self, name, value) -> None:
        self.parameters_given[name] = ["bus.I*"]

    def get_parameter(self, name):
        return SimpleNamespace(value=self.parameters_given[name])

    def create_publisher(self, kind, topic, depth):
        self.publishers[topic] = Publisher()
        return self.publishers[topic]

    def create_subscription(self, kind, topic, callback, depth) -> None:
        self.heard[topic] = callback

    def get_logger(self):
        return SimpleNamespace(error=self.errors.append)


@dataclass
class Message:
    header: SimpleNamespace = field(default_factory=SimpleNamespace)
    level: int = 0
    name: str = ""
    key: str = ""
    value: str = ""
    data: str = ""
    values: list = field(default_factory=list)
    status: list = field(default_factory=list)
    OK, WARN = 0, 1


@pytest.fixture
def node(tmp_path, monkeypatch):
    kinds = {
        "rclpy": (),
        "rclpy.node": (),
        "sensor_msgs.msg": ("Imu", "JointState"),
        "std_msgs.msg": ("String",),
        "diagnostic_msgs.msg": ("DiagnosticArray", "DiagnosticStatus", "KeyValue"),
    }
    for name, classes in kinds.items():
        for whole in (name.partition(".")[0], name):
            monkeypatch.setitem(sys.modules, whole, ModuleType(whole))
        for kind in classes:
            setattr(sys.modules[name], kind, Message)
    sys.modules["rclpy.node"].Node = Node
    sys.modules["rclpy"].node = sys.modules["rclpy.node"]
    spec = importlib.util.spec_from_file_location("tracker_node", NODE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    described = craft(tmp_path)
    names = {"gyro": "imu", "tacho": "tachometer"}
    sensors = [s.model_copy(update={"name": names.get(s.name, s.name)}) for s in described.sensor]
    save_description(described.model_copy(update={"sensor": tuple(sensors)}), tmp_path / "craft.toml")
    return module.TrackerNode(str(tmp_path / "craft.toml"))


def test_it_follows_what_it_hears(node):
    """Wheels in reversed order, by name; the attitude is not published as Imu, the gyro is enough."""
    flown = flight(40.0)
    wheels = list(flown.labels["wheel"])[::-1]
    for k, t in enumerate(flown.time()):
        stamp = SimpleNamespace(sec=int(t), nanosec=round(1e9 * (t - int(t))))
        header = SimpleNamespace(stamp=stamp)
        rates = dict(zip("xyz", flown["gyro.angular_rate"][k], strict=True))
        still = dict.fromkeys("xyz", np.nan)
        imu = SimpleNamespace(
            header=header,
            angular_velocity=SimpleNamespace(**rates),
            linear_acceleration=SimpleNamespace(**still),
        )
        joints = SimpleNamespace(
            header=header,
            name=wheels,
            position=[],
            velocity=flown["tacho.wheel_rate"][k][::-1].tolist(),
            effort=flown["command.wheel_torque"][k][::-1].tolist(),
        )
        node.heard["joint_states"](joints)
        node.heard["imu"](imu)
    assert not node.errors
    told = node.publishers["~/parameters"].messages
    assert len(told) >= 9
    names = [s.name for s in told[-1].status]
    sigma = [float(next(p.value for p in s.values if p.key == "sigma")) for s in told[-1].status]
    first = [float(next(p.value for p in s.values if p.key == "sigma")) for s in told[0].status]
    value = float(told[-1].status[names.index("bus.Izz")].values[0].value)
    assert sigma[names.index("bus.Izz")] < first[names.index("bus.Izz")] < 0.1
    assert abs(value - 70.0) < 4.0 * sigma[names.index("bus.Izz")]
