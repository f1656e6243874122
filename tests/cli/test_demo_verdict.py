"""What the demo names is what is hidden in its flight, with its size, and nothing else."""

from __future__ import annotations

from smsid.cli.demo import identify_craft
from smsid.datasets import demonstration
from smsid.diagnose import diagnose


def test_the_demo_names_what_is_hidden_and_its_size():
    which = demonstration()
    description, estimation, _, refinement, _ = identify_craft(which)
    found = diagnose(description, [estimation], estimate=refinement.estimate)
    (cause,) = found.diagnosis.causes
    (value,) = cause.parameters
    assert found.diagnosis.verdict == "explained", found.diagnosis.sentence
    assert value.name.endswith(which.hidden["parameter"].rsplit(".", 1)[-1])
    assert abs(value.value - which.hidden["value"]) < 3.0 * value.sigma < 0.01 * which.hidden["value"]
