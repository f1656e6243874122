"""What was found on an arm is identified and diagnosed again: by every command that reads a description."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.arm import identify_arm
from smsid.cli.app import app
from smsid.description import load_description, save_description
from smsid.diagnose import diagnose
from smsid.effects import BodyError, Payload
from smsid.export import export_folder
from smsid.identify.estimate import save_estimate
from smsid.recording import save_recording
from tests.diagnose.torque_world import described, recorded

CARRIED = 8.0  # [kg] at the tool, as MuJoCo has it
HELD = Payload(name="held", frame="tool", mass=CARRIED)


@pytest.fixture(scope="module")
def bare():
    """An estimate of the same arm without what it carries."""
    return identify_arm(described(), recorded(seed=99), cutoff=20.0).estimate


def combinations(found):
    return np.array([[p.value, p.sigma, p.nominal] for p in found.estimate.parameters]).T


def test_a_payload_is_part_of_its_link():
    """What torques show is the sum, whatever is listed; the described values are those of the sum too."""
    log = recorded(seed=3, payload=CARRIED)
    without = combinations(identify_arm(described(), log))
    value, sigma, nominal = combinations(identify_arm(described().with_effects(HELD), log))
    assert np.allclose(value, without[0]) and np.allclose(sigma, without[1])
    assert np.abs((value - nominal) / sigma).max() < 4.5
    assert np.abs((without[0] - without[2]) / sigma).max() > 50.0


def test_what_an_arm_carries_is_found_once(bare, tmp_path):
    """Diagnosed, identified, diagnosed again with more in the hand: each starts from what the last wrote."""
    first = diagnose(described(), [recorded(seed=6, payload=CARRIED)], estimate=bare)
    (cause,) = first.diagnosis.causes
    assert cause.effect == "payload"
    known = identify_arm(first.extended, recorded(seed=7, payload=CARRIED)).estimate
    again = diagnose(first.extended, [recorded(seed=8, payload=CARRIED)], estimate=known)
    assert again.diagnosis.verdict == "adequate", again.diagnosis.sentence
    more = diagnose(first.extended, [recorded(seed=9, payload=2.0 * CARRIED)], estimate=known)
    (cause,) = more.diagnosis.causes
    (mass,) = [p for p in cause.parameters if p.name.endswith(".mass")]
    assert abs(mass.value - CARRIED) < 4.0 * mass.sigma < 1.0
    carried = [e.mass for e in more.extended.effect if e.kind == "payload"]
    assert len(carried) == 2 and abs(sum(carried) - 2.0 * CARRIED) < 1.0


def test_an_arm_with_a_denser_link_is_exported_as_identified(tmp_path):
    """A share of the described link is not one of the link as it is written."""
    listed = described().with_effects(BodyError(name="dense", body="link3", density=0.5))
    known = identify_arm(listed, recorded(seed=7, payload=CARRIED)).estimate
    export_folder(listed, tmp_path / "out", known)
    (path,) = (tmp_path / "out").glob("*.toml")
    value, sigma, nominal = combinations(
        identify_arm(load_description(path), recorded(seed=8, payload=CARRIED))
    )
    assert np.abs((value - nominal) / sigma).max() < 6.0


def test_links_that_were_found_with_a_cause_are_found_again():
    """Without an estimate links are identified with the cause, and written as shifts of the described ones:
    of a description that has such shifts already, on top of these.
    """

    def rubbing(q, v, a, load):
        return 40.0 * v * np.array([0.0, 1.0, 0.0])

    first = diagnose(described(), [recorded(rubbing, seed=6, payload=CARRIED)])
    second = diagnose(first.extended, [recorded(rubbing, seed=7, payload=CARRIED)])
    direct = diagnose(described(), [recorded(rubbing, seed=7, payload=CARRIED)])
    assert {c.effect for c in first.diagnosis.causes} == {"joint_friction"}
    log, links = recorded(rubbing, seed=8, payload=CARRIED), slice(0, 6)
    for made in (first, second, direct):
        value, sigma, nominal = combinations(identify_arm(made.extended, log))
        assert np.abs((value - nominal) / sigma)[links].max() < 6.0
    value, sigma, nominal = combinations(identify_arm(described(), log))
    assert np.abs((value - nominal) / sigma)[links].max() > 50.0


def test_commands_take_what_a_diagnosis_wrote(bare, tmp_path):
    """`identify`, `diagnose`, `show` and `export` of extended.toml."""
    save_description(described(), tmp_path / "arm.toml")
    save_estimate(bare, tmp_path / "bare.json")
    for seed in (6, 7):
        save_recording(recorded(seed=seed, payload=CARRIED, name=f"log{seed}"), tmp_path / f"log{seed}.h5")

    def run(*arguments):
        done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return done.output

    log6, log7 = (tmp_path / f"log{k}.h5" for k in (6, 7))
    run(
        "diagnose",
        tmp_path / "arm.toml",
        log6,
        "--estimate",
        tmp_path / "bare.json",
        "-o",
        tmp_path / "a.json",
    )
    extended, known, told = (tmp_path / n for n in ("extended.toml", "known.json", "b.json"))
    assert [e.kind for e in load_description(extended).effect] == ["payload"]
    run("identify", extended, log7, "-o", known)
    run("diagnose", extended, log7, "--estimate", known, "-o", told)
    assert json.loads(told.read_text())["verdict"] == "adequate"
    run("show", extended)
    run("export", extended, known, "-o", tmp_path / "exported")
    (exported,) = (tmp_path / "exported").glob("*.toml")
    again = combinations(identify_arm(load_description(exported), recorded(seed=8, payload=CARRIED)))
    assert np.abs((again[0] - again[2]) / again[1]).max() < 6.0
