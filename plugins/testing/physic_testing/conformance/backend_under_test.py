"""The backend under test: constructed and loaded, and called once for each photo.

All results and errors are stored.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from physic_core.configuration.problems import problems_from_pydantic
from physic_core.discovery.backends import find_backend as find_offer
from physic_core.discovery.backends import find_by_name, load_class, missing_requirements
from physic_core.discovery.error_text import describe_error
from physic_core.discovery.local_modules import split_folder
from physic_core.errors import BackendError, ConfigError, PhysicError
from physic_core.interfaces import INTERFACES, Backend, call
from physic_core.interfaces.comparison import named_values
from physic_testing.conformance.cases import EVIDENCE, EVIDENCE_OF, FIRST_PHOTO, SIZE, build_case
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect
from physic_testing.conformance.network_and_memory import no_network
from physic_testing.conformance.process_watch import Watch
from physic_testing.conformance.requests import build_request

if TYPE_CHECKING:
    from pydantic import BaseModel

    from physic_core.discovery.entry_points import Offer
    from physic_core.interfaces import Request
    from physic_testing.conformance.cases import Case, Truth, Values
    from physic_testing.worlds import World

CAPABILITIES: dict[str, str] = {
    "stochastic": "output differs between calls on purpose: checks that compare two calls are "
    "skipped",
    "needs_cuda": "requires a GPU: on other devices all calls are skipped",
    "returns_intrinsics": "always returns the camera intrinsics",
    "ignores_image": "output depends on no pixel, such as that of a placeholder: checks of bias "
    "are skipped, but for that of disparity",
    "exact": "output is the ground truth of synthetic photos "
    "(a perfect network): limits on errors are tight",
}
"""Valid entries of a backend class's ``capabilities`` attribute -> effect on the checks."""

OptionsFor = Mapping[str, Any] | Callable[["World"], Mapping[str, Any]]
"""Options of a backend, or a function that returns the options for a world.

A segmenter whose prompts depend on the photo needs the function.
"""


@dataclass(frozen=True)
class CaseRun:
    """Result or error of one call of the backend.

    Attributes:
        result: a deep copy of the result of ``infer``; None if it raised an error.
        shared_result: the result itself, which a later call may have changed.
        error: the error that ``infer`` raised.
        violations: contract violations of the result.
        changed_arguments: names of the arguments that ``infer`` changed.
    """

    result: Any
    shared_result: Any
    error: BaseException | None
    violations: Sequence[str]
    changed_arguments: Sequence[str]


@dataclass
class BackendUnderTest:
    """One backend class with its options, its loaded instances and its stored results.

    Attributes:
        kind: backend class.
        interface: name of the interface that is checked.
        name: name in the report.
        options: see :data:`OptionsFor`; by default the result of the class's
            ``conformance_options(world)``, or the default options if the class has no such method.
        capabilities: entries of CAPABILITIES; by default those of the class.
        claim: entry point of the backend; None for a class that was passed directly.
        device: device on which the backend is loaded.
        size: width and height of the standard photos, px.
        declared: the capabilities.
        table: of :mod:`physic_testing.conformance.known_mistakes` of the interface; None before
            the checks start, and for one without truth.
        case_runs: photo name -> stored call, for all photos on which the backend was called.
        values: kept by :func:`physic_testing.conformance.known_mistakes.values_of`.

    Raises:
        BackendError: a capability is not in CAPABILITIES.
        ConfigError: the backend does not accept the options.
    """

    kind: type[Backend]
    interface: str
    name: str
    options: OptionsFor | None = None
    capabilities: Collection[str] | None = None
    claim: Offer | None = None
    device: str = "cpu"
    size: tuple[int, int] = SIZE
    declared: frozenset[str] = frozenset()
    table: Any = None
    watch: Watch = field(default_factory=Watch)
    case_runs: dict[str, CaseRun] = field(default_factory=dict)
    values: list[tuple[Values, Truth]] = field(default_factory=list)
    _loaded: dict[str, Backend] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given = self.capabilities
        self.declared = frozenset(
            getattr(self.kind, "capabilities", ()) if given is None else given
        )
        for unknown in sorted(self.declared - CAPABILITIES.keys()):
            raise BackendError(
                f"{self.interface} '{self.name}' has the unknown capability {unknown!r}; "
                f"valid are: {', '.join(CAPABILITIES)}"
            )
        if self.options is None:
            self.options = getattr(self.kind, "conformance_options", {})
        elif not callable(self.options):
            self._refuse_unknown(self.options)

    @property
    def evidence_names(self) -> tuple[str, ...]:
        """Names of the photos over which bias is measured."""
        return EVIDENCE_OF.get(self.interface, EVIDENCE)

    def case(self, name: str) -> Case:
        """Return the photo and its ground truth for a name of
        :data:`physic_testing.conformance.cases.CASES`.
        """
        return build_case(name, self.size)

    def request(self, case: Case) -> Any:
        """Build the request of the interface for a case; its arrays are writable copies."""
        return build_request(self.interface, case)

    def valid_request(self, name: str = "one person") -> tuple[Case, Any]:
        """Return a photo with its request, for further calls of a backend that has a valid output
        for it.

        Raises:
            CheckSkipped: it has none.
        """
        self.result(name)
        case = self.case(name)
        return case, self.request(case)

    def construct(self, case: Case | None = None) -> Backend:
        """Construct a new backend with network access blocked; it is not loaded."""
        options = self.options_for(case)
        with no_network():
            return self.kind(options)

    def construct_or_skip(self, case: Case | None = None) -> Backend:
        """Construct a new backend for another check than that of the constructor.

        Raises:
            CheckSkipped: it cannot be constructed.
        """
        try:
            return self.construct(case)
        except Exception as error:
            raise CheckSkipped(
                "it cannot be constructed: see 'constructs_quickly_and_offline'"
            ) from error

    def options_for(self, case: Case | None = None) -> BaseModel:
        """Return the backend's options for a photo.

        A photo without ground truth uses the options for "one person".
        """
        options = self.options or {}
        if callable(options):
            options = options((case and case.world) or self.case("one person").truth)
        return self.kind.Options.model_validate(dict(options))

    def loaded(self, case: Case) -> Backend:
        """Return the loaded backend; photos that need the same options share one backend.

        Raises:
            CheckSkipped: it cannot be constructed or loaded, or the device is not there.
        """
        if "needs_cuda" in self.declared and self.device == "cpu":
            raise CheckSkipped("needs a GPU: pass device='cuda'")
        key = case.name if callable(self.options) and case.world is not None else ""
        if key in self._loaded:
            return self._loaded[key]
        backend = self.construct_or_skip(case)
        elsewhere = "it cannot be loaded: see 'loads_or_reports_what_is_missing'"
        try:
            with no_network():
                lacking = missing_requirements(backend)
        except PhysicError as error:
            raise CheckSkipped(elsewhere) from error
        if lacking:
            raise CheckSkipped(f"not ready: {'; '.join(lacking)}")
        try:
            with self.watch.load():
                backend.load(self.device)
        except PhysicError as error:
            raise CheckSkipped(f"not ready: {error}") from error
        except Exception as error:
            raise CheckSkipped(elsewhere) from error
        self._loaded[key] = backend
        return backend

    def infer(self, backend: Backend, request: Request[Any]) -> Any:
        """Call ``infer`` of a loaded backend, watched; errors propagate."""
        with self.watch.call():
            return call(backend, request)

    def call(
        self,
        wanted: str,
        case: Case,
        request: Request[Any],
        hint: str = "",
        *,
        may_refuse: bool = False,
    ) -> Any:
        """Return a valid output for a request; None if the backend refuses it, and may.

        Raises:
            CheckFailed: infer raised another error, or the output is not valid for the case.
        """
        backend = self.loaded(case)
        try:
            answer = self.infer(backend, request)
        except Exception as error:
            if may_refuse and isinstance(error, PhysicError):
                return None
            raise CheckFailed(wanted, describe_error(error, self.kind), hint) from error
        faults = case_violations(self.interface, answer, case)
        expect(not faults, wanted, "; ".join(faults))
        return answer

    def run_case(self, name: str) -> CaseRun:
        """Run the backend on a photo, or return the stored result.

        FIRST_PHOTO is run first. The photos of one size are run one after the other, so that a
        result kept from the last call shows.

        Raises:
            CheckSkipped: the backend cannot be constructed or loaded.
        """
        if name not in self.case_runs:
            if name != FIRST_PHOTO:
                self.run_case(FIRST_PHOTO)
            case = self.case(name)
            self.case_runs[name] = self.try_case(case)
            earlier, later = self.evidence_names[:2]
            if name == earlier:
                self.run_case(later)
        return self.case_runs[name]

    def result(self, name: str = "one person") -> Any:
        """Return the valid result for a photo.

        Raises:
            CheckSkipped: there is none; other checks say why.
        """
        attempt = self.run_case(name)
        if isinstance(attempt.error, ConfigError):
            raise CheckSkipped(f"not ready: {attempt.error}")
        if attempt.error is not None:
            raise CheckSkipped(
                f"infer failed for the photo '{name}': {describe_error(attempt.error, self.kind)}"
            )
        if attempt.violations:
            raise CheckSkipped(f"its output for the photo '{name}' is invalid")
        return attempt.result

    def evidence(self) -> list[tuple[Case, Any]]:
        """Return the photos over which bias is measured, each with its valid result.

        Raises:
            CheckSkipped: there is none for one person, or the backend refused too many.
        """
        self.result()
        pairs = []
        for name in self.evidence_names:
            attempt = self.run_case(name)
            if attempt.error is None and not attempt.violations:
                pairs.append((self.case(name), attempt.result))
        if len(pairs) < 3:
            raise CheckSkipped(
                f"it has a valid output for {len(pairs)} of {len(self.evidence_names)} photos of "
                f"people"
            )
        return pairs

    def close(self) -> None:
        """Close all loaded backends.

        Errors are ignored, because the life cycle checks report them.
        """
        for backend in self._loaded.values():
            with suppress(Exception):
                backend.close()
        self._loaded = {}

    def _refuse_unknown(self, options: Mapping[str, Any]) -> None:
        """Raise ConfigError if the backend does not accept the options."""
        try:
            self.kind.Options.model_validate(dict(options))
        except ValidationError as error:
            faults = problems_from_pydantic(error, self.kind.Options, kind="option")
            errors = "; ".join(f"{fault.path}: {fault.message}" for fault in faults)
            raise ConfigError(f"{self.interface} '{self.name}': {errors}") from error

    def try_case(self, case: Case) -> CaseRun:
        """Call the backend on a case and record the result, the error and changed arguments.

        Raises:
            CheckSkipped: it cannot be constructed or loaded.
        """
        backend = self.loaded(case)
        before, request = self.request(case), self.request(case)
        answer = error = None
        try:
            answer = self.infer(backend, request)
        except (Exception, SystemExit) as raised:
            error = raised
        faults = () if error else case_violations(self.interface, answer, case)
        changed = _changed_fields(before, request)
        return CaseRun(deepcopy(answer), answer, error, faults, changed)


def find_backend(
    backend: str | type[Backend] | Backend, interface: str | None, **settings: Any
) -> BackendUnderTest:
    """Return the BackendUnderTest for a backend's name, class or instance.

    Args:
        backend: a name, "distribution:name", "package.module:Class", a class, or an instance, whose
            options are taken.
        interface: needed for a name that several interfaces have.
        settings: of :class:`BackendUnderTest`.

    Raises:
        BackendError: nothing of this name, or more than one thing.
    """
    if isinstance(backend, Backend):
        settings["options"] = settings.get("options") or backend.options.model_dump()
        backend = type(backend)
    if isinstance(backend, type):
        kind = interface or str(getattr(backend, "interface", ""))
        _require_interface(kind)
        return BackendUnderTest(
            backend, kind, f"{backend.__module__}:{backend.__qualname__}", **settings
        )
    if interface is None:
        interface = _single_interface(backend)
    _require_interface(interface)
    claim = find_offer(interface, backend)
    return BackendUnderTest(
        load_class(claim), interface, split_folder(backend)[1], claim=claim, **settings
    )


def _single_interface(name: str) -> str:
    """Return the only interface that has a backend of this name, or raise BackendError."""
    interfaces = sorted({offer.interface for offer in find_by_name(name)})
    if len(interfaces) != 1:
        raise BackendError(
            f"give the interface of the backend '{name}'; interfaces with this name: "
            f"{', '.join(interfaces)}"
        )
    return interfaces[0]


def _require_interface(interface: str) -> None:
    """Raise BackendError if no interface has this name."""
    if interface not in INTERFACES:
        raise BackendError(f"no interface named '{interface}'; valid are: {', '.join(INTERFACES)}")


def _changed_fields(before: Any, after: Any) -> list[str]:
    """Return the paths of the fields whose values changed at all, such as "people.masks"."""
    pairs = zip(named_values(before), named_values(after), strict=True)
    return [path for (path, old), (_, new) in pairs if pickle.dumps(old) != pickle.dumps(new)]
