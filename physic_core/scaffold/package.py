"""The files of a new plugin."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING

from physic_core.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Names", "files", "write"]

_PREFIX = "physic-"

_PYPROJECT = """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{distribution}"
version = "0.1.0"
description = "{summary}"
readme = "README.md"
requires-python = ">=3.11"
dependencies = ["numpy>=1.26", "physic-core>={core}", "pydantic>=2.7"]

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
    """The backends of this plugin; nothing heavy is imported here, since it runs whenever plugins are listed."""
    return [
        BackendRecord(
            "{interface}",
            "{backend}",
            "{package}.{module}:{kind}",
            api={api},
            summary="{summary}",
            weights_license="",  # of the weights, if there are any: "MIT (NameOfTheNetwork)"
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

- `{package}/{module}.py` is the backend: make it your own.
- `{package}/__init__.py` says what it is called, what it needs and under which licence its weights are.
- `tests/test_conformance.py` runs every check of the interface. A check that you know to fail goes there, with
  the reason: `@parametrize_with_checks("{interface}", "{backend}", expected_failures={{"name_of_the_check": "why"}})`.
"""


@dataclass(frozen=True)
class Names:
    """What everything of a new plugin is called.

    Attributes:
        backend: in configs, such as "my-depth".
        interface: "metric_depth", ...
    """

    backend: str
    interface: str

    @property
    def distribution(self) -> str:
        """As it is installed: "physic-my-depth"."""
        return f"{_PREFIX}{self.backend}"

    @property
    def package(self) -> str:
        """As it is imported: "physic_my_depth"."""
        return re.sub(r"[-.]", "_", self.distribution)

    @property
    def kind(self) -> str:
        """The class: "MyDepth"."""
        words = "".join(part.capitalize() for part in re.split(r"[-.]", self.backend))
        return words if words[0].isalpha() else f"Backend{words}"


def files(names: Names, core: str, api: int) -> dict[str, str]:
    """Path in the new folder -> text.

    Args:
        names: of the plugin.
        core: version of physic-core that it is begun with.
        api: that core's version of the interface.
    """
    source = (resources.files("physic_core.scaffold") / f"{names.interface}.py").read_text(encoding="utf-8")
    summary = source.partition('"""')[2].partition(".")[0]
    words = {
        "backend": names.backend,
        "interface": names.interface,
        "distribution": names.distribution,
        "package": names.package,
        "kind": names.kind,
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
        f"{names.package}/{names.interface}.py": source.replace("Template", names.kind),
        f"{names.package}/py.typed": "",
        "tests/test_conformance.py": _TEST.format(**words),
    }


def write(folder: Path, names: Names, core: str, api: int) -> list[Path]:
    """Write a new plugin into a folder that is not there yet, and return its files.

    Raises:
        ConfigError: the name cannot be one of a backend.
        OutputError: the folder is there already, or cannot be made.
    """
    if not re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", names.backend) or names.backend == "none":
        raise ConfigError(
            f"a backend's name is of a-z, 0-9 and hyphens, such as my-depth, and not 'none' (got '{names.backend}')"
        )
    written = []
    try:
        folder.mkdir(parents=True)
        for path, text in files(names, core, api).items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            written.append(file)
    except FileExistsError:
        raise OutputError(f"{folder} exists already: choose another name, or another --folder") from None
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror}") from error
    return written
