"""A structure whose motion is taken as unknown, and taken in again."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._noise_covariance import InflatedFit, with_misfit
from smsid.diagnose._unknown_structure import but_for_a_structure, refit_noise, with_structure_again
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming
from smsid.experiments import fly, named_experiment
from smsid.model import build_model


@pytest.fixture(scope="module")
def softer(description, problem):
    """The recording of a craft whose panel is softer than described."""
    panel = description.get_effect("panel")
    described = description.with_effects(
        panel.model_copy(update={"youngs_modulus": 0.9 * panel.youngs_modulus})
    )
    model = build_model(described)
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 6.0})
    flown = fly(model, plan, np.random.default_rng(5)).recording
    data = measurements_of(model, flown, description.effective_sensors())
    return replace(problem, recording=flown, data=data)


def test_where_a_structure_is_all_that_is_wrong_the_rest_is_as_well_known_as_it_is_followed(known, softer):
    """Links' masses bend to a panel that is too soft, but not where its motion is unknown."""
    unknowns = [u for u in known.unknowns if u.column in (20, 30)]  # masses of the last links
    assert len(unknowns) == 2
    strayed = evaluate(known.point, unknowns, softer)
    found = but_for_a_structure(InflatedFit(strayed, np.ones(softer.data.rows), misfit=True))
    bent = fit(known.point, unknowns, softer, iterations=3)
    assert found is not None and found.unknown == "panel" and not found.misfit
    for u in unknowns:
        assert abs(found.fit.point.value(u) - u.nominal) < 3.0 * found.fit.sigma(u.name)
        assert abs(bent.point.value(u) - u.nominal) > 30.0 * bent.sigma(u.name)


def test_a_structure_is_unknown_only_where_that_tells_causes_as_well(known, softer):
    """Its wrench hides a thrust on the bus: of that, counted misfit tells more."""
    strayed = evaluate(known.point, known.unknowns[:3], softer)
    first = InflatedFit(strayed, np.ones(softer.data.rows), misfit=True)
    for better in (True, False):

        def told(found, place, better=better):
            assert place == "panel"
            return [1.0 if found.problem.noise.more else 1.0 - better + 2.0 * (not better)]

        found = refit_noise(first, told=told)
        assert (found.unknown == "panel") is better and found.misfit is not better


def test_what_is_wrong_elsewhere_is_not_laid_on_a_structure(known, problem, recording):
    told = np.array(recording["command.joint_torque"])
    told[:, 1] *= 1.5
    wrong = replace(problem, recording=recording.with_channels({"command.joint_torque": told}))
    strayed = evaluate(known.point, known.unknowns[:1], wrong)
    assert but_for_a_structure(InflatedFit(strayed, np.ones(problem.data.rows), misfit=True)) is None


def test_commands_act_as_they_do_once_the_rest_is_followed(known, softer):
    """Held, as they were taken while nothing followed, they made a bias of accelerometers a cause."""
    held = replace(softer, timing=CommandTiming("held", "right"))
    strayed = evaluate(known.point, known.unknowns[:3], held)
    found = but_for_a_structure(InflatedFit(strayed, np.ones(softer.data.rows), misfit=True))
    assert found is not None and found.fit.problem.timing == CommandTiming("linear", "right")


def test_a_structure_is_taken_in_again_from_where_the_rest_was_before(known, softer):
    """Unknown, it lets what it alone tells of go anywhere: from there nothing was followed again, 90 times
    the noise was left on the bus' position where 1.4 is.
    """
    bodies = [u for u in known.unknowns if u.kind == "inertial"]
    before = with_misfit(InflatedFit(evaluate(known.point, bodies, softer), np.ones(softer.data.rows)))
    away = known.point.moved(bodies[:10], np.array([8.0 * u.scale for u in bodies[:10]]))
    lost = replace(before, fit=evaluate(away, bodies, softer), misfit=False, unknown="panel")
    again = with_structure_again(lost, softer, before.fit, ())
    assert again.misfit and not again.local
    bent = with_structure_again(lost, softer, lost.fit, ())
    assert again.fit.objective < bent.fit.objective - 30.0
    # but what causes have is theirs
    kept = with_structure_again(lost, softer, before.fit, {u.name for u in bodies})
    assert kept.fit.objective == bent.fit.objective
