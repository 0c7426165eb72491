"""Settings of the documentation site; `make docs` builds it into docs/html."""

from __future__ import annotations

import pathlib
import sys
from typing import Any

DOCS = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))

from site_pages.write_pages import write_pages  # noqa: E402

project = "vtff"
author = "vtff developers"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb"]
exclude_patterns = ["html", "jupyter_execute", "site_pages", "**/.ipynb_checkpoints"]
html_theme = "furo"
html_title = "vtff"
html_show_sourcelink = False
html_copy_source = False

# Single backticks in docstrings name Python objects, files and values alike.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
# Types of parameters are words of the numpy style ("sequence of float"), not always names of
# objects: Sphinx finds several objects of such a name and chooses none.
suppress_warnings = ["ref.python"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_timeout = 60  # s for one cell; a tutorial takes less than a minute
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True


def setup(app: Any) -> None:
    """Write the pages that come from the code, and rewrite the links of the others."""
    rewriter = write_pages(DOCS.parent)

    def rewrite(app: Any, name: str, source: list[str]) -> None:
        if not name.startswith("generated/"):
            source[0] = rewriter.rewrite(source[0], f"docs/{name}.md", f"{name}.md")

    app.connect("source-read", rewrite)
