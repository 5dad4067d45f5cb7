from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from physic_core import cli
from physic_core.configuration import model as config
from physic_core.configuration.resolve import resolve

pytestmark = pytest.mark.usefixtures("few_steps")

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    {page for place in ("*.md", "docs/*.md", "*/*/README.md") for page in ROOT.glob(place)}
)


def blocks(language):
    return [
        b
        for page in PAGES
        for b in re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.M | re.S)
    ]


def commands(program):
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    return [words for line in lines if (words := shlex.split(line, comments=True))[:1] == [program]]


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_config_of_the_pages_holds(text):
    given = {key: value for key, value in tomllib.loads(text).items() if key != "extends"}
    resolve(config.load_config(flags={"page": given}))


@pytest.mark.parametrize("words", commands("physic"), ids=" ".join)
def test_every_command_of_the_pages_can_be_given(words, tmp_path):
    group = cli.main
    arguments = words[1:]
    while arguments and arguments[0] in getattr(group, "commands", {}):
        group = group.commands[arguments[0]]
        arguments = arguments[1:]
    with group.make_context("physic", arguments) as context:
        named = context.params.get("file")
        overrides = context.params.get("overrides", ())
    if named is not None and named.parts[0] == "examples":
        config.load_config(ROOT / named, overrides=overrides)
    else:
        config.load_config(overrides=overrides)


@pytest.mark.parametrize("words", commands("make"), ids=" ".join)
def test_every_target_of_the_pages_exists(words):
    assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.M)


@pytest.mark.parametrize("words", commands("pip"), ids=" ".join)
def test_no_install_line_asks_an_index_for_the_project(words):
    """A stranger may register our names: each line names files and folders."""
    by_name = re.compile(r"(metricbody|physic)[\w-]*(\[.*\])?([=<>~!].*)?")
    assert not any(map(by_name.fullmatch, words))


# What the pages promise does not depend on the backends.
SCRIPTS = [re.sub(r'"embedded"|"telea", radius_px=5', '"mock"', text) for text in blocks("python")]
WITH_NETWORKS = [text for text in blocks("python") if "load_backend" in text]


@pytest.mark.parametrize(
    "text", [*SCRIPTS, *(pytest.param(text, marks=pytest.mark.slow) for text in WITH_NETWORKS)]
)
def test_every_script_of_the_pages_runs(text, tmp_path, monkeypatch):
    """On a world of the mocks."""
    from PIL import Image

    from physic_testing.worlds import load_world

    (tmp_path / "examples").mkdir()
    for photo in ("couple.jpg", "basketball.png"):
        Image.fromarray(load_world().image).save(tmp_path / "examples" / photo, "PNG")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "DEFAULT_PRESET", "mock")
    exec(compile(text, "page", "exec"), {})


def test_pages_state_what_code_and_measurements_do(module_at, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    assert module_at("tools/pages.py").old_pages() == []


def test_every_file_that_the_architecture_names_is_there():
    for name in re.findall(r"`([a-z_]+/[\w./-]+?)/?`", (ROOT / "ARCHITECTURE.md").read_text()):
        assert (ROOT / name).exists() or (ROOT / "physic_core" / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_file_that_a_page_links_is_there(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target
