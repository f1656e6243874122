"""Experiment design: the thrust or motion whose data tell most about what is asked, within limits."""

from smsid.design._design import Design, design_experiment
from smsid.design._goal import Goal
from smsid.design._limits import Limits

__all__ = ["Design", "Goal", "Limits", "design_experiment"]
