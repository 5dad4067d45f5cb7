"""The registry: look up backends by interface and name, and import their classes."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from physic_core.discovery import local_modules
from physic_core.discovery.local_modules import TARGET
from physic_core.discovery.offers import (
    NAMED_IN_CONFIG,
    REGISTERED_BY_HAND,
    UNREGISTERED_CLASS,
    BackendOffer,
    BrokenPlugin,
    Manifest,
    Origin,
    backend_record_problem,
    canonicalize_name,
    with_article,
)
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.records import BackendRecord
from physic_core.errors import AmbiguousBackendError, BackendError, BackendNotFoundError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.interfaces import Backend

__all__ = [
    "BackendOffer",
    "BackendRecord",
    "BrokenPlugin",
    "Manifest",
    "Origin",
    "Registry",
    "canonicalize_name",
    "signature_problem",
]


class Registry:
    """The available backends, by interface and name.

    :func:`physic_core.discovery.plugins.discover` returns a registry of all installed plugins. A new registry contains
    them too, and more can be added::

        registry = Registry()
        registry.register(BackendRecord("metric_depth", "mine", MyDepth, api=1))

    Args:
        offers: further backends; where two offer one name, users write "distribution:name".
        broken: further plugins with errors.
        restriction: value of ``PHYSIC_PLUGINS`` that hides all other plugins; None if it is not set.
        manifests: further weight manifests.
        installed: whether to include the installed plugins; False starts with an empty registry.
    """

    def __init__(
        self,
        offers: Iterable[BackendOffer] = (),
        broken: Iterable[BrokenPlugin] = (),
        *,
        restriction: str | None = None,
        manifests: Iterable[Manifest] = (),
        installed: bool = True,
    ) -> None:
        from physic_core.discovery.entry_points import FoundPlugins, find_plugins

        found = find_plugins() if installed else FoundPlugins()
        self._offers = [*found.offers, *offers]
        self.broken = (*found.broken, *broken)
        self.restriction = found.restriction if restriction is None else restriction
        self.manifests = (*found.manifests, *manifests)

    def __iter__(self) -> Iterator[BackendOffer]:
        """Iterate over all backends, sorted by interface, name and distribution."""
        # As text, since an invalid record may have a name that is not a string.
        return iter(sorted(self._offers, key=lambda c: (str(c.record.interface), str(c.record.name), str(c.origin))))

    def __repr__(self) -> str:
        plugins = len({offer.origin.distribution for offer in self._offers})
        parts = [f"{_count(len(self._offers), 'backend')} of {_count(plugins, 'distribution')}"]
        parts += [f"{len(self.broken)} broken"] if self.broken else []
        parts += [f"PHYSIC_PLUGINS={self.restriction!r}"] if self.restriction is not None else []
        return f"Registry({', '.join(parts)})"

    def register(self, record: BackendRecord, origin: Origin = REGISTERED_BY_HAND) -> None:
        """Add a backend, or replace a backend of the same name from an earlier call of this method.

        Raises:
            BackendError: the record is invalid.
        """
        offer = BackendOffer(record, origin)
        if problem := backend_record_problem(record, origin):
            raise BackendError(f"{offer} cannot be registered: {problem}")
        if origin == REGISTERED_BY_HAND:  # a notebook cell may run several times
            self._offers = [old for old in self._offers if (old.origin, _key(old)) != (REGISTERED_BY_HAND, _key(offer))]
        self._offers.append(offer)

    def names(self, interface: str) -> tuple[str, ...]:
        """Return the sorted names of the backends of an interface."""
        return tuple(sorted({str(c.record.name) for c in self._offers if c.record.interface == interface}))

    def with_same_name(self, offer: BackendOffer) -> tuple[BackendOffer, ...]:
        """Return the other backends with the same interface and name."""
        return tuple(c for c in self if _key(c) == _key(offer) and c is not offer)

    def get(self, interface: str, name: str) -> BackendOffer:
        """Return the backend of an interface that has this name.

        Args:
            interface: "metric_depth", ...
            name: "name"; "distribution:name" if two distributions offer it; "package.module:Class" for a class that no
                plugin registers; "/folder/module:Class" for a class in a file of that folder.

        Raises:
            BackendNotFoundError: no installed plugin offers it.
            AmbiguousBackendError: two distributions offer it.
            BackendError: one distribution offers it twice, or it was written for another version of its interface.
        """
        _, target = local_modules.split_folder(name)
        distribution, colon, rest = target.rpartition(":")
        found = [c for c in self if c.record.interface == interface and c.record.name == rest]
        if colon:
            found = [c for c in found if canonicalize_name(c.origin.distribution) == canonicalize_name(distribution)]
            if not found and TARGET.fullmatch(target) and not self._has_distribution(distribution):
                return BackendOffer(_record_of_class(interface, name), NAMED_IN_CONFIG)
        if not found:
            raise self._not_found(target, interface)
        if len(found) > 1:
            several = len({offer.origin.distribution for offer in found}) > 1
            raise (AmbiguousBackendError if several else BackendError)(self.explain_ambiguity(found))
        if found[0].problem:
            raise BackendError(f"{found[0]} cannot be used: {found[0].problem}")
        return found[0]

    def find_by_name(self, name: str) -> tuple[BackendOffer, ...]:
        """Return the backends of all interfaces that have this name. Names are written as in :meth:`get`.

        "package.module:Class" is imported to find its interface.

        Raises:
            BackendNotFoundError: no backend has this name.
            BackendError: the class cannot be imported, or implements no interface.
        """
        _, target = local_modules.split_folder(name)
        distribution, _, bare = target.rpartition(":")
        owner = canonicalize_name(distribution)
        found = [c for c in self if c.record.name == bare and owner in ("", canonicalize_name(c.origin.distribution))]
        if not found and TARGET.fullmatch(target) and not self._has_distribution(distribution):
            return (_offer_of_class(name),)
        if not found:
            raise self._not_found(target, None)
        return tuple(found)

    def load_class(self, offer: BackendOffer) -> type[Backend]:
        """Import the class of a backend.

        Raises:
            BackendError: it cannot be imported, or is not a subclass of its interface.
        """
        from physic_core.interfaces import INTERFACES

        record, wanted = offer.record, INTERFACES[offer.record.interface]
        found: object = record.target
        if isinstance(record.target, str):
            found = _import_target(record.target, f"{offer} cannot be imported from {record.target}", offer.origin)
        if not (isinstance(found, type) and issubclass(found, wanted)):
            raise BackendError(
                f"{offer}: {record.target} is not a subclass of physic_core.interfaces.{wanted.__name__}"
            )
        return found

    def load_concrete_class(self, offer: BackendOffer) -> type[Backend]:
        """Import the class of a backend, and check that it implements all methods of its interface.

        Raises:
            BackendError: it cannot be imported, is not a subclass of its interface, does not implement a method, or its
                ``infer`` has other arguments.
        """
        kind = self.load_class(offer)
        if missing := sorted(getattr(kind, "__abstractmethods__", ())):
            wanted = f"the interface {offer.record.interface} requires"
            raise BackendError(f"{offer}: {offer.record.target} has no method {' and '.join(missing)}, which {wanted}")
        if problem := signature_problem(kind, offer.record.interface):
            raise BackendError(f"{offer}: {problem}")
        return kind

    def explain_ambiguity(self, offers: Iterable[BackendOffer]) -> str:
        """Return a message that lists backends of the same name, and how to choose one."""
        offers = sorted(offers, key=lambda c: c.origin.distribution)
        record = offers[0].record
        offer = f"{with_article(record.interface)} named '{record.name}'"
        distributions = dict.fromkeys(c.origin.distribution for c in offers)
        if len(distributions) == 1:
            return f"{offers[0].origin} offers {offer} {len(offers)} times: its author has to remove all but one"
        choices = " or ".join(f"'{d}:{record.name}'" for d in distributions)
        return f"{' and '.join(str(c.origin) for c in offers)} each offer {offer}: write {choices} to choose"

    def _not_found(self, name: str, interface: str | None) -> BackendNotFoundError:
        from physic_core.discovery.missing_backends import explain_missing

        message = explain_missing(name, interface, tuple(self), self.broken, self.restriction)
        error = BackendNotFoundError(f"{message} (Python: {sys.executable})")
        error.__cause__ = next((b.error for b in self.broken if b.error), None)
        return error

    def _has_distribution(self, distribution: str) -> bool:
        return any(canonicalize_name(c.origin.distribution) == canonicalize_name(distribution) for c in self._offers)


def signature_problem(kind: type[Backend], interface: str) -> str:
    """Return why ``infer`` of a class does not accept the arguments of its interface; empty if it does."""
    from physic_core.interfaces import INTERFACES

    own: Any = kind
    arguments = list(inspect.signature(vars(INTERFACES[interface])["infer"]).parameters)
    taken = inspect.signature(own.infer)
    bound = isinstance(inspect.getattr_static(kind, "infer"), (staticmethod, classmethod))
    try:
        taken.bind(*arguments[1:] if bound else arguments)
    except TypeError as error:
        return f"infer{taken} should take {', '.join(arguments[1:])}: {error}"
    return ""


def _key(offer: BackendOffer) -> tuple[str, str]:
    return offer.record.interface, offer.record.name


def _offer_of_class(name: str) -> BackendOffer:
    """Import "package.module:Class", and return it as a backend of the interface that it implements."""
    from physic_core.interfaces import INTERFACES

    target = local_modules.split_folder(name)[1]
    kind = _import_target(name, f"'{target}' cannot be imported", NAMED_IN_CONFIG)
    own = [name for name, wanted in INTERFACES.items() if isinstance(kind, type) and issubclass(kind, wanted)]
    if len(own) != 1:
        names = ", ".join(wanted.__name__ for wanted in INTERFACES.values())
        raise BackendError(f"'{target}' should be a subclass of one class of physic_core.interfaces: {names}")
    return BackendOffer(_record_of_class(own[0], name), UNREGISTERED_CLASS)


def _record_of_class(interface: str, name: str) -> BackendRecord:
    """Return a record for a class that no plugin registers, with the core's version of the interface."""
    from physic_core.interfaces import INTERFACES

    return BackendRecord(interface, local_modules.split_folder(name)[1], name, api=INTERFACES[interface].api)


def _import_target(target: str, title: str, origin: Origin) -> object:
    """Import "package.module:Class" or "/folder/module:Class"."""
    folder, target = local_modules.split_folder(target)
    module, _, path = target.partition(":")
    found: object = None
    try:
        with plugin_code():
            found = importlib.import_module(module) if folder is None else local_modules.load_module(folder, module)
            for part in path.split("."):
                found = getattr(found, part)
    except Exception as cause:  # any error of a plugin's module: name the plugin
        advice = _advice(origin, folder, module, cause)
        named_wrong = found is not None or _is_not_found(module, cause)
        kind = BackendNotFoundError if origin in (NAMED_IN_CONFIG, UNREGISTERED_CLASS) and named_wrong else BackendError
        from physic_core.discovery.error_text import describe_error

        raise kind(f"{title}: {describe_error(cause, module, origin.plugin)}{advice}") from cause
    return found


def _is_not_found(module: str, cause: BaseException) -> bool:
    """Return whether the named module itself does not exist, rather than a module that it imports."""
    return isinstance(cause, ModuleNotFoundError) and (cause.name is None or f"{module}.".startswith(f"{cause.name}."))


def _advice(origin: Origin, folder: Path | None, module: str, cause: BaseException) -> str:
    """Return the remedy if a named module, or one that it imports, is not found; empty for other errors."""
    missing = cause.name if isinstance(cause, ModuleNotFoundError) else None
    if origin not in (NAMED_IN_CONFIG, UNREGISTERED_CLASS) or missing is None:
        return ""
    missing = missing.partition(".")[0]
    if folder is None:
        is_named = missing == module.partition(".")[0]
        return f"; put {missing}.py beside the config, or its folder into PYTHONPATH" if is_named else ""
    if not (folder / f"{missing}.py").is_file() and not (folder / missing).is_dir():
        return ""
    return (
        f"; {missing} lies in {folder} too, but only {module} is taken from there: put both into a package and import "
        f"relatively, or put that folder into PYTHONPATH"
    )


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
