"""The description of an arm with what its torques were found to lack, and its links as identified."""

from __future__ import annotations

import logging

import numpy as np

from smsid.description import Description
from smsid.diagnose.extended_description import body_errors
from smsid.diagnose.torque.fit import TorqueFit, effects_of
from smsid.diagnose.torque.known import links_known
from smsid.errors import SmsidError
from smsid.export.bodies import identified_bodies, urdf_bodies
from smsid.identify.estimate import Estimate, classify
from smsid.model import build_model

LOGGER = logging.getLogger(__name__)


def extended_description(found: TorqueFit) -> tuple[Description, tuple[str, ...]]:
    """Return the description with the causes in it, and notes on what could not be written.

    Links that were identified along with the causes become ``body_error`` effects: the bodies that agree with
    the identified combinations, can exist, and are nearest to the described ones.
    """
    described = found.equations.description
    sensors = {s.name for s in described.sensor}
    effects, notes = [], []
    for effect in effects_of(found):
        sensor = getattr(effect, "sensor", None)
        if sensor is None or sensor in sensors:
            effects.append(effect)
        else:
            notes.append(f"'{effect.name}' is not written: the description has no sensor '{sensor}'")
    extended = described.with_effects(*effects)
    if links_known(found.equations, found.prior):
        return extended, tuple(notes)
    try:
        return _with_links(extended, found), tuple(notes)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("links as described: %s", error)
        return extended, (*notes, f"links stay as described: {error}")


def _with_links(extended: Description, found: TorqueFit) -> Description:
    sigma = np.sqrt(np.diag(found.covariance))
    base = found.equations.base
    parameters = tuple(
        classify(n, float(x), u, float(s), "arm")
        for n, u, x, s in zip(base.names, base.units, found.x, sigma, strict=False)
    )
    model = build_model(extended)
    bodies = identified_bodies(model, Estimate(extended.name, "torque diagnosis", parameters)).parameters
    errors = body_errors({joint: bodies[joint] - own for joint, own in urdf_bodies(extended).items()})
    with_links = extended.with_effects(*errors)
    build_model(with_links)
    return with_links
