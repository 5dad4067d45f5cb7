"""Sphinx's configuration: the Markdown files of the repository as they are, and the reference from
the docstrings.

The source folder is the root of the repository, so that links between pages are the same here and
on a code host. The side bar and the lists of subpages are added to the text when a page is read
(``contents.py``).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

from contents import FOLDERS, ROOT, TITLES, sections, subpages
from reference import write_reference

import physic_core

project = "PhySIC"
author = "PhySIC contributors"
release = version = physic_core.__version__
root_doc = "README"
include_patterns = [
    "*.md",
    *(f"{folder}/*.md" for folder in FOLDERS),
    "docs/notebooks/*.ipynb",
    "docs/_reference/*.rst",
]
exclude_patterns = [
    "**/.*",
    ".venv",
    "demo",
    "dist",
    "docs/_build",
    "physic_core",
    "tests",
    "tools",
    "**/tests",
]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]

myst_heading_anchors = 4
nb_execution_mode = "off"

autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
add_module_names = False
# An annotation such as bytes counts as an attribute of this name.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_title = f"PhySIC {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
# Summaries are fetched, which browsers refuse for pages that are opened as files.
html_show_search_summary = False
html_show_sphinx = False
copybutton_exclude = ".linenos, .gp, .go, .c1"


def _toctree(entries: list[str], caption: str = "") -> str:
    head = ["```{toctree}", ":hidden:", *([f":caption: {caption}"] if caption else []), ""]
    return "\n".join([*head, *map(_entry, entries), "```"])


def _entry(page: str) -> str:
    return f"{TITLES[page]} </{page}>" if page in TITLES else f"/{page}"


def add_toctrees(app: Sphinx, page: str, source: list[str]) -> None:
    """Append the side bar to the first page, and their subpages to pages that have some."""
    if page == root_doc:
        source[0] += "\n\n" + "\n\n".join(
            _toctree(entries, caption) for caption, entries in sections().items()
        )
    elif page in subpages():
        source[0] += "\n\n" + _toctree(subpages()[page])


def pages_with_toctrees(
    app: Sphinx, env: object, added: set[str], changed: set[str], removed: set[str]
) -> list[str]:
    """Return the pages to read again when pages were added or removed: their lists have changed,
    their files not.
    """
    return [root_doc, *subpages()] if added or removed else []


def write_index(app: Sphinx, error: Exception | None) -> None:
    """Write ``index.html``, which servers show for the folder: it leads to the first page."""
    if error is None and app.builder.name == "html":
        Path(app.outdir, "index.html").write_text(
            '<!doctype html><meta charset="utf-8"><title>PhySIC</title>'
            f'<meta http-equiv="refresh" content="0; url={root_doc}.html"><a '
            f'href="{root_doc}.html">PhySIC</a>\n',
            encoding="utf-8",
        )


def setup(app: Sphinx) -> dict[str, Any]:
    """Register what happens at each build."""
    write_reference(ROOT / "docs" / "_reference")
    app.connect("env-get-outdated", pages_with_toctrees)
    app.connect("source-read", add_toctrees)
    app.connect("build-finished", write_index)
    return {"parallel_read_safe": True}
