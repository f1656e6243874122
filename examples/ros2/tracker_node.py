"""A ROS 2 node that follows a spacecraft: JointState and Imu in, parameters with standard deviations out.

    python3 examples/ros2/tracker_node.py craft.toml --ros-args -p follow:="['link3.*']"

Subscribes ``joint_states`` (sensor_msgs/JointState; joints by name, efforts as commands) and ``imu``
(sensor_msgs/Imu); publishes ``~/parameters`` (diagnostic_msgs/DiagnosticArray), and on ``~/events``
(std_msgs/String) what changed or is not explained. The description's sensors are named ``encoder``,
``tachometer`` and ``imu``.
"""

from __future__ import annotations

import sys

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from smsid import load_spacecraft
from smsid.errors import SmsidError
from smsid.model import build_model
from smsid.tracking import Sample, Stream

MISSING = float("nan")


class TrackerNode(Node):
    """Feeds what it hears to a `Tracker` and says what that believes, once a second of telemetry."""

    def __init__(self, path: str) -> None:
        super().__init__("smsid_tracker")
        self.declare_parameter("follow", [""])
        patterns = [p for p in self.get_parameter("follow").value if p]
        described = load_spacecraft(path)
        self.model = build_model(described)
        self.stream = Stream(described, follow=dict.fromkeys(patterns) or None, every=1.0, false_alarms=0.1)
        self.parameters = self.create_publisher(DiagnosticArray, "~/parameters", 10)
        self.events = self.create_publisher(String, "~/events", 10)
        self.create_subscription(JointState, "joint_states", self.hear_joints, 100)
        self.create_subscription(Imu, "imu", self.hear_imu, 100)

    def hear_joints(self, message: JointState) -> None:
        """Take in angles and rates of joints and wheels, whatever their order, and commanded torques."""
        groups = {"encoder": self.model.arm_joints.names, "tachometer": self.model.wheels.names}
        columns = {name: i for i, name in enumerate(message.name)}

        def of(values, names):
            read = [
                values[columns[n]] if n in columns and columns[n] < len(values) else MISSING for n in names
            ]
            return np.array(read)

        arm, wheels = groups.values()
        channels = {
            "encoder.joint_position": of(message.position, arm),
            "encoder.joint_velocity": of(message.velocity, arm),
            "tachometer.wheel_rate": of(message.velocity, wheels),
            "command.joint_torque": of(message.effort, arm),
            "command.wheel_torque": of(message.effort, wheels),
        }
        self.hear(
            message.header.stamp, {k: x for k, x in channels.items() if np.isfinite(x).all() and x.size}
        )

    def hear_imu(self, message: Imu) -> None:
        """Take in a gyro's and an accelerometer's reading."""
        rate, force = message.angular_velocity, message.linear_acceleration
        channels = {
            "imu.angular_rate": np.array([rate.x, rate.y, rate.z]),
            "imu.acceleration": np.array([force.x, force.y, force.z]),
        }
        self.hear(message.header.stamp, channels)

    def hear(self, stamp, channels: dict[str, np.ndarray]) -> None:
        """Give a sample to the tracker and publish what there is to say."""
        try:
            told = self.stream.hear(Sample(stamp.sec + 1e-9 * stamp.nanosec, channels))
        except SmsidError as error:
            self.get_logger().error(str(error))
            return
        for table in told:
            if "parameters" in table:
                self.publish(stamp, table)
            else:
                self.events.publish(String(data=f"{table['event']}: {table['text']}"))

    def publish(self, stamp, table: dict) -> None:
        """Publish every parameter with its standard deviation."""
        message = DiagnosticArray()
        message.header.stamp = stamp
        level = DiagnosticStatus.OK if table["explained"] else DiagnosticStatus.WARN
        for name, value in table["parameters"].items():
            numbers = {"value": value, "sigma": table["sigmas"][name]}
            pairs = [KeyValue(key=k, value=repr(x)) for k, x in numbers.items()]
            message.status.append(DiagnosticStatus(level=level, name=name, values=pairs))
        self.parameters.publish(message)


def main() -> None:
    """Run until interrupted."""
    rclpy.init(args=sys.argv)
    node = TrackerNode(sys.argv[1])
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
