"""The solution in the reference photo: the engine's four stages from the bodies, camera and scale of all photos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core import Pipeline
from physic_core.adapters.observed import observed_joints
from physic_core.body.joints import NUM_JOINTS
from physic_core.body.parameters import rotations_from_parameters
from physic_core.configuration.resolve import ResolvedPipeline, resolve
from physic_core.discovery.plugins import discover
from physic_core.engine.joint.problem import View
from physic_core.types import (
    Bodies,
    BodyParameters,
    CameraTrust,
    DepthMap,
    Intrinsics,
    Keypoints,
    PeoplePrompt,
)
from physic_core.types.short_repr import ShortRepr
from physic_scene.energy import KeypointSettings, OtherViews, with_other_views
from physic_scene.given import SolvedBodies, SolvedDepth

if TYPE_CHECKING:
    from physic_core import Config
    from physic_core.body.model import BodyModel
    from physic_core.engine.settings import EngineSettings
    from physic_core.types import BoolArray, FloatArray, IntArray, Reconstruction
    from physic_scene.cameras import SolvedScene
    from physic_scene.observations import PhotoPeople

__all__ = ["ReferenceInput", "scene_scales", "solve_reference", "solved_camera"]

_STATURE_SIGMA = 0.06  # of log(stature) of one person, whose mean gives the scale
_ON_FLOOR_M = 0.25  # largest height of the lowest point of a person who may stand on the floor
_STAND_M = 0.03  # error of that point
_FLOOR_DEG = 4.0  # error of the mean normal
_OTHER_SIGMA = 0.03  # of the scale by everything else


@dataclass(frozen=True)
class ReferenceInput(ShortRepr):
    """What the engine gets for the reference photo.

    Attributes:
        result: of the photo alone.
        camera: solved.
        bodies: of all people of the photo.
        depth: of its scene, at the solved scale.
        views: what the other photos show of these people.
        alone: what all photos alone say of their contact, and of the floor.
    """

    result: Reconstruction
    camera: Intrinsics
    bodies: Bodies
    depth: DepthMap
    views: tuple[View, ...]
    alone: OtherViews

    @classmethod
    def of(cls, solved: SolvedScene, model: BodyModel) -> ReferenceInput:
        """Return the input of the engine from the solved cameras and bodies."""
        v = solved.reference
        photo, camera = solved.chosen.photos[v], solved_camera(solved, v)
        result, people = photo.result, photo.people
        rows = {people.rows[row]: p for p, row in enumerate(solved.rows[:, v]) if row >= 0}
        parameters = _joined_parameters(result, solved, rows, model)
        scale = scene_scales(solved)[v]
        depth = np.where(result.scene.valid, scale * result.scene.points[..., 2], np.nan).astype(np.float32)
        number = {person: row for row, person in enumerate(people.rows)}
        observed = _observed(_keypoints(people, number, len(result.people)), result.image.shape[:2])
        sigma = float(np.hypot(_STATURE_SIGMA / np.sqrt(len(solved.rows)), _OTHER_SIGMA))
        return cls(
            result=result,
            camera=camera,
            bodies=Bodies(parameters, model.name, observed),
            depth=DepthMap(depth, camera, sigma, (f"scale and cameras from {len(solved.chosen.photos)} photos",)),
            views=_views(solved, rows),
            alone=_alone(solved, rows, parameters, model),
        )


@dataclass(frozen=True)
class _PlanWithViews(ResolvedPipeline):
    """Backends and settings of a run whose engine uses other photos."""

    solved: EngineSettings | None = None

    @cached_property
    def engine(self) -> EngineSettings:
        """Settings of the engine."""
        assert self.solved is not None
        return self.solved


def solve_reference(given: ReferenceInput, config: Config, errors: KeypointSettings) -> Reconstruction:
    """Run the pipeline on the reference photo, with the bodies and the depth of all photos.

    Args:
        given: what all photos show.
        config: of the photos alone; its table ``[photo]`` was used there, and is not used again.
        errors: of keypoints.
    """
    # The photos alone have said who is a child.
    plain = config.model_copy(update={"photo": type(config.photo)(child_share=0)})
    backends = {"body_estimator": SolvedBodies.of(given.bodies), "metric_depth": SolvedDepth.of(given.depth)}
    plan = resolve(plain, discover(), backends)
    own = _PlanWithViews(
        backends=plan.backends,
        photo=plan.photo,
        body_model=plan.body_model,
        device=plan.device,
        config=plan.config,
        solved=with_other_views(plan.engine, given.alone, errors),
    )
    prompt = None
    if config.photo.person or config.photo.box or config.photo.masks:
        prompt = PeoplePrompt(masks=np.stack([person.mask for person in given.result.people]))
    with Pipeline(own) as pipeline:
        found = pipeline(given.result.image, intrinsics=given.camera, people=prompt, views=given.views)
    return replace(found, photo=given.result.photo, lens=given.result.lens)


def solved_camera(solved: SolvedScene, view: int) -> Intrinsics:
    """Return the camera of a photo with its solved focal length."""
    before = solved.chosen.photos[view].result.intrinsics
    factor = float(np.exp(solved.bundle.log_focal[view]))
    return replace(
        before,
        fx=before.fx * factor,
        fy=before.fy * factor,
        source=before.source if before.known else "several photos",
        trust=before.trust if before.known else CameraTrust.ESTIMATED,
        focal_sigma=solved.sigmas[view].log_focal,
    )


def scene_scales(solved: SolvedScene) -> FloatArray:
    """Return the factor (V,) from the scene of each photo alone to the solution: by the depths of the people."""
    factors = np.ones(len(solved.chosen.photos))
    for v, photo in enumerate(solved.chosen.photos):
        here = np.flatnonzero(solved.rows[:, v] >= 0)
        if len(here):
            joints = solved.bundle.pose(v).to_camera(solved.bodies.joints[here, 0])
            alone = photo.people.joints[solved.rows[here, v], 0]
            factors[v] = np.exp(np.median(np.log(joints[:, 2] / alone[:, 2])))
    return factors


def _joined_parameters(
    result: Reconstruction, solved: SolvedScene, rows: Mapping[int, int], model: BodyModel
) -> BodyParameters:
    """Return the parameters of all people of the reference photo: solved ones, and others as in the photo alone."""
    parts = [
        solved.bodies.parameters([rows[i]], model) if i in rows else person.parameters
        for i, person in enumerate(result.people)
    ]
    return BodyParameters(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _contact(solved: SolvedScene, rows: Mapping[int, int], model: BodyModel) -> tuple[FloatArray, FloatArray]:
    """Return the summed probability of contact (N, V) of the photos alone that show a solved person, and their number.

    Both are 0 for a person of the reference photo alone, and where a photo alone has no probabilities.
    """
    photos = solved.chosen.photos
    people = len(photos[solved.reference].result.people)
    total, count = np.zeros((people, model.num_vertices)), np.zeros(people)
    for i, p in rows.items():
        for photo, row in zip(photos, solved.rows[p], strict=True):
            probability = photo.result.people[photo.people.rows[row]].contact_probability if row >= 0 else None
            if probability is not None:
                total[i] += probability
                count[i] += 1
    return total, count


def _floors(solved: SolvedScene, model: BodyModel) -> FloatArray | None:
    """Return normal and offset (2, 4) of the reference photo's floor, at the solved scale, and of that of all photos.

    The normal is the robust mean of the photos' normals, turned a little so that most people stand on the floor: those
    whose lowest point the photos alone have on it.
    """
    photos, ups = solved.chosen.photos, solved.observations.up
    known = np.flatnonzero(np.isfinite(ups).all(1))
    own = photos[solved.reference].result.scene.floor
    if own is None or len(known) < 2:
        return None
    turned = np.einsum("vji,vj->vi", solved.bundle.rotation[known], ups[known])
    normal = turned.mean(0)
    for _ in range(5):
        normal = normal / np.linalg.norm(normal)
        away = np.degrees(np.arccos(np.clip(turned @ normal, -1, 1)))
        normal = (turned / np.maximum(away, 3.0)[:, None]).sum(0)
    normal = normal / np.linalg.norm(normal)
    with torch.inference_mode():
        bodies = model(solved.bodies.rotations, solved.bodies.betas, solved.bodies.transl).vertices.numpy()
    standing = [p for p, row in enumerate(solved.rows) if _height_alone(solved, row, known) < _ON_FLOOR_M]
    if not standing:
        return None
    lowest = np.stack([bodies[p][(bodies[p] @ normal).argmin()] for p in standing])
    normal, offset = _plane_under(lowest.astype(np.float64), normal)
    if offset <= 0:
        return None
    before = np.append(np.asarray(own.normal, np.float64), own.offset * scene_scales(solved)[solved.reference])
    return np.stack([before, np.append(normal, offset)])


def _height_alone(solved: SolvedScene, row: IntArray, known: IntArray) -> float:
    """Return the median height of a person's lowest point over the floors of the photos alone; inf without any."""
    heights = []
    for v in known.tolist():
        photo = solved.chosen.photos[v]
        floor = photo.result.scene.floor
        if row[v] >= 0 and floor is not None:
            vertices = photo.result.people[photo.people.rows[row[v]]].vertices
            heights.append(float((vertices @ np.asarray(floor.normal)).min()) + floor.offset)
    return float(np.median(heights)) if heights else np.inf


def _plane_under(lowest: FloatArray, normal: FloatArray) -> tuple[FloatArray, float]:
    """Return normal and offset of the plane, near a normal, on which most people stand; their lowest points (n, 3)."""
    across = np.linalg.svd(normal[None])[2][1:]
    middle = lowest.mean(0)
    columns = np.column_stack([(lowest - middle) @ across.T, np.ones(len(lowest))])
    target, weight = -(lowest - middle) @ normal, np.ones(len(lowest))
    prior = np.diag([1 / np.radians(_FLOOR_DEG) ** 2, 1 / np.radians(_FLOOR_DEG) ** 2, 0.0])
    for _ in range(8):
        scaled = columns * weight[:, None] / _STAND_M**2
        tilt = np.linalg.solve(scaled.T @ columns + prior, scaled.T @ target)
        weight = 1 / (1 + ((columns @ tilt - target) / (2 * _STAND_M)) ** 2)
    turned = normal + tilt[:2] @ across
    length = np.linalg.norm(turned)
    return turned / length, float((tilt[2] - middle @ turned) / length)


def _views(solved: SolvedScene, rows: Mapping[int, int]) -> tuple[View, ...]:
    """Return what each other photo shows of the N people of the reference photo, of whom some are solved."""
    photos, found = solved.chosen.photos, []
    for v, photo in enumerate(photos):
        if v != solved.reference:
            own = {i: int(solved.rows[p, v]) for i, p in rows.items() if solved.rows[p, v] >= 0}
            keypoints = _keypoints(photo.people, own, len(photos[solved.reference].result.people))
            masks = np.zeros((len(keypoints.points), *photo.result.image.shape[:2]), bool)
            for i, row in own.items():
                masks[i] = photo.result.people[photo.people.rows[row]].mask
            rotation, translation, K, points, confidence = (
                torch.from_numpy(np.asarray(x, np.float64))
                for x in (
                    solved.bundle.rotation[v],
                    solved.bundle.translation[v],
                    solved_camera(solved, v).matrix,
                    keypoints.points,
                    keypoints.confidence,
                )
            )
            observed = torch.from_numpy(_observed(keypoints, masks.shape[1:]))
            found.append(View(rotation, translation, K, points, confidence, torch.from_numpy(masks), observed))
    return tuple(found)


def _keypoints(people: PhotoPeople, own: Mapping[int, int], count: int) -> Keypoints:
    """Return the keypoints of ``count`` people, of whom a photo shows those with a row: person -> row."""
    points, confidence = np.zeros((count, len(people.skeleton), 2)), np.zeros((count, len(people.skeleton)))
    for i, row in own.items():
        points[i], confidence[i] = people.points[row], people.confidence[row]
    return Keypoints(points, confidence, people.skeleton)


def _observed(keypoints: Keypoints, size: tuple[int, ...]) -> BoolArray:
    """Return the joints (N, 55) that a photo of a size (H, W) shows; all where the skeleton does not say so."""
    found = observed_joints(keypoints, *size)
    return np.ones((len(keypoints.points), NUM_JOINTS), bool) if found is None else found


def _alone(solved: SolvedScene, rows: Mapping[int, int], parameters: BodyParameters, model: BodyModel) -> OtherViews:
    """Return what all photos alone say of the N people of the reference photo, and of the floor."""
    contact, count = _contact(solved, rows, model)
    floors = _floors(solved, model)
    own = parameters[np.array(sorted(rows), np.int64)]
    with torch.inference_mode():
        rotations = rotations_from_parameters(own, dtype=torch.float64)
        betas, transl = (torch.from_numpy(x).double() for x in (own.betas, own.transl))
        vertex = model(rotations, betas, transl, vertex_ids=torch.tensor([0])).vertices[:, 0].clone()
    return OtherViews(
        vertex=vertex,
        contact=torch.from_numpy(contact),
        photos=torch.from_numpy(count),
        floors=None if floors is None else torch.from_numpy(floors),
    )
