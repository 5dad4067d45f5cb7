"""`physic config check` names every package that a backend's checkout will import, before anything is imported."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import physic_human
from physic_core.adapters import checkouts
from physic_human.checkout_backend import CheckoutBackend

from .published_imports import ENVIRONMENT, FILES

OURS = {"PIL", "cv2", "numpy", "scipy", "torch"}
"""What physic-human, or what it stands on, brings itself."""
KINDS = {
    record.name: getattr(importlib.import_module(module), kind)
    for record in physic_human.physic_backends()
    for module, _, kind in [str(record.target).partition(":")]
}


class Recorder:
    """Finds every package of some names, empty, and keeps the names of those that were imported."""

    def __init__(self, names: set[str]) -> None:
        self.names, self.imported = names, set[str]()

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        top = name.partition(".")[0]
        return ModuleSpec(name, self, is_package=True) if top in self.names else None  # type: ignore[arg-type]

    def forget(self) -> None:
        """Take its packages out of ``sys.modules``."""
        for key in [key for key in sys.modules if key.partition(".")[0] in self.names]:
            del sys.modules[key]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = ModuleType(spec.name)
        module.__getattr__ = lambda name: type(name, (), {})  # type: ignore[method-assign]
        return module

    def exec_module(self, module: ModuleType) -> None:
        self.imported.add(module.__name__.partition(".")[0])
        exec(ENVIRONMENT.get(module.__name__, ""), {})


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorder]:
    """In the place of all packages that the published files import and physic-human does not bring."""
    sources = [text for files in FILES.values() for text in files.values()]
    names = {name for text in (*sources, *ENVIRONMENT.values()) for name in packages_of(text)}
    own = {Path(path).parts[0] for files in FILES.values() for path in files}
    found = Recorder(names - own - OURS - sys.stdlib_module_names)
    before = {key: module for key, module in sys.modules.items() if key.partition(".")[0] in found.names}
    found.forget()
    sys.meta_path.insert(0, found)  # type: ignore[arg-type]
    yield found
    sys.meta_path.remove(found)  # type: ignore[arg-type]
    found.forget()
    sys.modules.update(before)


def packages_of(source: str) -> set[str]:
    """Top-level names that a file imports, without its own."""
    nodes = list(ast.walk(ast.parse(source)))
    plain = {alias.name.partition(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    others = {(n.module or "").partition(".")[0] for n in nodes if isinstance(n, ast.ImportFrom) and not n.level}
    return plain | others


def modules_of(kind: type[CheckoutBackend], *, own_focal: bool) -> list[str]:
    """Modules of its checkout that a backend names in its source, in that order."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(inspect.getmodule(kind)))) if is_load(node)]  # type: ignore[arg-type]
    named = [argument.value for call in calls for argument in call.args if isinstance(argument, ast.Constant)]
    found = dict.fromkeys([kind.project.package, *(name for name in named if re.fullmatch(r"\w+(\.\w+)+", name))])
    return [name for name in found if own_focal or not name.endswith("fl_net")]


def is_load(node: ast.AST) -> bool:
    """Whether it asks a checkout for a module: ``checkout.load(MODULE)``, ``checkout.attribute(NAME, MODULE)``."""
    return (
        isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in {"load", "attribute"}
    )


def test_all_backends_around_checkouts_are_here() -> None:
    assert {name for name, kind in KINDS.items() if issubclass(kind, CheckoutBackend)} == FILES.keys()


@pytest.mark.parametrize(
    ("name", "options"),
    [*((name, {}) for name in FILES), ("camerahmr", {"focal": "own"})],
    ids=lambda value: value if isinstance(value, str) else "-".join(value.values()),
)
def test_missing_names_all_packages_that_its_checkout_imports(
    name: str, options: dict[str, str], stub: Callable[..., Path], recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = KINDS[name]
    backend = kind(kind.Options(checkout=str(stub(name, FILES[name])), **options))
    for module in modules_of(kind, own_focal=options.get("focal") == "own"):
        backend._checkout_network.checkout.load(module)
    imported = set(recorder.imported)
    assert imported

    monkeypatch.setattr(checkouts, "_exists", lambda module: False)
    recorder.forget()
    (line,) = [line for line in backend.missing() if " of the environment: pip install " in line]
    named = re.search(r" needs the packages? (.*) of the environment", line)
    assert named is not None
    assert set(named[1].split(", ")) == imported
