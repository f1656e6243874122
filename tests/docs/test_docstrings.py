"""The package documents itself: a walk over every public function, method and class.

What is asked can be met by a sentence; that the sentence is true, readers have to see.
"""

from __future__ import annotations

import ast
import re

import pytest

from tests.docs.docstrings import CONVENTIONAL, NUMERICAL, SHAPE, SOURCE, UNIT, Function, classes, functions
from tests.docs.pages import ROOT

FUNCTIONS = functions()


def test_the_walk_finds_the_package() -> None:
    """A walk that finds nothing would find nothing wrong."""
    names = {f"{f.module}.{f.name}" for f in FUNCTIONS}
    assert len(names) > 1000
    assert {
        "smsid.identify._tls.total_least_squares",
        "smsid.model.spacecraft.SpacecraftModel.momentum",
    } <= names
    assert sum(f.exported for f in FUNCTIONS) > 200
    assert sum(bool(f.arrays) for f in FUNCTIONS) > 200


def test_everything_public_has_a_docstring() -> None:
    missing = [f.place for f in FUNCTIONS if not ast.get_docstring(f.node)]
    missing += [place for place, node in classes() if not ast.get_docstring(node)]
    assert not missing, listed(missing)


def test_arrays_have_shapes() -> None:
    """``(N, 3)``, ``(n,)``, or a word on whose shape it is."""
    missing = [f.place for f in FUNCTIONS if (f.arrays or f.gives_array) and not SHAPE.search(f.doc)]
    assert not missing, listed(missing)


def test_every_array_argument_is_named() -> None:
    """With several arrays, each is spoken of by name, but for those of section 1 of docs/design.md."""
    missing = []
    for f in FUNCTIONS:
        others = [x for x in f.arrays if x not in CONVENTIONAL]
        unnamed = [x for x in others if not re.search(rf"\b{re.escape(x)}s?\b", f.doc)]
        if (
            len(f.arrays) > 1
            and unnamed
            and not re.search(r"\bas (in|of|for|there|taken by|given to)\b", f.doc)
        ):
            missing.append(f"{f.place}: {', '.join(unnamed)}")
    assert not missing, listed(missing)


def test_what_is_raised_is_named() -> None:
    missing = []
    for f in FUNCTIONS:
        own = f.doc + ((ast.get_docstring(f.owner) or "") if f.owner else "")
        unnamed = sorted(x for x in f.raised if x not in own)
        if unnamed:
            missing.append(f"{f.place}: {', '.join(unnamed)}")
    assert not missing, listed(missing)


def test_exported_functions_of_arrays_have_units() -> None:
    missing = [f.place for f in surface() if not UNIT.search(f.doc + f.around)]
    assert not missing, listed(missing)


def test_exported_numerical_functions_name_their_source() -> None:
    """An equation of the paper, a publication, or a twin in another library; of it or of its module."""
    missing = [
        f.place
        for f in surface()
        if f.module.split(".")[1] in NUMERICAL and not SOURCE.search(f.doc + f.around)
    ]
    assert not missing, listed(missing)


def test_the_conventional_names_are_explained() -> None:
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    section = text[text.index("## 1.") : text.index("## 2.")]
    assert all(f"`{name}`" in section for name in CONVENTIONAL)


@pytest.mark.parametrize(
    ("text", "has"),
    [("(N, 3) of it", True), ("x (n,) [m]", True), ("of the same shape", True), ("(see there)", False)],
)
def test_what_counts_as_a_shape(text: str, has: bool) -> None:
    assert bool(SHAPE.search(text)) is has


def surface() -> list[Function]:
    """Return exported functions, no methods, that take arrays: classes say the units of theirs once."""
    return [f for f in FUNCTIONS if f.exported and f.owner is None and f.arrays]


def listed(places: list[str]) -> str:
    """Return a message."""
    return f"{len(places)} docstrings to mend:\n" + "\n".join(places)
