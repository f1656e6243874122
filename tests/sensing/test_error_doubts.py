"""Stated errors that hardly any sensor has are doubted; those of data sheets are not."""

import pytest

from smsid.model.review import errors_doubts
from smsid.sensing import ErrorModel, preset_names
from smsid.sensing.sensor import MEASURES, preset


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ({"noise_sigma": 5e-5, "saturation": 1e-6}, "saturation 1e-06 is no more than its noise"),
        ({"noise_density": 1e-3, "saturation": 5e-3}, "saturation 0.005 is no more than its noise"),
        ({"bias_sigma": (0.0, 2.0, 0.0), "saturation": 1.0}, "no more than its bias_sigma"),
        ({"quantisation": 2.0, "saturation": 1.0}, "no more than its quantisation"),
        ({"scale_sigma": 0.1}, "scale_sigma of 0.1"),
        ({"scale_error": (0.0, -0.4)}, "scale_error of 0.4"),
        ({"misalignment_sigma": 0.5}, "misalignment_sigma of 0.5"),
        ({"misalignment": (0.0, 0.0, -1.57)}, "misalignment of 1.57"),
        ({"delay": 3.0}, "delay of 3"),
        ({"time_offset": -3.0}, "time_offset of 3"),
    ],
)
def test_what_hardly_any_sensor_has_is_doubted(errors, words):
    (doubt,) = errors_doubts(ErrorModel(**errors), 100.0)
    assert words in doubt


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k in MEASURES for n in preset_names(k)])
def test_nothing_of_the_presets_is(kind, name):
    own = preset(name, kind)
    for errors in own["errors"].values():
        assert not list(errors_doubts(ErrorModel.model_validate(errors), own["rate"]))
