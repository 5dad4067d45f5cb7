"""The backend under test: constructed, loaded and asked once for each photo, with everything that went wrong kept."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from pydantic import ValidationError

from physic_core.configuration.faults import from_pydantic
from physic_core.discovery.error_text import describe
from physic_core.discovery.local_modules import split
from physic_core.discovery.readiness import missing_requirements
from physic_core.errors import BackendError, ConfigError, PhysicError
from physic_core.interfaces import INTERFACES, Backend
from physic_core.interfaces.checks import require_image
from physic_testing.conformance.asking import changed, form_faults, inputs
from physic_testing.conformance.cases import SIZE, build_case
from physic_testing.conformance.expect import CheckSkipped
from physic_testing.conformance.guard import no_network

if TYPE_CHECKING:
    from pydantic import BaseModel

    from physic_core.discovery.registry import Claim, Registry
    from physic_testing.conformance.cases import Case
    from physic_testing.worlds import World

__all__ = ["CAPABILITIES", "FIRST", "Attempt", "OptionsFor", "Subject", "find_subject"]

CAPABILITIES: dict[str, str] = {
    "stochastic": "answers differ from call to call on purpose: nothing is asked twice to compare",
    "needs_cuda": "runs on a GPU only: asks nothing on another device",
    "returns_intrinsics": "always answers the camera that it saw",
}
"""What a backend class may say of itself in ``capabilities``, a collection of these words."""

FIRST = "odd size"
"""The photo that every backend sees first, so that its answer is free of what others left behind."""

OptionsFor = Mapping[str, Any] | Callable[["World"], Mapping[str, Any]]
"""Options of a backend; a callable where they depend on the photo, as those of a segmenter that has to be pointed."""


@dataclass(frozen=True)
class Attempt:
    """What came of showing one photo.

    Attributes:
        answer: a copy of what ``infer`` returned, None where it raised.
        returned: what it returned, as a later call may have left it.
        error: what it raised.
        faults: what is wrong with the answer's form.
        edited: places of the arguments that ``infer`` wrote into.
    """

    answer: Any
    returned: Any
    error: BaseException | None
    faults: tuple[str, ...]
    edited: tuple[str, ...]

    @property
    def refused(self) -> bool:
        """Whether the backend said no in the way that it should."""
        return isinstance(self.error, PhysicError)


class Subject:
    """One backend class with options, as the checks see it.

    Args:
        kind: the class.
        interface: which interface it is tested for.
        name: for the report.
        options: see :data:`OptionsFor`; None for those of the class's ``conformance_options(world)``, if it has this
            method, else the defaults.
        capabilities: words of CAPABILITIES; None for those of the class and of its record.
        claim: who registered it, None for a class given by hand.
        device: where it is loaded.
        size: width and height of the ordinary photos, px.

    Raises:
        BackendError: a capability that does not exist.
        ConfigError: options that it does not take.
    """

    def __init__(
        self,
        kind: type[Backend],
        interface: str,
        name: str,
        *,
        options: OptionsFor | None = None,
        capabilities: Collection[str] | None = None,
        claim: Claim | None = None,
        device: str = "cpu",
        size: tuple[int, int] = SIZE,
    ) -> None:
        self.kind, self.interface, self.name = kind, interface, name
        self.claim, self.device, self.size = claim, device, size
        self.capabilities = _capabilities(kind, claim) if capabilities is None else frozenset(capabilities)
        unknown = self.capabilities - CAPABILITIES.keys()
        if unknown:
            raise BackendError(
                f"{interface} '{name}' claims the capability {sorted(unknown)[0]!r}; "
                f"there are: {', '.join(CAPABILITIES)}"
            )
        self._options = getattr(kind, "conformance_options", {}) if options is None else options
        if options is not None and not callable(options):
            self._refuse_unknown(options)
        self._loaded: dict[str, Backend] = {}
        self._attempts: dict[str, Attempt] = {}

    def case(self, name: str) -> Case:
        """A photo of :data:`physic_testing.conformance.cases.CASES`."""
        return build_case(name, self.size)

    def construct(self, case: Case | None = None) -> Backend:
        """A fresh backend, not loaded; whatever it wants of a network it does not get."""
        options = self.options(case)
        with no_network():
            return self.kind(options)

    def options(self, case: Case | None = None) -> BaseModel:
        """Its options for a case; those of the photo of one person where the case has no truth."""
        given = self._options
        if callable(given):
            world = self.case("one person").truth if case is None or case.world is None else case.world
            given = given(world)
        return self.kind.Options.model_validate(dict(given))

    def loaded(self, case: Case) -> Backend:
        """The backend that answers, loaded; the same for all cases that need the same options.

        Raises:
            CheckSkipped: it cannot be constructed or loaded, or the device is not there.
        """
        if "needs_cuda" in self.capabilities and self.device == "cpu":
            raise CheckSkipped("needs a GPU: give the device 'cuda'")
        key = case.name if callable(self._options) and case.world is not None else ""
        if key not in self._loaded:
            try:
                backend = self.construct(case)
            except Exception as error:
                raise CheckSkipped("it cannot be constructed: see 'constructs_with_its_defaults'") from error
            try:
                with no_network():
                    lacking = missing_requirements(backend)
            except PhysicError as error:
                raise CheckSkipped("it cannot be loaded: see 'loads_or_reports_what_is_missing'") from error
            if lacking:
                raise CheckSkipped(f"not ready: {'; '.join(lacking)}")
            try:
                backend.load(self.device)
            except PhysicError as error:
                raise CheckSkipped(f"not ready: {error}") from error
            except Exception as error:
                raise CheckSkipped("it cannot be loaded: see 'loads_or_reports_what_is_missing'") from error
            self._loaded[key] = backend
        return self._loaded[key]

    def ask(self, backend: Backend, case: Case, arguments: tuple[Any, ...] | None = None) -> Any:
        """What a backend answers to a case, or to other arguments in its place; errors go through."""
        given = inputs(self.interface, case) if arguments is None else arguments
        require_image(given[0])
        return cast("Any", backend).infer(*given)

    def attempt(self, name: str) -> Attempt:
        """What came of showing the photo; shown once only, and always FIRST before any other.

        Raises:
            CheckSkipped: the backend does not get as far as being asked.
        """
        if name not in self._attempts:
            if name != FIRST:
                self.attempt(FIRST)
            case = self.case(name)
            self._attempts[name] = self._try(self.loaded(case), case)
        return self._attempts[name]

    def answer(self, name: str = "one person") -> Any:
        """The answer to a photo, of the right form.

        Raises:
            CheckSkipped: there is none; other checks say why.
        """
        attempt = self.attempt(name)
        if isinstance(attempt.error, ConfigError):
            raise CheckSkipped(f"not ready: {attempt.error}")
        if attempt.error is not None:
            raise CheckSkipped(f"it did not answer the photo '{name}': {describe(attempt.error, self.kind)}")
        if attempt.faults:
            raise CheckSkipped(f"its answer to the photo '{name}' has the wrong form")
        return attempt.answer

    @property
    def attempts(self) -> Mapping[str, Attempt]:
        """Photo -> what came of it, of all photos shown so far."""
        return self._attempts

    def close(self) -> None:
        """Let go of every backend; what they do wrong then is another check's affair."""
        for backend in self._loaded.values():
            try:
                backend.close()
            except Exception:
                continue
        self._loaded = {}

    def _refuse_unknown(self, options: Mapping[str, Any]) -> None:
        try:
            self.kind.Options.model_validate(dict(options))
        except ValidationError as error:
            faults = from_pydantic(error, self.kind.Options, kind="option")
            told = "; ".join(f"{fault.path}: {fault.message}" for fault in faults)
            raise ConfigError(f"{self.interface} '{self.name}': {told}") from error

    def _try(self, backend: Backend, case: Case) -> Attempt:
        given, before = inputs(self.interface, case), inputs(self.interface, case)
        try:
            answer = self.ask(backend, case, given)
        except (Exception, SystemExit) as error:
            return Attempt(None, None, error, (), tuple(changed(before, given)))
        faults = tuple(form_faults(self.interface, answer, case))
        return Attempt(deepcopy(answer), answer, None, faults, tuple(changed(before, given)))


def find_subject(
    backend: str | type[Backend] | Backend, interface: str | None, registry: Registry | None, **settings: Any
) -> Subject:
    """The subject that a name, a class or an instance stands for.

    Args:
        backend: a name, "distribution:name", "package.module:Class", a class, or an instance, whose options are taken.
        interface: needed for a name that several interfaces have.
        registry: where names are looked up; None for everything installed.
        settings: of :class:`Subject`.

    Raises:
        BackendError: nothing of this name, or more than one thing.
    """
    if isinstance(backend, Backend):
        settings["options"] = settings.get("options") or backend.options.model_dump()
        backend = type(backend)
    if isinstance(backend, type):
        own = interface or str(getattr(backend, "interface", ""))
        _known(own)
        return Subject(backend, own, f"{backend.__module__}:{backend.__qualname__}", **settings)
    if registry is None:
        from physic_core.discovery.plugins import discover

        registry = discover()
    if interface is None:
        interface = _only_interface(backend, registry)
    _known(interface)
    claim = registry.get(interface, backend)
    return Subject(registry.load_class(claim), interface, split(backend)[1], claim=claim, **settings)


def _only_interface(name: str, registry: Registry) -> str:
    distribution, _, bare = name.rpartition(":")
    offers = [c for c in registry if c.record.name == bare and distribution in ("", c.origin.distribution)]
    interfaces = list(dict.fromkeys(c.record.interface for c in offers))
    if len(interfaces) != 1:
        have = ", ".join(interfaces) or "none"
        raise BackendError(f"name the interface of the backend '{name}': {have} of the installed ones has it")
    return interfaces[0]


def _known(interface: str) -> None:
    if interface not in INTERFACES:
        raise BackendError(f"no interface named '{interface}'; there are: {', '.join(INTERFACES)}")


def _capabilities(kind: type[Backend], claim: Claim | None) -> frozenset[str]:
    own = frozenset(getattr(kind, "capabilities", ()))
    gpu = claim is not None and any(need.lower() in ("gpu", "cuda") for need in claim.record.needs)
    return own | {"needs_cuda"} if gpu else own
