"""Faults that a wrapper of a network may have without an error, as changes of what a mock
returns.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.backends.people import boxes_from_masks
from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.convert.bodies import rest_mesh_of_model
from physic_mock.recognition import recognise_world
from physic_testing.conformance.truth import embedded_surface, mirrored_order


def moved(array, right, down, empty=None):
    """An image moved by whole pixels; what comes in repeats the border, or is ``empty``."""
    rows = np.arange(array.shape[0]) - down
    columns = np.arange(array.shape[1]) - right
    found = array[np.clip(rows, 0, len(rows) - 1)][:, np.clip(columns, 0, len(columns) - 1)]
    if empty is not None:
        found[(rows < 0) | (rows >= len(rows))] = empty
        found[:, (columns < 0) | (columns >= len(columns))] = empty
    return found


def fields(**changes):
    """A change of an answer's fields, each by a function, but for those that it does not have."""

    def change(answer, *_):
        held = {name: getattr(answer, name) for name in changes}
        found = {name: changes[name](value) for name, value in held.items() if value is not None}
        return replace(answer, **found)

    return change


# ---- segmenter
# --------------------------------------------------------------------------------------------------


def with_masks(people, change):
    if not len(people):
        return people
    masks = np.stack([change(mask) for mask in people.masks])
    return replace(people, masks=masks, boxes=boxes_from_masks(masks))


def enlarged(mask):
    return mask[np.ix_(*((np.arange(n) / 1.03).astype(int) for n in mask.shape))]


def in_one_mask(people, *_):
    if not len(people):
        return people
    masks = people.masks.any(axis=0, keepdims=True)
    return replace(people, masks=masks, boxes=boxes_from_masks(masks), scores=people.scores[:1])


# ---- keypoints
# --------------------------------------------------------------------------------------------------


def with_points(change):
    """The points changed, which see the centres (N, 1, 2) of the boxes."""

    def changed(keypoints, image, people):
        centres = ((people.boxes[:, :2] + people.boxes[:, 2:]) / 2 - 0.5)[:, None]
        return replace(keypoints, points=change(keypoints.points, centres))

    return changed


def swapped(names, *pairs):
    """The rows of names of which some pairs are exchanged."""
    order = list(range(len(names)))
    for first, second in pairs:
        order[names.index(first)] = names.index(second)
        order[names.index(second)] = names.index(first)
    return order


def with_wrists_exchanged(keypoints, *_):
    order = swapped(keypoints.joint_set.names, ("left_wrist", "right_wrist"))
    return replace(
        keypoints, points=keypoints.points[:, order], confidence=keypoints.confidence[:, order]
    )


def with_world(keypoints, image, people, *, right):
    tall = (people.boxes[:, 3] - people.boxes[:, 1]).reshape(-1, 1, 1)
    flat = (
        (keypoints.points - keypoints.points[:, 23:25].mean(axis=1, keepdims=True))
        * 1.7
        / np.maximum(tall, 1)
    )
    return replace(
        keypoints, world=np.concatenate([flat * [right, 1], np.zeros_like(flat[..., :1])], axis=2)
    )


def of_a_lens(keypoints, image, people):
    """The points in a photo that was not undistorted, of a lens of about one photo's width."""
    beside = keypoints.points - (np.array(image.shape[1::-1]) - 1) / 2
    farther = 0.1 * (beside**2).sum(axis=-1, keepdims=True) / max(image.shape) ** 2
    return replace(keypoints, points=keypoints.points + farther * beside)


_LEGS = [(f"{side}_knee", f"{side}_ankle") for side in ("left", "right")]


# ---- depth
# --------------------------------------------------------------------------------------------------


def stretch(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)


def along_rays(depth, *_):
    return replace(depth, depth=depth.depth * stretch(depth.intrinsics))


def half_a_pixel_off(camera):
    return replace(camera, cx=camera.cx + 0.5, cy=camera.cy + 0.5)


def with_points_of_map(change):
    return lambda p, *_: replace(p, points=change(p.points, p.intrinsics).astype(np.float32))


def half_a_pixel_right(points, camera):
    return points + points[..., 2:] * [0.5 / camera.fx, 0.5 / camera.fy, 0]


def on_same_rays(points, z):
    return points * (z / points[..., 2])[..., None]


def farther(points):
    return on_same_rays(points, points[..., 2] + 0.3 * np.nanmedian(points[..., 2]))


def bent(pointmap, *_):
    z = pointmap.points[..., 2]
    points = on_same_rays(pointmap.points, 1 / (1 / z + 0.3 / np.nanmedian(z)))
    return replace(pointmap, points=points.astype(np.float32), unknown="scale_shift")


# ---- inpainter
# --------------------------------------------------------------------------------------------------


def inside(mask, fill, image):
    return np.where(mask[..., None], fill, image).astype(np.uint8)


def with_fill(change):
    """The photo without people, as the mock fills it, changed inside of the mask."""

    def changed(filled, image, mask):
        if not mask.any():
            return filled
        fill = change(recognise_world(image).world.empty_image.astype(float))
        return inside(mask, np.clip(np.rint(fill), 0, 255), image)

    return changed


def rim_left(px):
    """People's outermost pixels as they were."""

    def changed(filled, image, mask):
        person = recognise_world(image).people.astype(np.uint8)
        inner = cv2.erode(person, np.ones((2 * px + 1, 2 * px + 1), np.uint8))
        return inside(person > inner, image, filled)

    return changed


def moved_picture(filled, image, mask):
    return moved(filled, 1, 0) if mask.any() else filled


# ---- bodies
# --------------------------------------------------------------------------------------------------

_MIRRORED = np.array(mirrored_order(tuple(JOINT_INDEX)[1:22]))
_FLIP = np.array([1, -1, -1])


def with_parameters(change):
    def changed(bodies, *_):
        p = bodies.parameters
        values = (
            {name: np.asarray(v, np.float32) for name, v in change(p).items()} if len(p) else {}
        )
        return replace(bodies, parameters=replace(p, **values))

    return changed


def pelvis_at(change):
    def changed(bodies, *_):
        if not len(bodies.parameters):
            return bodies
        pelvis = embedded_surface(bodies)[1][:, 0]
        return with_parameters(lambda p: {"transl": p.transl + change(pelvis) - pelvis})(bodies)

    return changed


def turned(rotvecs, by):
    return (Rotation.from_rotvec(by) * Rotation.from_rotvec(rotvecs)).as_rotvec()


def pose_of(p, change):
    return {"body_pose": change(p.body_pose.reshape(len(p), 21, 3)).reshape(len(p), 63)}


def of_mirrored_person(p):
    root = Rotation.from_euler("x", np.pi) * Rotation.from_rotvec(p.global_orient)
    mirrored = Rotation.from_euler("x", -np.pi) * Rotation.from_rotvec(root.as_rotvec() * _FLIP)
    return {
        "global_orient": mirrored.as_rotvec(),
        **pose_of(p, lambda pose: pose[:, _MIRRORED] * _FLIP),
    }


def with_joints(order):
    """Joints of another body model, in another order."""

    def changed(bodies, *_):
        joints = embedded_surface(bodies)[1] if len(bodies.parameters) else np.zeros((0, 55, 3))
        joints = joints[:, order(list(range(55)))].astype(np.float32)
        joints[:, 22:] = np.nan
        shape = replace(bodies.parameters, betas=np.zeros((len(bodies.parameters), 10), np.float32))
        return replace(bodies, parameters=shape, body_model="other", joints=joints)

    return changed


def sides_of_joints(order):
    return [*mirrored_order(tuple(JOINT_INDEX)[:22]), *order[22:]]


def knees_for_ankles(order):
    return swapped(tuple(JOINT_INDEX), *_LEGS)


def of_pose(*pairs):
    order = swapped(tuple(JOINT_INDEX)[1:22], *pairs)
    return lambda pose: pose[:, order]


# ---- hands, contact
# --------------------------------------------------------------------------------------------------


def mirrored_contact(probability):
    from scipy.spatial import cKDTree

    vertices = rest_mesh_of_model(load_body("embedded")).vertices
    return probability[:, cKDTree(vertices).query(vertices * [-1, 1, 1])[1]]


def euler(rotvecs):
    """Rotation vectors (..., 3) as angles about x, y and z."""
    return Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_euler("xyz").reshape(rotvecs.shape)


def eroded(mask):
    return (
        cv2.erode(mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        if mask.sum() > 400
        else mask
    )


def eight_bit(z):
    far = np.nanmax(z)
    return np.maximum(np.round(z / far * 255), 1) / 255 * far


def of_half_a_grid(z):
    return z[::2, ::2].repeat(2, axis=0).repeat(2, axis=1)[: z.shape[0], : z.shape[1]]


def canonical(depth, *_):
    return replace(depth, depth=depth.depth * 300 / depth.intrinsics.fx)


def sky_valid(pointmap, *_):
    far = np.nan_to_num(pointmap.points, nan=float(np.nanmax(pointmap.points)))
    far[..., 2] = np.maximum(far[..., 2], 1e-3)
    return replace(pointmap, points=far.astype(np.float32), valid=np.ones_like(pointmap.valid))


def both_sides(keypoints, image, *_):
    """The mean with the output for the mirrored photo, left and right not exchanged."""
    other = mirrored_order(keypoints.joint_set.names)
    return replace(keypoints, points=(keypoints.points + keypoints.points[:, other]) / 2)


def square_crop(points, centres):
    return centres + (points - centres) * [4 / 3, 1]


def in_cells(keypoints, image, people):
    """Points at the upper left corner of a cell of a heat map of 48 x 64."""
    sides = (people.boxes[:, 2:] - people.boxes[:, :2]).max(1, initial=0)[:, None, None] / 48
    low = people.boxes[:, None, :2]
    return replace(
        keypoints, points=low + np.floor((keypoints.points - low) / np.maximum(sides, 1e-6)) * sides
    )


def at_a_wide_angle(bodies, image, people, camera, *_):
    return pelvis_at(lambda pelvis: pelvis * [1, 1, 250 / camera.fx])(bodies)


def seen_by_the_crop(bodies, *_):
    """Each body turned as in a crop whose camera looks at it."""
    if not len(bodies.parameters):
        return bodies
    ray = embedded_surface(bodies)[1][:, 0]
    aside = np.linalg.norm(ray[:, :2], axis=1)
    axis = np.stack([-ray[:, 1], ray[:, 0], 0 * aside], 1) / np.maximum(aside, 1e-9)[:, None]
    by = -np.arctan2(aside, ray[:, 2])[:, None] * axis
    return with_parameters(lambda p: {"global_orient": turned(p.global_orient, by)})(bodies)


def flip_mean(p):
    return pose_of(p, lambda pose: (pose + pose[:, _MIRRORED]) / 2)


def second_half_reversed(p):
    middle = p.shape[1] // 2
    return np.concatenate([p[:, :middle], p[:, middle:][:, ::-1]], axis=1)


def blended(filled, image, mask):
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 6)[..., None]
    return inside(mask, np.rint(0.7 * soft * filled + (1 - 0.7 * soft) * image), image)


def soft_rim(filled, image, mask):
    distance = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    share = np.clip(distance / 8, 0, 1)[..., None]
    return inside(mask, np.rint(share * filled + (1 - share) * image), image)


def changed_fill(change):
    return lambda filled, image, mask: inside(mask, change(filled), image)


def with_floor(change):
    def changed(people, *_):
        if people.floor is None:
            return people
        return replace(people, floor=change(people.floor) & ~people.masks.any(axis=0))

    return changed


def flip_mean_of_z(points, camera):
    z = points[..., 2]
    other = points[:, ::-1, 2]
    return on_same_rays(points, np.where(np.isfinite(other), (z + other) / 2, z))


def next_row(points, camera):
    z = points[..., 2]
    below = moved(points[..., 2], 0, -1)
    return on_same_rays(points, np.where(np.isfinite(below), below, z))


_COLLARS = [(f"{side}_collar", f"{side}_shoulder") for side in ("left", "right")]

_FINGER_ORDER = np.arange(15).reshape(5, 3)

NOISY = {
    "MockSegmenter": {
        "padding left": lambda p, *_: with_masks(p, lambda m: moved(m, 0, 6, False)),
        "masks 3 px too small": lambda p, *_: with_masks(p, eroded),
        "masks 3 % too large": lambda p, *_: with_masks(p, enlarged),
    },
    "MockInpainter": {
        "blended": blended,
        "faded": changed_fill(lambda f: f * 0.5 + 64),
        "one pixel down": changed_fill(lambda f: moved(f, 0, 1)),
        "BGR": changed_fill(lambda f: f[..., ::-1]),
    },
    "MockMetricDepth": {
        "canonical focal length": canonical,
        "along the ray": along_rays,
        "mean with the mirrored photo": fields(depth=lambda z: (z + z[:, ::-1]) / 2),
        "8 bit": fields(depth=eight_bit),
        "sky at 65.5 m": fields(depth=lambda z: np.nan_to_num(z, nan=65.5)),
        "one pixel to the right": fields(depth=lambda z: moved(z, 1, 0)),
    },
    "MockRelativePointmap": {
        "ray length": with_points_of_map(lambda p, c: on_same_rays(p, p[..., 2] * stretch(c))),
        "sky valid": sky_valid,
        "half a pixel off": with_points_of_map(half_a_pixel_right),
        "mean with the mirrored photo": with_points_of_map(flip_mean_of_z),
    },
    "MockKeypointDetector": {
        "half a pixel off": with_points(lambda p, _: p + 0.5),
        "sigmoid twice": fields(confidence=lambda c: 1 / (1 + np.exp(-c))),
        "mean with the mirrored photo": both_sides,
        "stretched crop": with_points(square_crop),
        "corner of the cell": in_cells,
    },
    "MockBodyEstimator": {
        "Euler angles": with_parameters(lambda p: pose_of(p, euler)),
        "inverse root": with_parameters(lambda p: {"global_orient": -p.global_orient}),
        "distance for a focal length of 250 px": at_a_wide_angle,
        "seen by the camera of a crop": seen_by_the_crop,
        "mean with the mirrored photo": with_parameters(flip_mean),
        "0.25 m too low": pelvis_at(lambda pelvis: pelvis + np.array([0, 0.25, 0])),
    },
    "MockHandEstimator": {
        "left hand not mirrored": fields(
            rotvecs=lambda r: r * np.stack([_FLIP, _FLIP**2])[:, None]
        ),
        "thumb first": fields(rotvecs=lambda r: r[:, :, _FINGER_ORDER[[4, 0, 1, 3, 2]].ravel()]),
        "inverse": fields(rotvecs=np.negative),
    },
    "MockContactPrior": {
        "vertices moved by 37": fields(probability=lambda p: np.roll(p, 37, axis=1)),
        "constant": fields(probability=lambda p: np.full_like(p, 0.5)),
        "second half reversed": fields(probability=second_half_reversed),
        "mirrored": fields(probability=mirrored_contact),
    },
}
"""Mock -> fault in words -> ``change(result, *arguments)``; looked for in mocks with noise too."""

FURTHER = {
    "MockSegmenter": {
        "masks one pixel to the right": lambda p, *_: with_masks(
            p, lambda m: moved(m, 1, 0, False)
        ),
        "boxes with the last pixel": fields(boxes=lambda boxes: boxes - [0, 0, 1, 1]),
        "floor one pixel to the right": with_floor(lambda floor: moved(floor, 1, 0)),
        "everybody in one mask": in_one_mask,
        "boxes in another order": fields(boxes=lambda boxes: boxes[::-1].copy()),
    },
    "MockInpainter": {
        "whole picture one pixel to the right": moved_picture,
        "fill mirrored": with_fill(lambda image: image[:, ::-1]),
        "blended at its border": soft_rim,
        "10 % darker": with_fill(lambda image: 0.9 * image),
        "one pixel of the border of people left": rim_left(1),
    },
    "MockMetricDepth": {
        "principal point half a pixel off": fields(intrinsics=half_a_pixel_off),
        "times 1.25": fields(depth=lambda z: 1.25 * z),
        "0.3 m too far": fields(depth=lambda z: z + 0.3),
        "camera of a square photo": fields(intrinsics=lambda c: replace(c, fx=0.75 * c.fx)),
        "half-size grid": fields(depth=of_half_a_grid),
    },
    "MockRelativePointmap": {
        "offset of z not declared": with_points_of_map(lambda p, _: farther(p)),
        "rays of a focal length 2 % longer": with_points_of_map(lambda p, _: p / [1.02, 1.02, 1]),
        "z of the next row": with_points_of_map(next_row),
        "principal point W / 2": fields(intrinsics=half_a_pixel_off),
        "offset of 1 / z declared as one of z": bent,
    },
    "MockKeypointDetector": {
        "wrists exchanged": with_wrists_exchanged,
        "lens distortion": of_a_lens,
        "world points with x to the left": lambda *a: with_world(*a, right=-1),
    },
    "MockBodyEstimator": {
        "joints with left and right exchanged": with_joints(sides_of_joints),
        "joints with knees for ankles": with_joints(knees_for_ankles),
        "pose of the mirrored person": with_parameters(of_mirrored_person),
        "distance times 1.4": pelvis_at(lambda pelvis: 1.4 * pelvis),
        "8 degrees turned about the vertical": with_parameters(
            lambda p: {"global_orient": turned(p.global_orient, [0, np.radians(8), 0])}
        ),
        "collars for shoulders": with_parameters(lambda p: pose_of(p, of_pose(*_COLLARS))),
        "inverse rotations": with_parameters(lambda p: pose_of(p, np.negative)),
    },
    "MockHandEstimator": {
        "always flat": fields(rotvecs=np.zeros_like),
        "joints from tip to palm": fields(
            rotvecs=lambda r: r[:, :, _FINGER_ORDER[:, ::-1].ravel()]
        ),
    },
    "MockContactPrior": {
        "sigmoid twice": fields(probability=lambda p: 1 / (1 + np.exp(-p))),
    },
}
"""Further faults, which are looked for in mocks without noise alone."""

FOUND_BY = {
    "MockSegmenter": {
        "boxes with the last pixel": "boxes_are_tight",
        "boxes in another order": "accepts_photos_of_people",
        "floor one pixel to the right": "floor_is_in_place",
        "everybody in one mask": "accepts_photos_of_people",
    },
    "MockInpainter": {
        "blended": "fill_has_the_colours_around",
        "one pixel down": "fill_is_not_shifted",
        "whole picture one pixel to the right": "only_the_mask_is_filled",
    },
    "MockMetricDepth": {
        "canonical focal length": "depth_does_not_depend_on_the_focal_length",
        "one pixel to the right": "depth_is_not_shifted",
        "principal point half a pixel off": "intrinsics_are_not_biased",
        "sky at 65.5 m": "depth_is_where_it_can_be_known",
        "0.3 m too far": "unknown_names_the_ambiguity",
    },
    "MockRelativePointmap": {
        "half a pixel off": "points_lie_on_the_rays_of_the_camera",
    },
    "MockKeypointDetector": {
        "sigmoid twice": "confidence_tells_hidden_joints",
        "half a pixel off": "joints_are_not_shifted_or_scaled",
        "world points with x to the left": "world_points_are_metres",
        "wrists exchanged": "joints_are_those_of_the_person",
    },
    "MockBodyEstimator": {
        "inverse root": "bodies_face_the_right_way",
        "distance for a focal length of 250 px": "distance_does_not_depend_on_the_crop",
        "Euler angles": "joints_turn_as_in_the_photo",
        "joints with left and right exchanged": "pose_is_not_turned_or_mirrored",
        "distance times 1.4": "bodies_are_as_far_away",
        "0.25 m too low": "bodies_are_in_place",
    },
    "MockHandEstimator": {
        "left hand not mirrored": "hands_are_those_of_the_person",
    },
    "MockContactPrior": {
        "constant": "contact_is_more_likely_where_bodies_touch",
        "second half reversed": "vertices_are_in_order",
    },
}
"""Mock -> fault -> the check that finds it, for the checks that no wrong backend of
``wrong_backends.py`` is for.
"""
