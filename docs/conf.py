# ruff: noqa: INP001  (Sphinx reads this file by its path; it belongs to no package)
"""How Sphinx builds these pages: ``./run docs``. Nothing is fetched from the network."""

from __future__ import annotations

from importlib.metadata import version as installed_version
from typing import Any

project = "simple_ros"
release = version = installed_version("simple-ros")
html_title = f"{project} {release}"
html_show_copyright = False
html_theme = "furo"
html_copy_source = False

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
suppress_warnings = [
    # Pages are read on their own as well; there a section may begin below the top.
    "myst.header",
]

# Links are those that GitHub follows, too: to files, and to headings by their slugs.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

# Docstrings name things in single backticks; what is documented here becomes a link.
default_role = "py:obj"
autoclass_content = "both"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"


def keep_colons(*args: Any) -> None:
    """Let napoleon find no type before the first colon of an attribute's or property's docstring."""
    _, what, _, _, _, lines = args
    if what in ("attribute", "data", "property") and lines:
        lines[:0] = ["..", ""]  # an empty comment


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", keep_colons, priority=400)
