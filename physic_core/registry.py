"""Which backends there are, by interface and name, and what to say when one is not there."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import TYPE_CHECKING

from physic_core.catalog import distribution_for, known_names
from physic_core.errors import BackendError, BackendNotFoundError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.interfaces import Backend

__all__ = [
    "PLUGIN_API",
    "TARGET",
    "BackendRecord",
    "BrokenPlugin",
    "Claim",
    "Manifest",
    "Origin",
    "Registry",
    "normal_name",
]

PLUGIN_API = 1
"""Version of the contract between the core and its plugins: the hook, the record and the eight interfaces."""

TARGET = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
"""What a target written as text looks like."""


@dataclass(frozen=True)
class BackendRecord:
    """What a plugin says about one backend.

    Attributes:
        interface: "segmenter", "inpainter", "metric_depth", "relative_pointmap", "keypoint_detector", "body_estimator",
            "hand_estimator" or "contact_prior".
        name: the backend's name in configs, lower case with hyphens.
        target: "package.module:Class", imported when the backend is first used. In a registry built by hand, the class
            itself will do.
        api: plugin API that the backend was written for.
        summary: one line for ``physic plugins``.
        weights_license: licence of the weights in words; empty where there are none.
        needs: what it needs beyond its distribution, one word or phrase each ("GPU", "a checkpoint file").
        homepage: where to read more.
        packages: import names of what else has to be installed, such as that of an extra; ``physic plugins`` looks for
            them without importing them.
        weights: names of the sets of its plugin's list of weights that it reads where no option says otherwise;
            ``physic plugins`` looks for their files, which answers the need "weights".
    """

    interface: str
    name: str
    target: str | type[Backend]
    api: int = PLUGIN_API
    summary: str = ""
    weights_license: str = ""
    needs: tuple[str, ...] = ()
    homepage: str = ""
    packages: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()


@dataclass(frozen=True)
class Origin:
    """Who made a claim.

    Attributes:
        plugin: import name of the plugin's module.
        distribution: installed distribution.
        version: of the distribution.
        seconds: time that the plugin took to say what it offers.
    """

    plugin: str
    distribution: str
    version: str = ""
    seconds: float = field(default=0.0, compare=False)

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()


BY_HAND = Origin("", "registered by hand")
IN_CONFIG = Origin("", "named in the config")
BY_CLASS = Origin("", "a class that no plugin registers")


@dataclass(frozen=True)
class Claim:
    """One backend, as somebody offers it.

    Attributes:
        record: what it is.
        origin: who offers it.
        problem: why it cannot be used, in words; empty where nothing speaks against it.
    """

    record: BackendRecord
    origin: Origin
    problem: str = ""

    def __str__(self) -> str:
        return f"{self.record.interface} '{self.record.name}' ({self.origin})"


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that could not say what it offers.

    Attributes:
        origin: which one.
        cause: in one line.
        error: the exception itself, if there was one.
    """

    origin: Origin
    cause: str
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.origin} ({self.cause})"


@dataclass(frozen=True)
class Manifest:
    """Where a plugin lists its weights.

    Attributes:
        origin: whose it is.
        path: a TOML file, or a folder of them, for :func:`physic_core.weights.read_manifest`.
    """

    origin: Origin
    path: Path


class Registry:
    """Backends by interface and name.

    :func:`physic_core.plugins.discover` builds one of all that is installed; a test or a notebook builds its own::

        registry = Registry()
        registry.register(BackendRecord("metric_depth", "mine", MyDepth))

    Args:
        claims: backends on offer; two may claim one name, and neither gets it.
        broken: plugins that could not be read, or not as a whole.
        restriction: value of ``PHYSIC_PLUGINS`` that hid the rest, None where nothing did.
        manifests: the plugins' lists of weights; none of them has been read.
    """

    def __init__(
        self,
        claims: Iterable[Claim] = (),
        broken: Iterable[BrokenPlugin] = (),
        *,
        restriction: str | None = None,
        manifests: Iterable[Manifest] = (),
    ) -> None:
        self._claims = list(claims)
        self.broken = tuple(broken)
        self.restriction = restriction
        self.manifests = tuple(manifests)

    def __iter__(self) -> Iterator[Claim]:
        """Every claim, by interface, name and distribution."""
        # As text, since a plugin's mistake may be a name that is none.
        return iter(sorted(self._claims, key=lambda c: (str(c.record.interface), str(c.record.name), str(c.origin))))

    def register(self, record: BackendRecord, origin: Origin = BY_HAND) -> None:
        """Offer one more backend."""
        self._claims.append(Claim(record, origin))

    def names(self, interface: str) -> tuple[str, ...]:
        """Names on offer for an interface, sorted."""
        return tuple(sorted({str(c.record.name) for c in self._claims if c.record.interface == interface}))

    def rivals(self, claim: Claim) -> tuple[Claim, ...]:
        """The claims of others to the same name."""
        wanted = (claim.record.interface, claim.record.name)
        return tuple(c for c in self if (c.record.interface, c.record.name) == wanted and c is not claim)

    def get(self, interface: str, name: str) -> Claim:
        """Look a backend up.

        Args:
            interface: "metric_depth", ...
            name: a name; "distribution:name" where two distributions offer the same; "package.module:Class" for a class
                that no plugin registers.

        Raises:
            BackendNotFoundError: nothing installed offers it.
            BackendError: two distributions offer it, or it was written for another plugin API.
        """
        distribution, colon, rest = name.rpartition(":")
        found = [c for c in self if c.record.interface == interface and c.record.name == rest]
        if colon:
            found = [c for c in found if normal_name(c.origin.distribution) == normal_name(distribution)]
            if not found and TARGET.fullmatch(name) and not self._knows(distribution):
                return Claim(BackendRecord(interface, name, name), IN_CONFIG)
        if not found:
            raise self._not_found(interface, name)
        if len(found) > 1:
            raise BackendError(self.explain_rivals(found))
        if found[0].problem:
            raise BackendError(f"{found[0]} cannot be used: {found[0].problem}")
        return found[0]

    def called(self, name: str) -> tuple[Claim, ...]:
        """Every claim to a name, or to "distribution:name", whatever its interface; at least one.

        "package.module:Class" is a class that no plugin registers, and is imported to see what it is.

        Raises:
            BackendNotFoundError: there is none.
            BackendError: the class cannot be imported, or is of no interface.
        """
        distribution, _, bare = name.rpartition(":")
        asked = normal_name(distribution)
        found = [c for c in self if c.record.name == bare and asked in ("", normal_name(c.origin.distribution))]
        if not found and TARGET.fullmatch(name) and not self._knows(distribution):
            return (_claim_of_class(name),)
        if not found:
            says = self._explain("backend", name, tuple(sorted({str(c.record.name) for c in self})), None)
            raise self._not_found_error(says)
        return tuple(found)

    def load_class(self, claim: Claim) -> type[Backend]:
        """Import what a claim points at.

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

    def load_whole_class(self, claim: Claim) -> type[Backend]:
        """The same, of a class that can be constructed.

        Raises:
            BackendError: it cannot be imported, is no class of its interface, or lacks a method of it.
        """
        kind = self.load_class(claim)
        if missing := sorted(getattr(kind, "__abstractmethods__", ())):
            wanted = f"the interface {claim.record.interface} asks for"
            raise BackendError(f"{claim}: {claim.record.target} has no method {' and '.join(missing)}, which {wanted}")
        return kind

    def explain_rivals(self, claims: Iterable[Claim]) -> str:
        """What to do about several claims to one name; one line."""
        claims = sorted(claims, key=lambda c: c.origin.distribution)
        record = claims[0].record
        offer = f"{_a(record.interface)} named '{record.name}'"
        distributions = dict.fromkeys(c.origin.distribution for c in claims)
        if len(distributions) == 1:
            return f"{claims[0].origin} offers {offer} {len(claims)} times: its author has to remove all but one"
        choices = " or ".join(f"'{d}:{record.name}'" for d in distributions)
        return f"{' and '.join(str(c.origin) for c in claims)} each offer {offer}: write {choices} to choose"

    def explain_missing(self, interface: str, name: str) -> str:
        """Why there is no such backend, and what to do about it; one line."""
        return self._explain(interface, name, self.names(interface), interface)

    def _explain(self, kind: str, name: str, names: tuple[str, ...], interface: str | None) -> str:
        """The same for one interface, or for all where it is None."""
        asked, _, bare = name.rpartition(":")
        owners = dict.fromkeys(
            c.origin.distribution for c in self if c.record.name == bare and interface in (None, c.record.interface)
        )
        says = [f"no {kind} named '{name}'; installed: {', '.join(names) or 'none'}"]
        restricted = self.restriction is not None
        if restricted:
            # First, since what the rest advises may be done already and hidden by this.
            says.append(f"PHYSIC_PLUGINS='{self.restriction}' hides every other plugin: unset it, or add to it")
        if asked and owners:
            says.append(f"'{bare}' comes from {' and '.join(owners)}")
        elif close := get_close_matches(bare, names, n=1):
            says.append(f"Did you mean '{close[0]}'?")
        elif close := get_close_matches(bare, known_names(interface), n=1):
            # Nothing installed is near, so this one comes from a distribution that is not.
            known = distribution_for(interface, close[0])
            cure = (
                f"add {known} to it, if need be after `pip install {known}`" if restricted else f"pip install {known}"
            )
            asks = "" if close[0] == bare else f"Did you mean '{close[0]}'? "
            says.append(f"{asks}'{close[0]}' comes with {known}: {cure}")
        elif others := sorted({c.record.interface for c in self if c.record.name == bare}):
            says.append(f"'{bare}' is {' and '.join(map(_a, others))}")
        if self.broken:
            says.append(f"Broken plugins: {', '.join(map(str, self.broken))}")
        return ". ".join(says).replace("?.", "?")

    def _not_found(self, interface: str, name: str) -> BackendNotFoundError:
        return self._not_found_error(self.explain_missing(interface, name))

    def _not_found_error(self, says: str) -> BackendNotFoundError:
        error = BackendNotFoundError(f"{says}\nPython: {sys.executable}")
        error.__cause__ = next((b.error for b in self.broken if b.error), None)
        return error

    def _knows(self, distribution: str) -> bool:
        return any(normal_name(c.origin.distribution) == normal_name(distribution) for c in self._claims)


def _claim_of_class(target: str) -> Claim:
    """A class named as "package.module:Class", as a backend of the interface that it derives from."""
    from physic_core.interfaces import INTERFACES

    kind = _imported(target, f"'{target}' cannot be imported", IN_CONFIG)
    own = [name for name, wanted in INTERFACES.items() if isinstance(kind, type) and issubclass(kind, wanted)]
    if len(own) != 1:
        names = ", ".join(wanted.__name__ for wanted in INTERFACES.values())
        raise BackendError(f"'{target}' should be a subclass of one class of physic_core.interfaces: {names}")
    return Claim(BackendRecord(own[0], target, target), BY_CLASS)


def _imported(target: str, title: str, origin: Origin) -> object:
    """What "package.module:Class" names."""
    module, _, path = target.partition(":")
    try:
        found: object = importlib.import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except (Exception, SystemExit) as cause:  # a plugin's door: whatever its module does wrong, say whose it is
        where = _where_to_run(origin, module, cause)
        raise BackendError(f"{title}: {type(cause).__name__}: {cause}{where}") from cause
    return found


def _where_to_run(origin: Origin, module: str, cause: BaseException) -> str:
    """What to do where a user names a module that Python does not find; nothing where it is another's fault."""
    missing = cause.name if isinstance(cause, ModuleNotFoundError) else None
    if origin not in (IN_CONFIG, BY_CLASS) or missing is None or missing != module.partition(".")[0]:
        return ""
    return f"; run in the folder of {missing}.py, or put that folder into PYTHONPATH"


def normal_name(distribution: str) -> str:
    """A distribution's name as it is compared: without regard to case and to the kind of dash."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _a(interface: str) -> str:
    return f"an {interface}" if interface[0] in "aeiou" else f"a {interface}"
