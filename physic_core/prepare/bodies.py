"""Bodies that the user gives: whose they are, and how they enter the estimates of a photo."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from physic_core.backends.people import box_iou, boxes_from_masks, mask_iou
from physic_core.body.bones import ANCESTOR_MATRIX, pose_from_parameters
from physic_core.body.landmarks import keypoints_on_body
from physic_core.engine.state import MatchedBodies
from physic_core.errors import ConfigError, InputError
from physic_core.geometry.depth_comparison import turned_masks
from physic_core.geometry.raster import rasterize
from physic_core.interfaces.bodies import valid_body_rows
from physic_core.io.body_file import with_columns_of_zeros
from physic_core.prepare.people import LEAST_OVERLAP
from physic_core.types import BodyParameters
from physic_core.types.skeletons import SURE_CONFIDENCE, mirrored_order

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.io.body_file import GivenBodies
    from physic_core.types import (
        Bodies,
        BoolArray,
        FloatArray,
        IntArray,
        Intrinsics,
        Keypoints,
        People,
    )

_JOINTS = 22
_OFF = 0.15  # of the diagonal of a person's joints, from which on keypoints contradict a body
_MUCH_BETTER = 0.5  # of that, by which another reading of the file explains the keypoints
_FEWEST = 6  # keypoints that tell how a body stands in the picture


def in_configured_model(given: GivenBodies, model: BodyModel) -> GivenBodies:
    """Return bodies, which have been converted, with as many components as the model.

    Raises:
        InputError: one of them has numbers that are not finite, or too large.
    """
    p = given.bodies.parameters
    fitted = {
        name: with_columns_of_zeros(getattr(p, name), width)
        for name, width in (("betas", model.num_betas), ("expression", model.num_expression))
    }
    bodies = replace(given.bodies, parameters=replace(p, **fitted), joints=None, mesh=None)
    if not valid_body_rows(bodies).all():
        raise InputError(f"{given.source}: a body has numbers that are not finite, or too large")
    return replace(given, bodies=bodies)


def match_to_people(
    bodies: GivenBodies, model: BodyModel, camera: Intrinsics | None, people: People
) -> tuple[IntArray, BoolArray]:
    """Return the body (N,) of each person, -1 for none, and the outlines (M, H, W) bool of all
    bodies.

    Args:
        bodies: M bodies of the model, placed in the picture.
        model: of the bodies.
        camera: of the photo, for bodies that state none.
        people: N detected ones.

    Raises:
        InputError: the bodies are not of this photo.
    """
    outlines = _body_masks(bodies, model, camera, people.masks.shape[1:])
    drawn = outlines.any((1, 2))
    if not drawn.any():
        raise InputError(
            f"{bodies.source}: none of its {len(bodies)} bodies is in the picture: are they in "
            f"world coordinates, behind the camera, with y up, or in millimeters? They are needed "
            f"in the camera's frame: x right, y down, z forward, meters"
        )
    rows = np.full(len(people), -1)
    if not len(people):
        return rows, outlines
    if turned := turned_masks(outlines[drawn], people.masks):
        raise InputError(f"{bodies.source}: its bodies are of a picture that is {turned}")
    boxes = boxes_from_masks(outlines).astype(np.float64)
    overlap = box_iou(boxes, np.asarray(people.boxes, np.float64))
    overlap += mask_iou(outlines, people.masks)
    allowed = overlap > LEAST_OVERLAP
    for body, person in zip(*linear_sum_assignment(np.where(allowed, -overlap, 1.0)), strict=True):
        if allowed[body, person]:
            rows[person] = body
    if (rows < 0).all():
        x0, y0, x1, y1 = boxes[drawn.argmax()].round().astype(int).tolist()
        raise InputError(
            f"{bodies.source}: none of its {len(bodies)} bodies is where one of the {len(people)} "
            f"people of the photo is; the first is in the box {x0},{y0},{x1},{y1} px: are they of "
            f"another photo, or of another size or crop of it?"
        )
    return rows, outlines


def _body_masks(
    given: GivenBodies, model: BodyModel, camera: Intrinsics | None, size: tuple[int, ...]
) -> BoolArray:
    """Return the outlines (M, H, W) of bodies in their own camera."""
    if given.camera is None and camera is None:
        raise ConfigError(
            f"{given.source} states no camera, and the photo has none: give the camera that its "
            f"bodies are for, photo.focal_px or photo.intrinsics"
        )
    posed = model.double(*pose_from_parameters(given.bodies.parameters, dtype=torch.float64))
    vertices = posed.vertices.numpy()
    f, c = np.split(_cameras(given, camera), 2, axis=1)
    z = vertices[..., 2:]
    pixels = vertices[..., :2] / np.where(z > 0, z, np.nan) * f[:, None] + c[:, None]
    pixels = np.clip(np.nan_to_num(pixels, nan=-1e6), -1e6, 1e6)
    drawn = rasterize(torch.from_numpy(pixels), posed.vertices[..., 2], model.faces, *size)
    return drawn.numpy() >= 0


def _cameras(given: GivenBodies, camera: Intrinsics | None) -> FloatArray:
    """Return fx, fy, cx, cy (M, 4) of the camera of each body."""
    if given.camera is not None:
        return given.camera
    assert camera is not None
    return np.tile([camera.fx, camera.fy, camera.cx, camera.cy], (len(given), 1))


def place_by_keypoints(given: GivenBodies, model: BodyModel, photo: PhotoContent) -> GivenBodies:
    """Return the only body, which has no place, where the keypoints of the only person put it.

    Raises:
        InputError: there are several bodies or people.
    """
    if len(given) != 1 or len(photo.people) != 1:
        raise InputError(
            f"{given.source} has {len(given)} bodies that state no place, and the photo "
            f"{len(photo.people)} people: choose one person with --person, or give a file with "
            f"translations"
        )
    p = given.bodies.parameters
    keypoints, landmarks = _body_landmarks(p, model, photo)
    visible = keypoints.confidence[0] >= SURE_CONFIDENCE
    body = landmarks[0, visible]
    translation = _translation(body, keypoints.points[0, visible], photo.camera)
    if len(body) < _FEWEST or (body[:, 2] + translation[2] <= 0).any():
        raise InputError("the keypoints do not place the given body: give one with a translation")
    placed = replace(given.bodies, parameters=replace(p, transl=p.transl + np.float32(translation)))
    return replace(given, bodies=placed, is_placed=True)


def _translation(body: FloatArray, points: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return the translation (3,) that puts points of a body (n, 3) on points (n, 2) px."""
    ray = (points - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    # x + tx = r (z + tz), for both axes
    slopes = np.zeros((len(points), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1
    slopes[..., 2] = -ray
    target = ray * body[:, 2:] - body[:, :2]
    return np.linalg.lstsq(slopes.reshape(-1, 3), target.reshape(-1), rcond=None)[0]


def _body_landmarks(
    bodies: BodyParameters, model: BodyModel, photo: PhotoContent
) -> tuple[Keypoints, FloatArray]:
    """Return the J keypoints of people that lie on bodies, and the same points (M, J, 3) of the
    bodies.
    """
    keypoints = keypoints_on_body(photo.keypoints)
    posed = model.double(*pose_from_parameters(bodies, dtype=torch.float64))
    return keypoints, model.double.landmarks(posed, keypoints.joint_set).numpy()


def with_given_bodies(
    given: GivenBodies, rows: IntArray, photo: PhotoContent, bodies: Bodies, model: BodyModel
) -> tuple[Bodies, MatchedBodies, tuple[str, ...]]:
    """Return the bodies of N people with the given ones in place of estimated ones, whose they are,
    and warnings.

    A given body keeps its place in the picture. Its distance grows with the focal length of the
    photo over that of its own camera. Hands that are flat are the estimated ones.

    Args:
        given: of the model, placed in the picture.
        rows: (N,) the body of each person, -1 for none.
        photo: of the people.
        bodies: estimated, NaN where there is none.
        model: of both.

    Raises:
        InputError: keypoints show that the bodies are upside down.
    """
    has_given_body = rows >= 0
    parameters, joints = _in_photo_camera(given, rows[has_given_body], model, photo.camera)
    warnings = _contradictions(given.source, parameters, model, photo, has_given_body)
    distance = np.inf if given.distance_sigma is None else given.distance_sigma
    errors = {
        "rotation_sigma": rotation_sigmas(joints, given.sigma_m),
        "joint_sigma": np.full(joints.shape[:2], given.sigma_m),
        "lean_sigma": np.full(len(joints), np.nan),
        "distance_sigma": np.full(len(joints), distance),
    }
    stated: dict[str, Any] = {
        name: _with_replaced_rows(getattr(bodies, name), has_given_body, value)
        for name, value in errors.items()
    }
    changed = replace(
        bodies,
        parameters=_merged_parameters(bodies.parameters, has_given_body, parameters),
        joints=None,
        mesh=None,
        **stated,
    )
    return (
        changed,
        MatchedBodies(
            given.source, has_given_body, _with_replaced_rows(None, has_given_body, joints)
        ),
        warnings,
    )


def _in_photo_camera(
    given: GivenBodies, chosen: IntArray, model: BodyModel, camera: Intrinsics
) -> tuple[BodyParameters, FloatArray]:
    """Return the chosen bodies (n,) where their joints are at the same pixels of the photo's
    camera, and the joints (n, 55, 3).

    One joint does not tell the place: a crop's camera is far away, so that what is near is as large
    as what is behind.
    """
    p = given.bodies.parameters[chosen]
    joints = model.double(*pose_from_parameters(p, dtype=torch.float64)).joints.numpy()
    body = joints[:, :_JOINTS]
    f, c = np.split(_cameras(given, camera)[chosen, None], 2, axis=2)
    pixels = body[..., :2] / body[..., 2:] * f + c
    move = np.reshape(
        [_translation(*one, camera) for one in zip(body, pixels, strict=True)], (len(p), 3)
    )
    return replace(p, transl=p.transl + np.float32(move)), joints + move[:, None]


def _merged_parameters(
    estimated: BodyParameters, has_given_body: BoolArray, given: BodyParameters
) -> BodyParameters:
    """Return the parameters of N people, with given ones of some; hands that are flat are
    estimated.
    """
    merged = {
        one.name: _with_replaced_rows(
            getattr(estimated, one.name), has_given_body, getattr(given, one.name)
        )
        for one in fields(given)
    }
    for name in ("left_hand_pose", "right_hand_pose"):
        hands = getattr(estimated, name)
        flat = ~merged[name].any(1) & np.isfinite(hands).all(1)
        merged[name][flat] = hands[flat]
    return BodyParameters(**merged)


def _with_replaced_rows(
    values: FloatArray | None, has_given_body: BoolArray, new: FloatArray
) -> FloatArray:
    """Return values (N, ...) of people, NaN if there are none, with those of some (n, ...)."""
    out = np.full((len(has_given_body), *new.shape[1:]), np.nan, np.float32)
    if values is not None:
        out[:] = values
    out[has_given_body] = new
    return out


def rotation_sigmas(joints: FloatArray, sigma_m: float) -> FloatArray:
    """Return the equal errors (M, 22), radians, of independent turns of pelvis and body joints that
    move the joints (M, 55, 3) by a root mean square of ``sigma_m`` relative to the pelvis.

    A turn by an angle a about a random axis moves a point at the distance r by a r sqrt(2 / 3) in
    the root mean square.
    """
    body = joints[:, :_JOINTS]
    apart = np.square(body[:, :, None] - body[:, None]).sum(-1)
    moved = 2 / 3 * (apart * ANCESTOR_MATRIX[:_JOINTS, :_JOINTS]).sum(2)
    angle = sigma_m / np.sqrt(moved[:, 1:].mean(1))
    return np.repeat(angle[:, None], _JOINTS, axis=1)


def _contradictions(
    source: str,
    given: BodyParameters,
    model: BodyModel,
    photo: PhotoContent,
    has_given_body: BoolArray,
) -> tuple[str, ...]:
    """Return warnings of bodies (n,) of some people (N,) bool that the keypoints contradict.

    Raises:
        InputError: most bodies are upside down by the keypoints.
    """
    error, by_sides, by_turn = _keypoint_readings(given, model, photo, has_given_body).T
    far = error > _OFF
    if 2 * (far & (by_turn < _MUCH_BETTER * error)).sum() > len(error):
        raise InputError(
            f"{source}: its bodies stand upside down where the photo shows people: y points down "
            f"in the camera's frame; turn (x, y, z) to (x, -y, -z)"
        )
    swapped = far & (by_sides < _MUCH_BETTER * error)
    warnings = []
    for which, what in (
        (swapped, "left and right of the given bodies seem swapped by the keypoints of"),
        (far & ~swapped, "the given bodies are far from the keypoints of"),
    ):
        people = np.flatnonzero(has_given_body)[which].tolist()
        if people:
            shares = ", ".join(f"{share:.0%}" for share in error[which])
            warnings.append(
                f"{source}: {what} person {', '.join(map(str, people))} ({shares} of their size): "
                f"check them in the preview"
            )
    return tuple(warnings)


def _keypoint_readings(
    given: BodyParameters, model: BodyModel, photo: PhotoContent, has_given_body: BoolArray
) -> FloatArray:
    """Return the mean distances (n, 3) of bodies from the keypoints of their people, as shares of
    their size: as they are, with left and right exchanged, and upside down; NaN with few keypoints.
    """
    camera = photo.camera
    keypoints, landmarks = _body_landmarks(given, model, photo)
    drawn = landmarks[..., :2] / np.maximum(landmarks[..., 2:], 1e-3)
    drawn = drawn * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    mirrored = mirrored_order(keypoints.joint_set.names)
    errors = np.full((len(drawn), 3), np.nan)
    people = zip(
        drawn, keypoints.points[has_given_body], keypoints.confidence[has_given_body], strict=True
    )
    for row, (body, points, confidence) in enumerate(people):
        visible = confidence >= SURE_CONFIDENCE
        if visible.sum() >= _FEWEST:
            turned = body * [1, -1] + [0, 2 * body[visible, 1].mean()]
            readings = np.stack([body, body[mirrored], turned])[:, visible]
            apart = np.linalg.norm(readings - points[visible], axis=-1).mean(1)
            errors[row] = apart / np.linalg.norm(np.ptp(points[visible], axis=0))
    return errors
