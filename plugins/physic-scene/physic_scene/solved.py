"""The photos of a moment before and after their cameras are solved: input of a CameraSolver, and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.parameters import parameters_from_rotations
from physic_core.errors import InputError
from physic_core.types import Bodies, BodyParameters, Keypoints, MomentView, People, SolvedCameras
from physic_core.types.short_repr import ShortRepr
from physic_scene.bodies import MeanBodies, mean_bodies
from physic_scene.bundle import Bundle, MomentObservations
from physic_scene.cameras import keypoint_errors, known_statures
from physic_scene.observations import PhotoPeople, observe
from physic_scene.triangulation import sizes_by_cameras

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, IntArray, Intrinsics, Reconstruction, SkippedPhoto


@dataclass(frozen=True)
class ScenePhoto(ShortRepr):
    """One photo of the moment.

    Attributes:
        index: of the photo, as it was given.
        result: reconstruction of the photo alone.
        rows: (N,) index in ``result.people`` of each person who has a body.
        view: what the photo shows of these N people.
        people: the same, as matching uses it.
    """

    index: int
    result: Reconstruction
    rows: tuple[int, ...]
    view: MomentView
    people: PhotoPeople

    @property
    def name(self) -> str:
        """Name of the photo."""
        return self.view.name

    @classmethod
    def of(
        cls,
        index: int,
        name: str,
        result: Reconstruction,
        model: BodyModel,
        statures: Sequence[float] = (),
        pose: FloatArray | None = None,
    ) -> ScenePhoto:
        """Return a photo from its reconstruction.

        Args:
            index: of the photo, as it was given.
            name: of the photo.
            result: of the photo alone.
            model: body model of its people, float64.
            statures: known heights, metres: one for all, or of its people from left to right, 0 where unknown.
            pose: (4, 4) from the frame of its camera to that of a calibrated rig, metres; None where unknown.
        """
        rows = tuple(i for i, person in enumerate(result.people) if np.isfinite(person.vertices).all())
        view = _view(name, result, rows, model)
        known = np.zeros(len(rows))
        if len(statures):
            order = np.argsort((view.people.boxes[:, 0] + view.people.boxes[:, 2]) / 2, kind="stable")
            known[order] = np.resize(statures, len(rows))
        view = replace(view, statures=np.where(known > 0, known, np.nan), pose=pose)
        return cls(index, result, rows, view, observe(view, model))


def _view(name: str, result: Reconstruction, rows: Sequence[int], model: BodyModel) -> MomentView:
    people = [result.people[i] for i in rows]
    height, width = result.image.shape[:2]

    def stack(values: list[Any], *shape: int) -> Any:
        return np.stack(values) if values else np.zeros((0, *shape))

    if people:
        parts = [vars(person.parameters) for person in people]
        parameters = BodyParameters(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    else:
        rotations, betas, transl = model.zero_pose(0)
        parameters = parameters_from_rotations(rotations, betas, betas.new_zeros(0, model.num_expression), transl)
    return MomentView(
        name=name,
        image=result.image,
        intrinsics=result.intrinsics,
        people=People(
            stack([p.mask for p in people], height, width).astype(bool),
            stack([p.box for p in people], 4),
            np.array([p.score for p in people], np.float64),
        ),
        keypoints=Keypoints(
            stack([p.keypoints for p in people], 17, 2),
            stack([p.keypoint_confidence for p in people], 17),
            result.skeleton if people else "coco17",
        ),
        bodies=Bodies(parameters, model.name, joints=stack([p.joints for p in people], 55, 3)),
        statures=np.full(len(people), np.nan),
        floor=result.scene.floor,
    )


@dataclass(frozen=True)
class SolvedScene(ShortRepr):
    """Cameras and bodies of one moment, in the frame of the reference camera, metres; V photos are in the solution.

    Attributes:
        photos: V photos in the solution.
        left_out: the other photos.
        reference: index into ``photos``.
        rows: (P, V) row of each solved person in each photo, -1 where not shown.
        moved: (M, V) the same as ``rows`` for people who are in different places or poses, who are not solved.
        observations: of the solved people.
        bundle: cameras and points.
        intrinsics: of each photo, solved.
        rotation_sigma: (V,) radians.
        position_sigma: (V,) metres.
        bodies: of the solved people.
        errors: (V, P) median distance of keypoints, as a share of the stature in px; NaN where not shown.
        statures: (P,) metres, known ones of the solved people, NaN where unknown.
        scale_sigma: of the logarithm of all lengths; None if it is not known.
        notes: of the solver.
        diagnostics: of the solver.
    """

    photos: tuple[ScenePhoto, ...]
    left_out: tuple[SkippedPhoto, ...]
    reference: int
    rows: IntArray
    moved: IntArray
    observations: MomentObservations
    bundle: Bundle
    intrinsics: tuple[Intrinsics, ...]
    rotation_sigma: FloatArray
    position_sigma: FloatArray
    bodies: MeanBodies
    errors: FloatArray
    statures: FloatArray
    scale_sigma: float | None
    notes: tuple[str, ...]
    diagnostics: Mapping[str, Any]

    @classmethod
    def of(cls, solution: SolvedCameras, photos: Sequence[ScenePhoto], model: BodyModel) -> SolvedScene:
        """Return the solution of a CameraSolver for the photos that it got, with one body for each person."""
        skipped = {one.index for one in solution.skipped}
        kept = [v for v in range(len(photos)) if v not in skipped]
        chosen = [photos[v] for v in kept]
        people = [photo.people for photo in chosen]
        rows = solution.people[:, kept]
        observations = MomentObservations.of(people, rows)
        bundle = Bundle(
            rotation=solution.rotation[kept],
            translation=solution.translation[kept],
            log_focal=np.log([solution.intrinsics[v].fx / photos[v].view.intrinsics.fx for v in kept]),
            points=solution.points[:, list(chosen[0].view.keypoints.joint_set.fitted)],
            turn=np.broadcast_to(np.eye(3), (*observations.shown.shape, 3, 3)),
            place=np.zeros((*observations.shown.shape, 3)),
        )
        statures = sizes = known_statures(people, rows)
        if observations.known.any():
            factor = sizes_by_cameras(observations, [bundle.pose(v) for v in range(len(kept))])
            alone = [np.mean([people[v].stature[row[v]] for v in np.flatnonzero(row >= 0)]) for row in rows]
            sizes = np.where(np.isfinite(statures), statures, factor * alone)
        index = [photo.index for photo in photos]
        return cls(
            photos=tuple(chosen),
            left_out=tuple(replace(one, index=index[one.index]) for one in solution.skipped),
            reference=kept.index(solution.reference),
            rows=rows,
            moved=rows[:0] if solution.moved is None else solution.moved[:, kept],
            observations=observations,
            bundle=bundle,
            intrinsics=tuple(solution.intrinsics[v] for v in kept),
            rotation_sigma=solution.rotation_sigma[kept],
            position_sigma=solution.position_sigma[kept],
            bodies=mean_bodies(people, rows, observations, bundle, model, sizes),
            errors=keypoint_errors(observations, bundle),
            statures=statures,
            scale_sigma=solution.scale_sigma,
            notes=solution.notes,
            diagnostics=solution.diagnostics,
        )

    def first(self, sizes: str) -> ScenePhoto:
        """Return the photo that was given first, whose people have known sizes, such as "ages".

        Raises:
            InputError: it is skipped.
        """
        if self.photos[0].index:
            why = next(one.message for one in self.left_out if one.index == 0)
            raise InputError(f"the {sizes} are those of people of the first photo, but {why}; put another photo first")
        return self.photos[0]
