"""How the pages are built: `make docs`, or sphinx-build -W docs build/docs."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))

import smsid  # noqa: E402

project = "smsid"
author = "the smsid authors"
version = release = smsid.__version__
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_parser",
    "api_pages",
    "measured_pages",
    "mathml",
]

# Markdown: equations between dollars, definition lists, anchors of headings
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
myst_dmath_double_inline = False
exclude_patterns = ["_ext"]

# API: from the docstrings, which are in Google's style
default_role = "py:obj"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "separated"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88

# Pages: nothing is fetched when they are read
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"smsid {version}"
html_static_path = ["_static"]
html_css_files = ["smsid.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
