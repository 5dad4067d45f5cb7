"""The result of several photos, from the solved cameras and the solution in the reference photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_scene.checks import SolvedView, checks_of_cameras, checks_of_keypoints, with_checks
from physic_scene.reference import scene_scales
from physic_scene.rigid import CameraPose
from physic_scene.types import SceneCamera, SceneResult, SolvedPhoto

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Reconstruction
    from physic_scene.people import PersonOfScene
    from physic_scene.solution import SolvedScene


def assemble(
    solved: SolvedScene, everybody: Sequence[PersonOfScene], reconstruction: Reconstruction
) -> SceneResult:
    """Build the result of several photos, with its checks, notes and warnings.

    Args:
        solved: cameras and people.
        everybody: the people of the reconstruction.
        reconstruction: in the frame of the reference photo.
    """
    factor = reconstruction.scene.scale  # of the joint solution, which cameras and scene share
    scales = scene_scales(solved) * factor
    solved = replace(solved, bundle=solved.bundle.scaled(factor))
    reference = solved.photos[solved.reference]
    photos = _solved_photos(solved, everybody, reconstruction, scales)
    others = [photo for photo in photos if photo.index != reference.index]
    checks = (
        *checks_of_keypoints(reconstruction, others),
        *checks_of_cameras(_solved_views(solved), solved.rows),
    )
    reconstruction = with_checks(reconstruction, checks)
    moved_notes = [
        f"a person of {names} moved between them; the result follows one of them"
        for names in solved.photos_of_moved
    ]
    unseen = []
    for row, one in enumerate(everybody):
        if solved.reference not in one.row_by_photo:
            reference_name = reference.name
            photo_names = ", ".join(photo.name for photo in photos if row in photo.shown)
            unseen.append(
                f"person {row} is in {photo_names} only: the checks of {reference_name} do "
                f"not cover this person"
            )
    shared = "1 person" if len(solved.rows) == 1 else f"{len(solved.rows)} people"
    first = f"cameras of {len(photos)} photos from {shared}; the frame is that of {reference.name}"
    return SceneResult(
        reconstruction=replace(
            reconstruction,
            notes=(
                *reconstruction.notes,
                first,
                *_note_on_known_cameras(solved),
                *moved_notes,
                *unseen,
            ),
            warnings=(*reconstruction.warnings, *(one.message for one in solved.left_out)),
        ),
        reference=reference.index,
        photos=photos,
        left_out=solved.left_out,
    )


def _note_on_known_cameras(solved: SolvedScene) -> list[str]:
    """Return a sentence about which cameras are known, if some are."""
    known = [photo.name for photo in solved.photos if photo.people.pose is not None]
    others = [photo.name for photo in solved.photos if photo.people.pose is None]
    if len(known) == 1:
        return [f"the known pose of {known[0]} is not used: two are needed"]
    also = f"; those of {', '.join(others)} are estimated" if others else ""
    return [f"the poses of {', '.join(known)} are known, and give the scale{also}"] if known else []


def _solved_views(solved: SolvedScene) -> list[SolvedView]:
    """Return the photos in the form on which the cameras are checked."""
    views = []
    for v, (photo, camera) in enumerate(zip(solved.photos, solved.intrinsics, strict=True)):
        floor = photo.result.scene.floor
        size = (camera.width, camera.height)
        views.append(
            SolvedView(photo.name, photo.people, solved.bundle.pose(v), camera.matrix, size, floor)
        )
    return views


def _solved_photos(
    solved: SolvedScene,
    everybody: Sequence[PersonOfScene],
    reconstruction: Reconstruction,
    scales: FloatArray,
) -> tuple[SolvedPhoto, ...]:
    """Return the photos, with the factors (V,) on the scenes of the single photos."""
    solved_photos = []
    for v, photo in enumerate(solved.photos):
        errors = solved.errors[v][np.isfinite(solved.errors[v])]
        is_reference = v == solved.reference
        pose = CameraPose.identity() if is_reference else solved.bundle.pose(v)
        camera = SceneCamera(
            pose.rotation,
            pose.translation,
            reconstruction.intrinsics if is_reference else solved.intrinsics[v],
            float(solved.rotation_sigma[v]),
            float(solved.position_sigma[v]),
        )
        solved_photos.append(
            SolvedPhoto(
                index=photo.index,
                name=photo.name,
                camera=camera,
                shown={
                    row: one.row_by_photo[v]
                    for row, one in enumerate(everybody)
                    if v in one.row_by_photo
                },
                reprojection=float(np.median(errors)) if len(errors) else float("nan"),
                scene_scale=float(scales[v]),
                result=photo.result,
            )
        )
    return tuple(solved_photos)
