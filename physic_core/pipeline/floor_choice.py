"""Choose the floor: the surface beside the people's feet if they stand on it, otherwise the labelled floor.

A segmenter looks for the floor beside the feet. Behind the feet of people who hang or jump there is a wall as well as a
floor. Whether feet stand on a candidate is measured, see :func:`physic_core.engine.sizes.standing_scores`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import Plane

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.scene.method import SceneMethod
    from physic_core.geometry.floor import FloorEvidence
    from physic_core.types import Bodies, BoolArray, FloatArray, Hints, Keypoints, People, Pointmap

_LABELS = ("floor", "ground", "rug")
_MIN_LABELLED_SHARE = 0.02  # of the picture; a smaller floor among the labels is ignored
_SAME_SHARE = 0.5  # of the labelled floor; a mask that has more of it is the same floor


@dataclass(frozen=True)
class FloorCandidate:
    """A candidate for the floor.

    Attributes:
        mask: (H, W) bool, its pixels; None if the segmenter does not detect floors.
        plane: in the units of the scene; None if no plane fits.
    """

    mask: BoolArray | None
    plane: Plane | None


def floor_candidates(
    scene: Pointmap, people: People, hole: BoolArray, keypoints: Keypoints, method: SceneMethod
) -> tuple[FloorCandidate, ...]:
    """Return the segmenter's floor, and the labelled floor if it is elsewhere and a plane fits it."""
    if method.floor == "off":
        return (FloorCandidate(people.floor, None),)
    first = _candidate(scene, people.floor, hole, keypoints)
    if people.floor is None or people.surfaces is None or not len(people):
        return (first,)
    labelled = people.surfaces.mask(*_LABELS) & ~people.masks.any(0)
    shared = (labelled & people.floor).sum()
    if labelled.mean() < _MIN_LABELLED_SHARE or shared > _SAME_SHARE * labelled.sum():
        return (first,)
    other = _candidate(scene, labelled, hole, keypoints)
    return (first,) if other.plane is None else (first, other)


def choose_floor(
    candidates: tuple[FloorCandidate, ...], hints: Hints, model: BodyModel, lifted_sigmas: float = 3.0
) -> tuple[FloorCandidate, FloatArray]:
    """Return the first candidate on which a person stands, otherwise the last, and the standing scores (N,) of the
    people.

    If standing cannot be measured, the floor is the first candidate.

    Args:
        candidates: of :func:`floor_candidates`.
        hints: with the N people, their bodies, the camera, and the point map of the photo in units of the scene.
        model: of the bodies.
        lifted_sigmas: standard deviations from standing, beyond which feet are off the floor.
    """
    # Imported here: it imports torch, which a thread imports while the first network runs.
    from physic_core.engine.sizes import scales_by_soles, scales_by_torsos, standing_scores

    people, photo, bodies = hints.people, hints.original, hints.bodies
    count = 0 if people is None else len(people)
    unknown = np.full(count, np.nan)
    if people is None or photo is None or bodies is None or hints.intrinsics is None or not count:
        return candidates[0], unknown
    if photo.people_farther is None:
        return candidates[0], unknown
    vertices, observed = _posed_vertices(bodies, model), bodies.observed
    observed = np.ones((count, 55), bool) if observed is None else observed
    by_torsos = scales_by_torsos(vertices, model, people.masks, photo, hints.intrinsics.matrix)
    found: list[tuple[FloorCandidate, FloatArray]] = []
    for candidate in candidates:
        scores = unknown
        if candidate.plane is not None:
            soles = scales_by_soles(vertices, model, observed, candidate.plane)
            scores = standing_scores(soles, by_torsos, photo)
        found.append((candidate, scores))
        if (scores >= -lifted_sigmas).any():
            return found[-1]
    return found[-1] if np.isfinite(found[0][1]).any() or candidates[0].plane is None else found[0]


def _posed_vertices(bodies: Bodies, model: BodyModel) -> FloatArray:
    """Return the vertices (N, V, 3) of bodies, metres."""
    import torch

    from physic_core.body.parameters import rotations_from_parameters
    from physic_core.geometry.tensors import tensor

    p = bodies.parameters
    with torch.no_grad():
        rotations = rotations_from_parameters(p, model.device, model.dtype)
        betas, transl = (tensor(x).to(model.device, model.dtype) for x in (p.betas, p.transl))
        vertices: FloatArray = model(rotations, betas, transl).vertices.double().cpu().numpy()
    return vertices


def _candidate(scene: Pointmap, mask: BoolArray | None, hole: BoolArray, keypoints: Keypoints) -> FloorCandidate:
    from physic_core.geometry.floor import fit_floor
    from physic_core.geometry.tensors import tensor

    fit = fit_floor(tensor(scene.points), tensor(scene.valid), floor_evidence(mask, hole, keypoints)).plane
    return FloorCandidate(mask, None if fit is None else Plane(fit.normal.numpy(), float(fit.offset)))


def floor_evidence(mask: BoolArray | None, hole: BoolArray, keypoints: Keypoints) -> FloorEvidence:
    """Return the floor in the photo: its mask, the inpainted pixels and the feet."""
    from physic_core.geometry.floor import FloorEvidence
    from physic_core.geometry.tensors import optional_tensors

    return FloorEvidence(*optional_tensors(mask, hole, feet_pixels(keypoints, *hole.shape)))


def feet_pixels(keypoints: Keypoints, height: int, width: int, confidence: float = 0.5) -> FloatArray:
    """Return heels and toes inside the image with more than ``confidence``, (M, 2) px."""
    soles = [i for i, name in enumerate(keypoints.joint_set.names) if name.endswith(("heel", "toe", "foot_tip"))]
    points, seen = keypoints.points[:, soles], keypoints.confidence[:, soles] > confidence
    seen &= (points >= 0).all(-1) & (points[..., 0] <= width - 1) & (points[..., 1] <= height - 1)
    chosen: FloatArray = points[seen]
    return chosen
