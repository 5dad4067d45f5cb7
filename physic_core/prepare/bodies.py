"""Bodies that the user gives: whose they are, and how they enter the estimates of a photo."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from physic_core.backends.people import box_iou, boxes_from_masks
from physic_core.body.bones import ANCESTOR_MATRIX, pose_from_parameters
from physic_core.body.landmarks import keypoints_on_body
from physic_core.engine.state import MatchedBodies
from physic_core.errors import ConfigError, InputError
from physic_core.geometry.raster import rasterize
from physic_core.geometry.readings import turned_masks
from physic_core.interfaces.bodies import valid_body_rows
from physic_core.types.skeletons import mirrored_order

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.photo import PhotoContent
    from physic_core.io.body_file import GivenBodies
    from physic_core.types import Bodies, BoolArray, FloatArray, IntArray, Intrinsics, People

_LEAST_OVERLAP = 0.3
"""Least overlap of outlines or boxes of a body and the person whose it is."""
_JOINTS = 22
_SEEN = 0.5  # least confidence of keypoints that can contradict a body
_OFF = 0.15  # of the diagonal of a person's joints, from which on keypoints contradict a body
_MUCH_BETTER = 0.5  # of that, by which another reading of the file explains the keypoints
_FEWEST = 6  # keypoints that tell how a body stands in the picture


def of_model(given: GivenBodies, model: BodyModel) -> GivenBodies:
    """Return bodies, which have been converted, with as many components as the model.

    Raises:
        InputError: one of them has numbers that are not finite, or too large.
    """
    p = given.bodies.parameters
    widths = {"betas": model.num_betas, "expression": model.num_expression}
    fitted = {name: _with_columns(getattr(p, name), width) for name, width in widths.items()}
    bodies = replace(given.bodies, parameters=replace(p, **fitted), joints=None, mesh=None)
    if not valid_body_rows(bodies).all():
        raise InputError(f"{given.source}: a body has numbers that are not finite, or too large")
    return replace(given, bodies=bodies)


def _with_columns(values: FloatArray, width: int) -> FloatArray:
    full = np.zeros((len(values), width), np.float32)
    full[:, : values.shape[1]] = values[:, :width]
    return full


def match_to_people(
    given: GivenBodies, model: BodyModel, camera: Intrinsics | None, people: People
) -> tuple[IntArray, BoolArray]:
    """Return the body (N,) of each person, -1 for none, and the outlines (M, H, W) bool of all
    bodies.

    Args:
        given: M bodies of the model, placed in the picture.
        model: of the bodies.
        camera: of the photo, for bodies that state none.
        people: N detected ones.

    Raises:
        InputError: the bodies are not of this photo.
    """
    outlines = _outlines(given, model, camera, people.masks.shape[1:])
    drawn = outlines.any((1, 2))
    if not drawn.any():
        raise InputError(
            f"{given.source}: none of its {len(given)} bodies is in the picture: are they in world "
            f"coordinates, behind the camera, with y up, or in millimeters? They are needed in the "
            f"camera's frame: x right, y down, z forward, meters"
        )
    rows = np.full(len(people), -1)
    if not len(people):
        return rows, outlines
    if turned := turned_masks(outlines[drawn], people.masks):
        raise InputError(f"{given.source}: its bodies are of a picture that is {turned}")
    boxes = boxes_from_masks(outlines).astype(np.float64) if given.boxes is None else given.boxes
    flat = outlines.reshape(len(outlines), -1).astype(np.float32)
    masks = people.masks.reshape(len(people), -1).astype(np.float32)
    both = flat @ masks.T
    union = flat.sum(1)[:, None] + masks.sum(1) - both
    overlap = box_iou(boxes, np.asarray(people.boxes, np.float64)) + both / np.maximum(union, 1)
    allowed = overlap > _LEAST_OVERLAP
    for body, person in zip(*linear_sum_assignment(np.where(allowed, -overlap, 1.0)), strict=True):
        if allowed[body, person]:
            rows[person] = body
    if (rows < 0).all():
        x0, y0, x1, y1 = boxes[drawn.argmax()].round().astype(int).tolist()
        raise InputError(
            f"{given.source}: none of its {len(given)} bodies is where one of the {len(people)} "
            f"people of the photo is; the first is in the box {x0},{y0},{x1},{y1} px: are they of "
            f"another photo, or of another size or crop of it?"
        )
    return rows, outlines


def _outlines(
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
    return np.asarray(drawn.numpy() >= 0)


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
    points, landmarks = _landmarks(given, model, photo)
    seen = photo.keypoints.confidence[0, photo.keypoints.joint_set.fitted] >= _SEEN
    p = given.bodies.parameters
    place = _translation(landmarks[0, seen], points[0, seen], photo.camera)
    placed = replace(given.bodies, parameters=replace(p, transl=p.transl + np.float32(place)))
    return replace(given, bodies=placed, is_placed=True)


def _translation(landmarks: FloatArray, points: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return the translation (3,) that puts landmarks (n, 3) on points (n, 2) px.

    Raises:
        InputError: there are too few, or none puts them in front of the camera.
    """
    ray = (points - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    # x + tx = r (z + tz), for both axes
    slopes = np.zeros((len(points), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1
    slopes[..., 2] = -ray
    target = ray * landmarks[:, 2:] - landmarks[:, :2]
    found: FloatArray = np.linalg.lstsq(slopes.reshape(-1, 3), target.reshape(-1), rcond=None)[0]
    if len(points) < _FEWEST or (landmarks[:, 2] + found[2] <= 0).any():
        raise InputError("the keypoints do not place the given body: give one with a translation")
    return found


def _landmarks(
    given: GivenBodies, model: BodyModel, photo: PhotoContent
) -> tuple[FloatArray, FloatArray]:
    """Return the keypoints (N, J, 2) px of people that lie on bodies, and the same points (M, J, 3)
    of the bodies.
    """
    keypoints = keypoints_on_body(photo.keypoints)
    posed = model.double(*pose_from_parameters(given.bodies.parameters, dtype=torch.float64))
    return keypoints.points, model.double.landmarks(posed, keypoints.joint_set).numpy()


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
    p = given.bodies.parameters
    posed = model.double(*pose_from_parameters(p, dtype=torch.float64))
    pelvis = posed.joints[:, 0].numpy()
    move = _in_camera(pelvis, _cameras(given, photo.camera), photo.camera) - pelvis
    own = replace(p, transl=(p.transl + move).astype(p.transl.dtype))
    joints = posed.joints.numpy() + move[:, None]
    is_of = rows >= 0
    chosen = rows[is_of]
    merged = {}
    for one in fields(own):
        value = np.array(getattr(bodies.parameters, one.name))
        new = getattr(own, one.name)[chosen].astype(value.dtype)
        if one.name.endswith("hand_pose"):
            flat = ~new.any(1, keepdims=True) & np.isfinite(value[is_of]).all(1, keepdims=True)
            new = np.where(flat, value[is_of], new)
        value[is_of] = new
        merged[one.name] = value
    placed = replace(given, bodies=replace(given.bodies, parameters=own), camera=None)
    warnings = _contradictions(placed, model, photo, rows)
    distance = np.inf if given.distance_sigma is None else given.distance_sigma
    changed = replace(
        bodies,
        parameters=replace(own, **merged),
        joints=None,
        mesh=None,
        rotation_sigma=_changed(bodies.rotation_sigma, rows, turn_sigmas(joints, given.sigma_m)),
        joint_sigma=_changed(bodies.joint_sigma, rows, np.full((len(joints), 55), given.sigma_m)),
        lean_sigma=_changed(bodies.lean_sigma, rows, np.full(len(joints), np.nan)),
        distance_sigma=_changed(None, rows, np.full(len(joints), distance)),
    )
    matched = _changed(None, rows, joints)
    return changed, MatchedBodies(given.source, is_of, matched), warnings


def _in_camera(points: FloatArray, own: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return points (M, 3) of cameras (M, 4) at the same pixels of another one; distances grow with
    the focal length.
    """
    f, c = np.split(own, 2, axis=1)
    focal = np.array([camera.fx, camera.fy])
    z = points[:, 2:] * np.sqrt(focal.prod() / f.prod(1, keepdims=True))
    pixels = points[:, :2] / points[:, 2:] * f + c
    return np.concatenate([(pixels - [camera.cx, camera.cy]) / focal * z, z], 1)


def _changed(values: FloatArray | None, rows: IntArray, new: FloatArray) -> FloatArray:
    """Return values (N, ...) of people, NaN if there are none, with those of their bodies
    (M, ...).
    """
    out = np.full((len(rows), *new.shape[1:]), np.nan, np.float32)
    if values is not None:
        out[:] = values
    out[rows >= 0] = new[rows[rows >= 0]]
    return out


def turn_sigmas(joints: FloatArray, sigma_m: float) -> FloatArray:
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
    given: GivenBodies, model: BodyModel, photo: PhotoContent, rows: IntArray
) -> tuple[str, ...]:
    """Return warnings of bodies whose left and right are exchanged by the keypoints.

    Raises:
        InputError: most bodies are upside down by the keypoints.
    """
    points, landmarks = _landmarks(given, model, photo)
    camera = photo.camera
    drawn = landmarks[..., :2] / np.maximum(landmarks[..., 2:], 1e-3)
    drawn = drawn * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    mirrored = mirrored_order(keypoints_on_body(photo.keypoints).joint_set.names)
    swapped, turned = [], []
    for person in np.flatnonzero(rows >= 0).tolist():
        seen = photo.keypoints.confidence[person, photo.keypoints.joint_set.fitted] >= _SEEN
        if seen.sum() < _FEWEST:
            continue
        at, body = points[person, seen], drawn[rows[person]]
        middle = body[seen].mean(0)
        readings = body, body[mirrored], body * [1, -1] + [0, 2 * middle[1]]
        size = float(np.linalg.norm(np.ptp(at, axis=0)))
        off, by_sides, by_turn = (
            float(np.linalg.norm(one[seen] - at, axis=1).mean()) / size for one in readings
        )
        if off > _OFF:
            swapped += [person] if by_sides < _MUCH_BETTER * off else []
            turned += [person] if by_turn < _MUCH_BETTER * off else []
    if 2 * len(turned) > (rows >= 0).sum():
        raise InputError(
            f"{given.source}: its bodies stand upside down where the photo shows people: y points "
            f"down in the camera's frame; turn (x, y, z) to (x, -y, -z)"
        )
    people = ", ".join(map(str, swapped))
    return (
        f"{given.source}: left and right of the given bodies seem exchanged by the keypoints of "
        f"person {people}: check them in the preview",
    ) * bool(swapped)
