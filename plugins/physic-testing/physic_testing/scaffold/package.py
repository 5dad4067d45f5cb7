"""Write the files of a new plugin, or of one more backend of a plugin, from templates."""

from __future__ import annotations

import ast
import re
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from collections.abc import Mapping

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
dependencies = [
    "numpy>=2.0",
    # "physic-core>={core}",  # once released: until then, whoever registers this name with an index runs code here
    "pydantic>=2.9",
]

[project.optional-dependencies]
test = [
    # "physic-testing>={core}",  # once released: until then, whoever registers this name with an index runs code here
    "pytest>=8.2",
]

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
{record}
    ]
'''

_RECORD = """\
        BackendRecord(
            "{interface}",
            "{backend}",
            "{package}.{module}:{class_name}",
            api={api},
            summary="{summary}",
            weights_license="",  # licence of the weights, if there are any: "MIT (NameOfTheNetwork)"
        ),"""

_TEST = """\
from physic_testing import parametrize_with_checks

# A test with a network that knows the truth states it: `parametrize_with_checks(..., capabilities={{"exact"}})`.


@parametrize_with_checks("{interface}", "{backend}")
def test_conformance(check):
    check()
"""

_README = """\
# {distribution}

{summary}. A plugin of PhySIC: the `{interface}` named `{backend}`.

Install PhySIC first, from its checkout. Its distributions are not on a package index yet, and whoever registers their
names there could run code on your machine: so `dependencies` does not list them. PhySIC itself refuses a backend that
was written for another version of its interface.

```sh
pip install -c ~/physic/constraints.txt -e ~/physic -e ~/physic/plugins/physic-testing
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
  Without its weights a backend is not called: test it with a network that knows the truth, which
  `physic_testing.world_of(image)` tells, and state `capabilities={{"exact"}}`, so that the errors have close limits.
- `physic plugins new NAME --interface INTERFACE --add-to .` adds one more backend.
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
    words = _words(names, names.package, names.interface, api) | {"core": core}
    return {
        "pyproject.toml": _PYPROJECT.format(**words),
        "README.md": _README.format(**words),
        f"{names.package}/__init__.py": _INIT.format(**words),
        f"{names.package}/{names.interface}.py": _source(names),
        f"{names.package}/py.typed": "",
        "tests/test_conformance.py": _TEST.format(**words),
    }


def _source(names: PluginNames) -> str:
    source = (resources.files("physic_testing.scaffold") / f"{names.interface}.py").read_text(encoding="utf-8")
    return source.replace("Template", names.class_name)


def _words(names: PluginNames, package: str, module: str, api: int) -> dict[str, str]:
    words = {
        "backend": names.backend,
        "interface": names.interface,
        "distribution": names.distribution,
        "package": package,
        "class_name": names.class_name,
        "module": module,
        "entry": names.backend,
        "summary": _source(names).partition('"""')[2].partition(".")[0],
        "api": str(api),
    }
    return words | {"record": _RECORD.format(**words)}


def write_plugin(folder: Path, names: PluginNames, core: str, api: int) -> list[Path]:
    """Write the files of a new plugin into a new folder, and return their paths.

    Raises:
        ConfigError: the name is not a valid name of a backend.
        OutputError: the folder exists already, or cannot be created.
    """
    _check_name(names.backend)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise OutputError(
            f"{folder} exists already: choose another name, another --folder, or --add-to {folder} to add a backend"
        ) from None
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror}") from error
    return _write({folder / path: text for path, text in plugin_files(names, core, api).items()})


def add_backend(folder: Path, names: PluginNames, api: int) -> list[Path]:
    """Add a backend to an existing plugin, and return the paths of the files that were written or changed.

    Its module is called like the interface or, if there is such a module, like the backend.

    Args:
        folder: of the plugin's pyproject.toml.
        names: names of the backend; the package is that of the plugin.
        api: version of the interface.

    Raises:
        ConfigError: the name is not a valid name of a backend, the folder has no plugin, or its function
            ``physic_backends`` returns no list in brackets.
        OutputError: a file cannot be written, or exists already.
    """
    _check_name(names.backend)
    package = _package_in(folder)
    hooks = _hooks_file(folder, package)
    own = re.sub(r"[-.]", "_", names.backend)
    module = names.interface if not hooks.with_name(f"{names.interface}.py").exists() else own
    words = _words(names, package, module, api)
    changed = _with_record(hooks, words["record"])
    test = folder / "tests" / ("test_conformance.py" if not (folder / "tests").exists() else f"test_{own}.py")
    written = _write({hooks.with_name(f"{module}.py"): _source(names), test: _TEST.format(**words)})
    hooks.write_text(changed, encoding="utf-8")
    return [*written, hooks]


def _check_name(backend: str) -> None:
    if not re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", backend) or backend == "none":
        raise ConfigError(
            f"a backend's name has only a-z, 0-9 and hyphens, such as my-depth, and is not 'none' (got '{backend}')"
        )


def _write(files: Mapping[Path, str]) -> list[Path]:
    """Write files that do not exist."""
    if here := next((path for path in files if path.exists()), None):
        raise OutputError(f"{here} exists already: choose another name")
    for path, text in files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{path} cannot be written: {error.strerror}") from error
    return list(files)


def _package_in(folder: Path) -> str:
    """Return the package that the entry point of a plugin names."""
    path = folder / "pyproject.toml"
    try:
        groups = tomllib.loads(path.read_text(encoding="utf-8"))["project"]["entry-points"]
        package, *others = groups["physic.plugins"].values()
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(
            f'{path} should be the file of a plugin, with one line in [project.entry-points."physic.plugins"]'
        ) from error
    if others:
        raise ConfigError(f"{path} has several entry points of plugins: add the backend by hand")
    return str(package)


def _hooks_file(folder: Path, package: str) -> Path:
    """Return the ``__init__.py`` of a plugin."""
    places = [folder.joinpath(*above, *package.split("."), "__init__.py") for above in ((), ("src",))]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ConfigError(f"there is no {' or '.join(map(str, places))}: add the backend by hand")
    return found


def _with_record(path: Path, record: str) -> str:
    """Return the text of a module with one more record at the end of what its ``physic_backends`` returns."""
    text = path.read_text(encoding="utf-8")
    returned = [
        inside.value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.name == "physic_backends"
        for inside in ast.walk(node)
        if isinstance(inside, ast.Return)
    ]
    if len(returned) != 1 or not isinstance(returned[0], ast.List):
        raise ConfigError(f"physic_backends() in {path} does not return one list in brackets: add by hand\n{record}")
    found, source = returned[0], text.encode()
    end = _offset(source, found.end_lineno, found.end_col_offset) - 1  # of the closing bracket
    before = source[:end].rstrip()
    if found.elts:
        last = _offset(source, found.elts[-1].end_lineno, found.elts[-1].end_col_offset)
        comma = b"" if source[last:end].lstrip().startswith(b",") else b","
        before = source[:last] + comma + source[last:end].rstrip()
    return f"{before.decode()}\n{record}\n    {source[end:].decode()}"


def _offset(source: bytes, line: int | None, column: int | None) -> int:
    """Return the place of a line, from 1, and a column, from 0, of a syntax tree."""
    return sum(map(len, source.splitlines(keepends=True)[: (line or 1) - 1])) + (column or 0)
