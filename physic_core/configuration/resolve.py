"""Construct the backends that a configuration chooses, and check their options, files and device."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from pydantic import BaseModel, ValidationError

from physic_core.adapters.devices import check_device
from physic_core.configuration.model import load_config
from physic_core.configuration.problems import Problem, ProblemReport
from physic_core.discovery.offers import GIVEN_IN_PYTHON, BackendOffer
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.readiness import has_gpu, missing_requirements
from physic_core.discovery.records import BackendRecord
from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    ConfigError,
    PhysicError,
    WeightsMissingError,
)
from physic_core.interfaces import INTERFACES, PHOTO_INTERFACES
from physic_core.types import Provenance

if TYPE_CHECKING:
    from physic_core.configuration.model import Config, PhotoSettings
    from physic_core.discovery.registry import Registry
    from physic_core.engine.settings import EngineSettings
    from physic_core.interfaces import Backend, Options
    from physic_core.weights.manifest import WeightSet


@dataclass(frozen=True)
class ResolvedBackend:
    """A constructed backend, without loaded weights, and its provenance.

    Attributes:
        cacheable: whether its results may be cached. False for an instance that the user constructed: its attributes
            can change the results, and the cache key does not contain them.
    """

    backend: Backend
    provenance: Provenance
    cacheable: bool = True

    @property
    def title(self) -> str:
        """Name of the backend for messages: "segmenter 'embedded' (physic-embedded 0.1.0)"."""
        who = self.provenance
        return f"{who.interface} '{who.backend}' ({f'{who.distribution} {who.version}'.strip()})"


@dataclass(frozen=True)
class ResolvedPipeline:
    """The constructed backends and the settings of a run.

    Attributes:
        backends: by interface, without omitted optional interfaces.
        photo: settings of the photo.
        body_model: "embedded", or the path of an SMPL-X file.
        device: "cpu", "cuda" or "cuda:N".
        config: the configuration that was resolved.
        given_engine: engine settings that replace those of the config, or None.
    """

    backends: Mapping[str, ResolvedBackend]
    photo: PhotoSettings
    body_model: str
    device: str
    config: Config
    given_engine: EngineSettings | None = None

    @cached_property
    def engine(self) -> EngineSettings:
        """Settings of the engine; reading them imports torch."""
        return self.config.engine.settings() if self.given_engine is None else self.given_engine


@dataclass(frozen=True)
class _Choice:
    offer: BackendOffer
    kind: type[Backend]
    options: Options
    instance: Backend | None = None


def resolve(
    config: Config, registry: Registry, backends: Mapping[str, Backend | type[Backend]] | None = None
) -> ResolvedPipeline:
    """Construct one backend for each interface of a single photo; no weights are loaded and no network is used.

    Args:
        config: chooses the backends.
        registry: the installed plugins.
        backends: by interface, instances or classes that replace the config's choice. A class gets its default options.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
        BackendError: a backend is of another interface, or its constructor failed.
    """
    given = {name: _choose_given(name, backend, registry) for name, backend in (backends or {}).items()}
    others = set(INTERFACES) - set(PHOTO_INTERFACES)
    choices = _select_or_raise(config, registry, without=(*given, *others)) | given
    resolved = {name: _construct(name, choices[name]) for name in PHOTO_INTERFACES if name in choices}
    used = {name: resolved[name].provenance for name in given}
    config = config.with_backends({name: (who.backend, who.options) for name, who in used.items()})
    return ResolvedPipeline(
        backends=MappingProxyType(resolved),
        photo=config.photo,
        body_model=config.body_model.source,
        device=config.run.device,
        config=config,
    )


def resolve_one(interface: str, name: str, options: Mapping[str, object], registry: Registry) -> ResolvedBackend:
    """Construct one backend without a configuration and without loading weights.

    Raises:
        ConfigError: the interface, the name or the options are invalid; the message lists all errors.
        WeightsMissingError: files of the backend are missing.
        BackendError: its class cannot be imported or constructed.
    """
    _require_interface(interface)
    chosen, found = _select_backends({interface: {"backend": name, "options": dict(options)}}, registry)
    if found.problems:
        from physic_core.configuration.problem_text import config_error

        raise config_error(found.problems, lambda _: "default", "load_backend", found.footer) from found.cause
    if interface not in chosen:
        raise ConfigError(f"load_backend: name a backend of {interface}, one of {', '.join(registry.names(interface))}")
    resolved = _construct(interface, chosen[interface])
    if texts := missing_requirements(resolved.backend):
        raise WeightsMissingError(format_missing([f"{resolved.title}: {text}" for text in texts], ""))
    return resolved


def missing_file_messages(plan: ResolvedPipeline) -> tuple[str, ...]:
    """List the missing files that backends report, and a missing body model file; one message each.

    Raises:
        BackendError: the ``missing`` of a backend fails.
    """
    found: dict[str, list[str]] = {}
    for resolved in plan.backends.values():
        try:
            for text in missing_requirements(resolved.backend):
                found.setdefault(text, []).append(resolved.title)
        except PhysicError as error:
            raise BackendError(f"{resolved.title}: {error}") from error
    # A file that is missing for two backends is listed once.
    texts = [f"{' and '.join(titles)}: {text}" for text, titles in found.items()]
    path = plan.config.body_model.path
    if path is not None and not Path(path).exists():
        texts.append(f"body_model.path: no file at {path}: check the path, or remove it to use the embedded body")
    return tuple(texts)


def missing_gpu(plan: ResolvedPipeline) -> tuple[str, ...]:
    """Return one message if the configuration needs a GPU and there is none, else an empty tuple.

    Only :func:`physic_core.adapters.devices.check_device` checks that torch can use the GPU.
    """
    if plan.device == "cpu" or has_gpu():
        return ()
    return (
        f"run.device '{plan.device}': no GPU is found: use a machine with a GPU, or set run.device to 'cpu' if the "
        "backends support it",
    )


def require_available(plan: ResolvedPipeline) -> None:
    """Raise an error if files of a chosen backend, the body model, or the device are missing.

    Raises:
        WeightsMissingError: files are missing; the message lists them, and how to get each.
        DeviceError: only the device is missing.
        BackendError: the ``missing`` of a backend fails.
    """
    if files := missing_file_messages(plan):
        raise WeightsMissingError(format_missing((*files, *missing_gpu(plan)), ", and nothing was computed"))
    check_device(plan.device)


def format_missing(texts: Sequence[str], end: str) -> str:
    """Format messages about missing files and devices as an indented list below a heading."""
    head = "1 thing is missing" if len(texts) == 1 else f"{len(texts)} things are missing"
    return "\n".join([f"{head}{end}:", *("  " + text.replace("\n", "\n    ") for text in texts)])


def size_warnings(plan: ResolvedPipeline, registry: Registry) -> tuple[str, ...]:
    """Return warnings about weight files of another size than the published one; no file is read.

    Raises:
        BackendError: the manifest of a plugin is invalid.
    """
    from physic_core.weights.find import size_mismatches

    mismatches = ((weights.name, size_mismatches(weights)) for weights in named_weights(plan, registry))
    return tuple(f"weights '{name}' were found, but {text}" for name, text in mismatches if text)


def named_weights(plan: ResolvedPipeline, registry: Registry) -> tuple[WeightSet, ...]:
    """Return the weight sets that options of the backends name, each once, with the hashes of the lock file.

    Raises:
        BackendError: the manifest of a plugin is invalid.
    """
    from physic_core.weights.lock import locked
    from physic_core.weights.manifest import read_manifest

    found: dict[tuple[str, str], WeightSet] = {}
    for resolved in plan.backends.values():
        who = resolved.provenance
        for manifest in registry.manifests:
            if (manifest.origin.plugin, manifest.origin.distribution) == (who.plugin, who.distribution):
                sets = read_manifest(manifest.path)
                names = (value for value in who.options.values() if isinstance(value, str) and value in sets)
                found |= {(who.distribution, name): locked(sets[name]) for name in names}
    return tuple(found.values())


def check_backends(config: Config, registry: Registry) -> None:
    """Check the names and options of all backends without constructing them.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
    """
    _select_or_raise(config, registry)


def load_checked_config(registry: Registry, file: str | os.PathLike[str] | None = None, **settings: Any) -> Config:
    """Load a configuration, and check the names and options of its backends.

    Args:
        registry: the installed plugins.
        file: as in :func:`physic_core.configuration.model.load_config`.
        settings: preset, overrides, flags and environment, as in ``load_config``.

    Raises:
        ConfigError: the configuration is invalid; the message lists all errors.
    """
    return load_config(file, **settings, check_tables=lambda tables: _select_backends(tables, registry)[1])


def load_plan(registry: Registry, file: str | os.PathLike[str] | None = None, **settings: Any) -> ResolvedPipeline:
    """Load a configuration and check it, with its backends, their weights and the device; no network is loaded.

    Args:
        registry: the installed plugins.
        file: as in :func:`load_checked_config`.
        settings: as in :func:`load_checked_config`.

    Raises:
        ConfigError: the configuration is invalid.
        PhysicError: a backend cannot be imported or constructed, or its weights are missing.
    """
    plan = resolve(load_checked_config(registry, file, **settings), registry)
    require_available(plan)
    return plan


def _select_or_raise(config: Config, registry: Registry, without: tuple[str, ...] = ()) -> dict[str, _Choice]:
    tables = {name: config.choice(name).model_dump() for name in INTERFACES if name not in without}
    chosen, found = _select_backends(tables, registry)
    if found.problems:
        from physic_core.configuration.problem_text import config_error

        raise config_error(found.problems, config.source, "config", found.footer) from found.cause
    return chosen


def _require_interface(name: str) -> None:
    if name not in INTERFACES:
        from physic_core.discovery.close_names import did_you_mean

        hint = did_you_mean(name, INTERFACES)
        raise ConfigError(f"backends: no interface named '{name}'; there are: {', '.join(INTERFACES)}{hint}")


def _choose_given(interface: str, given: object, registry: Registry) -> _Choice:
    """Check an instance or class given in Python.

    Raises:
        ConfigError: no interface of a single photo has this name.
        BackendError: the object is of another interface, or its class is incomplete.
    """
    _require_interface(interface)
    if interface not in PHOTO_INTERFACES:
        raise ConfigError(f"backends: {interface} is only for several photos; a single photo does not use it")
    wanted = INTERFACES[interface]
    kind = given if isinstance(given, type) else type(given)
    if not issubclass(kind, wanted):
        got = f"the class {kind.__name__}" if isinstance(given, type) else repr(given)
        raise BackendError(
            f"backends['{interface}'] should be an instance or a subclass of physic_core.interfaces.{wanted.__name__} "
            f"(got {got})"
        )
    name = f"{kind.__module__}:{kind.__qualname__}"
    offer = BackendOffer(BackendRecord(interface, name, kind, api=wanted.api), GIVEN_IN_PYTHON)
    registry.load_concrete_class(offer)
    if isinstance(given, wanted):
        return _Choice(offer, kind, cast("Options", given.options), given)
    try:
        return _check_options(offer, kind, {})
    except _InvalidOptions as error:
        names = ", ".join(problem.path.rpartition(".")[2] for problem in error.problems)
        raise ConfigError(
            f"backends['{interface}']: {kind.__name__} has no default for {names}: give an instance, "
            f"{kind.__name__}({', '.join(f'{problem.path.rpartition(chr(46))[2]}=...' for problem in error.problems)})"
        ) from error


def _select_backends(tables: Mapping[str, Any], registry: Registry) -> tuple[dict[str, _Choice], ProblemReport]:
    """Import the chosen backend of each interface, and check its options; return the backends and the problems.

    A value that is not a table, or has no backend name, is skipped: the check of the structure reports it.
    """
    chosen: dict[str, _Choice] = {}
    problems: list[Problem] = []
    cause: BaseException | None = None
    footer = ""
    for interface in INTERFACES:
        table = tables.get(interface)
        name = table.get("backend") if isinstance(table, dict) else None
        options = table.get("options", {}) if isinstance(table, dict) else {}
        if not isinstance(name, str) or name in ("", "none"):
            continue
        try:
            offer = registry.get(interface, name)
            kind = registry.load_concrete_class(offer)
            chosen[interface] = _check_options(offer, kind, options if isinstance(options, dict) else {})
        except BackendNotFoundError as error:
            message, _, python = str(error).partition("\nPython: ")
            problems.append(Problem(f"{interface}.backend", message))
            cause, footer = cause or error.__cause__, f"Python: {python}" if python else footer
        except BackendError as error:
            is_choice = isinstance(error, AmbiguousBackendError)
            problems.append(Problem(f"{interface}.backend", str(error), of_plugin=not is_choice))
            cause = cause or error
        except _InvalidOptions as error:
            problems += error.problems
    return chosen, ProblemReport(tuple(problems), footer, cause)


class _InvalidOptions(Exception):
    def __init__(self, problems: list[Problem]) -> None:
        super().__init__()
        self.problems = problems


def _check_options(offer: BackendOffer, kind: type[Backend], options: Mapping[str, object]) -> _Choice:
    if not issubclass(kind.Options, BaseModel):
        raise BackendError(f"{offer}: its Options is not a subclass of physic_core.interfaces.Options")
    try:
        return _Choice(offer, kind, kind.Options.model_validate(dict(options)))
    except ValidationError as error:
        from physic_core.configuration.problem_text import problems_from_pydantic

        path = f"{offer.record.interface}.options"
        raise _InvalidOptions(problems_from_pydantic(error, kind.Options, path, "option")) from error


def _construct(interface: str, choice: _Choice) -> ResolvedBackend:
    record, origin = choice.offer.record, choice.offer.origin
    try:
        with plugin_code():
            backend = choice.kind(choice.options) if choice.instance is None else choice.instance
    except PhysicError:
        raise
    except Exception as cause:  # a plugin may raise anything
        from physic_core.discovery.error_text import describe_error

        raise BackendError(f"{choice.offer} cannot be constructed: {describe_error(cause, choice.kind)}") from cause
    return ResolvedBackend(
        backend,
        Provenance(
            interface=interface,
            backend=record.name,
            plugin=origin.plugin,
            distribution=origin.distribution,
            version=origin.version,
            options=choice.options.model_dump(mode="json"),
            weights_license=record.weights_license,
        ),
        cacheable=choice.instance is None,
    )
