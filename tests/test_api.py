"""What ``smsid`` offers: some thirty names, loaded when used, and the example that holds them together."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import smsid
from smsid.errors import ControlError, DescriptionError, SmsidError

URDF = Path(__file__).parents[1] / "urdf"


def fresh(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_name_is_loaded_when_it_is_used():
    heavy = ("numpy", "pinocchio", "xarray", "scipy", "pydantic")
    assert fresh(f"import sys, smsid; print([m for m in {heavy} if m in sys.modules])") == "[]"
    assert fresh("import sys, smsid; smsid.RecordingError; print('numpy' in sys.modules)") == "False"


def test_every_name_is_there_documented_and_listed():
    assert 20 <= len(smsid.__all__) <= 32
    assert smsid.__all__ == sorted(smsid._MODULES)
    for name in smsid.__all__:
        thing = getattr(smsid, name)
        assert callable(thing) and thing.__doc__ and name in dir(smsid)
    with pytest.raises(AttributeError, match="no attribute 'identfy'"):
        _ = smsid.identfy  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", smsid._CALLED)
def test_a_subpackage_can_be_called_in_whatever_order_things_are_imported(name):
    """``smsid.identify`` is function and subpackage, whichever comes first."""
    first = f"import smsid; a = callable(smsid.{name}); import smsid.{name} as m; print(a, callable(m))"
    then = f"import smsid.{name}; import smsid; print(callable(smsid.{name}), smsid.{name}.__name__)"
    assert fresh(first) == "True True"
    assert fresh(then) == f"True smsid.{name}"
    from smsid import api

    assert inspect.signature(getattr(smsid, name)) == inspect.signature(getattr(api, name))


def test_the_types_checkers_see_are_the_ones_there_are():
    text = Path(smsid.__file__).read_text()
    block = text[text.index("if TYPE_CHECKING") : text.index("def __getattr__")]
    for name, module in smsid._MODULES.items():
        assert f"from {module} import" in block and name in block


def test_fly_identify_and_look(tmp_path):
    """A spacecraft flown, identified from Exp. 1 alone by both methods, and exported."""
    craft = smsid.load_spacecraft(URDF / "paper_sms.toml")
    flight = smsid.simulate(craft, "exp1_x", seed=3)
    assert flight.provenance["seed"] == 3 and flight.role == "estimation"
    smsid.save_recording(flight, tmp_path / "exp1.nc")
    (again,) = smsid.load_recordings(tmp_path / "exp1.nc")
    estimate = smsid.identify(craft, again, method="paper")
    mass = estimate["total.mass"]
    assert abs(mass.value - 2256.8) < 4.0 * mass.sigma
    assert len(repr(estimate).splitlines()) <= 30
    smsid.save_estimate(estimate, tmp_path / "e.json")
    assert smsid.load_estimate(tmp_path / "e.json").names == estimate.names


def test_the_view_is_written(tmp_path):
    pytest.importorskip("meshcat")
    craft = smsid.load_spacecraft(URDF / "paper_sms.toml")
    assert smsid.view(craft, path=tmp_path / "at_rest.html").stat().st_size > 10_000


def test_what_makes_no_sense_is_told():
    craft = smsid.load_spacecraft(URDF / "paper_sms.toml")
    with pytest.raises(SmsidError, match="no method 'tls'"):
        smsid.identify(craft, [], method="tls")  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match="cutoff is for welded arms"):
        smsid.identify(craft, [], cutoff=3.0)
    with pytest.raises(ControlError, match="Without an estimate"):
        smsid.design_controller(craft)
