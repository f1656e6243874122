"""Outside of its own room no code asks which effect it has: the effect says what is wanted of it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest

import smsid
import smsid.effects
from smsid.effects import Effect, catalogue

SOURCES = Path(smsid.__file__).parent
STILL: set[str] = set()  # rooms in which some are left


def _subclasses(cls: type) -> Iterator[type]:
    for sub in cls.__subclasses__():
        yield sub
        yield from _subclasses(sub)


CLASSES = {c.__name__ for c in _subclasses(Effect) if c.__module__.startswith("smsid.effects.")}
KINDS = set(catalogue())


def _named(node: ast.AST) -> set[str]:
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return names | {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def _words(node: ast.AST) -> set[str]:
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def _assigned(statement: ast.stmt) -> tuple[str, ast.expr] | None:
    if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
        return statement.targets[0].id, statement.value
    if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.value:
        return statement.target.id, statement.value
    return None


def asked(source: str) -> list[int]:
    """Return the lines of a module that ask an effect which it is."""
    tree = ast.parse(source)
    classes, kinds = set(CLASSES), set()
    for name, value in filter(None, map(_assigned, tree.body)):  # constants of classes, or of kinds
        if isinstance(value, ast.Tuple | ast.List | ast.Set | ast.Dict | ast.BinOp):
            classes |= {name} if _named(value) & CLASSES else set()
            kinds |= {name} if _words(value) & KINDS and not isinstance(value, ast.Dict) else set()
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("isinstance", "issubclass", "register") and _named(ast.Tuple(node.args)) & classes:
                lines.append(node.lineno)
        elif isinstance(node, ast.FunctionDef):  # of functools.singledispatch
            own = [d for d in node.decorator_list if isinstance(d, ast.Attribute) and d.attr == "register"]
            first = node.args.args[0].annotation if own and node.args.args else None
            if first is not None and _named(first) & classes:
                lines.append(node.lineno)
        elif isinstance(node, ast.MatchClass) and _named(node.cls) & classes:
            lines.append(node.pattern.lineno if hasattr(node, "pattern") else node.lineno)
        elif isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            of_type = [s for s in sides if isinstance(s, ast.Call) and getattr(s.func, "id", "") == "type"]
            of_kind = [s for s in sides if isinstance(s, ast.Attribute) and s.attr == "kind"]
            others = ast.Tuple([s for s in sides if s not in of_type and s not in of_kind])
            if of_type and _named(others) & classes:
                lines.append(node.lineno)
            if of_kind and (_words(others) & KINDS or _named(others) & kinds):
                lines.append(node.lineno)
    return sorted(lines)


def _rooms() -> list[str]:
    return sorted({p.relative_to(SOURCES).parts[0].removesuffix(".py") for p in SOURCES.rglob("*.py")})


@pytest.mark.parametrize("room", [r for r in _rooms() if r not in {"effects", *STILL}])
def test_nobody_asks_an_effect_which_it_is(room: str) -> None:
    files = [*(SOURCES / room).rglob("*.py"), *SOURCES.glob(f"{room}.py")]
    found = [f"{f.relative_to(SOURCES)}:{n}" for f in files for n in asked(f.read_text(encoding="utf-8"))]
    assert not found, f"give the effect a method or a declaration instead: {', '.join(found)}"


@pytest.mark.parametrize(
    "question",
    [
        "isinstance(e, Slosh)",
        "isinstance(e, Gear | Servo)",
        "issubclass(kind, effects.Appendage)",
        "[e for e in effects if not isinstance(e, (Payload, BodyError))]",
        "type(e) is JointFriction",
        "PANELS = (BeamMode, ModeError)\ntype(e) in PANELS",
        "WHY: dict = {BeamMode: 'a reason'}\nisinstance(e, tuple(WHY))",
        'e.kind == "slosh"',
        'e.kind not in ("slosh", "payload")',
        'KINDS = ("slosh", "gear")\ne.kind in KINDS',
        "match e:\n    case Slosh():\n        pass",
        "@columns.register\ndef _(effect: Servo, model): ...",
        "columns.register(Gear)(f)",
    ],
)
def test_a_question_is_noticed(question: str) -> None:
    assert asked(question)


@pytest.mark.parametrize(
    "fine",
    [
        "isinstance(e, Effect)",
        "e.kind == sensor.kind",
        's.kind == "imu"',
        "Slosh(name='tank')",
        "type(x) is int",
    ],
)
def test_other_questions_are_left_alone(fine: str) -> None:
    assert not asked(fine)


def test_the_classes_are_those_of_the_catalogue() -> None:
    assert {c.__name__ for c in catalogue().values()} <= CLASSES
    assert {n for n, c in inspect.getmembers(smsid.effects, inspect.isclass) if issubclass(c, Effect)} <= {
        *CLASSES,
        "Effect",
    }
