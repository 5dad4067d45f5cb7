"""Noise-free mocks with one fault each, such as an adapter may have without an error: which of them the kit finds.

FAULTS are faults that adapters of published networks had or nearly had. READER_FAULTS were written by a reader of the
interfaces before the checks of bias were.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.convert.bodies import rest_mesh_of_model
from physic_core.types import Keypoints
from physic_mock import backends as mocks
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.run import CheckRun
from physic_testing.conformance.truth import embedded_surface, mirrored_order

NO_NOISE: dict[str, dict[str, Any]] = {
    "MockMetricDepth": {"noise": 0, "stated_sigma": 0.1},
    "MockRelativePointmap": {"noise": 0, "unknown": "scale"},
}
"""Mock -> its options; all others have {"noise": 0}."""


@dataclass(frozen=True)
class Fault:
    """A mock whose result is changed by ``change(result, *arguments)``; ``check`` finds it, "" where none does."""

    mock: str
    words: str
    check: str
    change: Callable[..., Any]

    @property
    def id(self) -> str:
        return f"{self.mock.removeprefix('Mock')}-{self.words}".replace(" ", "_")


def run_checks(fault: Fault | str) -> CheckRun:
    """All checks of a mock, with a fault or without one."""
    mock = getattr(mocks, fault if isinstance(fault, str) else fault.mock)

    def infer(self: Any, *arguments: Any) -> Any:
        result = mock.infer(self, *arguments)
        return result if isinstance(fault, str) else fault.change(result, *arguments)

    infer.__signature__ = inspect.signature(mock.infer)  # type: ignore[attr-defined]
    kind = type(mock.__name__, (mock,), {"infer": infer})
    return start_checks(find_backend(kind, None, options=NO_NOISE.get(mock.__name__, {"noise": 0})))


def moved(array: np.ndarray, right: int, down: int, empty: Any = None) -> np.ndarray:
    """An image moved by whole pixels; what comes in repeats the border, or is ``empty``."""
    rows = np.arange(array.shape[0]) - down
    columns = np.arange(array.shape[1]) - right
    found = array[np.clip(rows, 0, len(rows) - 1)][:, np.clip(columns, 0, len(columns) - 1)]
    if empty is not None:
        found[(rows < 0) | (rows >= len(rows))] = empty
        found[:, (columns < 0) | (columns >= len(columns))] = empty
    return found


# ---- segmenter -------------------------------------------------------------------------------------------------------


def boxes_of(masks: np.ndarray) -> np.ndarray:
    found = []
    for mask in masks:
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        found.append([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    return np.array(found, float).reshape(-1, 4)


def with_masks(people: Any, change: Callable[[np.ndarray], np.ndarray]) -> Any:
    if not len(people):
        return people
    masks = np.stack([change(mask) for mask in people.masks])
    return replace(people, masks=masks, boxes=boxes_of(masks))


def enlarged(mask: np.ndarray) -> np.ndarray:
    return mask[np.ix_(*((np.arange(n) / 1.03).astype(int) for n in mask.shape))]


def in_one_mask(people: Any, *_: Any) -> Any:
    if not len(people):
        return people
    masks = people.masks.any(axis=0, keepdims=True)
    return replace(people, masks=masks, boxes=boxes_of(masks), scores=people.scores[:1])


# ---- keypoints -------------------------------------------------------------------------------------------------------


def with_points(change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[..., Any]:
    """The points changed, which see the centres (N, 1, 2) of the boxes."""

    def changed(keypoints: Any, image: Any, people: Any) -> Any:
        centres = ((people.boxes[:, :2] + people.boxes[:, 2:]) / 2 - 0.5)[:, None]
        return replace(keypoints, points=change(keypoints.points, centres))

    return changed


def exchanged(keypoints: Keypoints, *names: tuple[str, str]) -> Keypoints:
    order = list(range(len(keypoints.joint_set)))
    for first, second in names:
        i, j = keypoints.joint_set.names.index(first), keypoints.joint_set.names.index(second)
        order[i], order[j] = j, i
    return replace(keypoints, points=keypoints.points[:, order], confidence=keypoints.confidence[:, order])


def with_world(keypoints: Any, image: Any, people: Any, *, right: int) -> Any:
    tall = (people.boxes[:, 3] - people.boxes[:, 1]).reshape(-1, 1, 1)
    flat = (keypoints.points - keypoints.points[:, 23:25].mean(axis=1, keepdims=True)) * 1.7 / np.maximum(tall, 1)
    return replace(keypoints, world=np.concatenate([flat * [right, 1], np.zeros_like(flat[..., :1])], axis=2))


_LEGS = [(f"{side}_knee", f"{side}_ankle") for side in ("left", "right")]


# ---- depth -----------------------------------------------------------------------------------------------------------


def with_depth(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    return lambda d, *_: replace(d, depth=change(d.depth).astype(np.float32))


def stretch(camera: Any) -> np.ndarray:
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)


def along_rays(depth: Any, *_: Any) -> Any:
    return replace(depth, depth=(depth.depth * stretch(depth.intrinsics)).astype(np.float32))


def with_camera(**by: float) -> Callable[..., Any]:
    def changed(result: Any, *_: Any) -> Any:
        camera = result.intrinsics
        factors = {name: getattr(camera, name) * value for name, value in by.items() if name.startswith("f")}
        offsets = {name: getattr(camera, name) + value for name, value in by.items() if name.startswith("c")}
        return replace(result, intrinsics=replace(camera, **factors, **offsets))

    return changed


def with_points_of_map(change: Callable[[np.ndarray, Any], np.ndarray]) -> Callable[..., Any]:
    return lambda p, *_: replace(p, points=change(p.points, p.intrinsics).astype(np.float32))


def half_a_pixel_right(points: np.ndarray, camera: Any) -> np.ndarray:
    return points + points[..., 2:] * [0.5 / camera.fx, 0.5 / camera.fy, 0]


def on_same_rays(points: np.ndarray, z: np.ndarray) -> np.ndarray:
    return points * (z / points[..., 2])[..., None]


def farther(points: np.ndarray) -> np.ndarray:
    return on_same_rays(points, points[..., 2] + 0.3 * np.nanmedian(points[..., 2]))


def bent(pointmap: Any, *_: Any) -> Any:
    z = pointmap.points[..., 2]
    points = on_same_rays(pointmap.points, 1 / (1 / z + 0.3 / np.nanmedian(z)))
    return replace(pointmap, points=points.astype(np.float32), unknown="scale_shift")


# ---- inpainter -------------------------------------------------------------------------------------------------------


def with_fill(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    """The photo without people, as the mock fills it, changed inside of the mask."""

    def changed(filled: np.ndarray, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        from physic_mock.recognition import recognise_world

        if not mask.any():
            return filled
        fill = change(recognise_world(image).world.empty_image.astype(float))
        return np.where(mask[..., None], np.clip(np.rint(fill), 0, 255), image).astype(np.uint8)

    return changed


def rim_left(px: int) -> Callable[..., Any]:
    """People's outermost pixels as they were."""

    def changed(filled: np.ndarray, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        import cv2

        from physic_mock.recognition import recognise_world

        person = recognise_world(image).people.astype(np.uint8)
        inner = cv2.erode(person, np.ones((2 * px + 1, 2 * px + 1), np.uint8))
        return np.where(((person > 0) & (inner == 0))[..., None], image, filled)

    return changed


def moved_picture(filled: np.ndarray, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return moved(filled, 1, 0) if mask.any() else filled


# ---- bodies ----------------------------------------------------------------------------------------------------------

_MIRRORED = np.array(mirrored_order(tuple(JOINT_INDEX)[1:22]))
_FLIP = np.array([1, -1, -1])


def with_parameters(change: Callable[[Any], dict[str, np.ndarray]]) -> Callable[..., Any]:
    def changed(bodies: Any, *_: Any) -> Any:
        p = bodies.parameters
        values = {name: np.asarray(v, np.float32) for name, v in change(p).items()} if len(p) else {}
        return replace(bodies, parameters=replace(p, **values))

    return changed


def pelvis_at(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    def changed(bodies: Any, *_: Any) -> Any:
        if not len(bodies.parameters):
            return bodies
        pelvis = embedded_surface(bodies)[1][:, 0]
        place = bodies.parameters.transl + change(pelvis) - pelvis
        return replace(bodies, parameters=replace(bodies.parameters, transl=place.astype(np.float32)))

    return changed


def at_the_focal_length_of_the_crop(bodies: Any, image: Any, people: Any, *_: Any) -> Any:
    sides = (people.boxes[:, 2:] - people.boxes[:, :2]).max(axis=1, initial=0)[:, None]
    return pelvis_at(lambda pelvis: pelvis * sides / 150)(bodies)


def turned(rotvecs: np.ndarray, by: list[float]) -> np.ndarray:
    return (Rotation.from_rotvec(by) * Rotation.from_rotvec(rotvecs)).as_rotvec()


def pose_of(p: Any, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, np.ndarray]:
    return {"body_pose": change(p.body_pose.reshape(len(p), 21, 3)).reshape(len(p), 63)}


def of_mirrored_person(p: Any) -> dict[str, np.ndarray]:
    root = Rotation.from_euler("x", np.pi) * Rotation.from_rotvec(p.global_orient)
    mirrored = Rotation.from_euler("x", -np.pi) * Rotation.from_rotvec(root.as_rotvec() * _FLIP)
    return {"global_orient": mirrored.as_rotvec(), **pose_of(p, lambda pose: pose[:, _MIRRORED] * _FLIP)}


def with_joints(order: Callable[[list[int]], list[int]]) -> Callable[..., Any]:
    """Joints of another body model, in another order."""

    def changed(bodies: Any, *_: Any) -> Any:
        joints = embedded_surface(bodies)[1] if len(bodies.parameters) else np.zeros((0, 55, 3))
        joints = joints[:, order(list(range(55)))].astype(np.float32)
        joints[:, 22:] = np.nan
        shape = replace(bodies.parameters, betas=np.zeros((len(bodies.parameters), 10), np.float32))
        return replace(bodies, parameters=shape, body_model="other", joints=joints)

    return changed


def sides_of_joints(order: list[int]) -> list[int]:
    return [*mirrored_order(tuple(JOINT_INDEX)[:22]), *order[22:]]


def knees_for_ankles(order: list[int]) -> list[int]:
    order[4], order[5], order[7], order[8] = 7, 8, 4, 5
    return order


def of_pose(*pairs: tuple[str, str]) -> Callable[[np.ndarray], np.ndarray]:
    order = list(range(21))
    for first, second in pairs:
        i, j = JOINT_INDEX[first] - 1, JOINT_INDEX[second] - 1
        order[i], order[j] = j, i
    return lambda pose: pose[:, order]


# ---- hands, contact --------------------------------------------------------------------------------------------------


def with_fingers(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    return lambda h, *_: replace(h, rotvecs=change(h.rotvecs).astype(np.float32))


def with_contact(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    return lambda c, *_: replace(c, probability=change(c.probability))


def mirrored_contact(probability: np.ndarray) -> np.ndarray:
    from scipy.spatial import cKDTree

    vertices = rest_mesh_of_model(load_body("embedded")).vertices
    return probability[:, cKDTree(vertices).query(vertices * [-1, 1, 1])[1]]


def half_moved(probability: np.ndarray) -> np.ndarray:
    middle = probability.shape[1] // 2
    return np.concatenate([probability[:, :middle], np.roll(probability[:, middle:], 5, axis=1)], axis=1)


_FINGER_ORDER = np.arange(15).reshape(5, 3)
_MEAN_HAND = np.radians(np.tile([5.0, 3.0, 20.0], (15, 1)))
_SEGMENTER, _INPAINTER, _DEPTH, _POINTS = "MockSegmenter", "MockInpainter", "MockMetricDepth", "MockRelativePointmap"
_KEYPOINTS, _BODY, _HANDS, _CONTACT = (
    "MockKeypointDetector",
    "MockBodyEstimator",
    "MockHandEstimator",
    "MockContactPrior",
)

FAULTS: tuple[Fault, ...] = (
    Fault(_DEPTH, "along the ray", "depth_is_along_z", along_rays),
    Fault(_DEPTH, "one pixel to the right", "depth_is_not_shifted", with_depth(lambda z: moved(z, 1, 0))),
    Fault(_DEPTH, "principal point half a pixel off", "intrinsics_are_not_biased", with_camera(cx=0.5, cy=0.5)),
    Fault(_POINTS, "y up", "frame_is_opencv", with_points_of_map(lambda p, _: p * [1, -1, 1])),
    Fault(_POINTS, "OpenGL camera", "returns_valid_output", with_points_of_map(lambda p, _: p * [1, -1, -1])),
    Fault(_POINTS, "half a pixel off", "pixel_centres_are_integers", with_points_of_map(half_a_pixel_right)),
    Fault(
        _POINTS, "offset of z not declared", "unknown_names_the_ambiguity", with_points_of_map(lambda p, _: farther(p))
    ),
    Fault(_KEYPOINTS, "half a pixel off", "joints_are_not_shifted_or_scaled", with_points(lambda p, _: p + 0.5)),
    Fault(
        _KEYPOINTS,
        "1.25 % too large",
        "joints_are_not_shifted_or_scaled",
        with_points(lambda p, centre: centre + 1.0125 * (p - centre)),
    ),
    Fault(_KEYPOINTS, "knees for ankles", "joints_are_in_order", lambda k, *_: exchanged(k, *_LEGS)),
    Fault(
        _CONTACT,
        "vertices reversed",
        "contact_is_more_likely_where_bodies_touch",
        with_contact(lambda p: p[:, ::-1].copy()),
    ),
    Fault(_CONTACT, "vertices moved by 37", "vertices_are_in_order", with_contact(lambda p: np.roll(p, 37, axis=1))),
    Fault(_CONTACT, "mirrored", "vertices_are_in_order", with_contact(mirrored_contact)),
    Fault(
        _BODY, "joints with left and right exchanged", "pose_is_not_turned_or_mirrored", with_joints(sides_of_joints)
    ),
    Fault(_BODY, "joints with knees for ankles", "joints_are_in_order", with_joints(knees_for_ankles)),
    Fault(_BODY, "pose of the mirrored person", "pose_is_not_turned_or_mirrored", with_parameters(of_mirrored_person)),
    Fault(_BODY, "pose always zero", "pose_follows_the_photo", with_parameters(lambda p: pose_of(p, np.zeros_like))),
    Fault(
        _BODY,
        "at the focal length of the crop",
        "distance_does_not_depend_on_the_crop",
        at_the_focal_length_of_the_crop,
    ),
    Fault(_BODY, "distance times 1.4", "bodies_are_in_place", pelvis_at(lambda pelvis: 1.4 * pelvis)),
    Fault(_BODY, "0.25 m too low", "bodies_are_in_place", pelvis_at(lambda pelvis: pelvis + np.array([0, 0.25, 0]))),
    Fault(
        _HANDS,
        "left hand not mirrored back",
        "hands_are_those_of_the_person",
        with_fingers(lambda r: r * np.stack([_FLIP, _FLIP**2])[:, None]),
    ),
    Fault(
        _HANDS,
        "thumb first",
        "finger_joints_are_in_order",
        with_fingers(lambda r: r[:, :, _FINGER_ORDER[[4, 0, 1, 3, 2]].ravel()]),
    ),
    Fault(_HANDS, "always flat", "fingers_follow_the_photo", with_fingers(np.zeros_like)),
    Fault(_INPAINTER, "whole picture one pixel to the right", "pixels_outside_the_mask_are_unchanged", moved_picture),
    Fault(
        _INPAINTER, "fill one pixel to the right", "fill_is_not_shifted", with_fill(lambda image: moved(image, 1, 0))
    ),
    Fault(
        _SEGMENTER,
        "masks one pixel to the right",
        "masks_are_not_shifted",
        lambda p, *_: with_masks(p, lambda m: moved(m, 1, 0, False)),
    ),
    Fault(
        _SEGMENTER,
        "boxes with the last pixel",
        "boxes_enclose_their_masks",
        lambda p, *_: replace(p, boxes=p.boxes - [0, 0, 1, 1]),
    ),
    Fault(
        _SEGMENTER,
        "floor one pixel to the right",
        "masks_are_not_shifted",
        lambda p, *_: replace(p, floor=None if p.floor is None else moved(p.floor, 1, 0) & ~p.masks.any(axis=0)),
    ),
)

READER_FAULTS: tuple[Fault, ...] = (
    Fault(_SEGMENTER, "masks 3 % too large", "masks_are_not_shifted", lambda p, *_: with_masks(p, enlarged)),
    Fault(_SEGMENTER, "everybody in one mask", "people_have_masks_of_their_own", in_one_mask),
    Fault(
        _SEGMENTER,
        "boxes in another order than masks",
        "boxes_enclose_their_masks",
        lambda p, *_: replace(p, boxes=p.boxes[::-1].copy()),
    ),
    Fault(_INPAINTER, "10 % darker", "fill_has_the_colours_around", with_fill(lambda image: 0.9 * image)),
    Fault(_INPAINTER, "mirrored", "fill_has_the_colours_around", with_fill(lambda image: image[:, ::-1])),
    Fault(_INPAINTER, "one pixel of the border of people left", "hole_is_filled", rim_left(1)),
    Fault(
        _INPAINTER,
        "without colour",
        "fill_has_the_colours_around",
        with_fill(lambda image: image.mean(axis=2, keepdims=True) * [1, 1, 1]),
    ),
    Fault(_DEPTH, "times 1.25", "depth_has_no_bias_of_scale", with_depth(lambda z: 1.25 * z)),
    Fault(_DEPTH, "0.3 m too far", "depth_has_no_offset", with_depth(lambda z: z + 0.3)),
    Fault(_DEPTH, "intrinsics of the photo squeezed to a square", "intrinsics_are_not_biased", with_camera(fx=0.75)),
    Fault(
        _POINTS,
        "rays of a focal length 2 % longer",
        "given_camera_is_used",
        with_points_of_map(lambda p, _: p / [1.02, 1.02, 1]),
    ),
    Fault(
        _POINTS,
        "z of the next row",
        "depth_is_not_shifted",
        with_points_of_map(lambda p, _: on_same_rays(p, moved(p[..., 2], 0, -1))),
    ),
    Fault(_POINTS, "returned principal point W / 2", "intrinsics_are_not_biased", with_camera(cx=0.5, cy=0.5)),
    Fault(_POINTS, "offset of 1 / z declared as one of z", "unknown_names_the_ambiguity", bent),
    Fault(
        _KEYPOINTS, "wrists exchanged", "joints_are_in_order", lambda k, *_: exchanged(k, ("left_wrist", "right_wrist"))
    ),
    Fault(
        _KEYPOINTS,
        "1 is unsure",
        "confidence_is_higher_in_sight",
        lambda k, *_: replace(k, confidence=1 - k.confidence),
    ),
    Fault(
        _KEYPOINTS, "world points with x to the left", "world_points_are_metres", lambda *a: with_world(*a, right=-1)
    ),
    Fault(
        _BODY,
        "8 degrees turned about the vertical",
        "bodies_face_the_right_way",
        with_parameters(lambda p: {"global_orient": turned(p.global_orient, [0, np.radians(8), 0])}),
    ),
    Fault(
        _BODY,
        "collars for shoulders",
        "joints_are_in_order",
        with_parameters(
            lambda p: pose_of(p, of_pose(("left_collar", "left_shoulder"), ("right_collar", "right_shoulder")))
        ),
    ),
    Fault(_BODY, "inverse rotations", "joints_are_in_order", with_parameters(lambda p: pose_of(p, np.negative))),
    Fault(
        _HANDS,
        "relative to a relaxed hand",
        "rotations_are_relative_to_the_flat_hand",
        with_fingers(lambda r: r - _MEAN_HAND),
    ),
    Fault(
        _HANDS,
        "joints from tip to palm",
        "finger_joints_are_in_order",
        with_fingers(lambda r: r[:, :, _FINGER_ORDER[:, ::-1].ravel()]),
    ),
    Fault(_CONTACT, "half of the vertices moved by 5", "", with_contact(half_moved)),
)
