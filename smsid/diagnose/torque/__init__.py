"""Diagnosis of arms whose torques were measured: what the rigid links lack, from the torque that is left."""

from smsid.diagnose.torque._diagnose import diagnose_torques, torques_were_measured
from smsid.diagnose.torque.search import TorqueSearch

__all__ = ["TorqueSearch", "diagnose_torques", "torques_were_measured"]
