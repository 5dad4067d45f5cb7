"""Which pages the site has, in which order: read by ``conf.py`` and by the tests."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

FOLDERS = (
    "docs",
    "docs/notebooks",
    "contrib",
    "contrib/*",
    "plugins",
    "plugins/*",
    "benchmarks",
    "examples",
    "findings",
)
"""Folders whose Markdown files and notebooks are pages, beside those of the root."""

SECTIONS = {
    "Start": ["docs/install", "docs/how-it-works", "docs/gallery", "docs/notebooks/README"],
    "Use": [
        "docs/running",
        "docs/tools",
        "docs/bodies",
        "docs/batch",
        "docs/scene",
        "docs/serve",
        "docs/configuration",
        "docs/outputs",
        "docs/file-format",
        "docs/exports",
    ],
    "Judge": [
        "docs/checks",
        "docs/evaluation",
        "benchmarks/README",
    ],
    "Extend": [
        "docs/plugins",
        "contrib/README",
        "plugins/README",
        "docs/networks",
        "docs/estimators",
        "docs/traps",
        "docs/terms-and-checks",
        "docs/api",
        "docs/_reference/index",
    ],
    "Project": [
        "docs/decisions",
        "ARCHITECTURE",
        "CONTRIBUTING",
        "CHANGELOG",
        "SECURITY",
        "CODE_OF_CONDUCT",
        "docs/README",
    ],
}
"""The side bar: caption and pages.

A page of ``docs/`` that is not named here goes to the end of "Use".
"""


TITLES = {"plugins/README": "Plugins of the project", "docs/README": "All pages"}
"""Titles in the side bar, where the page's own does not tell it from others."""


def pages() -> list[str]:
    """Return every page by its path from the root, without suffix."""
    files = [
        *ROOT.glob("*.md"),
        *(page for folder in FOLDERS for page in ROOT.glob(f"{folder}/*.md")),
    ]
    files += ROOT.glob("docs/notebooks/*.ipynb")
    return sorted(page.relative_to(ROOT).with_suffix("").as_posix() for page in files)


def subpages() -> dict[str, list[str]]:
    """Return the pages that are listed below another page, by the page that lists them."""
    below: dict[str, list[str]] = {
        "docs/gallery": ["examples/README"],
        "docs/notebooks/README": [],
        "contrib/README": [],
        "plugins/README": [],
    }
    for page in pages():
        for parent, children in below.items():
            if page.startswith(parent.removesuffix("README")) and page != parent:
                children.append(page)
    return {
        parent: _in_order_of(parent, children)
        for parent, children in below.items()
        if parent in pages()
    }


def _in_order_of(parent: str, below: list[str]) -> list[str]:
    """Sort pages by their first mention in the page that lists them; those that it does not mention
    come last.
    """
    text = (ROOT / f"{parent}.md").read_text(encoding="utf-8")
    names = {page: page.removeprefix(parent.removesuffix("README")) for page in below}
    return sorted(below, key=lambda page: (text.find(names[page]) % (len(text) + 1), page))


def sections() -> dict[str, list[str]]:
    """Return :data:`SECTIONS` with the pages that are there, and every other page of ``docs/``."""
    there = {*pages(), "docs/_reference/index"}
    listed = {page for section in SECTIONS.values() for page in section}
    listed |= {page for below in subpages().values() for page in below}
    rest = [page for page in pages() if page not in listed and page != "README"]
    pages_of = {
        caption: [page for page in section if page in there]
        for caption, section in SECTIONS.items()
    }
    pages_of["Use"] += rest
    return pages_of
