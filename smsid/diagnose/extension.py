"""Writing what was found into a description that simulates, identifies and controls like any other."""

from __future__ import annotations

import logging

from smsid.description.schema import Description
from smsid.diagnose.search import Search
from smsid.effects.base import known_effect
from smsid.errors import DescriptionError
from smsid.model import rebuild
from smsid.model.regressor import body_names

LOGGER = logging.getLogger(__name__)
INERTIA_ORDER = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


def with_inertial_shifts(found: Search) -> Description:
    """Return the last fit's description; shifts of inertial parameters become ``body_error`` effects.

    Where a shifted body could not exist - the recording determines combinations of bodies only - all bodies
    stay as described.
    """
    point = found.last.point
    description = point.description
    cls = known_effect("body_error")
    if cls is None or not point.inertial:
        return description
    names = body_names(point.base.pin)
    by_body: dict[str, dict[str, float]] = {}
    labels = ("m", "mx", "my", "mz", *INERTIA_ORDER)
    for column, shift in point.inertial.items():
        by_body.setdefault(names[column // 10], {})[labels[column % 10]] = shift
    effects = []
    for body, shifts in by_body.items():
        if not any(shifts.values()):
            continue
        effects.append(
            cls.model_validate(
                {
                    "kind": "body_error",
                    "name": f"body_error_{body}".replace("/", "_"),
                    "body": body,
                    "mass": shifts.get("m", 0.0),
                    "first_moment": tuple(shifts.get(k, 0.0) for k in ("mx", "my", "mz")),
                    "inertia": tuple(shifts.get(k, 0.0) for k in INERTIA_ORDER),
                }
            )
        )
    extended = description.with_effects(*effects)
    try:
        rebuild(point.base, extended)
    except DescriptionError as error:
        LOGGER.warning("bodies are left as described: %s", error)
        return description
    return extended
