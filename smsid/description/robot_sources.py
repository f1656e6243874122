"""Robots as people have them: URDF, xacro, SDF and MJCF, all brought to the text of a URDF."""

from __future__ import annotations

import logging
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

from smsid.errors import DescriptionError, require

logger = logging.getLogger(__name__)

XACRO = re.compile(rb"<xacro:|=\s*[\"']\$[({]")
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
SUFFIXES = (".urdf", ".xacro", ".sdf", ".mjcf", ".xml")
"""What `load_description` takes in place of a TOML."""


def is_xacro(path: Path) -> bool:
    """Tell whether a file is a xacro, by its suffix or by what stands in it."""
    return path.suffix == ".xacro" or (
        path.is_file() and bool(XACRO.search(COMMENT.sub(b"", path.read_bytes())))
    )


def robot_xml(path: Path, arguments: Mapping[str, str] | None = None, folders: Sequence[Path] = ()) -> bytes:
    """Return a robot's file as a URDF; what a URDF cannot say is logged by name.

    Args:
        path: URDF, xacro, SDF or MJCF.
        arguments: of a xacro.
        folders: searched for packages that a xacro includes, besides those above ``path``.

    Raises:
        DescriptionError: the file is missing, cannot be expanded, or holds what no URDF can say.
        MissingDependencyError: xacrodoc or MuJoCo is not installed.
    """
    if not path.is_file():
        raise DescriptionError(
            f"The URDF '{path}' does not exist.", advice="Check the `urdf` key of the TOML.", path=str(path)
        )
    content = path.read_bytes()
    bare = COMMENT.sub(b"", content)
    if is_xacro(path):
        return without_world(expand_xacro(path, arguments or {}, folders), str(path))
    if path.suffix == ".mjcf" or (re.search(rb"<mujoco[\s>]", bare) and not re.search(rb"<robot[\s>]", bare)):
        from smsid.description._mjcf_reading import mjcf_to_urdf

        return mjcf_to_urdf(path)
    if path.suffix == ".sdf" or re.search(rb"<sdf[\s>]", bare):
        from smsid.description._sdf_reading import sdf_to_urdf

        return sdf_to_urdf(content, str(path))
    return without_world(content, str(path))


def expand_xacro(path: Path, arguments: Mapping[str, str], folders: Sequence[Path]) -> bytes:
    """Return what a xacro file expands to; once, as long as it and what it includes stay as they are.

    Raises:
        DescriptionError: xacro cannot expand it, or it has no argument of a name given.
        MissingDependencyError: xacrodoc is not installed.
    """
    xacrodoc = require("xacrodoc", "xacro")
    xacro = require("xacro", "xacro")
    key = (path.resolve(), tuple(sorted(arguments.items())), tuple(folders))
    known = _expansions.get(key)
    if known is not None and known[0] == _stamps(known[0]):
        return known[1]
    xacrodoc.packages.look_in([str(f) for f in folders if f.is_dir()])
    xacrodoc.packages.walk_up_from(path)
    told = StringIO()
    try:
        with redirect_stderr(told):
            # not `XacroDoc.from_file`: it looks for what is included by a relative path in the working folder
            text = xacro.process_file(str(path.resolve()), mappings=dict(arguments)).toxml()
    except Exception as error:  # xacro raises what its expressions raise
        reason = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
        name = re.search(r"[Uu]ndefined substitution argument '?(\w+)", f"{error}")
        undeclared = "unbound prefix" in str(error)
        advice = (
            'Declare the prefix: <robot xmlns:xacro="http://www.ros.org/wiki/xacro" ...>, or expand it with '
            "xacro first."
            if undeclared
            else f"Give it: {name.group(1)}:=VALUE on the command line, or under [arguments] in the TOML."
            if name
            else "Mend the file; packages it includes are looked for above it and in `package_dirs`."
        )
        raise DescriptionError(
            f"xacro cannot expand '{path}': {reason}.", advice=advice, path=str(path)
        ) from error
    declared: set[str] = set()
    for file in (path, *map(Path, getattr(xacro, "all_includes", []) or [])):
        source = file.read_text(errors="replace") if file.is_file() else ""
        declared |= set(re.findall(r"<xacro:arg\s[^>]*?name\s*=\s*[\"']([^\"']+)", source))
        declared |= set(re.findall(r"\$\(arg\s+([^)\s]+)\s*\)", source))
    unknown = sorted(set(arguments) - declared)
    if unknown:
        raise DescriptionError(
            f"'{path}' has no argument {', '.join(map(repr, unknown))}.",
            advice=f"It has: {', '.join(sorted(declared)) or 'none'}.",
            arguments=unknown,
        )
    includes = [Path(x) for x in getattr(xacro, "all_includes", []) or []]
    _expansions[key] = (_stamps((path.resolve(), *includes)), text.encode())
    return text.encode()


_expansions: dict[tuple[object, ...], tuple[dict[Path, int], bytes]] = {}
"""What xacro files expanded to, with the times at which they and what they include were written [ns]."""


def _stamps(files: Iterable[Path]) -> dict[Path, int]:
    return {file: file.stat().st_mtime_ns if file.is_file() else -1 for file in files}


def without_world(content: bytes, source: str) -> bytes:
    """Return a URDF without a link that stands for the world, if its root floats in one.

    A root link without mass and without shape whose one joint is of type floating is the world; the craft
    begins at that joint's child.
    """
    try:
        parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
        root = ElementTree.fromstring(content, parser)
    except (ElementTree.ParseError, ValueError, LookupError):
        return content  # told where it is read
    joints = root.findall("joint")
    children = {end.get("link") for j in joints if (end := j.find("child")) is not None}
    tops = [link for link in root.findall("link") if link.get("name") not in children]
    if len(tops) != 1 or len(tops[0]):
        return content
    own = [
        j for j in joints if (end := j.find("parent")) is not None and end.get("link") == tops[0].get("name")
    ]
    if len(own) != 1 or own[0].get("type") != "floating":
        return content
    root.remove(tops[0])
    root.remove(own[0])
    logger.info("%s: link '%s' is the world; the craft floats in it.", source, tops[0].get("name"))
    return ElementTree.tostring(root, encoding="utf-8")
