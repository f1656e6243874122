"""Equations as MathML, written when the pages are built: no script and no network when they are read."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
# latex2mathml passes what it does not know on as text: an unknown command must not reach a page unseen
UNKNOWN = re.compile(r"<m[a-z]+[^>]*>[^<]*\\[A-Za-z]+")


def mathml(latex: str, display: str, node: nodes.Node) -> str:
    """Return the equation as MathML; what cannot be converted is a warning, an error of the build."""
    try:
        text = convert(latex, display=display)
    except Exception as error:  # of any kind: latex2mathml has no common base class
        logger.warning("equation not understood (%r): %s", error, latex, location=node)
        return ""
    if found := UNKNOWN.search(text):
        logger.warning("equation holds an unknown command %r: %s", found.group(), latex, location=node)
    return text.replace("<mover>", '<mover accent="true">')  # dots and hats at full size


def inline(self: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    self.body.append(mathml(node.astext(), "inline", node))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write a displayed equation, its number of the paper beside it where it has one."""
    latex = node.astext()
    tag = re.search(r"\\tag\{([^}]*)\}", latex)
    body = mathml(re.sub(r"\\tag\{[^}]*\}", "", latex), "block", node)
    number = f'<span class="eqno">({tag.group(1)})</span>' if tag else ""
    self.body.append(f'<div class="equation">{body}{number}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer as ``mathml``."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
