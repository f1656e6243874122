"""Loading what must fail."""

from __future__ import annotations

import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError
from smsid.model import build_model

from .pieces import BUS


@pytest.fixture
def fails(tmp_path):
    """Return a function that loads and builds a TOML and URDF and returns the error's text."""

    def load(toml: str, urdf: str = BUS) -> str:
        (tmp_path / "bus.urdf").write_text(urdf)
        (tmp_path / "x.toml").write_text(toml)
        with pytest.raises(DescriptionError) as caught:
            build_model(load_description(tmp_path / "x.toml"))
        return str(caught.value)

    return load
