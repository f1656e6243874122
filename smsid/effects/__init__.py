"""Effects: what a spacecraft has beyond rigid links. One file per family, one catalogue."""

from smsid.effects.actuator import ActuatorDelay, ThrusterGain, ThrusterMisalignment, TorqueGain
from smsid.effects.appendage import Appendage, BeamAppendage, ModalAppendage, Mode
from smsid.effects.appendage_effect import AppendageEffect
from smsid.effects.assembly import ForceTerm, InertiaTerm
from smsid.effects.base import (
    Effect,
    Starting,
    Vector3,
    Vector6,
    catalogue,
    parse_effect,
    physical,
    register,
)
from smsid.effects.base_tilt import BaseTilt
from smsid.effects.beam_mode import BeamMode
from smsid.effects.counterpart import Counterpart
from smsid.effects.elastic_gear import Backlash, GearCompliance
from smsid.effects.external import ExternalWrench, GravityGradient
from smsid.effects.extra_mode import ExtraMode
from smsid.effects.friction import JointFriction
from smsid.effects.gear import Gear
from smsid.effects.geometric_stiffness import GeometricStiffness
from smsid.effects.grasped_body import GraspedBody
from smsid.effects.joint_bias import JointOffset, TorqueOffset
from smsid.effects.joint_cable import JointCable
from smsid.effects.joint_effect import JointEffect
from smsid.effects.mass_loss import MassLoss
from smsid.effects.mode_error import FrequencyDrift, ModeError
from smsid.effects.motor import MotorCoupling, MotorInertia
from smsid.effects.payload import BodyError, Payload
from smsid.effects.sensor_errors import (
    LeverArm,
    ScaleByRate,
    SensorBias,
    SensorDelay,
    SensorMisalignment,
    SensorScale,
    TimeOffset,
)
from smsid.effects.sensor_faults import Outliers, Quantisation, Stuck
from smsid.effects.servo import Servo
from smsid.effects.slosh import Slosh, SloshNonlinearity, SloshWall
from smsid.effects.slosh_pendulum import SloshPendulum
from smsid.effects.tank_fill import TankFill
from smsid.effects.thermal_snap import ThermalSnap
from smsid.effects.wheel_imbalance import WheelImbalance

__all__ = [
    "ActuatorDelay",
    "Appendage",
    "AppendageEffect",
    "Backlash",
    "BaseTilt",
    "BeamAppendage",
    "BeamMode",
    "BodyError",
    "Counterpart",
    "Effect",
    "ExternalWrench",
    "ExtraMode",
    "ForceTerm",
    "FrequencyDrift",
    "Gear",
    "GearCompliance",
    "GeometricStiffness",
    "GraspedBody",
    "GravityGradient",
    "InertiaTerm",
    "JointCable",
    "JointEffect",
    "JointFriction",
    "JointOffset",
    "LeverArm",
    "MassLoss",
    "ModalAppendage",
    "Mode",
    "ModeError",
    "MotorCoupling",
    "MotorInertia",
    "Outliers",
    "Payload",
    "Quantisation",
    "ScaleByRate",
    "SensorBias",
    "SensorDelay",
    "SensorMisalignment",
    "SensorScale",
    "Servo",
    "Slosh",
    "SloshNonlinearity",
    "SloshPendulum",
    "SloshWall",
    "Starting",
    "Stuck",
    "TankFill",
    "ThermalSnap",
    "ThrusterGain",
    "ThrusterMisalignment",
    "TimeOffset",
    "TorqueGain",
    "TorqueOffset",
    "Vector3",
    "Vector6",
    "WheelImbalance",
    "catalogue",
    "parse_effect",
    "physical",
    "register",
]
