"""Write the files of a new plugin from templates."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING

from physic_core.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from pathlib import Path

_PREFIX = "physic-"

_PYPROJECT = """\
[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"

[project]
name = "{distribution}"
version = "0.1.0"
description = "{summary}"
readme = "README.md"
requires-python = ">=3.11"
dependencies = ["numpy>=2.0", "physic-core>={core}", "pydantic>=2.9"]

[project.optional-dependencies]
test = ["physic-testing>={core}", "pytest>=8.2"]

[project.entry-points."physic.plugins"]
"{entry}" = "{package}"

[tool.hatch.build.targets.wheel]
packages = ["{package}"]
"""

_INIT = '''\
"""{summary}"""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the backends of this plugin; import nothing slow here, as this runs whenever plugins are listed."""
    return [
        BackendRecord(
            "{interface}",
            "{backend}",
            "{package}.{module}:{class_name}",
            api={api},
            summary="{summary}",
            weights_license="",  # licence of the weights, if there are any: "MIT (NameOfTheNetwork)"
        ),
    ]
'''

_TEST = """\
from physic_testing import parametrize_with_checks


@parametrize_with_checks("{interface}", "{backend}")
def test_conformance(check):
    check()
"""

_README = """\
# {distribution}

{summary}. A plugin of PhySIC: the `{interface}` named `{backend}`.

```sh
pip install -e '.[test]'
physic plugins show {backend}
physic plugins check {backend}
pytest
physic run photo.jpg --set {interface}.backend={backend}
```

- `{package}/{module}.py` is the backend: replace its code by your own.
- `{package}/__init__.py` registers its name, its requirements and the licence of its weights.
- `tests/test_conformance.py` runs every check of the interface. List a check that is known to fail there, with
  the reason: `@parametrize_with_checks("{interface}", "{backend}", expected_failures={{"name_of_the_check": "why"}})`.
  Without its weights a backend is not called: `physic_testing.world_of(image)` tells a stand-in the truth.
"""


@dataclass(frozen=True)
class PluginNames:
    """Names of a new plugin: backend, interface, distribution, package and class.

    Attributes:
        backend: name in configs, such as "my-depth".
        interface: "metric_depth", ...
    """

    backend: str
    interface: str

    @property
    def distribution(self) -> str:
        """Name of the distribution, such as "physic-my-depth"."""
        return f"{_PREFIX}{self.backend}"

    @property
    def package(self) -> str:
        """Import name of the package, such as "physic_my_depth"."""
        return re.sub(r"[-.]", "_", self.distribution)

    @property
    def class_name(self) -> str:
        """Name of the backend class, such as "MyDepth"."""
        words = "".join(part.capitalize() for part in re.split(r"[-.]", self.backend))
        return words if words[0].isalpha() else f"Backend{words}"


def plugin_files(names: PluginNames, core: str, api: int) -> dict[str, str]:
    """Return the text of each file of a new plugin, by relative path.

    Args:
        names: names of the plugin.
        core: version of physic-core, the lower bound of the requirement.
        api: version of the interface.
    """
    source = (resources.files("physic_testing.scaffold") / f"{names.interface}.py").read_text(encoding="utf-8")
    summary = source.partition('"""')[2].partition(".")[0]
    words = {
        "backend": names.backend,
        "interface": names.interface,
        "distribution": names.distribution,
        "package": names.package,
        "class_name": names.class_name,
        "module": names.interface,
        "entry": names.backend,
        "summary": summary,
        "core": core,
        "api": api,
    }
    return {
        "pyproject.toml": _PYPROJECT.format(**words),
        "README.md": _README.format(**words),
        f"{names.package}/__init__.py": _INIT.format(**words),
        f"{names.package}/{names.interface}.py": source.replace("Template", names.class_name),
        f"{names.package}/py.typed": "",
        "tests/test_conformance.py": _TEST.format(**words),
    }


def write_plugin(folder: Path, names: PluginNames, core: str, api: int) -> list[Path]:
    """Write the files of a new plugin into a new folder, and return their paths.

    Raises:
        ConfigError: the name is not a valid name of a backend.
        OutputError: the folder exists already, or cannot be created.
    """
    if not re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", names.backend) or names.backend == "none":
        raise ConfigError(
            f"a backend's name has only a-z, 0-9 and hyphens, such as my-depth, and is not 'none' "
            f"(got '{names.backend}')"
        )
    written = []
    try:
        folder.mkdir(parents=True)
        for path, text in plugin_files(names, core, api).items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            written.append(file)
    except FileExistsError:
        raise OutputError(f"{folder} exists already: choose another name, or another --folder") from None
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror}") from error
    return written
