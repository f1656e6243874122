"""Joints that follow another, ``<mimic>`` of a URDF: q_f = ratio q_l + offset, exactly.

The model keeps a coordinate for every joint; what holds a follower to its leader is a force between the two.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.description.urdf_reading import Mimic, UrdfReading
from smsid.errors import DescriptionError

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Followers:
    """The followers of a model and their leaders: names, joints, places in v, ratio and offset (followers,).

    ``rows`` (followers, nv) are zero on rates that keep every follower with its leader.
    """

    names: tuple[str, ...]
    leaders: tuple[str, ...]
    joints: np.ndarray
    leading: np.ndarray
    v: np.ndarray
    leading_v: np.ndarray
    ratio: np.ndarray
    offset: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, model: pin.Model, mimics: Mapping[str, Mimic]) -> Followers | None:
        """Return the followers of a model; None if it has none."""
        if not mimics:
            return None
        joints = np.array([model.getJointId(name) for name in mimics])
        leading = np.array([model.getJointId(m.joint) for m in mimics.values()])
        v, leading_v = (np.array([model.joints[int(j)].idx_v for j in x]) for x in (joints, leading))
        ratio = np.array([m.ratio for m in mimics.values()])
        rows = np.zeros((len(v), model.nv))
        rows[np.arange(len(v)), v] = 1.0
        rows[np.arange(len(v)), leading_v] = -ratio
        leaders = tuple(m.joint for m in mimics.values())
        offset = np.array([m.offset for m in mimics.values()])
        return cls(tuple(mimics), leaders, joints, leading, v, leading_v, ratio, offset, rows)

    def place_followers(self, model: pin.Model, q: np.ndarray) -> np.ndarray:
        """Return a copy of q (nq,) with every follower where its leader puts it."""
        q = np.array(q, dtype=float)
        for j, k, ratio, offset in zip(self.joints, self.leading, self.ratio, self.offset, strict=True):
            lead, own = model.joints[int(k)], model.joints[int(j)]
            at = q[lead.idx_q] if lead.nq == 1 else np.arctan2(q[lead.idx_q + 1], q[lead.idx_q])
            angle = ratio * at + offset
            q[own.idx_q : own.idx_q + own.nq] = angle if own.nq == 1 else (np.cos(angle), np.sin(angle))
        return q

    def driven(self, v: np.ndarray) -> np.ndarray:
        """Return a copy of rates or accelerations v (nv,), every follower's by its leader's."""
        v = np.array(v, dtype=float)
        v[self.v] = self.ratio * v[self.leading_v]
        return v

    def among(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return T (n, n) and c (n,): the angles of a group of joints (n,) that follow are T angles + c.

        A follower whose leader is not of the group is left as it is.
        """
        turn, shift = np.eye(len(joints)), np.zeros(len(joints))
        place = {int(j): i for i, j in enumerate(joints)}
        for j, k, ratio, offset in zip(self.joints, self.leading, self.ratio, self.offset, strict=True):
            if int(j) in place and int(k) in place:
                i = place[int(j)]
                turn[i], shift[i] = 0.0, offset
                turn[i, place[int(k)]] = ratio
        return turn, shift


def mimics_of(reading: UrdfReading) -> dict[str, Mimic]:
    """Return the joints of a URDF that follow another, with leaders that follow none themselves.

    A joint whose leader does not exist is none, and a warning says so. Raises `DescriptionError` for a leader
    that cannot lead, and for joints that follow each other in a ring.
    """
    mimics = {j.name: j.mimic for j in reading.joints.values() if j.mimic is not None}
    found = {}
    for name, mimic in mimics.items():
        seen = [name]
        while (further := mimics.get(mimic.joint)) is not None:
            if mimic.joint in seen:
                raise DescriptionError(
                    f"Joints {', '.join(map(repr, seen))} of {reading.source} mimic each other.",
                    advice="One of them has to lead: take its <mimic> away.",
                )
            seen.append(mimic.joint)
            mimic = Mimic(
                further.joint, mimic.ratio * further.ratio, mimic.ratio * further.offset + mimic.offset
            )
        leader = reading.joints.get(mimic.joint)
        if leader is None:
            logger.warning(
                "%s: joint '%s' mimics '%s', which does not exist: it moves on its own.",
                reading.source,
                name,
                mimic.joint,
            )
            continue
        for one in (leader, reading.joints[name]):
            if one.kind in ("floating", "planar"):
                raise DescriptionError(
                    f"Joint '{name}' of {reading.source} mimics '{mimic.joint}'; '{one.name}' is {one.kind}.",
                    advice="Joints that lead or follow have one degree of freedom.",
                    joint=one.name,
                )
        found[name] = mimic
    return found
