"""Spacecraft that the tests of experiments fly."""

from __future__ import annotations

from pathlib import Path

import pytest

from smsid.description import load_description
from smsid.model import SpacecraftModel, build_model

URDF = Path(__file__).parents[2] / "urdf"


@pytest.fixture(scope="session")
def model() -> SpacecraftModel:
    """The paper's spacecraft."""
    return build_model(load_description(URDF / "paper_sms.toml"))


@pytest.fixture(scope="session")
def two_arms() -> SpacecraftModel:
    """Two arms, two tanks, two panels, four wheels."""
    return build_model(load_description(URDF / "two_arm_sms.toml"))
