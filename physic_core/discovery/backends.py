"""Find backends by interface and name, and import their classes; nothing is imported to list
them.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from physic_core.discovery import local_modules
from physic_core.discovery.catalog import BACKENDS, how_to_install
from physic_core.discovery.entry_points import (
    PLUGINS_VARIABLE,
    Offer,
    canonicalize_name,
    installed_offers,
    restricted_to,
)
from physic_core.discovery.error_text import describe_error, did_you_mean
from physic_core.discovery.local_modules import TARGET
from physic_core.discovery.plugin_code import named_plugin_code, plugin_code
from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    ConfigError,
    WeightsMissingError,
)
from physic_core.interfaces import INTERFACES

if TYPE_CHECKING:
    from physic_core.interfaces import Backend

_IN_CONFIG = "named in the config"


def require_interface(name: str) -> None:
    """Raise ConfigError if no interface has this name."""
    if name not in INTERFACES:
        raise ConfigError(
            f"no interface named '{name}'; there are: {', '.join(INTERFACES)}"
            f"{did_you_mean(name, INTERFACES)}"
        )


def list_backends(interface: str | None = None) -> tuple[Offer, ...]:
    """Return the installed backends of an interface, or of all, sorted by interface, name and
    distribution.

    Raises:
        ConfigError: no interface has this name.
    """
    if interface is not None:
        require_interface(interface)
    offers = installed_offers() if interface is None else installed_offers(f"physic.{interface}")
    return tuple(offer for offer in offers if offer.interface in INTERFACES)


def find_backend(interface: str, name: str) -> Offer:
    """Return the backend of an interface that has this name; it is not imported.

    Args:
        interface: "metric_depth", ...
        name: "name"; "distribution:name" if two distributions offer it; "package.module:Class" for
            a class that no plugin offers; "/folder/module:Class" for a class in a file of that
            folder.

    Raises:
        BackendNotFoundError: no installed plugin offers it.
        AmbiguousBackendError: two distributions offer it.
    """
    offers = _offers_named(list_backends(interface), name)
    if len(offers) == 1:
        return offers[0]
    if offers:
        ways = " or ".join(f"'{offer.distribution}:{offer.name}'" for offer in offers)
        raise AmbiguousBackendError(
            f"{' and '.join(map(str, offers))} share a name: write {ways} to choose"
        )
    target = local_modules.split_folder(name)[1]
    distribution = canonicalize_name(target.partition(":")[0])
    if TARGET.fullmatch(target) and distribution not in {
        canonicalize_name(o.distribution) for o in list_backends()
    }:
        return Offer(f"physic.{interface}", target, name, _IN_CONFIG)
    raise BackendNotFoundError(f"{_explain_missing(target, interface)} (Python: {sys.executable})")


def find_by_name(name: str) -> tuple[Offer, ...]:
    """Return the backends of all interfaces that have this name.

    Names are written as in :func:`find_backend`.

    "package.module:Class" is imported to find its interface.

    Raises:
        BackendNotFoundError: no backend has this name.
        BackendError: the class cannot be imported, or implements no interface.
    """
    if offers := _offers_named(list_backends(), name):
        return offers
    target = local_modules.split_folder(name)[1]
    if not TARGET.fullmatch(target):
        raise BackendNotFoundError(f"{_explain_missing(target, None)} (Python: {sys.executable})")
    kind = _import_target(Offer("", target, name, _IN_CONFIG), f"'{target}'")
    matches = [
        name
        for name, wanted in INTERFACES.items()
        if isinstance(kind, type) and issubclass(kind, wanted)
    ]
    if len(matches) != 1:
        names = ", ".join(wanted.__name__ for wanted in INTERFACES.values())
        raise BackendError(
            f"'{target}' should be a subclass of one class of physic_core.interfaces: {names}"
        )
    return (Offer(f"physic.{matches[0]}", target, name, _IN_CONFIG),)


def load_class(offer: Offer) -> type[Backend]:
    """Import the class of a backend, and check its interface and the version of the interface.

    Raises:
        BackendNotFoundError: a config names a class that does not exist.
        BackendError: the class cannot be imported, or is not a backend of the interface.
    """
    kind: Any = _import_target(offer, str(offer))
    if problem := class_problem(kind, offer.interface) or _constructor_problem(kind):
        raise BackendError(f"{offer}: {offer.target} {problem}")
    written = getattr(kind, "written_for", None)
    ours = INTERFACES[offer.interface].api
    if written is None and offer.distribution == _IN_CONFIG:
        written = ours
    if not isinstance(written, int):
        raise BackendError(
            f"{offer}: {offer.target} should state the version of its interface: written_for = "
            f"{ours}"
        )
    if written != ours:
        older = "metricbody" if written > ours else offer.distribution
        raise BackendError(
            f"{offer} is written for version {written} of the interface {offer.interface}, and "
            f"this metricbody has version {ours}: upgrade {older}"
        )
    loaded: type[Backend] = kind
    return loaded


def class_problem(kind: object, interface: str) -> str:
    """Return why an object is not a complete backend class of an interface, as the end of a
    sentence; "" if it is.
    """
    wanted: Any = INTERFACES[interface]
    if not (isinstance(kind, type) and issubclass(kind, wanted)):
        return f"is not a subclass of physic_core.interfaces.{wanted.__name__}"
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        return f"has no method {' and '.join(missing)}, which the interface {interface} requires"
    options = getattr(kind, "Options", None)
    if not (isinstance(options, type) and issubclass(options, BaseModel)):
        return "has Options that are not a subclass of physic_core.interfaces.Options"
    own: Any = kind
    arguments = list(inspect.signature(vars(wanted)["infer"]).parameters)
    bound = isinstance(inspect.getattr_static(kind, "infer"), (staticmethod, classmethod))
    taken = inspect.signature(own.infer)
    try:
        taken.bind(*arguments[1:] if bound else arguments)
    except TypeError as error:
        return f"has infer{taken}, which should take {', '.join(arguments[1:])}: {error}"
    return ""


def _constructor_problem(kind: Any) -> str:
    """Return why a class cannot be constructed with its options, likewise."""
    taken = inspect.signature(kind.__init__)
    try:
        taken.bind(kind, None)
    except TypeError:
        return (
            f"has __init__{taken}, which should take the options, or be left out: "
            f"def __init__(self, options=None): super().__init__(options)"
        )
    return ""


def summary_of(kind: type[Backend]) -> str:
    """Return the first paragraph of the docstring of a backend's class, as one line."""
    return " ".join(inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())


def missing_requirements(backend: Backend) -> tuple[str, ...]:
    """Call ``missing()`` of a backend, and return its messages about missing requirements.

    Raises:
        BackendError: ``missing()`` fails, or does not return texts.
        PhysicError: raised by the backend itself.
    """
    try:
        with named_plugin_code("missing() fails", type(backend)):
            messages: object = backend.missing()
    except WeightsMissingError as error:
        return (str(error),)
    if not isinstance(messages, (tuple, list)) or not all(
        isinstance(text, str) for text in messages
    ):
        raise BackendError(f"missing() must return a tuple of texts, got {messages!r}")
    return tuple(messages)


def _offers_named(offers: tuple[Offer, ...], name: str) -> tuple[Offer, ...]:
    """Return the backends named "name" or "distribution:name"."""
    owner, _, bare = name.rpartition(":")
    return tuple(
        offer
        for offer in offers
        if offer.name == bare
        and canonicalize_name(owner) in ("", canonicalize_name(offer.distribution))
    )


def _explain_missing(name: str, interface: str | None) -> str:
    """Return why no backend has this name, and what to install or to write instead."""
    offers = list_backends(interface)
    names = sorted({offer.name for offer in offers})
    installed = (
        f"installed: {', '.join(names) or 'none'}"
        if interface
        else "`physic plugins` lists what is installed"
    )
    parts = [f"no {interface or 'backend'} named '{name}'; {installed}"]
    if restricted_to() is not None:
        # First, since a restriction may hide plugins that the later advice would install.
        parts.append(
            f"{PLUGINS_VARIABLE}={os.environ[PLUGINS_VARIABLE]!r} hides every other plugin: add "
            f"to it"
        )
    bare = name.rpartition(":")[2]
    others = sorted({offer.interface for offer in list_backends() if offer.name == bare})
    if owners := [offer.distribution for offer in offers if offer.name == bare]:
        parts.append(f"'{bare}' comes from {' and '.join(owners)}")
    elif others:
        parts.append(f"'{bare}' is the name of a {' and of a '.join(others)}")
    elif bare in BACKENDS:
        parts.append(f"'{bare}' comes with {BACKENDS[bare]}: {how_to_install(BACKENDS[bare])}")
    elif bare in INTERFACES:
        parts.append(f"'{bare}' is an interface: physic plugins --interface {bare}")
    similar = did_you_mean(bare, {*names, *BACKENDS} - {bare})
    if len(parts) == 1 and not similar:
        parts.append(
            "For a plugin of yours, install it (pip install -e its folder), or name it as "
            "PACKAGE.MODULE:CLASS"
        )
    return ". ".join(parts) + similar


def _import_target(offer: Offer, title: str) -> object:
    """Import "package.module:Class" or "/folder/module:Class"."""
    folder, target = local_modules.split_folder(offer.target)
    module, _, path = target.partition(":")
    imported: object = None
    try:
        with plugin_code():
            imported = (
                importlib.import_module(module)
                if folder is None
                else local_modules.load_module(folder, module)
            )
            for part in path.split("."):
                imported = getattr(imported, part)
    except Exception as cause:  # any error of a plugin's module: name the plugin
        kind = BackendError
        advice = ""
        if offer.distribution == _IN_CONFIG:
            if isinstance(cause, ModuleNotFoundError):
                advice = (
                    "; beside a config, only the module that it names is found: put others "
                    "into PYTHONPATH"
                )
            if imported is not None or _is_not_found(module, cause):
                kind = BackendNotFoundError
        raise kind(
            f"{title} cannot be imported: {describe_error(cause, module)}{advice}"
        ) from cause
    return imported


def _is_not_found(module: str, cause: BaseException) -> bool:
    """Return whether the named module itself does not exist, rather than a module that it
    imports.
    """
    return isinstance(cause, ModuleNotFoundError) and (
        cause.name is None or f"{module}.".startswith(f"{cause.name}.")
    )
