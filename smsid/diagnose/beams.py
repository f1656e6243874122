"""An estimate's values in a description whose beams stay beams: what bends is known by its shape, too."""

from __future__ import annotations

import re

import numpy as np

from smsid.description.schema import Description
from smsid.effects.appendage import Appendage, BeamAppendage
from smsid.effects.base import Effect
from smsid.effects.mode_error import ModeError
from smsid.export.estimate_values import with_estimate
from smsid.identify.estimate import Estimate


def with_beams(description: Description, estimate: Estimate) -> tuple[Description, list[str], set[str]]:
    """Return `with_estimate` with beams as beams, its notes, and the names whose prior is the estimate's.

    A beam gets the identified density, Young's modulus from the first mode's frequency and that mode's
    damping; what the other modes are off by then are `mode_error` effects, so that frequencies and dampings
    are the identified ones. Modal data would do the same, but could no longer soften as a beam does.
    """
    found, notes = with_estimate(description, estimate)
    effects: list[Effect] = []
    known: set[str] = set()
    for effect in found.effect:
        beam = next((e for e in description.effect if e.name == effect.name), None)
        if isinstance(beam, BeamAppendage) and isinstance(effect, Appendage) and effect is not beam:
            parts = _as_beam(beam, effect, estimate)
            effects += parts
            known |= {f"{beam.name}.{key}" for key in parts[0].prior if key not in beam.prior}
        else:
            effects.append(effect)
    return found.with_effects(*effects), notes, known


def _as_beam(beam: BeamAppendage, identified: Appendage, estimate: Estimate) -> list[Effect]:
    modes = identified.modal_data()
    factor = identified.rigid_inertia().mass / beam.mass
    stiffer = factor * (modes[0].frequency / beam.modal_data()[0].frequency) ** 2
    prior = {
        "density": _relative(estimate, f"{beam.name}.linear_density") * beam.density * factor,
        "damping": _sigma(estimate, f"{beam.name}.mode1.damping"),
        "youngs_modulus": beam.youngs_modulus
        * stiffer
        * np.hypot(
            _relative(estimate, f"{beam.name}.linear_density"),
            2.0 * _relative(estimate, f"{beam.name}.mode1.frequency"),
        ),
    }
    own = beam.model_copy(
        update={
            "density": beam.density * factor,
            "youngs_modulus": beam.youngs_modulus * stiffer,
            "damping": modes[0].damping,
            "prior": {**beam.prior, **{k: float(v) for k, v in prior.items() if np.isfinite(v) and v > 0.0}},
        }
    )
    out: list[Effect] = [own]
    for k, (mode, plain) in enumerate(zip(modes, own.modal_data(), strict=True), start=1):
        off = mode.frequency / plain.frequency - 1.0, mode.damping - plain.damping
        if k > 1 and any(off):
            name = re.sub(r"\W+", "_", f"mode_error_{beam.name}_{k}")  # that of the candidate, which goes on
            out.append(ModeError(name=name, appendage=beam.name, mode=k, frequency=off[0], damping=off[1]))
    return out


def _sigma(estimate: Estimate, name: str) -> float:
    return float(estimate[name].sigma) if name in estimate else np.nan


def _relative(estimate: Estimate, name: str) -> float:
    return _sigma(estimate, name) / abs(estimate[name].value) if name in estimate else np.nan
