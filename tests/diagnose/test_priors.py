"""What an estimate knows of the nominal parameters: its values, and its errors as they go together."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.description import Description
from smsid.diagnose._described_effects import from_described
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.effects import JointFriction
from smsid.estimation.map_estimate import prior_of
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.model import build_model
from smsid.paths import urdf_folder

FACTORS = ({"link2.mx": 1.0, "link3.m": 2.0}, {"link3.mx": 1.0}, {"tank.mass": 1.0})
NAMES = ("link2.mx + 2 link3.m", "link3.mx", "tank.mass")
SIGMA = np.array([0.05, 0.03, 0.02])
TOGETHER = np.array([[1.0, 0.9, 0.6], [0.9, 1.0, 0.5], [0.6, 0.5, 1.0]])


def estimate_of(description, covariance):
    found = [
        ParameterEstimate(n, v, u, s, "identifiable", "maximum_likelihood")
        for n, v, u, s in zip(NAMES, (150.0, 50.0, 50.0), ("kg m", "kg m", "kg"), SIGMA, strict=True)
    ]
    return Estimate(description.name, "maximum_likelihood", tuple(found), ("exp2",), covariance=covariance)


@pytest.mark.parametrize("together", [TOGETHER, None])
def test_errors_of_an_estimate_go_together_as_it_says(description, together):
    """Taken as independent, their sum was known three times too well."""
    covariance = None if together is None else together * np.outer(SIGMA, SIGMA)
    known = nominal(description, estimate_of(description, covariance))
    prior = prior_of(known.point, known.unknowns, SimpleNamespace(joint=known.joint))
    scale = np.array([u.scale for u in known.unknowns])
    rows = prior.rows / scale
    sums = np.array([[f.get(u.name, 0.0) for u in known.unknowns] for f in FACTORS])
    found = sums @ np.linalg.inv(rows.T @ rows) @ sums.T / np.outer(SIGMA, SIGMA)
    assert found == pytest.approx(np.eye(3) if together is None else together, abs=0.05)
    assert any("as independent" in n for n in known.notes) == (together is None)


def test_friction_that_a_urdf_states_is_listed(tmp_path, known, problem):
    """What is found beside it adds to it; a candidate begins from it, and is written once."""
    text = (urdf_folder() / "paper_sms.urdf").read_text()
    joint = re.search(r'<joint name="joint2".*?</joint>', text, re.DOTALL)
    assert joint
    stated = joint[0].replace("</joint>", '<dynamics damping="2.0" friction="0.5"/></joint>')
    (tmp_path / "x.urdf").write_text(text.replace(joint[0], stated))
    point = nominal(Description(name="x", urdf="x.urdf", folder=tmp_path), None).point
    more = point.with_effect(JointFriction(name="joint_friction_joint2", joint="joint2", viscous=0.3))
    forces = []
    for p in (point, more):
        model = p.model()
        v = np.zeros(model.nv)
        v[7] = 0.1
        forces.append(model.passive_forces(0.0, model.home, v)[7])
    assert forces == pytest.approx([-0.7, -0.73])
    again = build_model(more.description)
    assert [e.name for e in again.description.effect] == ["joint2_friction", "joint_friction_joint2"]
    every = {c.key: c for c in propose(known.point, problem, known.unknowns)}
    candidate = from_described(every["joint_friction", "joint2", "viscous"], point)
    assert candidate.effect is not None and candidate.free == ("joint2_friction.viscous",)
    assert (candidate.effect.viscous, candidate.effect.coulomb) == (2.0, 0.5)
    now = candidate.effect.with_values({"joint2_friction.viscous": 3.0})
    written = build_model(point.with_effect(now).description)
    assert [e.viscous for e in written.description.effect] == [3.0]
