"""The first half of the method: everything that the estimators can say about one photo.

The order lets each backend see what it may need as a hint: the floor and the camera before the bodies, the bodies
before the metric depth, so that a classical backend can use the human as its ruler.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError, NoPersonError
from physic_core.pipeline import partial_answers as salvage
from physic_core.pipeline import validation as border
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Hands,
    Hints,
    Intrinsics,
    Keypoints,
    People,
    Plane,
    Pointmap,
)
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedBackend, ResolvedPipeline
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.stages import Stages
    from physic_core.types import BoolArray, FloatArray, UInt8Array

__all__ = ["Evidence", "dilate", "feet_pixels", "perceive", "with_hands"]


@dataclass(frozen=True)
class Evidence(ShortRepr):
    """What the estimators said, in the camera frame of ``intrinsics``.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        intrinsics: the camera, given or estimated.
        camera_given: whether the user or the file gave it.
        people: N people.
        keypoints: of the N people.
        hole: (H, W) bool, what the inpainter filled.
        empty: (H, W, 3) uint8 RGB, the photo without its people.
        scene: relative point map of ``empty``.
        original: relative point map of ``image``.
        floor: in the units of ``scene``, or None.
        bodies: N bodies with their hands.
        contact: contact prior, zero where no backend was configured.
        depth: metric depth of ``empty``.
        lost: per person, the interfaces whose backend answered no numbers for them; such a person has unseen
            keypoints, a body of NaN, flat hands or no prior contact.
    """

    image: UInt8Array
    intrinsics: Intrinsics
    camera_given: bool
    people: People
    keypoints: Keypoints
    hole: BoolArray
    empty: UInt8Array
    scene: Pointmap
    original: Pointmap
    floor: Plane | None
    bodies: Bodies
    contact: ContactProbability
    depth: DepthMap
    lost: tuple[tuple[str, ...], ...] = ()


def perceive(
    image: UInt8Array,
    given: Intrinsics | None,
    plan: ResolvedPipeline,
    model: BodyModel,
    stages: Stages,
) -> Evidence:
    """Ask every backend of ``plan`` about ``image`` (H, W, 3).

    Raises:
        NoPersonError: nobody was found.
        BackendError: a backend failed.
        BackendOutputError: a backend answered what its interface does not allow.
    """
    height, width = image.shape[:2]
    backends = plan.backends

    people = stages.ask(
        "people",
        backends["segmenter"],
        (image,),
        People,
        lambda a: border.people_faults(replace(a, floor=None), height, width),
    )
    people = _with_floor_if_it_can(people, backends["segmenter"], stages)
    if not len(people):
        raise NoPersonError(
            f"no person was found in the photo of {width} x {height} px by {backends['segmenter'].title}: "
            "use a photo that shows at least one head and torso, or another segmenter"
        )
    n = len(people)
    lost: dict[str, BoolArray] = {}
    if people.keypoints is not None:
        own, lost["segmenter"] = salvage.seen_keypoints(people.keypoints)
        people = replace(people, keypoints=own)
    keypoints = stages.ask(
        "keypoints",
        backends["keypoint_detector"],
        (image, people),
        Keypoints,
        lambda a: border.keypoints_faults(a, n),
    )
    keypoints, lost["keypoint_detector"] = salvage.seen_keypoints(keypoints)

    hole = dilate(np.logical_or.reduce(people.masks), max(4.0, plan.photo.mask_growth * max(height, width)))
    empty = stages.ask(
        "inpainting",
        backends["inpainter"],
        (image, hole),
        np.ndarray,
        lambda a: border.image_faults(a, height, width),
    )

    hints = Hints(intrinsics=given, people=people, keypoints=keypoints, hole=hole)
    scene = stages.ask(
        "scene point map",
        backends["relative_pointmap"],
        (empty, hints),
        Pointmap,
        lambda a: border.pointmap_faults(a, height, width),
        again=True,
    )
    camera = given or scene.intrinsics or _camera_of(scene)
    hints = replace(hints, intrinsics=camera, scene=scene)
    original = stages.ask(
        "photo point map",
        backends["relative_pointmap"],
        (image, replace(hints, hole=None)),
        Pointmap,
        lambda a: border.pointmap_faults(a, height, width),
    )
    stages.note(*scene.notes, *original.notes)

    with stages.engine("relative floor"):
        floor = _relative_floor(scene, people, hole, keypoints, plan.engine)
        hints = replace(hints, floor=floor, original=_aligned(original, scene, hole, plan.engine))

    bodies = stages.ask(
        "bodies",
        backends["body_estimator"],
        (image, people, camera, keypoints, hints),
        Bodies,
        lambda a: border.bodies_faults(a, n),
    )
    bodies, lost["body_estimator"] = salvage.bodies_or_nan(bodies)
    if bodies.body_model != model.name:
        bodies = _carried(bodies, model, backends["body_estimator"].title, stages)
        lost["body_estimator"] |= ~border.sound_bodies(bodies)
    embodied = ~lost["body_estimator"]
    if "hand_estimator" in backends:
        hands = stages.ask_if_it_can(
            "hands",
            backends["hand_estimator"],
            (image, people, keypoints),
            Hands,
            lambda a: border.hands_faults(a, n),
            otherwise="fingers stay as the body_estimator posed them",
        )
        lost["hand_estimator"] = np.ones(n, bool)
        if hands is not None:
            hands, lost["hand_estimator"] = salvage.found_hands(hands)
            bodies = with_hands(bodies, hands, model)
    # Whoever has no body is not shown to those who build on bodies.
    seen, whole = salvage.rows_of(people, embodied), _shown(salvage.rows_of(bodies, embodied), model)
    hints = replace(hints, people=seen, keypoints=salvage.rows_of(keypoints, embodied), bodies=whole)
    contact = ContactProbability(np.zeros((n, model.num_vertices), np.float32), model.topology)
    if "contact_prior" in backends:
        some = stages.ask_if_it_can(
            "contact prior",
            backends["contact_prior"],
            (image, seen, whole),
            ContactProbability,
            lambda a: border.contact_faults(a, len(seen), model.num_vertices, model.topology),
            otherwise="contact is told from distances alone",
        )
        if some is not None and some.topology != model.topology:
            some = _carried_contact(some, model, backends["contact_prior"].title, stages)
        lost["contact_prior"] = np.ones(n, bool)
        if some is not None:
            contact, lost["contact_prior"] = salvage.contact_of_all(some, embodied)
    depth = stages.ask(
        "metric depth",
        backends["metric_depth"],
        (empty, hints),
        DepthMap,
        lambda a: border.depth_faults(a, height, width),
    )
    stages.note(*depth.notes)
    return Evidence(
        image=image,
        intrinsics=camera,
        camera_given=given is not None,
        people=people,
        keypoints=keypoints,
        hole=hole,
        empty=empty,
        scene=scene,
        original=original,
        floor=floor,
        bodies=bodies,
        contact=contact,
        depth=depth,
        lost=tuple(tuple(name for name, who in lost.items() if who[i]) for i in range(n)),
    )


def dilate(mask: BoolArray, radius_px: float) -> BoolArray:
    """Mask (H, W) bool grown by a disc of ``radius_px``."""
    import cv2

    r = round(radius_px)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1))
    grown: BoolArray = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return grown


def feet_pixels(keypoints: Keypoints, height: int, width: int, confidence: float = 0.5) -> FloatArray:
    """(M, 2) px: heels and toes that are seen with ``confidence`` inside the image."""
    from physic_core.body.landmarks import DETECTED

    names = DETECTED.get(keypoints.skeleton, ())
    soles = [i for i, name in enumerate(names) if name.endswith(("heel", "toe", "foot_tip"))]
    points, seen = keypoints.points[:, soles], keypoints.confidence[:, soles] > confidence
    seen &= (points >= 0).all(-1) & (points[..., 0] <= width - 1) & (points[..., 1] <= height - 1)
    chosen: FloatArray = points[seen]
    return chosen


def with_hands(bodies: Bodies, hands: Hands, model: BodyModel) -> Bodies:
    """The bodies with the finger rotations of every hand whose confidence is above zero.

    Hands that say how they lie as a whole are put onto the arms, as far as they are sure.
    """
    if hands.wrists is not None:
        from physic_core.body.wrists import WRIST_RANGE, stitch

        return replace(bodies, parameters=stitch(bodies.parameters, hands, model, WRIST_RANGE))
    p, found = bodies.parameters, hands.confidence > 0
    flat = hands.rotvecs.reshape(len(p), 2, 45).astype(p.left_hand_pose.dtype)
    left = np.where(found[:, :1], flat[:, 0], p.left_hand_pose)
    right = np.where(found[:, 1:], flat[:, 1], p.right_hand_pose)
    return replace(bodies, parameters=replace(p, left_hand_pose=left, right_hand_pose=right))


def _carried(bodies: Bodies, model: BodyModel, who: str, stages: Stages) -> Bodies:
    """Bodies of another model than the configured one, as bodies of that; with a note that says how near they come.

    Raises:
        BodyModelError: nothing tells where they are but parameters of a model that is not there, or of nobody is
            enough told.
    """
    from physic_core.body.conversion import can_carry, carry
    from physic_core.cache.maps import kept_correspondence

    if not can_carry(bodies, model):
        cure = "name = 'embedded'" if bodies.body_model == "embedded" else f"path = the file of a '{bodies.body_model}'"
        raise BodyModelError(
            f"{who} gives bodies for the body model '{bodies.body_model}', "
            f"but the configuration loads '{model.name}': set [body_model] {cure}, "
            f"or choose a body_estimator that gives '{model.name}'"
        )
    try:
        found = carry(bodies, model, kept_correspondence)
    except BodyModelError as error:
        raise BodyModelError(f"{who}: {error}") from error
    if not border.sound_bodies(found.bodies).any():
        raise BodyModelError(
            f"{who} gives bodies for the body model '{bodies.body_model}' with too few joints to carry them over to "
            f"'{model.name}': both hips, and both shoulders or the neck, are needed of at least one person"
        )
    stages.note(found.note(bodies.body_model))
    return found.bodies


def _carried_contact(
    contact: ContactProbability, model: BodyModel, who: str, stages: Stages
) -> ContactProbability | None:
    """Contact on another mesh, on the model's own; None, with a warning, where the mesh is none of a body."""
    from physic_core.body.conversion import contact_to_model
    from physic_core.cache.maps import kept_correspondence

    try:
        carried = contact_to_model(contact, model, kept_correspondence)
    except BodyModelError as error:
        stages.warn(f"{who}: {error}; contact is told from distances alone")
        return None
    stages.note(f"contact carried over from the mesh '{contact.topology}' to '{model.topology}'")
    return carried


def _shown(bodies: Bodies, model: BodyModel) -> Bodies:
    """Bodies for those who build on them: with joints where nobody but us can load the model."""
    from physic_core.body.conversion import with_joints

    return bodies if model.name == "embedded" else with_joints(bodies, model)


def _with_floor_if_it_can(people: People, segmenter: ResolvedBackend, stages: Stages) -> People:
    """The people, without a floor mask that is none, and then with a warning."""
    if people.floor is None:
        return people
    faults = border.floor_faults(people.floor, *people.masks.shape[1:])
    if not faults:
        return people
    stages.warn(
        f"{segmenter.title}, stage 'people' answered what the interface does not allow: {'; '.join(faults)}; "
        "the floor is sought without its mask"
    )
    return replace(people, floor=None)


def _camera_of(pointmap: Pointmap) -> Intrinsics:
    from physic_core.geometry.pointmap import intrinsics_from_pointmap
    from physic_core.geometry.tensors import tensor

    height, width = pointmap.valid.shape
    fx, fy, cx, cy = intrinsics_from_pointmap(tensor(pointmap.points), tensor(pointmap.valid))
    return Intrinsics(fx, fy, cx, cy, width, height, "point map")


def _relative_floor(
    scene: Pointmap, people: People, hole: BoolArray, keypoints: Keypoints, settings: EngineSettings
) -> Plane | None:
    from physic_core.engine.scene.build import fit_relative_floor
    from physic_core.geometry.tensors import tensor

    height, width = hole.shape
    fit = fit_relative_floor(
        tensor(scene.points),
        tensor(scene.valid),
        floor_mask=None if people.floor is None else tensor(people.floor),
        hole=tensor(hole),
        feet_px=tensor(feet_pixels(keypoints, height, width)),
        settings=settings.scene,
    )
    return None if fit is None else Plane(fit.normal.numpy(), float(fit.offset))


def _aligned(original: Pointmap, scene: Pointmap, hole: BoolArray, settings: EngineSettings) -> Pointmap:
    from physic_core.engine.placement.human_points import align_original
    from physic_core.geometry.alignment import apply_alignment
    from physic_core.geometry.tensors import tensor

    points = tensor(original.points)
    alignment = align_original(
        points,
        tensor(original.valid),
        original.unknown,
        tensor(scene.points),
        tensor(scene.valid),
        tensor(hole),
        settings.human,
    )
    return replace(original, points=apply_alignment(points, alignment).numpy(), unknown=scene.unknown)
