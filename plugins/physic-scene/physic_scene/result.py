"""The result of several photos, from the solved cameras and the solution in the reference photo."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core import with_cameras
from physic_core.types import CameraView, Detection
from physic_scene.reference import scene_scales, solved_camera
from physic_scene.types import CameraPose, ScenePerson, SceneResult

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, Reconstruction, UInt8Array
    from physic_scene.cameras import SolvedScene

__all__ = ["assemble"]

_POINTS = 60_000  # of the scene of each photo


def assemble(solved: SolvedScene, reconstruction: Reconstruction, model: BodyModel) -> SceneResult:
    """Return the result.

    Args:
        solved: cameras and people.
        reconstruction: of the reference photo.
        model: body model, float64.
    """
    factor = reconstruction.scene.scale  # of the joint solution, which cameras and scene share
    solved = replace(solved, bundle=solved.bundle.scaled(factor), bodies=solved.bodies.scaled(factor))
    photos, v = solved.chosen.photos, solved.reference
    cameras = tuple(_cameras(solved))
    people = _people(solved, reconstruction, model)
    reconstruction = with_cameras(reconstruction, _views(reconstruction, cameras, people, photos[v].index))
    points, colors = _merged_points(reconstruction, cameras, photos[v].index)
    names = {photo.index: photo.name for photo in photos}
    moved = [_move(one, names) for one in people if one.moved]
    shared = "1 person" if len(solved.rows) == 1 else f"{len(solved.rows)} people"
    notes = (
        f"cameras of {len(photos)} photos from {shared}; the frame is that of {photos[v].name}",
        *moved,
    )
    left_out = tuple(one.message for one in solved.chosen.left_out)
    return SceneResult(
        reconstruction=replace(
            reconstruction,
            notes=(*reconstruction.notes, *notes),
            warnings=(*reconstruction.warnings, *left_out),
        ),
        reference=photos[v].index,
        cameras=cameras,
        people=people,
        left_out=solved.chosen.left_out,
        points=points,
        colors=colors,
        notes=(notes[0], *left_out, *moved),
        diagnostics={
            "matched_pixels": {
                f"{photos[m.views[0]].name}, {photos[m.views[1]].name}": len(m.first) for m in solved.chosen.background
            },
            "matching_scores": {
                f"{photos[a].name}, {photos[b].name}": round(match.score, 2)
                for (a, b), match in solved.chosen.matches.items()
            },
        },
    )


def _move(person: ScenePerson, names: dict[int, str]) -> str:
    """Return a sentence about a person who moved; names are those of the photos."""
    who = "another person" if person.row is None else f"person {person.row}"
    views = ", ".join(names[view] for view in person.views)
    if person.elsewhere:
        others = ", ".join(names[view] for view in person.elsewhere)
        return f"{who} moved: {others} shows them in another place or pose, and they are as in {views}"
    return f"{who} moved between the photos ({views}), and is as one of them shows"


def _cameras(solved: SolvedScene) -> list[CameraPose]:
    """Return the camera of each photo."""
    scales, found = scene_scales(solved), []
    every = np.concatenate([solved.rows, solved.moved])
    for v, photo in enumerate(solved.chosen.photos):
        person = {photo.people.rows[row]: p for p, row in enumerate(every[:, v]) if row >= 0}
        errors = solved.errors[v][np.isfinite(solved.errors[v])]
        sigma, own = solved.sigmas[v], v == solved.reference
        found.append(
            CameraPose(
                photo=photo.name,
                index=photo.index,
                intrinsics=solved_camera(solved, v),
                rotation=solved.bundle.rotation[v],
                translation=solved.bundle.translation[v],
                rotation_sigma_deg=0.0 if own else sigma.rotation_deg,
                position_sigma_m=0.0 if own else sigma.position_m,
                focal_sigma=sigma.log_focal,
                people=tuple(person.get(i) for i in range(len(photo.result.people))),
                reprojection=float(np.median(errors)) if len(errors) else float("nan"),
                scene_scale=float(scales[v]),
                result=photo.result,
            )
        )
    return found


def _views(
    reconstruction: Reconstruction, cameras: tuple[CameraPose, ...], people: tuple[ScenePerson, ...], reference: int
) -> list[CameraView]:
    """Return the cameras of the result, the reference first."""
    found: list[CameraView] = []
    for camera in cameras:
        if camera.index == reference:
            found.insert(0, CameraView.of_reference(reconstruction, camera.photo))
            continue
        shown = {}
        for p, person in zip(camera.people, camera.result.people, strict=True):
            row = None if p is None or not people[p].solved else people[p].row
            if row is not None:
                shown[row] = Detection.of(person)
        found.append(
            CameraView(
                photo=camera.photo,
                image=camera.result.image,
                intrinsics=camera.intrinsics,
                rotation=np.asarray(camera.rotation, np.float64),
                translation=np.asarray(camera.translation, np.float64),
                rotation_sigma=float(np.radians(camera.rotation_sigma_deg)),
                position_sigma=float(camera.position_sigma_m),
                people=dict(sorted(shown.items())),
            )
        )
    return found


def _people(solved: SolvedScene, reconstruction: Reconstruction, model: BodyModel) -> tuple[ScenePerson, ...]:
    """Return the people whom at least two photos show."""
    photos, v = solved.chosen.photos, solved.reference
    found = []
    with torch.inference_mode():
        body = model(solved.bodies.rotations, solved.bodies.betas, solved.bodies.transl)
    vertices = body.vertices.float().numpy()
    for p, row in enumerate(np.concatenate([solved.rows, solved.moved])):
        shown = tuple(photos[w].index for w in np.flatnonzero(row >= 0))
        unsolved = p >= len(solved.rows)
        other = () if unsolved else tuple(photos[w].index for w in np.flatnonzero(solved.elsewhere[p] >= 0))
        moved = unsolved or bool(other)
        if row[v] >= 0:
            own = photos[v].people.rows[row[v]]
            person = reconstruction.people[own]
            found.append(ScenePerson(shown, own, moved, person.parameters, person.vertices, person.joints, other))
        elif not unsolved:
            joints, parameters = solved.bodies.joints[p].astype(np.float32), solved.bodies.parameters([p], model)
            found.append(ScenePerson(shown, None, moved, parameters, vertices[p], joints, other))
        else:
            w = int(np.flatnonzero(row >= 0)[0])
            person = photos[w].result.people[photos[w].people.rows[row[w]]]
            pose = solved.bundle.pose(w)
            found.append(
                ScenePerson(
                    shown,
                    None,
                    True,
                    person.parameters,
                    pose.to_common(person.vertices).astype(np.float32),
                    pose.to_common(person.joints).astype(np.float32),
                )
            )
    return tuple(found)


def _merged_points(
    reconstruction: Reconstruction, cameras: tuple[CameraPose, ...], reference: int
) -> tuple[FloatArray, UInt8Array]:
    """Return points (M, 3) and colours (M, 3) of the scenes of all photos in the reference frame."""
    points, colors = [], []
    for camera in cameras:
        own = camera.index == reference
        scene = reconstruction.scene if own else camera.result.scene
        chosen = scene.valid & np.isfinite(scene.points).all(-1)
        every = max(1, int(chosen.sum()) // _POINTS)
        xyz: FloatArray = scene.points[chosen][::every].astype(np.float64)
        if not own:
            # The solved focal length moves points of the photo alone across the ray.
            zoom = camera.result.intrinsics.fx / camera.intrinsics.fx
            xyz = camera.to_reference(camera.scene_scale * xyz * [zoom, zoom, 1.0])
        points.append(xyz.astype(np.float32))
        colors.append(scene.colors[chosen][::every])
    return np.concatenate(points), np.concatenate(colors)
