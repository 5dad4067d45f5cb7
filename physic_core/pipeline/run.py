"""Reconstruct people, scene and contact from photos.

The three steps are ``estimate.run_backends``, ``optimise.run_engine`` and ``checks.run_checks`` of
this package.
"""

from __future__ import annotations

import multiprocessing
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

# imported before any backend: it detects later edits of their code
from physic_core.cache.digests import CodeDigester
from physic_core.configuration.model import as_config
from physic_core.configuration.resolve import (
    ResolvedPipeline,
    check_input_files,
    require_available,
    resolve,
    resolve_one,
)
from physic_core.errors import ConfigError, PhysicError
from physic_core.io.photo import Photo, photo_path_for_messages, read_photo
from physic_core.pipeline.photo_run import PhotoRun, stages_before_the_engine
from physic_core.pipeline.stage_caller import LoadedBackends, StageCaller
from physic_core.prepare.photo import prepare_photo
from physic_core.types import (
    Bodies,
    CameraTrust,
    Intrinsics,
    KnownSizes,
    PeoplePrompt,
    Reconstruction,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any, Self

    from physic_core.configuration.model import Config
    from physic_core.engine.state import Estimates, OtherView
    from physic_core.interfaces import Backend
    from physic_core.io.photo import PhotoSource
    from physic_core.pipeline.stage_caller import Progress
    from physic_core.types import BoolArray

    Configuration = ResolvedPipeline | Config | Mapping[str, Any] | str | os.PathLike[str] | None

_ENGINE_STAGES = 4  # of :mod:`.optimise`
_MAX_READING_BYTES = 2_000_000_000
"""More than any photo needs: files just below the limits of their formats took up to 1.27 GB."""


class Pipeline:
    """The backends and settings of a configuration; the backends are loaded once and used for many
    photos.

    ::

        with Pipeline("embedded") as pipeline:
            for path in paths:
                result = pipeline(path)

    Files and device are checked at construction. Each backend is loaded at its first call, or all
    by :meth:`warm_up`, and closed at the end of the ``with`` block. With ``[run] low_memory``, each
    backend is closed right after its last use for a photo instead, and the next photo loads it
    again.

    A pipeline is not thread-safe, since backends are not: use one per thread or process. A call
    from a second thread during a call raises PhysicError.

    Args:
        config: a Config, the name of a preset, the path of a TOML file, or its tables, of which
            "extends" may name a preset or a file; preset "embedded" if None. Or a ResolvedPipeline,
            whose backends are used as they are.
        backends: by interface, instances or classes of backends that replace those of the config,
            such as ``{"metric_depth": MyDepth()}``. A class gets its default options. Results of
            instances are not cached.

    Raises:
        ConfigError: the configuration is invalid.
        WeightsMissingError: files of backends are missing; the message lists all.
        DeviceError: the device does not exist.
        BackendError: a backend cannot be constructed, or is of another interface.
    """

    def __init__(
        self,
        config: Configuration = None,
        *,
        backends: Mapping[str, Backend | type[Backend]] | None = None,
    ) -> None:
        if isinstance(config, ResolvedPipeline):
            if backends:
                raise ConfigError(
                    "backends cannot be replaced in a ResolvedPipeline: pass them to resolve()"
                )
            self._plan = config
        else:
            self._plan = resolve(as_config(config), backends)
        require_available(self._plan)
        self._loaded = LoadedBackends(self._plan.device)
        self._code = CodeDigester()
        self._running = threading.Lock()
        self._closed = False

    @property
    def config(self) -> Config:
        """The resolved configuration; it names the classes of given backends."""
        return self._plan.config

    def __repr__(self) -> str:
        names = ", ".join(
            f"{name}={who.provenance.backend}" for name, who in self._plan.backends.items()
        )
        return f"Pipeline({names}{', closed' if self._closed else ''})"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # an error in the block is reported, not hidden
        with nullcontext() if kind is None else suppress(PhysicError):
            self.close()

    def __call__(
        self,
        photo: PhotoSource,
        *,
        intrinsics: Intrinsics | None = None,
        people: PeoplePrompt | None = None,
        known: KnownSizes | None = None,
        bodies: Bodies | None = None,
        masks: BoolArray | None = None,
        views: Sequence[OtherView] = (),
        complete: Callable[[Estimates], Estimates] | None = None,
        settings: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction:
        """Reconstruct people, scene and contact from one photo.

        Args:
            photo: path of a file, bytes of a file, PIL image, or upright array (H, W, 3) of uint8
                RGB. EXIF data may give camera and orientation.
            intrinsics: the camera of the upright photo, px. It counts as known unless its ``trust``
                is "guessed"; ``[photo]`` of the config replaces it.
            people: the people to reconstruct, px of the upright photo; ``[photo]`` of the config if
                None, where no choice means all people.
            known: sizes that are known, in px of the upright photo; ``[photo]`` of the config
                replaces each of them.
            bodies: of some people, in metres, in the frame of the photo's camera, which must be
                known; for people whom the photo shows there, instead of the body estimator's.
            masks: (M, H, W) bool, visible pixels of each person to reconstruct, px of the upright
                file; as those of ``people``.
            views: what other cameras show of the same people, in their order, at the same moment.
            complete: adds data from other photos of the moment to the estimates of the backends.
            settings: of the table ``[photo]``, for this photo only, such as ``{"focal_px":
                900.0}``.
            progress: called when each stage begins.

        Returns:
            Everything in metres in the OpenCV camera frame (x right, y down, z forward).

        Raises:
            InputError: the photo, or a file that ``settings`` name, cannot be used.
            ConfigError: ``settings``, intrinsics, chosen people or known sizes are invalid, or the
                photo contradicts a known size.
            NoPersonError: one of ``people`` was not found, or the photo shows no person and the
                config requires people.
            BackendError: a required backend failed, or returned an invalid result.
        """
        return self._run(
            photo,
            _UserInput(intrinsics, people, known, tuple(views), complete, bodies, masks),
            settings,
            progress,
        )

    def warm_up(self) -> None:
        """Load all backends and the body model now; with ``[run] low_memory``, load and close one
        after another.

        Raises:
            BackendError: a backend cannot be loaded.
        """
        from physic_core.backends.memory import release_memory
        from physic_core.body import load_body

        with self._exclusive():
            load_body(self._plan.body_model)
            for resolved in self._plan.backends.values():
                self._loaded.load(resolved)
                if self.config.run.low_memory:
                    self._loaded.close(resolved)
            # of sessions that wrote optimised graphs
            release_memory(one.backend for one in self._plan.backends.values())

    def close(self) -> None:
        """Close all loaded backends; the pipeline cannot be used afterwards.

        A second call does nothing.

        Raises:
            BackendError: a backend cannot be closed; all others are closed.
        """
        self._closed = True
        if errors := self._loaded.close():
            raise errors[0]

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        if self._closed:
            raise PhysicError("the pipeline is closed: create a new one")
        if not self._running.acquire(blocking=False):
            raise PhysicError("the pipeline is running in another thread: create one per thread")
        try:
            yield
        finally:
            self._running.release()

    def _run(
        self,
        source: PhotoSource,
        user_input: _UserInput,
        settings: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
        *,
        close: bool = False,
    ) -> Reconstruction:
        """Reconstruct a photo; with ``close``, close each backend after its last use, which frees
        its memory.
        """
        camera = user_input.camera()
        plan = self._plan_with(settings)
        path = photo_path_for_messages(source)
        with self._exclusive(), _errors_name_photo(path):
            with limited_memory(self.config.run.device):
                photo = read_photo(source)
            if camera is not None and (camera.width, camera.height) == photo.file_size:
                # the file was reduced while it was read
                camera = camera.resized(*photo.image.shape[1::-1])
            if camera is not None:
                photo = replace(photo, intrinsics=camera)
            photo = replace(photo, name=Path(path).name)
            stages = self._stages(progress, close=close)
            try:
                result = _reconstruct(
                    photo, plan, user_input, stages, close=close or plan.config.run.low_memory
                )
            finally:
                for name, resolved in plan.backends.items():
                    if resolved is not self._plan.backends[name]:
                        self._loaded.close(resolved)
            width, height = photo.file_size or photo.image.shape[1::-1]
            return replace(
                result, photo=photo.digest, photo_name=photo.name, file_size=(width, height)
            )

    def _plan_with(self, settings: Mapping[str, Any] | None) -> ResolvedPipeline:
        """Return the plan with other values in the table ``[photo]``, and backends that read its
        files.
        """
        if not settings:
            return self._plan
        config = self._plan.config.with_photo(settings)
        check_input_files(config)
        backends = dict(self._plan.backends)
        for name in backends:
            if (choice := config.choice(name)) != self._plan.config.choice(name):
                backends[name] = resolve_one(name, choice.backend, choice.options)
        return replace(self._plan, photo=config.photo, config=config, backends=backends)

    def _stages(self, progress: Progress | None, *, close: bool) -> StageCaller:
        run = self.config.run
        cache = None
        if run.cache:
            from physic_core.cache.results import ResultCache

            cache = ResultCache.in_users_folder(run.cache_mb, self._code)
        return StageCaller(
            self._plan.device,
            stages_before_the_engine(self._plan.backends) + _ENGINE_STAGES,
            progress,
            cache=cache,
            low_memory=run.low_memory,
            close_used=close,
            loaded=self._loaded,
        )


def reconstruct(
    photo: PhotoSource,
    config: Configuration = None,
    *,
    backends: Mapping[str, Backend | type[Backend]] | None = None,
    intrinsics: Intrinsics | None = None,
    people: PeoplePrompt | None = None,
    known: KnownSizes | None = None,
    bodies: Bodies | None = None,
    masks: BoolArray | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct people, scene and contact from one photo; for several photos, :class:`Pipeline`
    loads backends once.

    Args:
        photo: as in :meth:`Pipeline.__call__`.
        config: as in :class:`Pipeline`.
        backends: as in :class:`Pipeline`.
        intrinsics: as in :meth:`Pipeline.__call__`.
        people: as in :meth:`Pipeline.__call__`.
        known: as in :meth:`Pipeline.__call__`.
        bodies: as in :meth:`Pipeline.__call__`.
        masks: as in :meth:`Pipeline.__call__`.
        progress: called when each stage begins.

    Returns:
        Everything in metres in the OpenCV camera frame (x right, y down, z forward).

    Raises:
        PhysicError: as in :class:`Pipeline` and :meth:`Pipeline.__call__`. If files of backends are
            missing, nothing was computed.
    """
    with Pipeline(config, backends=backends) as pipeline:
        user_input = _UserInput(intrinsics, people, known, bodies=bodies, masks=masks)
        return pipeline._run(photo, user_input, progress=progress, close=True)


@contextmanager
def _errors_name_photo(photo: str) -> Iterator[None]:
    """Start the message of an error with the path of the photo, if it has one."""
    try:
        yield
    except PhysicError as error:
        if not photo or photo in str(error):
            raise
        raise type(error)(f"{photo}: {error}") from error


_GIVEN: dict[str, tuple[type, str]] = {
    "intrinsics": (Intrinsics, "(fx, fy, cx, cy, width, height) in px of the image"),
    "people": (PeoplePrompt, "(points=((x, y),)) in px of the photo"),
    "known": (KnownSizes, "(stature=(1.8,)) in meters"),
    "bodies": (Bodies, "(parameters, body_model) in meters"),
}
"""Fields of `_UserInput` that users pass -> type, and how it is constructed."""


@dataclass(frozen=True)
class _UserInput:
    """The user's data for one photo, px of the upright file, and the views of other cameras."""

    intrinsics: Intrinsics | None = None
    people: PeoplePrompt | None = None
    known: KnownSizes | None = None
    views: tuple[OtherView, ...] = ()
    complete: Callable[[Estimates], Estimates] | None = None
    bodies: Bodies | None = None
    masks: BoolArray | None = None

    def __post_init__(self) -> None:
        """Raise ConfigError for a value of another type."""
        for name, (kind, example) in _GIVEN.items():
            value = getattr(self, name)
            if value is not None and not isinstance(value, kind):
                raise ConfigError(
                    f"{name} must be physic_core.{kind.__name__}, got {type(value).__name__}: pass "
                    f"{kind.__name__}{example}"
                )

    def camera(self) -> Intrinsics | None:
        """Return the given camera; it counts as known unless it is a guess."""
        if self.intrinsics is not None and not self.intrinsics.guessed:
            return replace(self.intrinsics, trust=CameraTrust.KNOWN)
        return self.intrinsics


def _reconstruct(
    photo: Photo,
    plan: ResolvedPipeline,
    user_input: _UserInput,
    stages: StageCaller,
    *,
    close: bool,
) -> Reconstruction:
    from physic_core.backends.devices import limited_threads
    from physic_core.prepare.files import read_bodies_of, read_masks_of

    people, masks = read_masks_of(photo, plan, user_input.people, user_input.masks)
    bodies = read_bodies_of(photo, plan, user_input.bodies)
    prepared = prepare_photo(photo, plan.photo, people, user_input.known, bodies, masks)
    photo = prepared.photo
    stages.note(*photo.notes)
    stages.warn(*photo.warnings)
    run = PhotoRun(prepared, plan, stages)
    with limited_threads(plan.config.run.threads):
        estimates = _estimate(run, close=close)
    from physic_core.pipeline.optimise import run_engine

    estimates = replace(estimates, views=user_input.views)
    estimates = estimates if user_input.complete is None else user_input.complete(estimates)
    engine = plan.engine
    if plan.photo.bodies_final and bodies is not None:
        engine = replace(engine, joint=engine.joint.with_fixed_bodies())
    with limited_threads(plan.config.run.threads):
        result = run_engine(estimates, engine, run.model, stages)
        result = _with_checks(result, estimates, stages)
    result = _with_descriptions(result, estimates, plan, stages)
    result = replace(
        result,
        stages=tuple(stages.records),
        warnings=tuple(stages.warnings),
        notes=tuple(stages.notes),
        config=plan.config.as_dict(),
        lens=prepared.lens,
    )
    return result if prepared.border is None else prepared.border.added_to(result)


def _with_checks(
    result: Reconstruction, estimates: Estimates, stages: StageCaller
) -> Reconstruction:
    """Return a result with its checks, and the trust in each person."""
    from physic_core.judge import run_checks
    from physic_core.pipeline.reconstruction import with_checks_and_trust

    with stages.optional_step("the check of the result"):
        return with_checks_and_trust(result, run_checks(estimates, result))
    return result


def _with_descriptions(
    result: Reconstruction, estimates: Estimates, plan: ResolvedPipeline, stages: StageCaller
) -> Reconstruction:
    """Add warnings and notes about a judged result to the run; return it with the repositories."""
    from physic_core.judge import warning_messages
    from physic_core.pipeline.reconstruction import (
        bent_trunk_warnings,
        describe_methods,
        describe_repositories,
        small_stature_warnings,
    )

    repositories: dict[str, Any] = {}
    with stages.optional_step("the description of the result"):
        repositories, others = describe_repositories(plan)
        stages.warn(*others, *warning_messages(result.checks))
        stages.warn(*small_stature_warnings(estimates, result), *bent_trunk_warnings(result))
        stages.note(*describe_methods(estimates, result))
    with stages.optional_step("the search for mistakes of backends"):
        _warn_of_contradictions(plan, estimates, result, stages)
    return replace(result, diagnostics={**result.diagnostics, **repositories})


def _warn_of_contradictions(
    plan: ResolvedPipeline, estimates: Estimates, result: Reconstruction, stages: StageCaller
) -> None:
    """Warn of backends that never passed the kit, and whose answers contradict those of others."""
    from physic_core.pipeline.plausibility import (
        disagreement_with_other_backends,
        implausible_contact_places,
    )

    strange = {name: one for name, one in plan.backends.items() if not stages.has_passed_kit(one)}
    prior = strange.get("contact_prior")
    if prior and (doubt := implausible_contact_places(result, estimates.contact.probability)):
        stages.warn(f"{prior.title}: {doubt}")
    furthest, doubt = disagreement_with_other_backends(result, strange)
    if furthest and not any(strange[furthest].title in text for text in stages.warnings):
        stages.warn(f"{strange[furthest].title}: {doubt}; physic plugins check tries it alone")
    titles = [backend.title for backend in strange.values()]
    is_usable = all(len(person.usable) == len(person.marks) for person in result.people)
    if result.people and is_usable and not any(check.failed for check in result.checks):
        return
    if titles and not any(title in text for title in titles for text in stages.warnings):
        stages.warn(
            f"not everything is usable, and these backends never passed physic plugins check here, "
            f"so they may be wrong: {', '.join(titles)}"
        )


def _estimate(run: PhotoRun, *, close: bool) -> Estimates:
    """Run the backends, and release their memory."""
    from physic_core.backends.memory import release_memory
    from physic_core.pipeline.estimate import run_backends

    try:
        return run_backends(run)
    finally:
        if close:
            run.stages.close()
        else:
            run.stages.trim_cache()
        # So that a worker's networks and engine do not hold theirs at one time. A single run
        # would take the memory of the C library again at once.
        release_memory(
            (one.backend for one in run.plan.backends.values()),
            all_of_it=run.plan.config.run.low_memory or not close,
        )


@contextmanager
def limited_memory(device: str) -> Iterator[None]:
    """Inside the block, limit a Linux worker with networks on a CPU to 2 GB more memory.

    Memory already in use does not count, since networks take from a few MB to many GB. CUDA
    reserves memory at any time, and is not limited.

    Args:
        device: of the networks.
    """
    if sys.platform != "linux" or device != "cpu" or multiprocessing.parent_process() is None:
        yield
        return
    import resource

    before = resource.getrlimit(resource.RLIMIT_DATA)
    held = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    limits = [
        limit for limit in (*before, held + _MAX_READING_BYTES) if limit != resource.RLIM_INFINITY
    ]
    resource.setrlimit(resource.RLIMIT_DATA, (min(limits), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
