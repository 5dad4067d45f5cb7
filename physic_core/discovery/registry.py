"""Registry of available backends by interface and name, with error messages for missing ones."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from physic_core.discovery import local_modules
from physic_core.discovery.catalog import CATALOG, distribution_for, how_to_install, known_names
from physic_core.discovery.claims import (
    BY_CLASS,
    BY_HAND,
    IN_CONFIG,
    BrokenPlugin,
    Claim,
    Manifest,
    Origin,
    normal_name,
    problem_of,
)
from physic_core.discovery.error_text import describe
from physic_core.discovery.local_modules import TARGET
from physic_core.discovery.records import BackendRecord
from physic_core.errors import AmbiguousBackendError, BackendError, BackendNotFoundError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.interfaces import Backend

__all__ = [
    "TARGET",
    "BackendRecord",
    "BrokenPlugin",
    "Claim",
    "Manifest",
    "Origin",
    "Registry",
    "call_fault",
    "normal_name",
]


class Registry:
    """Backends by interface and name.

    :func:`physic_core.discovery.plugins.discover` builds one of all installed plugins. One built by hand adds
    to the installed backends::

        registry = Registry()
        registry.register(BackendRecord("metric_depth", "mine", MyDepth, api=1))

    Args:
        claims: further backends; where two claim one name, users write "distribution:name".
        broken: further plugins that failed, completely or in part.
        restriction: value of ``PHYSIC_PLUGINS`` that hides all other plugins; None if it is not set.
        manifests: further lists of weights, unread.
        installed: whether to include the installed plugins; False starts with an empty registry.
    """

    def __init__(
        self,
        claims: Iterable[Claim] = (),
        broken: Iterable[BrokenPlugin] = (),
        *,
        restriction: str | None = None,
        manifests: Iterable[Manifest] = (),
        installed: bool = True,
    ) -> None:
        from physic_core.discovery.entry_points import Found, find

        found = find() if installed else Found()
        self._claims = [*found.claims, *claims]
        self.broken = (*found.broken, *broken)
        self.restriction = found.restriction if restriction is None else restriction
        self.manifests = (*found.manifests, *manifests)

    def __iter__(self) -> Iterator[Claim]:
        """Every claim, by interface, name and distribution."""
        # As text, since an invalid record may have a name that is not a string.
        return iter(sorted(self._claims, key=lambda c: (str(c.record.interface), str(c.record.name), str(c.origin))))

    def __repr__(self) -> str:
        plugins = len({claim.origin.distribution for claim in self._claims})
        parts = [f"{_count(len(self._claims), 'backend')} of {_count(plugins, 'distribution')}"]
        parts += [f"{len(self.broken)} broken"] if self.broken else []
        parts += [f"PHYSIC_PLUGINS={self.restriction!r}"] if self.restriction is not None else []
        return f"Registry({', '.join(parts)})"

    def register(self, record: BackendRecord, origin: Origin = BY_HAND) -> None:
        """Add a backend; it replaces one that was registered by hand under its name.

        Raises:
            BackendError: the record is invalid.
        """
        claim = Claim(record, origin)
        if problem := problem_of(record, origin):
            raise BackendError(f"{claim} cannot be registered: {problem}")
        if origin == BY_HAND:  # a notebook cell may run several times
            self._claims = [old for old in self._claims if (old.origin, _key(old)) != (BY_HAND, _key(claim))]
        self._claims.append(claim)

    def names(self, interface: str) -> tuple[str, ...]:
        """Names of the backends of an interface, sorted."""
        return tuple(sorted({str(c.record.name) for c in self._claims if c.record.interface == interface}))

    def rivals(self, claim: Claim) -> tuple[Claim, ...]:
        """Other backends with the interface and name of ``claim``."""
        return tuple(c for c in self if _key(c) == _key(claim) and c is not claim)

    def get(self, interface: str, name: str) -> Claim:
        """Look up a backend.

        Args:
            interface: "metric_depth", ...
            name: a name; "distribution:name" where two distributions offer it; "package.module:Class" for a class
                that no plugin registers, with a folder before it ("/folder/module:Class") for one in a file of its own.

        Raises:
            BackendNotFoundError: nothing installed offers it.
            AmbiguousBackendError: two distributions offer it.
            BackendError: one distribution offers it twice, or it was written for another version of its interface.
        """
        _, target = local_modules.split(name)
        distribution, colon, rest = target.rpartition(":")
        found = [c for c in self if c.record.interface == interface and c.record.name == rest]
        if colon:
            found = [c for c in found if normal_name(c.origin.distribution) == normal_name(distribution)]
            if not found and TARGET.fullmatch(target) and not self._knows(distribution):
                return Claim(_record_of_class(interface, name), IN_CONFIG)
        if not found:
            raise self._not_found(interface, target)
        if len(found) > 1:
            several = len({claim.origin.distribution for claim in found}) > 1
            raise (AmbiguousBackendError if several else BackendError)(self.explain_rivals(found))
        if found[0].problem:
            raise BackendError(f"{found[0]} cannot be used: {found[0].problem}")
        return found[0]

    def called(self, name: str) -> tuple[Claim, ...]:
        """All claims to a name, or to "distribution:name", of any interface; at least one.

        "package.module:Class" is a class that no plugin registers, and is imported to find its interface.

        Raises:
            BackendNotFoundError: there is none.
            BackendError: the class cannot be imported, or is of no interface.
        """
        _, target = local_modules.split(name)
        distribution, _, bare = target.rpartition(":")
        asked = normal_name(distribution)
        found = [c for c in self if c.record.name == bare and asked in ("", normal_name(c.origin.distribution))]
        if not found and TARGET.fullmatch(target) and not self._knows(distribution):
            return (_claim_of_class(name),)
        if not found:
            says = self._explain("backend", target, tuple(sorted({str(c.record.name) for c in self})), None)
            raise self._not_found_error(says)
        return tuple(found)

    def load_class(self, claim: Claim) -> type[Backend]:
        """Import the target of a claim.

        Raises:
            BackendError: the target cannot be imported, or is no class of its interface.
        """
        from physic_core.interfaces import INTERFACES

        record, wanted = claim.record, INTERFACES[claim.record.interface]
        found: object = record.target
        if isinstance(record.target, str):
            found = _imported(record.target, f"{claim} cannot be imported from {record.target}", claim.origin)
        if not (isinstance(found, type) and issubclass(found, wanted)):
            raise BackendError(f"{claim}: {record.target} is no subclass of physic_core.interfaces.{wanted.__name__}")
        return found

    def load_concrete_class(self, claim: Claim) -> type[Backend]:
        """Import a backend and check that its class implements all methods of its interface.

        Raises:
            BackendError: it cannot be imported, is no class of its interface, lacks a method of it, or its ``infer``
                takes other arguments.
        """
        kind = self.load_class(claim)
        if missing := sorted(getattr(kind, "__abstractmethods__", ())):
            wanted = f"the interface {claim.record.interface} asks for"
            raise BackendError(f"{claim}: {claim.record.target} has no method {' and '.join(missing)}, which {wanted}")
        if fault := call_fault(kind, claim.record.interface):
            raise BackendError(f"{claim}: {fault}")
        return kind

    def explain_rivals(self, claims: Iterable[Claim]) -> str:
        """How to choose between several backends of one name; one line."""
        claims = sorted(claims, key=lambda c: c.origin.distribution)
        record = claims[0].record
        offer = f"{_a(record.interface)} named '{record.name}'"
        distributions = dict.fromkeys(c.origin.distribution for c in claims)
        if len(distributions) == 1:
            return f"{claims[0].origin} offers {offer} {len(claims)} times: its author has to remove all but one"
        choices = " or ".join(f"'{d}:{record.name}'" for d in distributions)
        return f"{' and '.join(str(c.origin) for c in claims)} each offer {offer}: write {choices} to choose"

    def explain_missing(self, interface: str, name: str) -> str:
        """The reason why there is no such backend, and its remedy; one line."""
        return self._explain(interface, name, self.names(interface), interface)

    def _explain(self, kind: str, name: str, names: tuple[str, ...], interface: str | None) -> str:
        """The message for one interface, or for all where it is None."""
        asked, _, bare = name.rpartition(":")
        owners = dict.fromkeys(
            c.origin.distribution for c in self if c.record.name == bare and interface in (None, c.record.interface)
        )
        says = [f"no {kind} named '{name}'; installed: {', '.join(names) or 'none'}"]
        restricted = self.restriction is not None
        if restricted:
            # First, since a restriction may hide plugins that the later advice would install.
            says.append(f"PHYSIC_PLUGINS='{self.restriction}' hides every other plugin: unset it, or add to it")
        if asked and owners and self._knows(asked):
            says.append(f"'{bare}' comes from {' and '.join(owners)}")
        elif asked and not self._knows(asked):
            says += self._explain_distribution(asked, bare)
        elif close := get_close_matches(bare, names, n=1):
            says.append(f"Did you mean '{close[0]}'?")
        elif close := get_close_matches(bare, known_names(interface), n=1):
            # No installed name is similar: a distribution that is not installed may offer it.
            known = distribution_for(interface, close[0]) or close[0]
            cure = how_to_install(known)
            if restricted:
                cure = f"add {known} to it, if need be after {cure}"
            asks = "" if close[0] == bare else f"Did you mean '{close[0]}'? "
            says.append(f"{asks}'{close[0]}' comes with {known}: {cure}")
        elif others := sorted({c.record.interface for c in self if c.record.name == bare}):
            says.append(f"'{bare}' is {' and '.join(map(_a, others))}")
        if self.broken:
            says.append(f"Broken plugins: {', '.join(map(str, self.broken))}")
        return ". ".join(says).replace("?.", "?")

    def _explain_distribution(self, distribution: str, name: str) -> list[str]:
        """The reason why the distribution of a qualified name offers no such backend, and its remedy."""
        asked = normal_name(distribution)
        if any(normal_name(broken.origin.distribution) == asked for broken in self.broken):
            return []  # the list of broken plugins has the reason
        known = dict.fromkeys((*(normal_name(c.origin.distribution) for c in self), *CATALOG))
        if asked not in known and (close := get_close_matches(asked, known, n=1)):
            return [f"Did you mean '{close[0]}:{name}'?"]
        if self.restriction is not None:
            return [f"'{name}' comes with {asked}: add {asked} to it, if need be after {how_to_install(asked)}"]
        return [f"'{name}' comes with {asked}, which is not installed: {how_to_install(asked)}"]

    def _not_found(self, interface: str, name: str) -> BackendNotFoundError:
        return self._not_found_error(self.explain_missing(interface, name))

    def _not_found_error(self, says: str) -> BackendNotFoundError:
        error = BackendNotFoundError(f"{says}\nPython: {sys.executable}")
        error.__cause__ = next((b.error for b in self.broken if b.error), None)
        return error

    def _knows(self, distribution: str) -> bool:
        return any(normal_name(c.origin.distribution) == normal_name(distribution) for c in self._claims)


def call_fault(kind: type[Backend], interface: str) -> str:
    """Why ``infer`` of a class cannot be called with the arguments of its interface; empty where it can."""
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


def _key(claim: Claim) -> tuple[str, str]:
    return claim.record.interface, claim.record.name


def _claim_of_class(name: str) -> Claim:
    """A class named as "package.module:Class", as a backend of the interface that it derives from."""
    from physic_core.interfaces import INTERFACES

    target = local_modules.split(name)[1]
    kind = _imported(name, f"'{target}' cannot be imported", IN_CONFIG)
    own = [name for name, wanted in INTERFACES.items() if isinstance(kind, type) and issubclass(kind, wanted)]
    if len(own) != 1:
        names = ", ".join(wanted.__name__ for wanted in INTERFACES.values())
        raise BackendError(f"'{target}' should be a subclass of one class of physic_core.interfaces: {names}")
    return Claim(_record_of_class(own[0], name), BY_CLASS)


def _record_of_class(interface: str, name: str) -> BackendRecord:
    """The record of a class that no plugin registers: without a stated version, the core's is assumed."""
    from physic_core.interfaces import INTERFACES

    return BackendRecord(interface, local_modules.split(name)[1], name, api=INTERFACES[interface].api)


def _imported(target: str, title: str, origin: Origin) -> object:
    """Import "package.module:Class", with or without a folder before it."""
    folder, target = local_modules.split(target)
    module, _, path = target.partition(":")
    found: object = None
    try:
        found = importlib.import_module(module) if folder is None else local_modules.load(folder, module)
        for part in path.split("."):
            found = getattr(found, part)
    except (Exception, SystemExit) as cause:  # any error of a plugin's module: name the plugin
        advice = _advice(origin, folder, module, cause)
        named_wrong = found is not None or _is_not_found(module, cause)
        kind = BackendNotFoundError if origin in (IN_CONFIG, BY_CLASS) and named_wrong else BackendError
        raise kind(f"{title}: {describe(cause, module, origin.plugin)}{advice}") from cause
    return found


def _is_not_found(module: str, cause: BaseException) -> bool:
    """Whether the module itself does not exist, rather than one that it imports."""
    return isinstance(cause, ModuleNotFoundError) and (cause.name is None or f"{module}.".startswith(f"{cause.name}."))


def _advice(origin: Origin, folder: Path | None, module: str, cause: BaseException) -> str:
    """Remedy if a named module, or one that it imports, is not found; empty for other errors."""
    missing = cause.name if isinstance(cause, ModuleNotFoundError) else None
    if origin not in (IN_CONFIG, BY_CLASS) or missing is None:
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


def _a(interface: str) -> str:
    return f"an {interface}" if interface[0] in "aeiou" else f"a {interface}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
