"""The paper's spacecraft, for all tests of experiment design."""

from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.model import build_model
from smsid.paths import urdf_folder


@pytest.fixture(scope="package")
def description():
    return load_description(urdf_folder() / "paper_sms.toml")


@pytest.fixture(scope="package")
def model(description):
    return build_model(description)
