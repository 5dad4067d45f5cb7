"""Faults that a wrapper of a network may have, as changes of what a mock returns, each with the
check that finds it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physic_core.backends.people import boxes_from_masks
from physic_core.body import JOINT_INDEX, JOINT_NAMES, load_body, rest_mesh_of_model
from physic_core.body.bones import rotations_from_parameters
from physic_core.errors import BackendError
from physic_core.types import (
    Bodies,
    ContactProbability,
    Mesh,
    RestMesh,
    Skeleton,
    mirrored_order,
)
from physic_mock.recognition import match_masks_to_world, recognise_world
from physic_testing.conformance.cases import rows_of
from physic_testing.conformance.truth import embedded_surface, true_wrists


def fields(**changes):
    """A change of an answer's fields, each by a function, but for those that it does not have."""

    def change(answer, *_):
        held = {name: getattr(answer, name) for name in changes}
        found = {name: changes[name](value) for name, value in held.items() if value is not None}
        return replace(answer, **found)

    return change


def raising(error, where):
    """An error in place of the answer to the arguments of which ``where`` holds."""

    def change(answer, *arguments):
        if where(*arguments):
            raise error
        return answer

    return change


def needing(hint):
    """An error where this hint is missing."""
    return raising(AttributeError("'NoneType'"), lambda *given: getattr(given[-1], hint) is None)


def after(*changes):
    """Changes one after the other."""

    def change(answer, *arguments):
        for one in changes:
            answer = one(answer, *arguments)
        return answer

    return change


def moved(array, right, down, empty=None):
    """An image moved by whole pixels; what comes in repeats the border, or is ``empty``."""
    rows = np.arange(array.shape[0]) - down
    columns = np.arange(array.shape[1]) - right
    found = array[np.clip(rows, 0, len(rows) - 1)][:, np.clip(columns, 0, len(columns) - 1)]
    if empty is not None:
        found[(rows < 0) | (rows >= len(rows))] = empty
        found[:, (columns < 0) | (columns >= len(columns))] = empty
    return found


# ---- people, boxes and floor


def with_masks(change):
    def changed(people, *_):
        if not len(people):
            return people
        masks = np.stack([change(mask) for mask in people.masks])
        return replace(people, masks=masks, boxes=boxes_from_masks(masks))

    return changed


def enlarged(mask):
    return mask[np.ix_(*((np.arange(n) / 1.03).astype(int) for n in mask.shape))]


def in_one_mask(people, *_):
    if not len(people):
        return people
    masks = people.masks.any(axis=0, keepdims=True)
    one = rows_of(people, np.arange(1), len(people))
    return replace(one, masks=masks, boxes=boxes_from_masks(masks))


def inverted(people, *_):
    return after(in_one_mask, with_masks(np.logical_not), fields(floor=lambda _: None))(people)


def with_floor(change):
    """The floor changed, which sees where people are."""

    def changed(people, *_):
        shown = people.masks.any(axis=0)
        return fields(floor=lambda floor: change(floor, shown))(people)

    return changed


# ---- keypoints


def with_points(change):
    """The points changed, which see the boxes (N, 1, 4)."""

    def changed(keypoints, image, people):
        return replace(keypoints, points=change(keypoints.points, people.boxes[:, None]))

    return changed


def square_crop(points, boxes):
    centres = (boxes[..., :2] + boxes[..., 2:]) / 2 - 0.5
    return centres + (points - centres) * [4 / 3, 1]


def in_cells(points, boxes):
    """Points at the upper left corner of a cell of a heat map of 48 x 64."""
    sides = (boxes[..., 2:] - boxes[..., :2]).max(2, keepdims=True) / 48
    low = boxes[..., :2]
    return low + np.floor((points - low) / np.maximum(sides, 1e-6)) * sides


def swapped(names, *pairs):
    """The rows of names of which some pairs are exchanged."""
    order = list(range(len(names)))
    for first, second in pairs:
        order[names.index(first)] = names.index(second)
        order[names.index(second)] = names.index(first)
    return order


def with_wrists_exchanged(keypoints, *_):
    order = swapped(keypoints.joint_set.names, ("left_wrist", "right_wrist"))
    return fields(points=lambda p: p[:, order], confidence=lambda c: c[:, order])(keypoints)


def both_sides(keypoints, *_):
    """The mean with the output for the mirrored photo, left and right not exchanged."""
    other = mirrored_order(keypoints.joint_set.names)
    return fields(points=lambda points: (points + points[:, other]) / 2)(keypoints)


def with_world(right):
    """World points in metres, with x to the right or to the left."""

    def changed(keypoints, image, people):
        tall = (people.boxes[:, 3] - people.boxes[:, 1]).reshape(-1, 1, 1)
        hips = keypoints.points[:, 23:25].mean(axis=1, keepdims=True)
        flat = (keypoints.points - hips) * 1.7 / np.maximum(tall, 1) * [right, 1]
        return replace(keypoints, world=np.pad(flat, [(0, 0), (0, 0), (0, 1)]))

    return changed


def sorted_rows(answer, image, people, *_):
    """Rows by the people's boxes, whatever the order in which they were asked about."""
    return rows_of(answer, np.argsort(people.boxes[:, 0]), len(people))


# ---- depth and points


def stretch(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)


def eight_bit(z):
    far = np.nanmax(z)
    return np.maximum(np.round(z / far * 255), 1) / 255 * far


def of_half_a_grid(z):
    return z[::2, ::2].repeat(2, axis=0).repeat(2, axis=1)[: z.shape[0], : z.shape[1]]


def only_corner(z):
    kept = np.full_like(z, np.nan)
    corner = np.s_[: z.shape[0] // 3, : z.shape[1] // 3]
    kept[corner] = z[corner]
    return kept


def half_a_pixel_off(camera):
    return replace(camera, cx=camera.cx + 0.5, cy=camera.cy + 0.5)


def with_z(change):
    """A point map with other z, on the same rays: ``change(z, camera)``."""

    def changed(pointmap, *_):
        z = pointmap.points[..., 2]
        factor = change(z, pointmap.intrinsics) / z
        return replace(pointmap, points=(pointmap.points * factor[..., None]).astype(np.float32))

    return changed


def half_a_pixel_right(pointmap, *_):
    camera = pointmap.intrinsics
    off = np.float32([0.5 / camera.fx, 0.5 / camera.fy, 0])
    return fields(points=lambda points: points + points[..., 2:] * off)(pointmap)


def mean_with_mirrored(z, camera):
    other = z[:, ::-1]
    return np.where(np.isfinite(other), (z + other) / 2, z)


def sky_valid(pointmap, *_):
    far = np.nan_to_num(pointmap.points, nan=float(np.nanmax(pointmap.points)))
    far[..., 2] = np.maximum(far[..., 2], 1e-3)
    return replace(pointmap, points=far.astype(np.float32), valid=np.ones_like(pointmap.valid))


def to_the_right(up):
    sideways = np.array([0.2, *up[1:]])
    return sideways / np.linalg.norm(sideways)


# ---- pictures


def with_fill(change):
    """The fill changed, ``change(filled, image)``, which may see the mask."""
    return lambda filled, image, mask: np.where(
        mask[..., None], change(filled, image, mask), image
    ).astype(np.uint8)


def blended(filled, image, mask):
    soft = 0.7 * cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 6)[..., None]
    return np.rint(soft * filled + (1 - soft) * image)


# ---- bodies

_MIRRORED = np.array(mirrored_order(JOINT_NAMES[1:22]))
_LEFT_FLIP = np.array([1, -1, -1])


def with_parameters(change):
    """Some parameters changed: ``change(parameters)`` returns their values by name."""

    def changed(bodies, *_):
        p = bodies.parameters
        values = change(p).items() if len(p) else ()
        found = {name: np.asarray(value, np.float32) for name, value in values}
        return replace(bodies, parameters=replace(p, **found))

    return changed


def with_pose(change):
    """The rotation vectors (N, 21, 3) of the joints changed."""
    return with_parameters(
        lambda p: {"body_pose": change(p.body_pose.reshape(-1, 21, 3)).reshape(-1, 63)}
    )


def pelvis_at(change):
    """Bodies moved: ``change(pelvis)`` of the places (N, 3) of the pelvises."""

    def changed(bodies, *_):
        if not len(bodies.parameters):
            return bodies
        pelvis = embedded_surface(bodies)[1][:, 0]
        return with_parameters(lambda p: {"transl": p.transl + change(pelvis) - pelvis})(bodies)

    return changed


def at_a_wide_angle(bodies, image, people, camera, *_):
    return pelvis_at(lambda pelvis: pelvis * [1, 1, 0.78 * camera.width / camera.fx])(bodies)


def seen_by_the_crop(bodies, *_):
    """Each body turned as in a crop whose camera looks at it."""
    if not len(bodies.parameters):
        return bodies
    ray = embedded_surface(bodies)[1][:, 0]
    aside = np.linalg.norm(ray[:, :2], axis=1)
    axis = np.stack([-ray[:, 1], ray[:, 0], 0 * aside], 1) / np.maximum(aside, 1e-9)[:, None]
    turn = Rotation.from_rotvec(-np.arctan2(aside, ray[:, 2])[:, None] * axis)
    return with_parameters(
        lambda p: {"global_orient": (turn * Rotation.from_rotvec(p.global_orient)).as_rotvec()}
    )(bodies)


def euler(rotvecs):
    """Rotation vectors (..., 3) as angles about x, y and z."""
    return Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_euler("xyz").reshape(rotvecs.shape)


@lru_cache(maxsize=1)
def shuffled():
    """The embedded body's mesh with another name and order of vertices, and the old number of
    each.
    """
    rest = rest_mesh_of_model(load_body("embedded"))
    order = np.random.default_rng(0).permutation(len(rest.vertices))
    return RestMesh("shuffled", rest.vertices[order], np.argsort(order)[rest.faces]), order


def with_joints(order=range(22), *, surface=False):
    """SMPL's parameters with 24 joints, as a network gives them that was trained on SMPL; with
    ``surface``, on a mesh of its own.
    """

    def changed(bodies, *_):
        p = replace(bodies.parameters, betas=np.zeros((len(bodies.parameters), 10), np.float32))
        given = (torch.from_numpy(v) for v in (bodies.parameters.betas, p.transl))
        with torch.no_grad():
            out = load_body("embedded")(rotations_from_parameters(bodies.parameters), *given)
        joints = np.full((len(out.joints), 55, 3), np.nan, np.float32)
        joints[:, :22] = out.joints.numpy()[:, list(order)]
        rest, new = shuffled()
        mesh = Mesh("shuffled", out.vertices.numpy()[:, new], rest.faces, rest.vertices)
        return Bodies(p, "smpl", bodies.observed, joints, mesh if surface else None)

    return changed


def hipless(joints):
    return np.where(np.arange(joints.shape[1])[:, None] == 1, np.nan, joints)


# ---- hands and contact


def with_wrists(hands, image, people, *_):
    found = recognise_world(image)
    rows = match_masks_to_world(found, people)
    return replace(hands, wrists=true_wrists(found.world).astype(np.float32)[rows])


_FINGERS = np.arange(15).reshape(5, 3)


def other_mesh(contact, *_):
    rest, order = shuffled()
    return ContactProbability(contact.probability[:, order], "shuffled", rest)


def mirrored_contact(probability):
    from scipy.spatial import cKDTree

    vertices = rest_mesh_of_model(load_body("embedded")).vertices
    return probability[:, cKDTree(vertices).query(vertices * [-1, 1, 1])[1]]


def second_half_reversed(p):
    middle = p.shape[1] // 2
    return np.concatenate([p[:, :middle], p[:, middle:][:, ::-1]], axis=1)


def sigmoid(values):
    return 1 / (1 + np.exp(-values))


MILLIMETRES = fields(vertices=lambda vertices: 1000 * vertices)
NO_PEOPLE_IS_AN_ERROR = raising(
    ValueError("need at least one array to stack"), lambda image, p, *_: not len(p)
)

RIGHT = {
    "MockBodyEstimator": {
        "joints of another model": with_joints(),
        "a surface of another mesh": with_joints(surface=True),
    },
    "MockContactPrior": {"another mesh with its T-pose": other_mesh},
    "MockHandEstimator": {"wrists": with_wrists},
    "MockKeypointDetector": {"world points": with_world(right=1)},
    "MockRelativePointmap": {
        "refused without people": raising(
            BackendError("hints.people is needed"), lambda image, hints: hints.people is None
        ),
    },
}
"""Mock -> other form of an answer, which is no fault."""

NOISY = {
    "MockSegmenter": {
        "padding left": ("masks_are_in_place", with_masks(lambda m: moved(m, 0, 6, False))),
        "masks 3 % too large": ("masks_are_in_place", with_masks(enlarged)),
    },
    "MockInpainter": {
        "blended": ("fill_has_the_colours_around", with_fill(blended)),
        "one pixel down": ("fill_is_not_shifted", with_fill(lambda f, *_: moved(f, 0, 1))),
        "BGR": ("fill_has_the_colours_around", with_fill(lambda f, *_: f[..., ::-1])),
    },
    "MockMetricDepth": {
        "canonical focal length": (
            "depth_does_not_depend_on_the_focal_length",
            lambda a, i, _: replace(a, depth=a.depth * 0.94 * i.shape[1] / a.intrinsics.fx),
        ),
        "along the ray": (
            "depth_is_along_z_and_upright",
            lambda a, *_: replace(a, depth=a.depth * stretch(a.intrinsics)),
        ),
        "mean with the mirrored photo": (
            "depth_is_along_z_and_upright",
            fields(depth=lambda z: (z + z[:, ::-1]) / 2),
        ),
        "8 bit": ("depth_is_where_it_can_be_known", fields(depth=eight_bit)),
        "sky at 65.5 m": (
            "depth_is_where_it_can_be_known",
            fields(depth=lambda z: np.nan_to_num(z, nan=65.5)),
        ),
        "one pixel to the right": ("depth_is_not_shifted", fields(depth=lambda z: moved(z, 1, 0))),
    },
    "MockRelativePointmap": {
        "ray length": ("depth_is_along_z_and_upright", with_z(lambda z, c: z * stretch(c))),
        "sky valid": ("depth_is_where_it_can_be_known", sky_valid),
        "half a pixel off": ("points_lie_on_the_rays_of_the_camera", half_a_pixel_right),
        "mean with the mirrored photo": (
            "depth_is_along_z_and_upright",
            with_z(mean_with_mirrored),
        ),
    },
    "MockKeypointDetector": {
        "half a pixel off": (
            "joints_are_not_shifted_or_scaled",
            fields(points=lambda points: points + 0.5),
        ),
        "sigmoid twice": ("confidence_tells_hidden_joints", fields(confidence=sigmoid)),
        "mean with the mirrored photo": ("joints_are_those_of_the_person", both_sides),
        "stretched crop": ("joints_are_those_of_the_person", with_points(square_crop)),
        "corner of the cell": ("joints_are_not_shifted_or_scaled", with_points(in_cells)),
    },
    "MockBodyEstimator": {
        "Euler angles": ("joints_turn_as_in_the_photo", with_pose(euler)),
        "inverse root": (
            "bodies_face_the_right_way",
            with_parameters(lambda p: {"global_orient": -p.global_orient}),
        ),
        "distance for another focal length": (
            "distance_does_not_depend_on_the_crop",
            at_a_wide_angle,
        ),
        "seen by the camera of a crop": ("bodies_face_the_right_way", seen_by_the_crop),
        "mean with the mirrored photo": (
            "joints_turn_as_in_the_photo",
            with_pose(lambda pose: (pose + pose[:, _MIRRORED]) / 2),
        ),
        "0.25 m too low": (
            "bodies_are_in_place",
            pelvis_at(lambda pelvis: pelvis + np.array([0, 0.25, 0])),
        ),
    },
    "MockHandEstimator": {
        "left hand not mirrored": (
            "hands_are_those_of_the_person",
            fields(rotvecs=lambda r: r * np.stack([_LEFT_FLIP, _LEFT_FLIP**2])[:, None]),
        ),
        "thumb first": (
            "hands_are_those_of_the_person",
            fields(rotvecs=lambda r: r[:, :, _FINGERS[[4, 0, 1, 3, 2]].ravel()]),
        ),
        "inverse": ("hands_are_those_of_the_person", fields(rotvecs=np.negative)),
    },
    "MockContactPrior": {
        "vertices moved by 37": (
            "contact_is_more_likely_where_bodies_touch",
            fields(probability=lambda p: np.roll(p, 37, axis=1)),
        ),
        "constant": (
            "contact_is_more_likely_where_bodies_touch",
            fields(probability=lambda p: np.full_like(p, 0.5)),
        ),
        "second half reversed": ("vertices_are_in_order", fields(probability=second_half_reversed)),
        "mirrored": ("vertices_are_in_order", fields(probability=mirrored_contact)),
    },
}
"""Mock -> fault -> the check that finds it, and ``change(answer, *arguments)``; looked for among
the errors of a network too.
"""

EXACT = {
    "MockSegmenter": {
        "everybody in one mask": ("masks_lie_on_people", in_one_mask),
        "inverted masks": ("masks_lie_on_people", inverted),
        "worst score first": (
            "masks_lie_on_people",
            fields(masks=np.flipud, boxes=np.flipud, scores=np.flipud),
        ),
        "boxes with the last pixel": (
            "boxes_are_tight",
            fields(boxes=lambda boxes: boxes - [0, 0, 1, 1]),
        ),
        "boxes of upper bodies": (
            "boxes_enclose_their_masks",
            fields(boxes=lambda b: np.column_stack([b[:, :3], (b[:, 1] + b[:, 3]) / 2])),
        ),
        "floor one pixel to the right": (
            "floor_is_in_place",
            with_floor(lambda floor, people: moved(floor, 1, 0) & ~people),
        ),
        "an inverted floor": (
            "floor_mask_excludes_people",
            with_floor(lambda floor, people: ~floor & ~people),
        ),
        "people who are floor": ("floor_mask_excludes_people", with_floor(np.logical_or)),
        "None without people": (
            "accepts_a_photo_without_people",
            lambda a, *_: a if len(a) else None,
        ),
    },
    "MockInpainter": {
        "whole picture one pixel to the right": (
            "only_the_mask_is_filled",
            lambda filled, image, mask: moved(filled, 1, 0) if mask.any() else filled,
        ),
        "an empty mask is an error": (
            "an_empty_mask_changes_nothing",
            raising(
                ValueError("zero-size array to reduction operation"),
                lambda image, mask: not mask.any() and image.shape[0] > 32 and image.std() > 0,
            ),
        ),
        "a full mask is an error": (
            "an_empty_mask_changes_nothing",
            raising(IndexError("index 0 is out of bounds"), lambda image, mask: mask.all()),
        ),
    },
    "MockMetricDepth": {
        "text": ("returns_valid_output", fields(depth=lambda z: z.astype(str))),
        "padded to a multiple of 8": (
            "accepts_photos_of_people",
            fields(depth=lambda z: np.pad(z, [(0, -n % 8) for n in z.shape], mode="edge")),
        ),
        "portraits left lying": (
            "accepts_photos_of_people",
            fields(depth=lambda z: z.T if z.shape[0] > z.shape[1] else z),
        ),
        "one person at most": (
            "accepts_photos_of_people",
            raising(
                IndexError("index 1 is out of bounds"),
                lambda image, hints: hints.people is not None and len(hints.people) > 1,
            ),
        ),
        "tiny is an error": (
            "accepts_or_refuses_any_photo",
            raising(ValueError("output size (0, 1)"), lambda i, _: min(i.shape[:2]) < 32),
        ),
        "large is an error": (
            "accepts_or_refuses_any_photo",
            raising(AssertionError("at most 512 px"), lambda i, _: max(i.shape[:2]) > 512),
        ),
        "zero in the sky": (
            "accepts_or_refuses_any_photo",
            fields(depth=lambda z: np.where(np.isfinite(z), z, 0)),
        ),
        "hidden randomness": (
            "output_depends_on_the_photo_alone",
            fields(depth=lambda z: z * np.random.default_rng().normal(1, 0.01, z.shape)),
        ),
        "arrays of its own kind only": (
            "accepts_array_views",
            raising(ValueError("negative strides"), lambda image, _: min(image.strides) < 0),
        ),
        "hints that are there": ("works_without_hints", needing("people")),
        "only a corner": ("depth_is_where_it_can_be_known", fields(depth=only_corner)),
        "half-size grid": ("depth_is_where_it_can_be_known", fields(depth=of_half_a_grid)),
        "centimetres": ("depth_is_in_metres", fields(depth=lambda z: 100 * z)),
        "0.3 m too far": ("unknown_names_the_ambiguity", fields(depth=lambda z: z + 0.3)),
        "principal point half a pixel off": (
            "intrinsics_are_not_biased",
            fields(intrinsics=half_a_pixel_off),
        ),
        "a sigma in percent": ("states_what_it_promises", fields(scale_sigma=lambda _: 10.0)),
    },
    "MockRelativePointmap": {
        "a camera that is there": ("works_without_intrinsics", needing("intrinsics")),
        "hints that are there": ("works_without_hints", needing("people")),
        "no second call": (
            "accepts_the_photo_with_people",
            raising(BackendError("one call is enough"), lambda i, hints: hints.scene is not None),
        ),
        "offset of z not declared": (
            "unknown_names_the_ambiguity",
            with_z(lambda z, _: z + 0.3 * np.nanmedian(z)),
        ),
        "offset of 1 / z declared as one of z": (
            "unknown_names_the_ambiguity",
            after(
                with_z(lambda z, _: 1 / (1 / z + 0.3 / np.nanmedian(z))),
                fields(unknown=lambda _: "scale_shift"),
            ),
        ),
        "down": ("up_is_against_gravity", fields(up=np.negative)),
        "a sigma that is too small": (
            "up_is_against_gravity",
            fields(up=Rotation.from_euler("x", 9, degrees=True).apply),
        ),
        "the same up in a mirrored photo": (
            "up_is_against_gravity",
            fields(up=to_the_right, up_sigma=lambda _: 4.5),
        ),
    },
    "MockKeypointDetector": {
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "rows from left to right": ("rows_follow_the_people", sorted_rows),
        "points that lie nowhere on a body": (
            "skeleton_is_known",
            fields(skeleton=lambda _: Skeleton("dots", tuple(f"dot{i}" for i in range(33)))),
        ),
        "wrists exchanged": ("joints_are_those_of_the_person", with_wrists_exchanged),
        "world points with x to the left": ("world_points_are_metres", with_world(right=-1)),
    },
    "MockBodyEstimator": {
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "rows from left to right": ("rows_follow_the_people", sorted_rows),
        "hints that are there": ("works_without_hints", needing("floor")),
        "an unknown body": ("bodies_can_be_posed", fields(body_model=lambda _: "mhr")),
        "joints without hips": (
            "bodies_can_be_posed",
            after(with_joints(), fields(joints=hipless)),
        ),
        "a surface in millimetres": (
            "bodies_can_be_posed",
            after(with_joints(surface=True), fields(mesh=MILLIMETRES)),
        ),
        "an OpenGL camera": ("bodies_are_in_front", pelvis_at(lambda pelvis: pelvis * [1, -1, -1])),
        "joints about the pelvis": (
            "bodies_are_in_front",
            after(with_joints(), fields(joints=lambda joints: joints - joints[:, :1])),
        ),
        "joints with left and right exchanged": (
            "pose_is_not_turned_or_mirrored",
            with_joints(mirrored_order(tuple(JOINT_INDEX)[:22])),
        ),
        "distance times 1.4": ("bodies_are_as_far_away", pelvis_at(lambda pelvis: 1.4 * pelvis)),
        "observed inverted": ("observed_is_true_in_sight", fields(observed=np.logical_not)),
    },
    "MockHandEstimator": {
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "rows from left to right": ("rows_follow_the_people", sorted_rows),
        "longer than a turn": (
            "angles_are_radians",
            fields(rotvecs=lambda rotvecs: np.full_like(rotvecs, 4.0)),
        ),
        "wrists against the forearm": (
            "wrists_are_in_the_cameras_frame",
            after(with_wrists, fields(wrists=lambda wrists: np.full_like(wrists, 0.1))),
        ),
        "wrists exchanged": (
            "wrists_are_in_the_cameras_frame",
            after(with_wrists, fields(wrists=lambda wrists: wrists[:, ::-1].copy())),
        ),
    },
    "MockPersonObserver": {
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "1 is no touch": ("touch_is_that_of_the_parts", fields(touch=lambda p: 1 - p)),
        "right limbs touch": (
            "mirrored_photo_exchanges_sides",
            fields(touch=lambda p: 0 * p + [0.2, 0.8, 0.2, 0.8, 0.5]),
        ),
        "faces that look into the heads": (
            "head_looks_out_of_the_face",
            fields(head=np.negative),
        ),
    },
    "MockContactPrior": {
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "rows from left to right": ("rows_follow_the_people", sorted_rows),
        "normalised over people": (
            "rows_do_not_depend_on_other_people",
            fields(probability=lambda p: p * (1 - 0.1 * len(p))),
        ),
        "lower for all but the first": (
            "rows_do_not_depend_on_other_people",
            fields(probability=lambda p: np.concatenate([p[:1], p[1:] * 0.9])),
        ),
        "a mesh that is not given": ("mesh_is_known", fields(topology=lambda _: "smplx")),
        "a T-pose in millimetres": (
            "mesh_is_known",
            after(other_mesh, fields(rest=MILLIMETRES)),
        ),
        "sigmoid twice": (
            "contact_is_more_likely_where_bodies_touch",
            fields(probability=sigmoid),
        ),
    },
}
"""The same of faults that are looked for in networks without other errors alone."""
