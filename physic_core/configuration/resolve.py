"""Construct the backends that a configuration chooses, and check their options, files and
device.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import ValidationError

from physic_core.backends.devices import check_device, has_gpu
from physic_core.configuration.model import BackendChoice
from physic_core.configuration.problems import Problem, config_error, problems_from_pydantic
from physic_core.discovery.backends import (
    class_problem,
    find_backend,
    list_backends,
    load_class,
    missing_requirements,
    require_interface,
)
from physic_core.discovery.entry_points import Offer
from physic_core.discovery.error_text import describe_error
from physic_core.discovery.plugin_code import named_plugin_code, plugin_code
from physic_core.discovery.process_state import restored_process_state
from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    ConfigError,
    InputError,
    PhysicError,
    WeightsMissingError,
)
from physic_core.files.atomic import check_regular, unreadable
from physic_core.files.text import quoted
from physic_core.interfaces import INTERFACES
from physic_core.types import Provenance
from physic_core.weights.library import licence_text, named_sets

if TYPE_CHECKING:
    from physic_core.configuration.model import Config, PhotoSettings
    from physic_core.engine.settings import EngineSettings
    from physic_core.interfaces import Backend, Options
    from physic_core.weights.manifest import WeightSet

_LOG = logging.getLogger(__name__)

_Chosen: TypeAlias = "tuple[Offer, type[Backend], Options]"
"""A backend, its class, and its options."""


@dataclass(frozen=True)
class ResolvedBackend:
    """A constructed backend, without loaded weights, and its provenance.

    Attributes:
        cacheable: whether its results may be cached. False for an instance that the user
            constructed: its attributes can change the results, and the cache key does not contain
            them.
    """

    backend: Backend
    provenance: Provenance
    cacheable: bool = True

    @property
    def title(self) -> str:
        """Name of the backend for messages: "segmenter 'embedded' (metricbody-embedded 0.1.0)"."""
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


def resolve(
    config: Config, backends: Mapping[str, Backend | type[Backend]] | None = None
) -> ResolvedPipeline:
    """Construct one backend for each interface; no weights are loaded and no network is used.

    Args:
        config: chooses the backends.
        backends: by interface, instances or classes that replace the config's choice. A class gets
            its default options.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
        BackendError: a backend is broken or of another interface, or its constructor failed.
    """
    instances = {
        name: _given_in_python(name, backend) for name, backend in (backends or {}).items()
    }
    choices = {name: config.choice(name) for name in INTERFACES if name not in instances}
    constructed = {
        name: _construct_backend(*one)
        for name, one in _choose_backends(choices, config.source).items()
    } | instances
    config = config.with_backends(
        {n: (one.provenance.backend, one.provenance.options) for n, one in instances.items()}
    )
    return ResolvedPipeline(
        backends=MappingProxyType(
            {name: constructed[name] for name in INTERFACES if name in constructed}
        ),
        photo=config.photo,
        body_model=config.body_model.source,
        device=config.run.device,
        config=config,
    )


def resolve_one(interface: str, name: str, options: Mapping[str, object]) -> ResolvedBackend:
    """Construct one backend without a configuration and without loading weights.

    Raises:
        ConfigError: the interface, the name or the options are invalid; the message lists all
            errors.
        WeightsMissingError: files of the backend are missing.
        BackendError: its class cannot be imported or constructed.
    """
    require_interface(interface)
    if name in ("", "none"):
        names = ", ".join(offer.name for offer in list_backends(interface))
        raise ConfigError(f"load_backend: name a backend of {interface}, one of {names}")
    choice = BackendChoice(backend=name, options=dict(options))
    resolved = _construct_backend(
        *_choose_backends({interface: choice}, lambda _: "load_backend")[interface]
    )
    if texts := missing_requirements(resolved.backend):
        raise WeightsMissingError(
            format_missing([f"{resolved.title}: {text}" for text in texts], "")
        )
    return resolved


def missing_file_messages(plan: ResolvedPipeline) -> tuple[str, ...]:
    """List the missing files that backends report, and a missing body model file; one message each.

    Raises:
        BackendError: the ``missing`` of a backend fails.
        InputError: a backend cannot read a file of the photo.
    """
    messages: dict[str, list[str]] = {}
    for resolved in plan.backends.values():
        try:
            for text in missing_requirements(resolved.backend):
                messages.setdefault(text, []).append(resolved.title)
        except PhysicError as error:
            kind = InputError if isinstance(error, InputError) else BackendError
            raise kind(f"{resolved.title}: {error}") from error
    # A file that is missing for two backends is listed once.
    texts = [f"{' and '.join(titles)}: {text}" for text, titles in messages.items()]
    path = plan.config.body_model.path
    if path is not None and not Path(path).exists():
        texts.append(
            f"body_model.path: no file at {path}: check the path, or remove it to use the "
            f"embedded body"
        )
    return tuple(texts)


def missing_gpu(plan: ResolvedPipeline) -> tuple[str, ...]:
    """Return one message if the configuration needs a GPU and there is none, else an empty tuple.

    Only :func:`physic_core.backends.devices.check_device` checks that torch can use the GPU.
    """
    if plan.device == "cpu" or has_gpu():
        return ()
    return (
        f"run.device '{plan.device}': no GPU is found: use a machine with a GPU, or set run.device "
        "to 'cpu' if the backends support it",
    )


def require_available(plan: ResolvedPipeline) -> None:
    """Raise an error if files of a chosen backend, the body model, or the device are missing.

    Raises:
        InputError: a file of the photo cannot be read, such as its depth map.
        WeightsMissingError: files are missing; the message lists them, and how to get each.
        DeviceError: only the device is missing.
        BackendError: the ``missing`` of a backend fails.
    """
    check_input_files(plan.config)
    if files := missing_file_messages(plan):
        raise WeightsMissingError(
            format_missing((*files, *missing_gpu(plan)), ", and nothing was computed")
        )
    check_device(plan.device)


def check_input_files(config: Config) -> None:
    """Raise InputError unless the files of the photo, such as its depth map, and the body model are
    regular files.

    A body model that is missing is one of the missing weights.

    Raises:
        InputError: one of them is missing, a folder, a pipe or a device.
    """
    files = config.input_files()
    if config.body_model.path is not None and os.path.lexists(config.body_model.path):
        files["body_model.path"] = config.body_model.path
    for name, path in files.items():
        if name in ("photo.bodies", "photo.masks") and os.path.isdir(path):
            continue  # of a file for each person
        try:
            check_regular(Path(path))
        except OSError as error:
            setting = f"{config.source(name)}: {name}"
            raise InputError(f"{setting}: cannot read {path}: {unreadable(error)}") from error


def format_missing(texts: Sequence[str], end: str) -> str:
    """Format messages about missing files and devices as an indented list below a heading."""
    head = "1 thing is missing" if len(texts) == 1 else f"{len(texts)} things are missing"
    return "\n".join([f"{head}{end}:", *("  " + text.replace("\n", "\n    ") for text in texts)])


def named_weights(plan: ResolvedPipeline) -> tuple[WeightSet, ...]:
    """Return the weight sets that options of the backends name, each once.

    Raises:
        BackendError: the manifest of a plugin is invalid.
    """
    sets: dict[tuple[str, str], WeightSet] = {}
    for resolved in plan.backends.values():
        who = resolved.provenance
        for weights in named_sets(who.distribution, who.options):
            sets[who.distribution, weights.name] = weights
    return tuple(sets.values())


def _given_in_python(interface: str, given: object) -> ResolvedBackend:
    """Check an instance given in Python, or construct a class with its default options.

    Raises:
        ConfigError: no interface has this name, or the class needs options.
        BackendError: the object is of another interface, or its class is incomplete.
    """
    require_interface(interface)
    kind: Any = given if isinstance(given, type) else type(given)
    if problem := class_problem(kind, interface):
        raise BackendError(f"backends['{interface}']: the class of {quoted(given)} {problem}")
    name = f"{kind.__module__}:{kind.__qualname__}"
    offer = Offer(f"physic.{interface}", name, name, "given in Python")
    if isinstance(given, INTERFACES[interface]):
        return _resolved(offer, given, cacheable=False)
    try:
        return _construct_backend(offer, kind, kind.Options())
    except ValidationError as error:
        raise ConfigError(
            f"backends['{interface}']: {name} has options without a default: give an instance"
        ) from error


def _choose_backends(
    choices: Mapping[str, BackendChoice], source: Callable[[str], str]
) -> dict[str, _Chosen]:
    """Import the chosen backend of each interface, and check its options.

    Raises:
        ConfigError: names or options are invalid; the message lists all errors.
        BackendError: a backend is broken.
    """
    chosen: dict[str, _Chosen] = {}
    problems: list[Problem] = []
    cause: BackendError | None = None
    for interface, choice in choices.items():
        if choice.backend == "none":
            continue
        try:
            offer = find_backend(interface, choice.backend)
            kind = load_class(offer)
        except (BackendNotFoundError, AmbiguousBackendError) as error:
            problems.append(Problem(f"{interface}.backend", str(error)))
            cause = cause or error
            continue
        try:
            with plugin_code():
                chosen[interface] = offer, kind, kind.Options.model_validate(choice.options)
        except ValidationError as error:
            problems += problems_from_pydantic(
                error, kind.Options, f"{interface}.options", "option"
            )
        except Exception as error:  # of a validator
            text = f"{offer} has options that cannot be read: {describe_error(error, kind)}"
            raise BackendError(text) from error
    if problems:
        raise config_error(problems, source) from cause
    return chosen


def _construct_backend(offer: Offer, kind: type[Backend], options: Options) -> ResolvedBackend:
    with (
        restored_process_state() as changes,
        named_plugin_code(f"{offer} cannot be constructed", kind),
    ):
        resolved = _resolved(offer, kind(options))
    for change in changes:
        _LOG.warning("the constructor of %s %s", offer, change)
    return resolved


def _resolved(offer: Offer, backend: Backend, *, cacheable: bool = True) -> ResolvedBackend:
    options = backend.options.model_dump(mode="json")
    provenance = Provenance(
        interface=offer.interface,
        backend=offer.name,
        plugin=type(backend).__module__.partition(".")[0],
        distribution=offer.distribution,
        version=offer.version,
        options=options,
        weights_license=licence_text(named_sets(offer.distribution, options))
        or backend.weights_license,
    )
    return ResolvedBackend(backend, provenance, cacheable)
