"""Faults that a wrapper of a network may have, as changes of what a mock returns, each with the
check that finds it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physic_core.backends.people import boxes_from_masks
from physic_core.body import load_body, rest_mesh_of_model
from physic_core.body.bones import rotations_from_parameters
from physic_core.errors import BackendError
from physic_core.types import (
    TOUCH_PARTS,
    TOUCHED,
    Bodies,
    ContactProbability,
    Mesh,
    RestMesh,
    Skeleton,
)
from physic_mock.recognition import match_masks_to_world, recognise_world
from physic_testing.conformance.cases import rows_of
from physic_testing.conformance.truth import embedded_surface, true_wrists

WORLD = np.eye(len(TOUCHED))[TOUCHED.index("world")].astype(np.float32)
RIGHT_LIMBS_TOUCH = np.where(
    np.char.startswith(TOUCH_PARTS, "right")[:, None], [0.8, 0, 0, 0, 0.2], [0.2, 0, 0, 0, 0.8]
)
"""Whether a part touches the world, (5,); of each part what it touches (10, 5): of the right ones
the world.
"""


def fields(**changes):
    """A change of an answer's fields, each by a function, but for those that it does not have."""

    def change(answer, *_):
        values = {name: getattr(answer, name) for name in changes}
        changed = {
            name: changes[name](value) for name, value in values.items() if value is not None
        }
        return replace(answer, **changed)

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
    shifted = array[np.clip(rows, 0, len(rows) - 1)][:, np.clip(columns, 0, len(columns) - 1)]
    if empty is not None:
        shifted[(rows < 0) | (rows >= len(rows))] = empty
        shifted[:, (columns < 0) | (columns >= len(columns))] = empty
    return shifted


# ---- people, boxes and floor


def with_masks(change):
    def changed(people, *_):
        if not len(people):
            return people
        masks = np.stack([change(mask) for mask in people.masks])
        return replace(people, masks=masks, boxes=boxes_from_masks(masks))

    return changed


def in_one_mask(people, *_):
    if not len(people):
        return people
    masks = people.masks.any(axis=0, keepdims=True)
    one = rows_of(people, np.arange(1), len(people))
    return replace(one, masks=masks, boxes=boxes_from_masks(masks))


# ---- keypoints


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


def only_corner(z):
    kept = np.full_like(z, np.nan)
    corner = np.s_[: z.shape[0] // 3, : z.shape[1] // 3]
    kept[corner] = z[corner]
    return kept


def with_z(change):
    """A point map with other z, on the same rays: ``change(z, camera)``."""

    def changed(pointmap, *_):
        z = pointmap.points[..., 2]
        factor = change(z, pointmap.intrinsics) / z
        return replace(pointmap, points=(pointmap.points * factor[..., None]).astype(np.float32))

    return changed


def to_the_right(up):
    sideways = np.array([0.2, *up[1:]])
    return sideways / np.linalg.norm(sideways)


# ---- bodies


def with_parameters(change):
    """Some parameters changed: ``change(parameters)`` returns their values by name."""

    def changed(bodies, *_):
        p = bodies.parameters
        values = change(p).items() if len(p) else ()
        parameters = {name: np.asarray(value, np.float32) for name, value in values}
        return replace(bodies, parameters=replace(p, **parameters))

    return changed


def pelvis_at(change):
    """Bodies moved: ``change(pelvis)`` of the places (N, 3) of the pelvises."""

    def changed(bodies, *_):
        if not len(bodies.parameters):
            return bodies
        pelvis = embedded_surface(bodies)[1][:, 0]
        return with_parameters(lambda p: {"transl": p.transl + change(pelvis) - pelvis})(bodies)

    return changed


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
        inputs = (torch.from_numpy(v) for v in (bodies.parameters.betas, p.transl))
        with torch.no_grad():
            out = load_body("embedded")(rotations_from_parameters(bodies.parameters), *inputs)
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
    recognised = recognise_world(image)
    rows = match_masks_to_world(recognised, people)
    return replace(hands, wrists=true_wrists(recognised.world).astype(np.float32)[rows])


def other_mesh(contact, *_):
    rest, order = shuffled()
    return ContactProbability(contact.probability[:, order], "shuffled", rest)


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

FAULTS = {
    "MockSegmenter": {
        "everybody in one mask": ("masks_lie_on_people", in_one_mask),
        "worst score first": (
            "masks_lie_on_people",
            fields(masks=np.flipud, boxes=np.flipud, scores=np.flipud),
        ),
    },
    "MockInpainter": {
        "whole picture one pixel to the right": (
            "only_the_mask_is_filled",
            lambda filled, image, mask: moved(filled, 1, 0) if mask.any() else filled,
        ),
        "values from 0 to 1": (
            "fill_has_the_colours_around",
            lambda filled, _, mask: np.where(mask[..., None], filled // 255, filled),
        ),
        "an empty mask is an error": (
            "an_empty_mask_changes_nothing",
            raising(
                ValueError("zero-size array to reduction operation"),
                lambda image, mask: not mask.any() and image.shape[0] > 32 and image.std() > 0,
            ),
        ),
    },
    "MockMetricDepth": {
        "a sigma for other photos": (
            "stated_errors_hold",
            fields(depth=lambda z: 1.15 * z, scale_sigma=lambda _: 0.001),
        ),
        "sky at 65.5 m": (
            "depth_is_where_it_can_be_known",
            fields(depth=lambda z: np.nan_to_num(z, nan=65.5)),
        ),
        "text": ("returns_valid_output", fields(depth=lambda z: z.astype(str))),
        "portraits left lying": (
            "accepts_photos_of_people",
            fields(depth=lambda z: z.T if z.shape[0] > z.shape[1] else z),
        ),
        "tiny is an error": (
            "accepts_or_refuses_any_photo",
            raising(ValueError("output size (0, 1)"), lambda i, _: min(i.shape[:2]) < 32),
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
        "0.3 m too far": ("unknown_names_the_ambiguity", fields(depth=lambda z: z + 0.3)),
        "a sigma in percent": ("states_what_it_promises", fields(scale_sigma=lambda _: 10.0)),
    },
    "MockRelativePointmap": {
        "down for up": ("stated_errors_hold", fields(up=np.negative)),
        "a camera that is there": ("works_without_intrinsics", needing("intrinsics")),
        "no second call": (
            "accepts_the_photo_with_people",
            raising(BackendError("one call is enough"), lambda i, hints: hints.scene is not None),
        ),
        "offset of 1 / z declared as one of z": (
            "unknown_names_the_ambiguity",
            after(
                with_z(lambda z, _: 1 / (1 / z + 0.3 / np.nanmedian(z))),
                fields(unknown=lambda _: "scale_shift"),
            ),
        ),
        "the same up in a mirrored photo": (
            "up_is_mirrored_in_a_mirrored_photo",
            fields(up=to_the_right, up_sigma=lambda _: 4.5),
        ),
    },
    "MockKeypointDetector": {
        "all points sure": ("confidence_tells_hidden_joints", fields(confidence=np.ones_like)),
        "an error without people": ("accepts_a_photo_without_people", NO_PEOPLE_IS_AN_ERROR),
        "rows from left to right": ("rows_follow_the_people", sorted_rows),
        "points that lie nowhere on a body": (
            "skeleton_is_known",
            fields(skeleton=lambda _: Skeleton("dots", tuple(f"dot{i}" for i in range(33)))),
        ),
    },
    "MockBodyEstimator": {
        "an unknown body": ("bodies_can_be_posed", fields(body_model=lambda _: "mhr")),
        "joints without hips": (
            "bodies_can_be_posed",
            after(with_joints(), fields(joints=hipless)),
        ),
        "a surface in millimeters": (
            "bodies_can_be_posed",
            after(with_joints(surface=True), fields(mesh=MILLIMETRES)),
        ),
        "an OpenGL camera": (
            "bodies_are_as_far_away",
            pelvis_at(lambda pelvis: pelvis * [1, -1, -1]),
        ),
    },
    "MockHandEstimator": {
        "wrists against the forearm": (
            "wrists_are_in_the_cameras_frame",
            after(with_wrists, fields(wrists=lambda wrists: np.full_like(wrists, 0.1))),
        ),
    },
    "MockContactPrior": {
        "normalized over people": (
            "rows_do_not_depend_on_other_people",
            fields(probability=lambda p: p * (1 - 0.1 * len(p))),
        ),
        "lower for all but the first": (
            "rows_do_not_depend_on_other_people",
            fields(probability=lambda p: np.concatenate([p[:1], p[1:] * 0.9])),
        ),
        "a mesh that is not given": ("mesh_is_known", fields(topology=lambda _: "smplx")),
        "a T-pose in millimeters": (
            "mesh_is_known",
            after(other_mesh, fields(rest=MILLIMETRES)),
        ),
    },
    "MockPersonObserver": {
        **{
            f"{name} for everybody": (
                "probabilities_agree_with_the_worlds",
                fields(
                    **{
                        name: lambda p: np.full_like(p, 0.9),
                        f"{name}_share": lambda s: 0 * np.nan_to_num(s) + 0.1,
                    }
                ),
            )
            for name in ("child", "away")
        },
        "touch of the world for everybody": (
            "touch_is_that_of_the_parts",
            fields(
                touch=lambda p: np.full_like(p, 0.025) + WORLD * 0.875,
                touch_share=lambda s: np.full_like(s, 0.225) - WORLD * 0.125,
            ),
        ),
        "postures in another order": (
            "probabilities_agree_with_the_worlds",
            fields(posture=lambda p: np.roll(p, 1, axis=1)),
        ),
        "a sigma for other photos": (
            "stated_errors_hold",
            fields(head=Rotation.from_euler("y", 25, degrees=True).apply),
        ),
        "right limbs touch": (
            "mirrored_photo_exchanges_sides",
            fields(touch=lambda p: 0 * p + RIGHT_LIMBS_TOUCH),
        ),
    },
}
"""Mock -> fault that no reading of the kit is -> the check that finds it, and ``change(answer,
*arguments)``.
"""
