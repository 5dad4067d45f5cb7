"""Reconstruct people, scene and contact from one photo.

The three steps are ``estimate.run_backends``, ``optimise.run_engine`` and ``checks.run_checks`` of this package.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.cache.code import CodeDigester  # imported before any backend: it detects later edits of their code
from physic_core.configuration.model import as_config
from physic_core.configuration.resolve import ResolvedPipeline, require_available, resolve
from physic_core.discovery.plugins import discover
from physic_core.errors import InputError
from physic_core.io.photo import Photo, check_image, limit_size, read_photo
from physic_core.io.result_folder import image_digest, photo_digest
from physic_core.pipeline.stage_runner import StageRunner
from physic_core.types import CameraTrust, Intrinsics, PeoplePrompt, Person, Reconstruction

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping
    from typing import Any

    from physic_core.configuration.model import Config, PhotoSettings
    from physic_core.discovery.registry import Registry
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution
    from physic_core.pipeline.stage_runner import Progress
    from physic_core.types import CheckResult, KnownSizes, UInt8Array

    Configuration = ResolvedPipeline | Config | Mapping[str, Any] | str | os.PathLike[str] | None

__all__ = ["reconstruct", "reconstruct_photo"]


def reconstruct(
    image: UInt8Array,
    config: Configuration = None,
    *,
    registry: Registry | None = None,
    intrinsics: Intrinsics | None = None,
    people: PeoplePrompt | None = None,
    known: KnownSizes | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct people, scene and contact from one image.

    Args:
        image: (H, W, 3) uint8 RGB, upright.
        config: a Config, the name of a preset, the path of a TOML file, or its tables; preset "embedded" if None. Or a
            ResolvedPipeline, whose backends are used as they are.
        registry: of the backends; the installed ones if None. Not used with a ResolvedPipeline.
        intrinsics: the camera of ``image``. It counts as known unless its ``trust`` is "guessed"; ``[photo]`` of the
            config replaces it.
        people: the people to reconstruct, px of ``image``; ``[photo]`` of the config if None, where no choice means all
            people.
        known: sizes that are known, in px of ``image``; ``[photo]`` of the config replaces each of them.
        progress: called when each stage begins.

    Returns:
        Everything in metres in the OpenCV camera frame (x right, y down, z forward).

    Raises:
        InputError: the image, its intrinsics, the chosen people or the known sizes cannot be used.
        ConfigError: the configuration is invalid.
        WeightsMissingError: files of backends are missing; the message lists all. Nothing was computed.
        DeviceError: the device does not exist.
        NoPersonError: no person was found, or one of ``people`` was not found.
        BackendError: a required backend failed, or returned an invalid result.
    """
    if intrinsics is not None and not isinstance(intrinsics, Intrinsics):
        raise InputError(
            f"intrinsics must be physic_core.types.Intrinsics, got {type(intrinsics).__name__}: "
            "pass Intrinsics(fx, fy, cx, cy, width, height) in px of the image"
        )
    if intrinsics is not None and not intrinsics.guessed:
        intrinsics = replace(intrinsics, trust=CameraTrust.KNOWN)
    photo = Photo(check_image(image), intrinsics)
    found = _reconstruct(photo, _plan(config, registry), people, known, progress)
    return replace(found, photo=image_digest(photo.image))


def reconstruct_photo(
    path: str | os.PathLike[str],
    config: Configuration = None,
    *,
    registry: Registry | None = None,
    people: PeoplePrompt | None = None,
    known: KnownSizes | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct people, scene and contact from a photo file; its EXIF data may give camera and orientation.

    Arguments and errors are those of :func:`reconstruct`; ``people`` and ``known`` are in px of the upright photo file.
    The file is read after config, device and backends have been checked.
    """
    plan = _plan(config, registry)
    photo = read_photo(path)
    return replace(_reconstruct(photo, plan, people, known, progress), photo=photo_digest(path, photo.image))


def _plan(config: Configuration, registry: Registry | None) -> ResolvedPipeline:
    """Resolve the backends and settings of a run, and raise WeightsMissingError if files are missing."""
    if isinstance(config, ResolvedPipeline):
        plan = config
    else:
        plan = resolve(as_config(config), discover() if registry is None else registry)
    require_available(plan)
    return plan


def _reconstruct(
    photo: Photo,
    plan: ResolvedPipeline,
    people: PeoplePrompt | None,
    known: KnownSizes | None,
    progress: Progress | None,
) -> Reconstruction:
    from physic_core.adapters.threads import limited_threads
    from physic_core.body import load_body
    from physic_core.cache.result_cache import ResultCache
    from physic_core.pipeline.checks import run_checks
    from physic_core.pipeline.estimate import run_backends
    from physic_core.pipeline.optimise import run_engine

    file_size = photo.file_size or photo.image.shape[1::-1]
    photo = limit_size(_with_camera(photo, plan.photo), plan.photo.max_side)
    prompt = _prompt(people, plan.photo, file_size, photo.image.shape[1::-1])
    height, width = photo.image.shape[:2]
    known = plan.photo.known_sizes(known).resized(width / file_size[0], height / file_size[1])
    run = plan.config.run
    stages = StageRunner(
        plan.device,
        len(plan.backends) + _EXTRA_STAGES,
        progress,
        cache=ResultCache.in_users_folder(run.cache_mb, CodeDigester()) if run.cache else None,
        low_memory=run.low_memory,
    )
    stages.note(*photo.notes)
    model = load_body(plan.body_model)
    with limited_threads(run.threads):
        try:
            estimates = run_backends(photo.image, photo.intrinsics, plan, model, stages, prompt, known)
        finally:
            stages.close()
        solution = run_engine(estimates, plan.engine, model, stages)
    checks = run_checks(estimates, solution, plan.engine)
    return _result(estimates, solution, checks, model.faces.int().numpy(), model.name, plan.config, stages)


_EXTRA_STAGES = 6
"""Number of stages without a backend of their own: second point map, relative floor, four of the engine."""


def _with_camera(photo: Photo, settings: PhotoSettings) -> Photo:
    """Return the photo with the camera of the config (in px of the file), if the config has one."""
    height, width = photo.image.shape[:2]
    file_width, file_height = photo.file_size or (width, height)
    if settings.intrinsics is not None:
        given = Intrinsics(*settings.intrinsics, file_width, file_height, trust=CameraTrust.KNOWN)
    elif settings.focal_px is not None:
        given = Intrinsics.from_focal(settings.focal_px, file_width, file_height, trust=CameraTrust.KNOWN)
    else:
        return photo
    return replace(photo, intrinsics=given.resized(width, height))


def _prompt(
    people: PeoplePrompt | None, settings: PhotoSettings, file_size: tuple[int, int], size: tuple[int, int]
) -> PeoplePrompt | None:
    """Return the user's choice of people, in px of the image to reconstruct; None for all people.

    Args:
        people: in px of the upright file; the config's choice if None.
        settings: of the config.
        file_size: width and height of the upright file, px.
        size: width and height of the image to reconstruct, px.
    """
    from physic_core.io.people_prompt import check_prompt, read_masks, resize_prompt

    if people is None and (settings.person or settings.box or settings.masks):
        masks = None if settings.masks is None else read_masks(settings.masks)
        people = PeoplePrompt(settings.person, settings.box, masks)
    return None if people is None else resize_prompt(check_prompt(people, *file_size), file_size, size)


def _result(
    estimates: Estimates,
    solution: Solution,
    checks: tuple[CheckResult, ...],
    faces: Any,
    body_model: str,
    config: Config,
    stages: StageRunner,
) -> Reconstruction:
    from physic_core.pipeline.checks import check_warnings, failed_checks, unknown_checks

    people = []
    for i in range(len(estimates.people)):
        people.append(
            Person(
                box=estimates.people.boxes[i],
                score=float(estimates.people.scores[i]),
                mask=estimates.people.masks[i],
                keypoints=estimates.keypoints.points[i],
                keypoint_confidence=estimates.keypoints.confidence[i],
                parameters=solution.parameters[i : i + 1],
                vertices=solution.vertices[i],
                joints=solution.joints[i],
                contact=solution.contact[i],
                distance=solution.distance[i],
                failed_checks=failed_checks(checks, i),
                unknown_checks=unknown_checks(checks, i),
            )
        )
    stages.warn(*check_warnings(checks))
    return Reconstruction(
        image=estimates.image,
        intrinsics=solution.intrinsics,
        scene=solution.scene,
        people=tuple(people),
        faces=faces,
        body_model=body_model,
        skeleton=estimates.keypoints.skeleton,
        stages=tuple(stages.records),
        diagnostics={**solution.diagnostics, "people": [dict(p) for p in solution.people]},
        warnings=tuple(stages.warnings),
        notes=tuple(stages.notes),
        config=config.as_dict(),
        checks=checks,
    )
