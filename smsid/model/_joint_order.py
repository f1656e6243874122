"""The order of a model's joints: Pinocchio's `crba`, inverse of the mass matrix and derivatives read a body's
subtree as one run of numbers, as a depth-first walk gives them. `aba` and `rnea` do without.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin


def is_depth_first(model: pin.Model) -> bool:
    """Whether the numbers of every joint's subtree follow one another without a gap."""
    subtrees = [sorted(s) for s in model.subtrees][1:]
    return all(s == list(range(s[0], s[0] + len(s))) for s in subtrees)


def with_room_for(base: pin.Model, complete: pin.Model) -> pin.Model:
    """Return ``base`` with all joints of ``complete`` in depth-first order.

    Bodies and frames are those of ``base``, whose joints are the first of ``complete``: what joints came
    after carry no body and no frame yet. Siblings keep their order, so that a model in order stays as it is.
    """
    out, order = pin.Model(), [0, *_walk(complete, 0)]
    number = {old: new for new, old in enumerate(order)}
    for j in order[1:]:
        parent = number[int(complete.parents[j])]
        out.addJoint(parent, complete.joints[j], complete.jointPlacements[j], complete.names[j])
    _copy_limits(complete, out, order)
    for j in range(base.njoints):
        out.inertias[number[j]] = base.inertias[j].copy()
    for k in range(1, base.nframes):
        f = base.frames[k]
        out.addFrame(pin.Frame(f.name, number[f.parentJoint], f.parentFrame, f.placement, f.type), False)
        out.frames[k].inertia = f.inertia
    out.name, out.gravity = base.name, base.gravity
    return out


def _walk(model: pin.Model, parent: int) -> list[int]:
    return [k for child in model.children[parent] for k in (int(child), *_walk(model, int(child)))]


def _copy_limits(source: pin.Model, target: pin.Model, order: list[int]) -> None:
    """Copy whatever a model says by coordinate: limits, armature, friction."""
    joints = [source.joints[j] for j in order[1:]]
    coordinates = {
        source.nv: np.concatenate([j.idx_v + np.arange(j.nv) for j in joints]),
        source.nq: np.concatenate([j.idx_q + np.arange(j.nq) for j in joints]),
    }
    for name in dir(source):
        values = getattr(source, name)
        if isinstance(values, np.ndarray) and values.ndim == 1 and not name.startswith("gravity"):
            setattr(target, name, values[coordinates[len(values)]])
