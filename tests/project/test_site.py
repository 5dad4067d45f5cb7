"""The site of ``make docs``: every page is in the side bar, every public name in the reference."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

import physic_core
import physic_testing
from physic_core import body, errors, interfaces, types, weights

ROOT = Path(__file__).parents[2]


def site(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"site_{name}", ROOT / "docs" / "site" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


contents, reference, check_links = site("contents"), site("reference"), site("check_links")


def test_every_page_is_in_the_side_bar_once():
    listed = [page for section in contents.sections().values() for page in section]
    listed += [page for below in contents.subpages().values() for page in below]
    assert Counter(listed) == Counter({*contents.pages(), "docs/_reference/index"} - {"README"})


def test_every_page_of_the_documentation_is_found():
    found = {
        str(page.relative_to(ROOT).with_suffix("")) for page in ROOT.glob("docs/**/*.md") if "_build" not in page.parts
    }
    assert found <= set(contents.pages())


def test_the_pages_that_a_reader_looks_for_are_in_the_side_bar():
    listed = [page for section in contents.sections().values() for page in section]
    wanted = [
        "install",
        "how-it-works",
        "configuration",
        "plugins",
        "batch",
        "outputs",
        "evaluation",
        "checks",
        "api",
        "gallery",
        "decisions/README",
    ]
    assert {f"docs/{page}" for page in wanted} | {"CHANGELOG", "contrib/README"} <= set(listed)


@pytest.fixture(scope="module")
def reference_text() -> str:
    return "\n".join(reference.reference_pages().values())


@pytest.mark.parametrize(
    "module", [physic_core, types, interfaces, errors, weights, body, physic_testing], ids=lambda m: m.__name__
)
def test_every_public_name_is_in_the_reference(module: ModuleType, reference_text: str):
    named = set(re.findall(r"^(?:\.\. (?:py:)?\w+:: [\w.]*?|``)(\w+)(?:``.*)?$", reference_text, re.M))
    assert set(module.__all__) <= named


def test_every_public_module_of_the_page_of_the_api_is_in_the_reference():
    public = (ROOT / "docs" / "api.md").read_text()
    named = {name.rstrip(".") for name in re.findall(r"`(physic_(?:core|testing)[a-z_.]*)", public)}
    documented = {part for module in reference.MODULES for part in (module, module.rpartition(".")[0])}
    assert named - {"physic_core.__all__", "physic_core.io.photo.read_photo"} <= documented


def test_a_constant_has_the_docstring_below_its_assignment(reference_text: str):
    assert (
        ".. py:data:: physic_core.interfaces.INTERFACES\n\n   Interface classes by their names in configs."
        in reference_text
    )


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top"></h1><a href="b.html#there">1</a><a href="b.html#gone">2</a><a href="c.html">3</a>'
        '<a href="#top">4</a><a href="https://example.org/x">5</a><script src="https://example.org/s.js"></script>'
    )
    (tmp_path / "b.html").write_text('<h1 id="there"></h1>')
    found = check_links.read_site(tmp_path)
    assert check_links.broken_links(found) == [
        "a.html: b.html#gone",
        "a.html: c.html",
        "a.html: loads https://example.org/s.js",
    ]
    assert check_links.external_links(found) == ["https://example.org/s.js", "https://example.org/x"]


@pytest.mark.parametrize("picture", sorted(ROOT.glob("docs/pictures/*.*")), ids=lambda p: p.name)
def test_a_picture_is_shown(picture: Path):
    assert any(f"pictures/{picture.name}" in page.read_text() for page in ROOT.glob("docs/*.md"))
