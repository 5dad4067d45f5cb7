"""The solution in the reference photo: the engine's four stages from the bodies, camera and scale
of all photos.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import torch

from physic_core import Pipeline
from physic_core.body import NUM_JOINTS
from physic_core.configuration.resolve import resolve
from physic_core.engine.sizes.stature import ADULT_YEARS
from physic_core.engine.state import Estimates, OtherView
from physic_core.prepare.border import cut_camera
from physic_core.prepare.frame import find_frame
from physic_core.types import (
    Bodies,
    BodyParameters,
    DepthMap,
    Intrinsics,
    Keypoints,
    KnownSizes,
    PeoplePrompt,
    Plane,
    ShortRepr,
    expand_people,
    select_people,
)
from physic_networks.bodies import observed_joints
from physic_scene.energy import OtherViews, with_other_views
from physic_scene.solved_backends import SolvedBodies, SolvedDepth

if TYPE_CHECKING:
    from physic_core import Config
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray, IntArray, Reconstruction
    from physic_scene.people import PersonOfScene
    from physic_scene.photos import ScenePhoto
    from physic_scene.solution import SolvedScene

_Value = TypeVar("_Value")

_ON_FLOOR_M = 0.25  # largest height of the lowest point of a person who may stand on the floor
_KNOWN_SCALE = 1e-3  # least error of the scale, of known cameras


@dataclass(frozen=True)
class ReferenceInput(ShortRepr):
    """Input of the engine for the reference photo.

    Attributes:
        result: of the single photo.
        camera: solved.
        bodies: of all people of the result: those of the photo, then those whom only other photos
            show.
        is_visible: (N,) bool, whether the photo shows this body; true for the first ones.
        scores: (N,) of the best detection of each person.
        depth: of its scene, at the solved scale.
        views: what the other photos show of these people.
        single_photos: results of the single photos on their contact and on the floor.
        statures: (N,) metres, known ones, NaN where unknown.
        ages: (N,) years, known ones, NaN where unknown; None if no age is known.
        body_sources: what the user gives as each body, in the first photo with one; "" in none.
    """

    result: Reconstruction
    camera: Intrinsics
    bodies: Bodies
    is_visible: BoolArray
    scores: FloatArray
    depth: DepthMap
    views: tuple[OtherView, ...]
    single_photos: OtherViews
    statures: FloatArray
    ages: FloatArray | None = None
    body_sources: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, solved: SolvedScene, people: Sequence[PersonOfScene], model: BodyModel
    ) -> ReferenceInput:
        """Return the input of the engine from the solved cameras and all people of the result."""
        v = solved.reference
        photos = solved.photos
        camera = solved.intrinsics[v]
        result = photos[v].result
        scale = scene_scales(solved)[v]
        depth = np.where(result.scene.valid, scale * result.scene.points[..., 2], np.nan).astype(
            np.float32
        )
        sigma = max(solved.scale_sigma, _KNOWN_SCALE)
        shown_by = [
            [photos[w].result.people[row] for w, row in one.row_by_photo.items()] for one in people
        ]
        ages = np.array([_first((one.age for one in own), np.nan) for own in shown_by])
        sources = [_first((one.body_source for one in own), "") for own in shown_by]
        parameters = _joined_parameters([person.parameters for person in people])
        shown = np.array([v in person.row_by_photo for person in people])
        # What the other photos show of each person is in their views.
        observed = _joints_in_photo(_keypoints(people, photos, v), result.image.shape[:2])
        return cls(
            result=result,
            camera=camera,
            bodies=Bodies(parameters, model.name, observed),
            is_visible=shown,
            scores=np.array([max(one.score for one in own) for own in shown_by]),
            depth=DepthMap(depth, camera, sigma, (f"scale and cameras from {len(photos)} photos",)),
            views=tuple(_other_view(solved, people, w) for w in range(len(photos)) if w != v),
            single_photos=_results_of_single_photos(solved, people, model),
            statures=np.array([one.stature for one in people]),
            ages=ages if np.isfinite(ages).any() else None,
            body_sources=tuple(sources),
        )

    def complete(self, estimates: Estimates) -> Estimates:
        """Return the estimates of the photo with the other photos, and with people whom only these
        show.
        """
        photo = estimates.photo
        sizes = estimates.known
        known = replace(photo.known, years=self.ages)
        if np.isfinite(self.statures).any():
            sizes = KnownSizes(stature=tuple(np.nan_to_num(self.statures).tolist()))
            known = replace(known, stature=self.statures)
        people = expand_people(photo.people, self.is_visible)
        scores = np.where(self.is_visible, people.scores, self.scores).astype(people.scores.dtype)
        others = self.bodies.parameters[~self.is_visible]
        bodies = {
            name: np.concatenate([value, getattr(others, name).astype(value.dtype)])
            for name, value in vars(estimates.bodies.parameters).items()
        }
        return replace(
            estimates,
            photo=replace(
                photo,
                people=replace(people, scores=scores),
                keypoints=expand_people(photo.keypoints, self.is_visible),
                observations=photo.observations.expanded(self.is_visible),
                known=known,
            ),
            bodies=replace(
                estimates.bodies, parameters=BodyParameters(**bodies), observed=self.bodies.observed
            ),
            contact=expand_people(estimates.contact, self.is_visible),
            missing_results=(*estimates.missing_results, *[()] * len(others)),
            ground=estimates.ground.expanded(self.is_visible),
            known=sizes,
            views=self.views,
        )


def _first(values: Iterable[_Value | None], default: _Value) -> _Value:
    """Return the first value that is neither None nor empty."""
    return next(filter(None, values), default)


def solve_reference(reference_input: ReferenceInput, config: Config) -> Reconstruction:
    """Run the pipeline on the reference photo, with the bodies and the depth of all photos.

    Args:
        reference_input: what all photos show.
        config: of the single photos; its table ``[photo]`` was used there, and is not used again.
    """
    plain = config.model_copy(update={"photo": type(config.photo)()})
    own_bodies = select_people(
        reference_input.bodies, np.arange(len(reference_input.result.people))
    )
    depth = reference_input.depth
    inside = find_frame(reference_input.result.image).inside
    if inside:  # the pipeline cuts the border off this photo
        camera = cut_camera(reference_input.camera, reference_input.result.image.shape[:2], inside)
        depth = replace(depth, depth=depth.depth[inside], intrinsics=camera)
    backends = {
        "body_estimator": SolvedBodies.of(own_bodies),
        "metric_depth": SolvedDepth.of(depth),
    }
    plan = resolve(plain, backends)
    scene_plan = replace(
        plan, given_engine=with_other_views(plan.engine, reference_input.single_photos)
    )
    prompt = None
    if config.photo.person or config.photo.box:
        prompt = PeoplePrompt(
            masks=np.stack([person.mask for person in reference_input.result.people])
        )
    with Pipeline(scene_plan) as pipeline:
        result = pipeline(
            reference_input.result.image,
            intrinsics=reference_input.camera,
            people=prompt,
            complete=reference_input.complete,
        )
    ages = () if reference_input.ages is None else reference_input.ages
    notes = (
        f"person {i} is a child of {years:g} years"
        for i, years in enumerate(ages)
        if years < ADULT_YEARS
    )
    # The pipeline takes a given camera for a known one.
    camera = replace(result.intrinsics, trust=reference_input.camera.trust)
    people = zip(result.people, reference_input.body_sources, strict=True)
    return replace(
        result,
        people=tuple(replace(person, body_source=source) for person, source in people),
        intrinsics=camera,
        photo=reference_input.result.photo,
        lens=reference_input.result.lens,
        notes=(*result.notes, *notes),
    )


def scene_scales(solved: SolvedScene) -> FloatArray:
    """Return the factor (V,) from the scene of each single photo to the solution, by the depths of
    the people.
    """
    factors = np.ones(len(solved.photos))
    for v, photo in enumerate(solved.photos):
        here = np.flatnonzero(solved.rows[:, v] >= 0)
        if len(here):
            joints = solved.bundle.pose(v).to_camera(solved.bodies.joints[here, 0])
            alone = photo.people.joints[solved.rows[here, v], 0]
            factors[v] = np.exp(np.median(np.log(joints[:, 2] / alone[:, 2])))
    return factors


def _is_visible_in_other_photo(person: PersonOfScene, solved: SolvedScene) -> bool:
    """Return whether other photos than the reference determine the place of a person."""
    return set(person.row_by_photo) != {solved.reference}


def _floors(solved: SolvedScene, model: BodyModel) -> tuple[Plane, Plane] | None:
    """Return the floor of the reference photo at the solved scale, and the floor fitted to all
    photos.

    The normal is the median of the photos' normals. The floor is at the median of the lowest points
    of the people who stand on it: those with the lowest point on it in the single photos.
    """
    photos = solved.photos
    ups = solved.observations.up
    known = np.flatnonzero(np.isfinite(ups).all(1))
    reference_floor = photos[solved.reference].result.scene.floor
    if reference_floor is None or len(known) < 2:
        return None
    normal = np.median(np.einsum("vji,vj->vi", solved.bundle.rotation[known], ups[known]), axis=0)
    normal = normal / np.linalg.norm(normal)
    with torch.inference_mode():
        bodies = model(
            solved.bodies.rotations, solved.bodies.betas, solved.bodies.transl
        ).vertices.numpy()
    standing = [
        p for p, row in enumerate(solved.rows) if _height_alone(solved, row, known) < _ON_FLOOR_M
    ]
    if not standing:
        return None
    offset = -float(np.median([(bodies[p] @ normal).min() for p in standing]))
    if offset <= 0:
        return None
    scale = float(scene_scales(solved)[solved.reference])
    return replace(reference_floor, offset=reference_floor.offset * scale), Plane(normal, offset)


def _height_alone(solved: SolvedScene, row: IntArray, known: IntArray) -> float:
    """Return the median height of a person's lowest point over the floors of the single photos; inf
    without any.
    """
    heights = []
    for v in known.tolist():
        photo = solved.photos[v]
        floor = photo.result.scene.floor
        if row[v] >= 0 and floor is not None:
            vertices = photo.result.people[photo.rows[row[v]]].vertices
            heights.append(float((vertices @ np.asarray(floor.normal)).min()) + floor.offset)
    return float(np.median(heights)) if heights else np.inf


def _other_view(solved: SolvedScene, people: Sequence[PersonOfScene], view: int) -> OtherView:
    """Return the view of another photo of all people of the result."""
    photos = solved.photos
    keypoints = _keypoints(people, photos, view)
    result = photos[view].result
    masks = np.zeros((len(people), *result.image.shape[:2]), bool)
    for i, person in enumerate(people):
        if view in person.row_by_photo:
            masks[i] = result.people[person.row_by_photo[view]].mask
    rotation, translation, K, points, confidence = (
        torch.from_numpy(np.asarray(x, np.float64))
        for x in (
            solved.bundle.rotation[view],
            solved.bundle.translation[view],
            solved.intrinsics[view].matrix,
            keypoints.points,
            keypoints.confidence,
        )
    )
    observed = torch.from_numpy(_joints_in_photo(keypoints, masks.shape[1:]))
    return OtherView(
        rotation, translation, K, points, confidence, torch.from_numpy(masks), observed
    )


def _joined_parameters(parts: Sequence[BodyParameters]) -> BodyParameters:
    """Return the parameters of all people in one batch."""
    return BodyParameters(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    )


def _keypoints(
    everybody: Sequence[PersonOfScene], photos: Sequence[ScenePhoto], view: int
) -> Keypoints:
    """Return the keypoints of all people of the result in one photo; 0 for people whom it does not
    show.
    """
    own = photos[view].people
    count = len(everybody)
    points = np.zeros((count, len(own.skeleton), 2))
    confidence = np.zeros((count, len(own.skeleton)))
    row_of = {index: row for row, index in enumerate(photos[view].rows)}
    for i, person in enumerate(everybody):
        row = row_of.get(person.row_by_photo.get(view, -1))
        if row is not None:
            points[i] = own.points[row]
            confidence[i] = own.confidence[row]
    return Keypoints(points, confidence, own.skeleton)


def _joints_in_photo(keypoints: Keypoints, size: tuple[int, ...]) -> BoolArray:
    """Return the joints (N, 55) that a photo of a size (H, W) shows; all joints if the skeleton
    does not define them.
    """
    observed = observed_joints(keypoints, *size)
    return np.ones((len(keypoints.points), NUM_JOINTS), bool) if observed is None else observed


def _results_of_single_photos(
    solved: SolvedScene, people: Sequence[PersonOfScene], model: BodyModel
) -> OtherViews:
    """Return the results of the single photos on all people of the result and on the floor.

    The probability of contact is summed over the photos that show a person. Sum and number are 0
    for a person whom only the reference photo shows, and if the single photos have no
    probabilities.
    """
    placed = [_is_visible_in_other_photo(person, solved) for person in people]
    contact = torch.zeros(len(people), model.num_vertices, dtype=torch.float64)
    count = torch.zeros(len(people), dtype=torch.float64)
    for i in np.flatnonzero(placed).tolist():
        for v, row in people[i].row_by_photo.items():
            probability = solved.photos[v].result.people[row].contact_probability
            if probability is not None:
                contact[i] += torch.tensor(probability)
                count[i] += 1
    return OtherViews(
        is_placed=torch.tensor(placed),
        contact=contact,
        photo_count=count,
        floors=_floors(solved, model),
        scale_is_known=bool(solved.observations.camera_is_known.any()),
    )
