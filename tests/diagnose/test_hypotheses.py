"""Which effects are proposed where."""

import re
import shutil
from itertools import combinations

import numpy as np

from smsid.description import load_description
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.diagnose.score_test import signatures
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder


def test_a_gear_may_give_at_a_joint_that_slides_too(tmp_path):
    """There no link carries its rotor round."""
    folder = tmp_path / "urdf"
    shutil.copytree(urdf_folder(), folder)
    path = folder / "paper_sms.toml"
    (name,) = re.findall(r'"([^"]+\.urdf)"', path.read_text())
    turning = (folder / name).read_text()
    sliding = re.sub(r'(<joint name="joint3" type=")[a-z]+', r"\1prismatic", turning)
    assert sliding != turning
    (folder / name).write_text(sliding)
    description = load_description(path)
    model = build_model(description)
    plan = named_experiment("exp2", model).model_copy(update={"duration": 5.0})
    recording = fly(model, plan, np.random.default_rng(3)).recording
    known = nominal(description, None)
    sensors = known.point.description.effective_sensors()
    data = measurements_of(known.point.base, recording, sensors).thinned(10.0)
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    gears = [c for c in propose(known.point, problem, known.unknowns) if c.kind == "gear_compliance"]
    by_joint = {c.location: c.effect for c in gears}
    assert set(by_joint) == {"joint1", "joint2", "joint3"}
    carried = {c.location: any(name.endswith(".carried") for name in c.free) for c in gears}
    assert carried == {"joint1": True, "joint2": True, "joint3": False}
    current = evaluate(known.point, known.unknowns[:1], problem)
    assert set(signatures(current, gears)) == {0, 1, 2}


def test_candidates_that_share_an_effect_agree_on_what_it_is(known, problem):
    """What is fitted of one is part of the other then: no effect follows two laws."""
    for a, b in combinations(propose(known.point, problem, known.unknowns), 2):
        if a.effect is None or b.effect is None or a.effect.name != b.effect.name:
            continue
        numbers = {p.name.rpartition(".")[2] for e in (a.effect, b.effect) for p in e.parameters()}
        assert a.effect.model_dump(exclude=numbers) == b.effect.model_dump(exclude=numbers)
