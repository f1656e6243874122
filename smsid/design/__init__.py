"""Experiment design: the thrust or motion whose data tell most about what is asked, within limits."""

from smsid.design.design import Design, design_experiment
from smsid.design.goal import Goal
from smsid.design.limits import Limits

__all__ = ["Design", "Goal", "Limits", "design_experiment"]
