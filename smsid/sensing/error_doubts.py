"""Errors of sensors that are possible, but that hardly any sensor has: a wrong unit or a slip."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smsid.sensing.error_model import ErrorModel

SCALE = 0.05
"""Scale error [1] beyond those of data sheets, 1 % and less."""
TURN = 0.1
"""Misalignment [rad] from which axes are turned on purpose, which ``orientation`` says."""
LATE = 1.0
"""Age of a sample [s] beyond that of any sensor aboard."""

SHARE = "a share, 0.01 is 1 %"
RADIANS = "in rad; axes that are turned on purpose are the sensor's `orientation`"


def errors_doubts(errors: ErrorModel, rate: float | None) -> Iterator[str]:
    """Yield what is doubtful in the stated errors of one quantity, sampled at ``rate`` [Hz], in words."""
    if errors.noise_density is None or rate is not None:
        noise = float(np.max(errors.white_sigma(rate or 1.0)))
        for what, size in (
            ("noise of one sigma", noise),
            ("bias_sigma", float(np.max(errors.bias_sigma))),
            ("quantisation", errors.quantisation),
        ):
            if errors.saturation is not None and size >= errors.saturation:
                yield (
                    f"saturation {errors.saturation:g} is no more than its {what}, {size:.3g}: nothing else "
                    "would be read"
                )
    for key, limit, told in (
        ("scale_error", SCALE, SHARE),
        ("scale_sigma", SCALE, SHARE),
        ("misalignment", TURN, RADIANS),
        ("misalignment_sigma", TURN, RADIANS),
        ("delay", LATE, "in s"),
        ("time_offset", LATE, "in s"),
    ):
        size = float(np.max(np.abs(getattr(errors, key))))
        if size >= limit:
            yield f"{key} of {size:g} is more than sensors have ({limit:g}): it is {told}"
