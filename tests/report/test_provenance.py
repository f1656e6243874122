"""Where a report is from is told by sums that other tools give too."""

from __future__ import annotations

import hashlib

from smsid.description import load_description
from smsid.report import files_of, provenance


def test_sums_versions_and_seed(tmp_path):
    file = tmp_path / "a.nc"
    file.write_bytes(b"samples")
    found = provenance([file, file], seed=3)
    assert found.inputs == {str(file): hashlib.sha256(b"samples").hexdigest()}
    assert found.seed == "3"
    assert {"smsid", "python", "pinocchio", "numpy", "scipy"} <= set(found.versions)
    assert provenance([tmp_path / "none"]).inputs == {str(tmp_path / "none"): "not a file"}


def test_the_urdf_of_a_description_is_an_input_too(urdf):
    path = urdf / "two_arm_sms.toml"
    names = [p.rpartition("/")[2] for p in files_of(load_description(path), path)]
    assert names[0] == "two_arm_sms.toml"
    assert any(n.endswith(".urdf") for n in names)
