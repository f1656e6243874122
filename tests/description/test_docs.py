"""docs/description.md and docs/effects.md list every key; the tables of effects are the catalogue's."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from smsid.description import Arm, Description, Mount, Thrust, Thruster, Wheel, load_description
from smsid.description.robots import robot_files, robots_folder
from smsid.effects import Effect, Mode, catalogue
from smsid.errors import MissingDependencyError
from smsid.model import build_model
from smsid.recording.channels import QUANTITIES
from smsid.sensing import ErrorModel
from smsid.sensing.sensor import MEASURES, Sensor
from tests.description.reference import (
    BEGIN,
    CHANNELS,
    END,
    ERRORS,
    SHARED,
    channels_reference,
    effects_reference,
    errors_reference,
    shared_reference,
    write_reference,
)

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs" / "description.md"
TEXT = DOCS.read_text(encoding="utf-8")
EFFECTS = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")


def section(title: str, page: str = TEXT) -> str:
    """The text under a heading, up to the next heading of its level or above."""
    level = title.split(" ")[0]
    start = page.index(f"\n{title}\n") + len(title) + 2
    end = re.search(rf"^#{{1,{len(level)}}} ", page[start:], re.MULTILINE)
    return page[start:][: end.start()] if end else page[start:]


def keys(text: str) -> list[str]:
    return re.findall(r"^\| `(\w+)`", text, re.MULTILINE)


@pytest.mark.parametrize(
    ("title", "model"),
    [
        ("## Top of the file", Description),
        ("## `[thrust]`", Thrust),
        ("## `[[thruster]]`", Thruster),
        ("### `mount`", Mount),
        ("## `[[wheel]]`", Wheel),
        ("## `[[sensor]]`", Sensor),
    ],
)
def test_every_key_is_listed_and_no_other(title, model):
    tables = ("thrust", "thruster", "wheel", "arm", "effect", "sensor")  # they have sections of their own
    fields = {
        info.alias or name
        for name, info in model.model_fields.items()
        if not info.exclude and not (model is Description and name in tables)
    }
    listed = keys(section(title))
    assert len(listed) == len(set(listed))
    assert set(listed) == fields


def test_every_key_of_an_arm_is_listed():
    listed = keys(section("## `[[arm]]`").split("### `mount`")[0])
    assert set(listed) == set(Arm.model_fields)


def test_every_kind_and_parameter_of_an_effect_is_listed():
    begin, end = SHARED
    shared = EFFECTS.split(begin)[1].split(end)[0].strip()
    assert shared == shared_reference().strip(), "write it anew with python -m tests.description.reference"
    assert set(keys(shared)) == set(Effect.model_fields) - {"kind"}
    for kind, cls in catalogue().items():
        text = section(f"## `{kind}`", EFFECTS)
        assert set(keys(text)) >= set(cls.model_fields) - {"kind", *keys(shared)}
        for name, info in cls.model_fields.items():
            if isinstance(info.json_schema_extra, dict):
                assert f"| `{name}` | {info.json_schema_extra['unit']} |" in text
    assert set(keys(section("## `modal_appendage`", EFFECTS))) >= set(Mode.model_fields)
    for kind in MEASURES:
        assert f"`{kind}`" in section("## `[[sensor]]`")


def test_the_table_of_errors_is_that_of_the_model():
    begin, end = ERRORS
    inside = TEXT.split(begin)[1].split(end)[0].strip()
    assert inside == errors_reference().strip(), "write it anew with python -m tests.description.reference"
    assert set(keys(inside)) == set(ErrorModel.model_fields)


def test_the_table_of_channels_is_that_of_the_code():
    begin, end = CHANNELS
    inside = (ROOT / "docs" / "design.md").read_text(encoding="utf-8").split(begin)[1].split(end)[0].strip()
    assert inside == channels_reference().strip(), "write it anew with python -m tests.description.reference"
    assert all(q.meaning for q in QUANTITIES.values())


def test_the_table_of_effects_is_that_of_the_catalogue(tmp_path):
    inside = EFFECTS.split(BEGIN)[1].split(END)[0].strip()
    assert inside == effects_reference().strip(), "write it anew with python -m tests.description.reference"
    copy = tmp_path / "x.md"
    before, after = EFFECTS.split(BEGIN)[0], EFFECTS.split(END)[1]
    copy.write_text(before + BEGIN + "stale" + END + after, encoding="utf-8")
    write_reference(copy)
    assert copy.read_text(encoding="utf-8") == EFFECTS


def test_every_key_of_the_built_in_effects_has_a_meaning():
    for line in effects_reference().splitlines():
        if line.startswith("| `"):
            assert line.split("|")[4].strip(), line


def test_defaults_are_as_listed():
    for title, model in (
        ("## Top of the file", Description),
        ("## `[[wheel]]`", Wheel),
        ("### `mount`", Mount),
    ):
        for line in section(title).splitlines():
            found = re.match(r"\| `(\w+)` \|[^|]*\| `([^`]*)` \|", line)
            if found is None:
                continue
            name = {"schema": "schema_version"}.get(found[1], found[1])
            default = model.model_fields[name].get_default(call_default_factory=True)
            written = tomllib.loads(f"x = {found[2]}")["x"]
            assert (list(default) if isinstance(default, tuple) else default) == written, line


def test_the_example_loads_and_builds(tmp_path):
    try:
        robots_folder()
    except MissingDependencyError:
        pytest.skip("example-robot-data is not installed")
    example = TEXT.split("```toml\n")[1].split("```")[0]
    file = tmp_path / "inspector.toml"
    file.write_text(example.replace('"bus.urdf"', f'"{(ROOT / "urdf" / "bus.urdf").as_posix()}"'))
    model = build_model(load_description(file))
    assert len(model.arm_joints) == 6 and len(model.wheels) == 1 and len(model.slosh) == 1
    named = re.search(r"A robot is called .*?\n\n", TEXT, re.DOTALL)
    assert named is not None
    mentioned = re.findall(r"`([a-z0-9_]+)`", named[0])[1:]
    assert set(mentioned) <= set(robot_files()) and len(mentioned) >= 12
