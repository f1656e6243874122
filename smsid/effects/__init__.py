"""Effects: what a spacecraft has beyond rigid links. One file per family, one catalogue."""

from smsid.effects.actuator import ActuatorDelay, ThrusterGain, ThrusterMisalignment, TorqueGain
from smsid.effects.appendage import Appendage, BeamAppendage, ModalAppendage, Mode
from smsid.effects.appendage_effect import AppendageEffect, ExtraMode, FrequencyDrift, ModeError, ThermalSnap
from smsid.effects.assembly import ForceTerm, InertiaTerm
from smsid.effects.base import (
    Effect,
    JointEffect,
    Starting,
    Vector3,
    Vector6,
    catalogue,
    parse_effect,
    physical,
    register,
)
from smsid.effects.beam_mode import BeamMode
from smsid.effects.external import BaseTilt, ExternalWrench, GravityGradient
from smsid.effects.friction import JointFriction
from smsid.effects.gear import Gear, Servo
from smsid.effects.geometric_stiffness import GeometricStiffness
from smsid.effects.joint_bias import JointCable, JointOffset, TorqueOffset
from smsid.effects.joint_state import Counterpart
from smsid.effects.motor import Backlash, GearCompliance, MotorCoupling, MotorInertia
from smsid.effects.payload import BodyError, GraspedBody, MassLoss, Payload, WheelImbalance
from smsid.effects.sensor_errors import (
    LeverArm,
    Outliers,
    Quantisation,
    ScaleByRate,
    SensorBias,
    SensorDelay,
    SensorMisalignment,
    SensorScale,
    StuckChannel,
    TimeOffset,
)
from smsid.effects.slosh import Slosh, SloshNonlinearity, SloshPendulum, SloshWall
from smsid.effects.tank_fill import TankFill

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
    "StuckChannel",
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
