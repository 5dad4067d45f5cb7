"""Construct the backends of a configuration; the second check, of each backend's own options."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError

from physic_core.adapters.devices import check_device
from physic_core.configuration.faults import Fault, Findings, config_error, from_pydantic
from physic_core.configuration.model import load_config
from physic_core.discovery.error_text import describe
from physic_core.discovery.readiness import gpu_is_seen, missing_requirements
from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    PhysicError,
    WeightsMissingError,
)
from physic_core.interfaces import INTERFACES
from physic_core.types import Provenance

if TYPE_CHECKING:
    from physic_core.configuration.model import Config, PhotoSettings
    from physic_core.discovery.registry import Claim, Registry
    from physic_core.engine.settings import EngineSettings
    from physic_core.interfaces import Backend, Options

__all__ = [
    "ResolvedBackend",
    "ResolvedPipeline",
    "check",
    "load_checked",
    "missing",
    "missing_device",
    "missing_files",
    "missing_report",
    "require_available",
    "resolve",
]


@dataclass(frozen=True)
class ResolvedBackend:
    """A constructed backend with its provenance.

    Attributes:
        backend: constructed, weights not loaded.
        provenance: name, distribution, version, options and licence.
    """

    backend: Backend
    provenance: Provenance

    @property
    def title(self) -> str:
        """Name for messages: "segmenter 'embedded' (physic-embedded 0.1.0)"."""
        who = self.provenance
        return f"{who.interface} '{who.backend}' ({f'{who.distribution} {who.version}'.strip()})"


@dataclass(frozen=True)
class ResolvedPipeline:
    """Everything that a run needs.

    Attributes:
        backends: by interface; without optional interfaces that the configuration leaves out.
        photo: how the photo is prepared.
        body_model: "embedded", or the path of an SMPL-X file.
        device: "cpu", "cuda" or "cuda:N".
        config: the configuration that was resolved.
    """

    backends: Mapping[str, ResolvedBackend]
    photo: PhotoSettings
    body_model: str
    device: str
    config: Config

    @cached_property
    def engine(self) -> EngineSettings:
        """The engine's settings. Importing them imports torch."""
        return self.config.engine.settings()


@dataclass(frozen=True)
class _Choice:
    claim: Claim
    kind: type[Backend]
    options: Options


def resolve(config: Config, registry: Registry) -> ResolvedPipeline:
    """Construct one backend for each interface; no weights are loaded and no network is used.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
        BackendError: the constructor of a backend failed.
    """
    backends = {name: _construct(name, choice) for name, choice in _choose(config, registry).items()}
    return ResolvedPipeline(
        backends=MappingProxyType(backends),
        photo=config.photo,
        body_model=config.body_model.source,
        device=config.run.device,
        config=config,
    )


def missing(plan: ResolvedPipeline) -> tuple[str, ...]:
    """List what a run lacks on this machine, one text for each item; no network is used.

    These are files that the chosen backends report as missing, and a GPU if the configuration needs one and none is
    found. Only :func:`physic_core.adapters.devices.check_device` checks that torch can use the GPU.

    Raises:
        BackendError: the ``missing`` of a backend fails.
    """
    return (*missing_files(plan), *missing_device(plan))


def missing_files(plan: ResolvedPipeline) -> tuple[str, ...]:
    """The missing files: those that the backends report, and the file of the body model.

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


def missing_device(plan: ResolvedPipeline) -> tuple[str, ...]:
    """The part of :func:`missing` about the GPU: one text if the configuration needs one and none is seen."""
    if plan.device == "cpu" or gpu_is_seen():
        return ()
    return (
        f"run.device '{plan.device}': no GPU is seen: run it where there is one, or set run.device to 'cpu' for "
        "backends that can do without",
    )


def require_available(plan: ResolvedPipeline) -> None:
    """Raise an error if a chosen backend, even of an optional interface, or the device is not available.

    Raises:
        WeightsMissingError: files are missing; the message lists them, how to get each, and a missing GPU.
        DeviceError: only the device is missing.
        BackendError: the ``missing`` of a backend fails.
    """
    if files := missing_files(plan):
        raise WeightsMissingError(missing_report((*files, *missing_device(plan)), ", and nothing was computed"))
    check_device(plan.device)


def missing_report(texts: Sequence[str], end: str) -> str:
    """Join several texts of :func:`missing` below one heading."""
    head = "1 thing is missing" if len(texts) == 1 else f"{len(texts)} things are missing"
    return "\n".join([f"{head}{end}:", *("  " + text.replace("\n", "\n    ") for text in texts)])


def check(config: Config, registry: Registry) -> None:
    """Check names and options without constructing anything.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
    """
    _choose(config, registry)


def load_checked(registry: Registry, file: str | os.PathLike[str] | None = None, **settings: Any) -> Config:
    """:func:`physic_core.configuration.model.load_config`, with names and options of backends checked too.

    Args:
        registry: the installed plugins.
        file: as in ``load_config``.
        settings: preset, overrides, flags and environment, as in ``load_config``.

    Raises:
        ConfigError: the configuration is invalid; the message lists all errors.
    """
    return load_config(file, **settings, further=lambda tables: _look(tables, registry)[1])


def _choose(config: Config, registry: Registry) -> dict[str, _Choice]:
    tables = {name: config.choice(name).model_dump() for name in INTERFACES}
    chosen, found = _look(tables, registry)
    if found.faults:
        raise config_error(found.faults, config.source, "config", found.footer) from found.cause
    return chosen


def _look(tables: Mapping[str, Any], registry: Registry) -> tuple[dict[str, _Choice], Findings]:
    """The backends that merged tables choose, and the errors in names and options.

    Values that are not a table or have no name are left to the check of the structure.
    """
    chosen: dict[str, _Choice] = {}
    faults: list[Fault] = []
    cause: BaseException | None = None
    footer = ""
    for interface in INTERFACES:
        table = tables.get(interface)
        name = table.get("backend") if isinstance(table, dict) else None
        options = table.get("options", {}) if isinstance(table, dict) else {}
        if not isinstance(name, str) or name in ("", "none"):
            continue
        try:
            claim = registry.get(interface, name)
            kind = registry.load_concrete_class(claim)
            chosen[interface] = _check_options(claim, kind, options if isinstance(options, dict) else {})
        except BackendNotFoundError as error:
            message, _, python = str(error).partition("\nPython: ")
            faults.append(Fault(f"{interface}.backend", message))
            cause, footer = cause or error.__cause__, f"Python: {python}" if python else footer
        except BackendError as error:
            is_choice = isinstance(error, AmbiguousBackendError)
            faults.append(Fault(f"{interface}.backend", str(error), of_plugin=not is_choice))
            cause = cause or error
        except _OptionFaults as error:
            faults += error.faults
    return chosen, Findings(tuple(faults), footer, cause)


class _OptionFaults(Exception):
    def __init__(self, faults: list[Fault]) -> None:
        super().__init__()
        self.faults = faults


def _check_options(claim: Claim, kind: type[Backend], options: Mapping[str, object]) -> _Choice:
    if not issubclass(kind.Options, BaseModel):
        raise BackendError(f"{claim}: its Options is no subclass of physic_core.interfaces.Options")
    try:
        return _Choice(claim, kind, kind.Options.model_validate(dict(options)))
    except ValidationError as error:
        path = f"{claim.record.interface}.options"
        raise _OptionFaults(from_pydantic(error, kind.Options, path, "option")) from error


def _construct(interface: str, choice: _Choice) -> ResolvedBackend:
    record, origin = choice.claim.record, choice.claim.origin
    try:
        backend = choice.kind(choice.options)
    except PhysicError:
        raise
    except (Exception, SystemExit) as cause:  # a plugin's door
        raise BackendError(f"{choice.claim} cannot be constructed: {describe(cause, choice.kind)}") from cause
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
    )
