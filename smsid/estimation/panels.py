"""Descriptions in the parameters that the likelihood takes, and back in those anyone can read."""

from __future__ import annotations

from smsid.description.schema import Description


def modal_panels(description: Description) -> tuple[Description, dict[str, tuple[str, float]]]:
    """Return the description as it is estimated, beams by their modes (`Effect.estimated_as`).

    The second value gives name and size of what a factor stands for by the name of the factor: the linear
    density [kg/m] of a beam.
    """
    found = [e.estimated_as(description.effect) for e in description.effect]
    effects = tuple(e for e in found if e is not None)
    stands_for = {k: v for e in effects for k, v in e.reported_as().items()}
    return description.model_copy(update={"effect": effects}), stands_for


def plain_panels(description: Description) -> Description:
    """Return the description with its panels as modal data anyone can read."""
    effects = tuple(e.described_as() for e in description.effect)
    return description.model_copy(update={"effect": effects})
