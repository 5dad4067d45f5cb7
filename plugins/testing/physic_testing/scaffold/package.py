"""Write the files of a new plugin from templates."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from physic_core.errors import ConfigError, OutputError

_PYPROJECT = """\
[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"

[project]
name = "{distribution}"
version = "0.1.0"
description = "{summary}"
requires-python = ">=3.11"
dependencies = [
    "numpy>=2.0",
    "metricbody>={core}",
    "pydantic>=2.9",
]

[project.optional-dependencies]
test = [
    "metricbody-testing>={core}",
    "pytest>=8.2",
]

[project.entry-points."physic.{interface}"]  # one line for each backend of this interface
"{backend}" = "{module}:{class_name}"
"""

_TEST = """\
from physic_testing import parametrize_with_checks


# All checks must pass: until then, `physic plugins` marks the backend, and a run doubts it.
@parametrize_with_checks("{interface}", "{backend}")
def test_conformance(check):
    check()


# Test the wrapper of a network without its weights, too: `WithTruth` is a subclass of {class_name}
# whose network knows the truth, which `physic_testing.world_of(image)` tells. Its errors have close
# limits.
#
# @parametrize_with_checks("{interface}", WithTruth, capabilities={{"exact"}})
# def test_wrapper(check):
#     check()
"""


@dataclass(frozen=True)
class PluginNames:
    """Names of a new plugin: backend, interface, distribution, module and class.

    Attributes:
        backend: name in configs, such as "my-depth".
        interface: "metric_depth", ...
    """

    backend: str
    interface: str

    @property
    def distribution(self) -> str:
        """Name of the distribution, such as "physic-my-depth"."""
        return f"physic-{self.backend}"

    @property
    def module(self) -> str:
        """Import name of the module, such as "physic_my_depth"."""
        return re.sub(r"[-.]", "_", self.distribution)

    @property
    def class_name(self) -> str:
        """Name of the backend class, such as "MyDepth"."""
        words = "".join(part.capitalize() for part in re.split(r"[-.]", self.backend))
        return words if words[0].isalpha() else f"Backend{words}"


def plugin_files(names: PluginNames, core: str) -> dict[str, str]:
    """Return the text of each file of a new plugin, by relative path; ``core`` is the version of
    metricbody.
    """
    source = (resources.files("physic_testing.scaffold") / f"{names.interface}.py").read_text(
        encoding="utf-8"
    )
    words = {
        "backend": names.backend,
        "interface": names.interface,
        "distribution": names.distribution,
        "module": names.module,
        "class_name": names.class_name,
        "summary": " ".join(source.partition('"""')[2].partition(".")[0].split()),
        "core": core,
    }
    return {
        "pyproject.toml": _PYPROJECT.format(**words),
        f"{names.module}.py": source.replace("Template", names.class_name),
        "tests/test_conformance.py": _TEST.format(**words),
    }


def write_plugin(folder: Path, names: PluginNames, core: str) -> list[Path]:
    """Write the files of a new plugin into a new folder, and return their paths.

    Raises:
        ConfigError: the name is not a valid name of a backend.
        OutputError: the folder exists already, or cannot be written.
    """
    if not re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", names.backend) or names.backend == "none":
        raise ConfigError(
            "a backend's name has only a-z, 0-9 and hyphens, such as my-depth, and is not 'none' "
            f"(got '{names.backend}')"
        )
    files = {folder / path: text for path, text in plugin_files(names, core).items()}
    if os.path.lexists(folder):
        raise OutputError(f"{folder} exists already: choose another name, or another --folder")
    try:
        folder.mkdir(parents=True)
        for path, text in files.items():
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        if not isinstance(error, FileExistsError):  # else it is of somebody else
            shutil.rmtree(folder, ignore_errors=True)
        raise OutputError(f"{folder} cannot be written: {error.strerror}") from error
    return list(files)
