from __future__ import annotations

import re
import sys
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from physic_core.configuration.layers import preset_names
from physic_core.discovery.entry_points import group_problem
from physic_core.interfaces import INTERFACES

from .imports import imported_names

pytestmark = pytest.mark.quick

ROOT = Path(__file__).parents[2]


def projects(parent):
    files = ROOT.glob(f"{parent}/*/pyproject.toml")
    return {tomllib.loads(p.read_text())["project"]["name"]: p.parent for p in files}


PROJECTS = projects("plugins") | {"metricbody": ROOT}


def project(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text())["project"]


def requirements(folder):
    own = project(folder)
    return [*own["dependencies"], *chain(*own.get("optional-dependencies", {}).values())]


def wheel_files(folder):
    """What a wheel of the distribution would hold, without building it."""
    return {
        f.distribution_path.replace("\\", "/")
        for f in WheelBuilder(str(folder)).recurse_included_files()
    }


def pins():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


def version(name):
    """The version of a distribution as its build states it."""
    return WheelBuilder(str(ALL[name])).metadata.version


@pytest.mark.parametrize("name", PROJECTS)
def test_a_distribution_is_named_as_its_folder_and_shares_the_version(name):
    own = project(PROJECTS[name])
    assert name in ("metricbody", f"metricbody-{PROJECTS[name].name}")
    assert version(name) == project(ROOT)["version"]
    assert own["license"] == "Apache-2.0"
    assert own["authors"] == project(ROOT)["authors"]
    assert own["requires-python"] == project(ROOT)["requires-python"]


@pytest.mark.parametrize("name", PROJECTS)
def test_a_distribution_sets_lower_bounds_only_and_each_is_pinned_for_the_machine(name):
    for requirement in requirements(PROJECTS[name]):
        package, bound = re.fullmatch(
            r"([a-z0-9-]+)(?:\[[a-z]+\])?(>=[\w.]+)(?:; .+)?", requirement, re.I
        ).groups()
        assert package.startswith("metricbody") or package in pins(), (
            f"{requirement} of {name} is not in constraints.txt"
        )
        assert "<" not in bound


ALL = PROJECTS | projects("contrib")


MODULES = {
    "openexr": "OpenEXR",
    "opencv-python-headless": "cv2",
    "pillow": "PIL",
    "ray[data]": "ray",
    "rerun-sdk": "rerun",
    "usd-core": "pxr",
}
"""Import names that are not the distribution's."""
THROUGH_OTHERS = {
    "metricbody-onnx": {"onnxruntime"},  # metricbody-embedded
    "metricbody-batch": {"jinja2", "python-multipart"},  # starlette
    # diffusers
    "metricbody-omnieraser": {"accelerate", "peft", "protobuf", "sentencepiece", "transformers"},
}
"""Requirements that another library imports for us."""
BY_THE_USER = {
    "metricbody": {"pandas"},  # for Reconstruction.to_pandas
    "metricbody-paper": {"torchvision"},  # has to fit the user's torch; missing() names it
    "metricbody-testing": {"pytest"},  # for the tests of plugins only
}
"""Modules that are imported if they are there, or whose absence is reported with how to get
them.
"""


def packages(folder):
    """Names of the packages and modules that a project's folder offers."""
    return {path.stem for path in folder.glob("physic_*")}


def imported(folder):
    """Top-level modules that the packages in a project's folder import anywhere, without its own
    and Python's.
    """
    own = packages(folder)
    files = [file for name in own for file in folder.glob(f"{name}/**/*.py")]
    files += folder.glob("physic_*.py")
    names = {module.partition(".")[0] for file in files for module, _ in imported_names(file)}
    return names - own - {"__future__"} - set(sys.stdlib_module_names)


OWNERS = {package: name for name, folder in ALL.items() for package in packages(folder)}
"""Distribution of each package of the project."""


@pytest.mark.parametrize("name", ALL)
def test_a_distribution_requires_what_it_imports_and_nothing_else(name):
    own = project(ALL[name])
    tools = {"dev", "docs", "full", "test"}
    wanted = [*own["dependencies"]]
    wanted += [
        r
        for extra, some in own.get("optional-dependencies", {}).items()
        if extra not in tools
        for r in some
    ]
    required = {
        MODULES.get(r, r.replace("-", "_")) for r in (re.split("[>=]", text)[0] for text in wanted)
    }
    through = {module.replace("-", "_") for module in THROUGH_OTHERS.get(name, set())}
    modules = {OWNERS.get(module, module).replace("-", "_") for module in imported(ALL[name])}
    assert required - through == modules - BY_THE_USER.get(name, set())
    assert through <= required


@pytest.mark.parametrize("name", ALL)
def test_one_lower_bound_of_a_requirement_holds_everywhere(name):
    ours = dict(re.split("(?=>)", text, maxsplit=1) for text in requirements(ROOT))
    for text in project(ALL[name])["dependencies"]:
        package, bound = re.split("(?=>)", text, maxsplit=1)
        assert ours.get(package, bound) == bound, text


@pytest.mark.parametrize("file", ["requirements.txt", "requirements-dev.txt"])
def test_the_requirements_install_every_plugin(file):
    lines = {line.partition("[")[0] for line in (ROOT / file).read_text().splitlines()}
    assert {f"-e plugins/{folder.name}" for folder in PROJECTS.values() if folder != ROOT} <= lines
    assert "-c constraints.txt" in lines


def test_the_extra_full_is_every_plugin():
    full = {re.split(r"[\[>]", name)[0] for name in project(ROOT)["optional-dependencies"]["full"]}
    assert full == PROJECTS.keys() - {"metricbody"}


@pytest.mark.parametrize("name", [n for n in PROJECTS if n != "metricbody"])
def test_a_plugin_registers_modules_of_its_own(name):
    groups = project(PROJECTS[name]).get("entry-points", {})
    assert not any(map(group_problem, groups))
    modules = {
        target.partition(":")[0] for entries in groups.values() for target in entries.values()
    }
    assert {module.partition(".")[0] for module in modules} <= packages(PROJECTS[name])
    files = wheel_files(PROJECTS[name])
    for path in (module.replace(".", "/") for module in modules):
        assert any(file == f"{path}.py" or file.startswith(f"{path}/") for file in files), path


MEGABYTES = {"metricbody": 15, "metricbody-embedded": 105, "metricbody-testing": 4}


# Compressing 100 MB of networks takes seconds.
SLOW = {"metricbody-embedded": pytest.mark.slow}


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in ALL])
def test_a_built_wheel_holds_its_package_and_its_notices(name, tmp_path):
    """Its package alone, licence and notices, nothing of tests or other folders, and no more bytes
    than known.
    """
    (wheel,) = WheelBuilder(str(ALL[name])).build(directory=str(tmp_path))
    own = packages(ALL[name])
    info = f"{name.replace('-', '_')}-{version(name)}.dist-info"
    with zipfile.ZipFile(wheel) as archive:
        files = set(archive.namelist())
        metadata = archive.read(f"{info}/METADATA").decode()
        licence = archive.read(f"{info}/licenses/LICENSE")
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert re.search("^License-Expression: Apache-2.0$", metadata, re.M)
    if name.startswith("metricbody"):
        shared = project(ROOT)
        assert set(re.findall("^Classifier: (.*)$", metadata, re.M)) == set(shared["classifiers"])
        addresses = dict(re.findall("^Project-URL: (.*), (.*)$", metadata, re.M))
        assert addresses == shared["urls"]
    assert {f.partition("/")[0].removesuffix(".py") for f in files} == own | {info}
    assert {f"{one}/py.typed" for one in own} <= files or ALL[name].parent.name == "contrib"
    assert not [
        f
        for f in files
        if re.search(r"(^|/)(tests?|test_[^/]*|conftest\.py|__pycache__|shared|out)(/|$)", f)
    ]
    assert HELD.get(name, set()) <= files
    assert (f"{info}/licenses/NOTICE" in files) == (ALL[name] / "NOTICE").exists()
    assert Path(wheel).stat().st_size < 1e6 * MEGABYTES.get(name, 1)


HELD = {
    "metricbody": {
        "physic_core/body/NOTICE-embedded.md",
        "physic_core/body/embedded.npz",
        *(f"physic_core/configuration/presets/{name}.toml" for name in preset_names()),
    },
    "metricbody-embedded": {
        f"physic_embedded/weights/{name}"
        for name in (
            "NOTICE",
            "LICENSES/Apache-2.0.txt",
            "LICENSES/MIT-MI-GAN.txt",
            "LICENSES/MIT-TinyViT.txt",
        )
    },
    "metricbody-testing": {f"physic_testing/scaffold/{interface}.py" for interface in INTERFACES},
}
"""Files beside the code of a wheel: presets, the body, templates, and notices of assets."""
