from __future__ import annotations

import re
import shlex
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import physic_core
from physic_core import cli
from physic_core.configuration import model as config
from physic_core.configuration.resolve import check_backends, resolve
from physic_core.discovery.plugins import discover

pytestmark = pytest.mark.usefixtures("few_steps")

ROOT = Path(__file__).parents[2]
PAPERS = [page for page in ROOT.glob("*.md") if page.name != "CHANGELOG.md"]
PAGES = sorted(
    [*PAPERS, *ROOT.glob("docs/**/*.md"), *ROOT.glob("plugins/*/README.md"), ROOT / "examples" / "README.md"]
)


def blocks(language: str) -> list[str]:
    return [b for page in PAGES for b in re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.M | re.S)]


def commands(program: str) -> list[list[str]]:
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    words = [shlex.split(line, comments=True) for line in lines]
    return [w for w in words if w[:1] == [program]]


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_config_of_the_pages_holds(text: str):
    check_backends(
        config.load_config(flags={"page": {k: v for k, v in tomllib.loads(text).items() if k != "extends"}}), discover()
    )


@pytest.mark.parametrize("words", commands("physic"), ids=" ".join)
def test_every_command_of_the_pages_can_be_given(words: list[str], tmp_path: Path):
    group, arguments = cli.main, words[1:]
    while arguments and arguments[0] in getattr(group, "commands", {}):
        group, arguments = group.commands[arguments[0]], arguments[1:]  # type: ignore[attr-defined,assignment]
    with group.make_context("physic", arguments) as context:
        named = context.params.get("file")
        overrides = context.params.get("overrides", ())
    if named is not None and named.parts[0] == "examples":
        config.load_config(ROOT / named, overrides=overrides)
    else:
        config.load_config(overrides=overrides)


def test_the_example_of_a_camera_fits_its_photo():
    from physic_core.io.photo import limit_size, read_photo
    from physic_core.types import Intrinsics

    (words,) = [words for words in commands("physic") if "--intrinsics" in words]
    photo = read_photo(ROOT / words[2])
    height, width = photo.image.shape[:2]
    camera = Intrinsics(*map(float, words[words.index("--intrinsics") + 1].split(",")), width, height)
    limit_size(replace(photo, intrinsics=camera), 1280)
    assert (camera.cx, camera.cy) == ((width - 1) / 2, (height - 1) / 2)


@pytest.mark.parametrize("words", commands("make"), ids=" ".join)
def test_every_target_of_the_pages_exists(words: list[str]):
    assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.M)


@pytest.mark.parametrize("words", commands("pip"), ids=" ".join)
def test_every_install_line_names_what_is_there(words: list[str]):
    for flag, value in zip(words[2::2], words[3::2], strict=True):
        folder = ROOT / value.partition("[")[0]
        assert {"-r": (ROOT / value).is_file(), "-e": (folder / "pyproject.toml").is_file()}[flag]


@pytest.mark.parametrize("text", blocks("python"))
def test_every_script_of_the_pages_runs(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a world of the mocks: what the pages promise does not depend on the backends."""
    from PIL import Image

    from physic_testing.worlds import build_world

    (tmp_path / "examples").mkdir()
    for photo in ("couple.jpg", "basketball.png"):
        Image.fromarray(build_world().image).save(tmp_path / "examples" / photo, "PNG")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "DEFAULT_PRESET", "mock")
    exec(compile(text.replace('"extends": "embedded"', '"extends": "mock"'), "page", "exec"), {})


def test_the_continuous_integration_runs_the_test_command_of_the_readme():
    assert ["make", "test"] in commands("make")
    assert (ROOT / ".ci" / "run").read_text().rstrip().splitlines()[-2:] == ["make test", "exec make kernels"]


def test_the_workflow_runs_the_commands_of_the_readme_on_x86_and_arm():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    (job,) = workflow["jobs"].values()
    commands_run = [step["run"].split() for step in job["steps"] if "run" in step]
    assert commands_run == [["make", "demo"], ["make", "test"], ["make", "docs"]]
    assert all(command in commands("make") for command in commands_run)
    assert job["strategy"]["matrix"]["machine"] == ["ubuntu-24.04", "ubuntu-24.04-arm"]
    assert job["strategy"]["matrix"]["python"][0] == project_python()
    used = [step["uses"] for step in job["steps"] if "uses" in step]
    assert all(re.fullmatch(r"actions/[\w-]+@v\d+", action) for action in used)


def project_python() -> str:
    """Return the oldest version of Python that the distributions accept."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"].removeprefix(">=")


def test_the_import_order_of_the_architecture_is_the_contract():
    (shown,) = re.findall(r"^```text\n(cli\n.*?)^```", (ROOT / "ARCHITECTURE.md").read_text(), re.M | re.S)
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    assert shown.splitlines() == layers


@pytest.mark.parametrize("page", ["ARCHITECTURE.md", "README.md", "CONTRIBUTING.md", "docs/api.md"])
def test_every_file_that_a_paper_names_is_there(page: str):
    text = (ROOT / page).read_text()
    for name in re.findall(r"`([a-z_]+/[\w./-]+?)/?`", text):
        roots = (ROOT, ROOT / "physic_core", ROOT / "physic_core" / "engine" / "joint")
        assert any((root / name).exists() for root in roots), name
    for folder, names in re.findall(r"^\| file in `(.*?)/` .*?\n\|[-|]+\n((?:\|.*\n)+)", text, re.M):
        for name in re.findall(r"`([\w*]+\.py)`", "\n".join(row.split("|")[1] for row in names.splitlines())):
            assert list((ROOT / "physic_core" / folder).glob(name)), name


def test_the_page_of_the_api_names_everything_public():
    page = (ROOT / "docs" / "api.md").read_text()
    named = {*re.findall(r"`(\w+)", page), *(name for name in physic_core.__all__ if name.endswith("Error"))}
    assert set(physic_core.__all__) <= named


@pytest.mark.parametrize("page", sorted({*PAGES, *ROOT.glob("*/README.md"), ROOT / "CHANGELOG.md"}), ids=str)
def test_every_row_of_a_table_is_under_its_head(page: Path):
    lines = ["", *re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S).splitlines(), ""]
    first = [i for i, line in enumerate(lines) if line.startswith("|") and not lines[i - 1].startswith("|")]
    assert all(re.fullmatch(r"[|: -]+", lines[i + 1]) for i in first), [lines[i] for i in first]


def test_the_example_of_another_inpainter_is_the_flag():
    by_file, by_flag = (
        resolve(found, discover())
        for found in (
            config.load_config(ROOT / "examples" / "telea.toml"),
            config.load_config(overrides=["inpainter.backend=telea"]),
        )
    )
    assert {k: b.provenance for k, b in by_file.backends.items()} == {
        k: b.provenance for k, b in by_flag.backends.items()
    }
    assert by_file.config.as_dict() == by_flag.config.as_dict()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_file_that_a_page_links_is_there(page: Path):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target
