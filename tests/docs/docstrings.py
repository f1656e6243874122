"""What the public functions of the package say of themselves, read from the source without importing it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from tests.docs.pages import ROOT

PACKAGE = ROOT / "smsid"
ARRAY = re.compile(r"ndarray|NDArray|ArrayLike|FloatArray")
SHAPE = re.compile(
    r"\((?:[^()]|\([^()]*\))+,(?:[^()]|\([^()]*\))*\)"  # (n, 3), (n,), (2 (n - 1), 3)
    r"|\b(?:any|same|its|their|this) shapes?\b|\bas (?:in|of|for|there|taken by|given to)\b"
)
UNIT = re.compile(r"\[[^\]\n]+\]|\bdimensionless\b|\bunit\b")
SOURCE = re.compile(
    r"\(\d+\)|\bequations?\b|\bsection\b|\bTwin\b|\bSource\b|\btwin\b|\b(?:19|20)\d\d\b|`(?:numpy|scipy|pinocchio)\."
)
CONVENTIONAL = {"q", "v", "a", "tau", "t"}
"""Names whose meaning, shape and units section 1 of docs/design.md fixes for the whole package."""
NUMERICAL = ("arm", "control", "identify", "lab", "likelihood", "sensing")


@dataclass(frozen=True)
class Function:
    """A public function or method with the docstrings around it; ``exported`` by its subpackage."""

    module: str
    name: str
    node: ast.FunctionDef
    module_doc: str
    owner: ast.ClassDef | None
    exported: bool
    inherited: list[Function] = field(default_factory=list, compare=False)

    @property
    def place(self) -> str:
        """Where it is."""
        return f"{self.module}:{self.node.lineno} {self.name}"

    @cached_property
    def doc(self) -> str:
        """Its docstring, and those of the methods it stands in for."""
        own = ast.get_docstring(self.node) or ""
        return "\n".join([own, *(f.doc for f in self.inherited)])

    @cached_property
    def around(self) -> str:
        """Docstrings of its class and module."""
        return "\n".join([(ast.get_docstring(self.owner) or "") if self.owner else "", self.module_doc])

    @cached_property
    def arrays(self) -> list[str]:
        """Names of its arguments that are arrays."""
        a = self.node.args
        every = [*a.posonlyargs, *a.args, *a.kwonlyargs]
        return [x.arg for x in every if x.annotation and ARRAY.search(ast.unparse(x.annotation))]

    @property
    def gives_array(self) -> bool:
        """Whether it returns arrays."""
        return self.node.returns is not None and bool(ARRAY.search(ast.unparse(self.node.returns)))

    @property
    def raised(self) -> set[str]:
        """Exceptions of the package that its own body raises."""
        found, left = set(), list(self.node.body)
        while left:
            x = left.pop()
            if isinstance(x, ast.FunctionDef | ast.Lambda | ast.ClassDef):
                continue
            if isinstance(x, ast.Raise) and isinstance(x.exc, ast.Call):
                found.add(ast.unparse(x.exc.func))
            left.extend(ast.iter_child_nodes(x))
        return {x for x in found if x.endswith("Error")} - {"NotImplementedError", "AssertionError"}


def exported() -> dict[str, set[str]]:
    """Return by module what the ``__init__`` of a subpackage takes from it."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("__init__.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                found.setdefault(node.module, set()).update(alias.name for alias in node.names)
    return found


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Give every public module with its name in the package; the command line documents itself by --help."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts[0] == "cli" or parts[-1].endswith("command"):
            continue
        yield ".".join(("smsid", *parts)), ast.parse(path.read_text(encoding="utf-8"))


def functions() -> list[Function]:
    """Return all public functions and methods."""
    offered, found = exported(), []
    methods: dict[str, list[Function]] = {}
    for module, tree in modules():
        doc = ast.get_docstring(tree) or ""
        surface = offered.get(module, set())
        for node, owner in _public(tree):
            name = f"{owner.name}.{node.name}" if owner else node.name
            # control exports nothing by name: all its modules are its surface
            own = name.split(".")[0] in surface or module.startswith("smsid.control.")
            f = Function(module, name, node, doc, owner, own)
            found.append(f)
            if owner:
                methods.setdefault(name, []).append(f)
    for f in found:
        for base in f.owner.bases if f.owner else ():
            f.inherited.extend(methods.get(f"{ast.unparse(base)}.{f.node.name}", ()))
    return found


def _public(tree: ast.Module | ast.ClassDef) -> Iterator[tuple[ast.FunctionDef, ast.ClassDef | None]]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node, tree if isinstance(tree, ast.ClassDef) else None
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node)


def classes() -> list[tuple[str, ast.ClassDef]]:
    """Return all public classes by their place."""
    return [
        (f"{module}:{node.lineno} {node.name}", node)
        for module, tree in modules()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
