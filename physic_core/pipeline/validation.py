"""The border between backends and the pipeline: what an answer must look like before anything is built on it.

Each function returns the faults of one answer, each in words that say what was expected and what came; the pipeline
turns them into one :class:`physic_core.errors.BackendOutputError` that names the backend.

Numbers that are not finite are a fault where nobody's are; where a backend fails on some people only,
:mod:`physic_core.pipeline.partial_answers` keeps the others.
"""

from __future__ import annotations

import math
from dataclasses import fields
from numbers import Real
from typing import TYPE_CHECKING, Any, get_args

from physic_core.types import AffineAmbiguity, BodyParameters, Intrinsics, Keypoints, Mesh, RestMesh

if TYPE_CHECKING:
    from physic_core.types import (
        Bodies,
        BoolArray,
        ContactProbability,
        DepthMap,
        Hands,
        People,
        Pointmap,
        UInt8Array,
    )

__all__ = [
    "bodies_faults",
    "contact_faults",
    "depth_faults",
    "floor_faults",
    "hands_faults",
    "image_faults",
    "keypoints_faults",
    "people_faults",
    "pointmap_faults",
    "sound_bodies",
    "sound_contact",
    "sound_hands",
    "sound_keypoints",
    "tensor_advice",
]

_PARAMETER_WIDTH = {
    "global_orient": 3,
    "body_pose": 63,
    "left_hand_pose": 45,
    "right_hand_pose": 45,
    "jaw_pose": 3,
    "leye_pose": 3,
    "reye_pose": 3,
    "transl": 3,
}


def image_faults(image: UInt8Array, height: int, width: int) -> list[str]:
    """Faults of an (H, W, 3) uint8 image of a known size."""
    return _array("image", image, (height, width, 3), "uint8")


def people_faults(people: People, height: int, width: int) -> list[str]:
    """Faults of a Segmenter's answer for an image of ``height`` x ``width`` px."""
    n = _rows_in(people.masks)
    faults = _array("masks", people.masks, (n, height, width), "bool")
    faults += _array("boxes", people.boxes, (n, 4), "float") + _array("scores", people.scores, (n,), "float")
    if people.floor is not None:
        faults += floor_faults(people.floor, height, width)
    if not faults and n:
        faults += _unit_range("scores", people.scores) + _finite("boxes", people.boxes)
        empty = [i for i in range(n) if not people.masks[i].any()]
        if empty:
            faults.append(f"every person needs at least one pixel, masks {empty} are empty")
        outside = (people.boxes < 0).any(1) | (people.boxes[:, 2] > width) | (people.boxes[:, 3] > height)
        flipped = (people.boxes[:, 2:] <= people.boxes[:, :2]).any(1)
        if (outside | flipped).any():
            bad = people.boxes[outside | flipped][0]
            faults.append(f"boxes must be x0 y0 x1 y1 inside the {width} x {height} px image, got {bad.tolist()}")
        if people.masks.sum(0, dtype="int64").max() > 1:
            faults.append("masks of two people overlap: every pixel belongs to one person at most")
    if people.keypoints is not None:
        told = _kind("keypoints", people.keypoints, Keypoints)
        faults += told or keypoints_faults(people.keypoints, n)
    return faults


def floor_faults(floor: BoolArray, height: int, width: int) -> list[str]:
    """Faults of the mask of the ground that a Segmenter may give."""
    return _array("floor", floor, (height, width), "bool")


def keypoints_faults(keypoints: Keypoints, people: int) -> list[str]:
    """Faults of a KeypointDetector's answer for ``people`` people."""
    joints = keypoints.points.shape[1] if getattr(keypoints.points, "ndim", 0) == 3 else 0
    faults = _kind("skeleton", keypoints.skeleton, str)
    faults += _array("points", keypoints.points, (people, joints, 2), "float")
    faults += _array("confidence", keypoints.confidence, (people, joints), "float")
    if keypoints.world is not None:
        faults += _array("world", keypoints.world, (people, joints, 3), "float")
    if not faults:
        some = _looked_at(sound_keypoints(keypoints))
        points, confidence = keypoints.points[some], keypoints.confidence[some]
        faults += _unit_range("confidence", confidence) + _finite("points", points[confidence > 0])
        if keypoints.world is not None:
            faults += _finite("world", keypoints.world[some][confidence > 0])
    return faults


def sound_keypoints(keypoints: Keypoints) -> BoolArray:
    """(N,) bool: people whose confidence is made of numbers, and their seen points too, on the photo and in metres."""
    import numpy as np

    unseen = keypoints.confidence <= 0
    sound: BoolArray = _rows(keypoints.confidence) & (np.isfinite(keypoints.points).all(-1) | unseen).all(1)
    if keypoints.world is not None:
        sound &= (np.isfinite(keypoints.world).all(-1) | unseen).all(1)
    return sound


def pointmap_faults(pointmap: Pointmap, height: int, width: int) -> list[str]:
    """Faults of a RelativePointmap's answer."""
    faults = _array("points", pointmap.points, (height, width, 3), "float")
    faults += _array("valid", pointmap.valid, (height, width), "bool")
    if not faults:
        seen = pointmap.points[pointmap.valid]
        if not len(seen):
            faults.append("no pixel is valid")
        else:
            faults += _finite("points", seen)
            if (seen[:, 2] <= 0).any():
                share = float((seen[:, 2] <= 0).mean())
                faults.append(f"z must be > 0 where valid (z forward), {share:.0%} of the valid points lie behind")
    if pointmap.unknown not in get_args(AffineAmbiguity):
        faults.append(f"unknown must be one of {', '.join(get_args(AffineAmbiguity))}, got {pointmap.unknown!r}")
    return faults + _camera(pointmap.intrinsics, height, width) + _notes(pointmap.notes)


def depth_faults(depth: DepthMap, height: int, width: int) -> list[str]:
    """Faults of a MetricDepth's answer."""
    import numpy as np

    faults = _array("depth", depth.depth, (height, width), "float")
    if not faults:
        known = depth.depth[np.isfinite(depth.depth)]
        if not len(known):
            faults.append("depth is NaN or infinite everywhere")
        elif (known <= 0).any():
            faults.append(f"depth must be > 0 m or NaN, the smallest is {float(known.min()):g}")
    sigma = depth.scale_sigma
    if sigma is not None and not (isinstance(sigma, Real) and 0 <= sigma < math.inf):
        faults.append(f"scale_sigma must be a number >= 0 or None, got {sigma!r}")
    return faults + _camera(depth.intrinsics, height, width) + _notes(depth.notes)


def bodies_faults(bodies: Bodies, people: int) -> list[str]:
    """Faults of a BodyEstimator's answer for ``people`` people."""
    faults = _kind("parameters", bodies.parameters, BodyParameters) + _kind("body_model", bodies.body_model, str)
    if faults:
        return faults
    fitting = []
    for field in fields(bodies.parameters):
        value = getattr(bodies.parameters, field.name)
        width = _PARAMETER_WIDTH.get(field.name, value.shape[-1] if getattr(value, "ndim", 0) else 0)
        own = _array(field.name, value, (people, width), "float")
        faults += own
        if not own:
            fitting.append((field.name, value))
    if people and not _all_rows([value for _, value in fitting], people).any():
        faults += [fault for name, value in fitting for fault in _finite(name, value)]
    if bodies.observed is not None:
        faults += _array("observed", bodies.observed, (people, 55), "bool")
    if bodies.joints is not None:
        faults += _joints(bodies.joints, people)
    if bodies.mesh is not None:
        faults += _kind("mesh", bodies.mesh, Mesh) or _mesh(bodies.mesh, people)
    return faults


def sound_bodies(bodies: Bodies) -> BoolArray:
    """(N,) bool: people whose parameters, and mesh if there is one, are all made of numbers.

    Single joints may be NaN, where the backend does not say.
    """
    parameters = bodies.parameters
    values = [getattr(parameters, field.name) for field in fields(parameters)]
    return _all_rows(values if bodies.mesh is None else [*values, bodies.mesh.vertices], len(parameters))


def hands_faults(hands: Hands, people: int) -> list[str]:
    """Faults of a HandEstimator's answer for ``people`` people."""
    faults = _array("rotvecs", hands.rotvecs, (people, 2, 15, 3), "float")
    faults += _array("confidence", hands.confidence, (people, 2), "float")
    if hands.wrists is not None:
        faults += _array("wrists", hands.wrists, (people, 2, 3), "float")
    if faults:
        return faults
    some = _looked_at(sound_hands(hands))
    rotvecs, confidence = hands.rotvecs[some], hands.confidence[some]
    faults = _unit_range("confidence", confidence) + _finite("rotvecs", rotvecs[confidence > 0])
    return faults if hands.wrists is None else faults + _finite("wrists", hands.wrists[some][confidence > 0])


def sound_hands(hands: Hands) -> BoolArray:
    """(N,) bool: people whose confidence is made of numbers, and the hands of theirs that were found too."""
    import numpy as np

    absent = hands.confidence <= 0
    sound: BoolArray = _rows(hands.confidence) & (np.isfinite(hands.rotvecs).all((-2, -1)) | absent).all(1)
    if hands.wrists is not None:
        sound &= (np.isfinite(hands.wrists).all(-1) | absent).all(1)
    return sound


def contact_faults(contact: ContactProbability, people: int, vertices: int, topology: str) -> list[str]:
    """Faults of a ContactPrior's answer for a mesh of ``vertices`` vertices, or for one that it brings along."""
    if contact.topology != topology:
        if contact.rest is None:
            return [f"topology must be {topology!r} as the bodies', got {contact.topology!r}"]
        faults = _rest(contact.rest, contact.topology)
        if faults:
            return faults
        vertices = len(contact.rest.vertices)
    faults = _array("probability", contact.probability, (people, vertices), "float")
    return faults or _unit_range("probability", contact.probability[_looked_at(sound_contact(contact))])


def sound_contact(contact: ContactProbability) -> BoolArray:
    """(N,) bool: people whose probabilities are all made of numbers."""
    return _rows(contact.probability)


def _rows(value: Any) -> BoolArray:
    """(N,) bool: rows of an array (N, ...) without NaN or infinity."""
    import numpy as np

    finite: BoolArray = np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
    return finite


def _all_rows(values: list[Any], rows: int) -> BoolArray:
    import numpy as np

    every: BoolArray = np.logical_and.reduce([np.ones(rows, bool), *(_rows(value) for value in values)])
    return every


def _looked_at(sound: BoolArray) -> BoolArray:
    """The sound people, or all of them where nobody is."""
    return sound if sound.any() else ~sound


def tensor_advice(value: object) -> str:
    """What makes a numpy array of a torch tensor, in words; empty for anything else."""
    return ": write .detach().cpu().numpy()" if type(value).__module__.partition(".")[0] == "torch" else ""


def _array(name: str, value: Any, shape: tuple[int, ...], kind: str) -> list[str]:
    import numpy as np

    if not isinstance(value, np.ndarray):
        return [f"{name} must be a numpy array {_shape(shape)}, got {type(value).__name__}{tensor_advice(value)}"]
    dtype, faults = value.dtype, []
    if tuple(value.shape) != shape:
        faults.append(f"{name} must be {_shape(shape)}, got {_shape(tuple(value.shape))}")
    right = dtype.kind == "f" if kind == "float" else dtype == kind
    if not right:
        faults.append(f"{name} must be {kind}, got {dtype}")
    return faults


def _joints(joints: Any, people: int) -> list[str]:
    """Faults of joints that a BodyEstimator may give; NaN is none."""
    import numpy as np

    faults = _array("joints", joints, (people, 55, 3), "float")
    if not faults and np.isinf(joints).any():
        faults.append(
            f"joints must be metres, or NaN where nothing is known, {int(np.isinf(joints).sum())} are infinite"
        )
    return faults


def _mesh(mesh: Mesh, people: int) -> list[str]:
    vertices = mesh.vertices.shape[1] if getattr(mesh.vertices, "ndim", 0) == 3 else 0
    faults = _kind("mesh.name", mesh.name, str)
    faults += _array("mesh.vertices", mesh.vertices, (people, vertices, 3), "float")
    if not faults and people and not _rows(mesh.vertices).any():
        faults += _finite("mesh.vertices", mesh.vertices)
    if mesh.rest is not None:
        faults += _array("mesh.rest", mesh.rest, (vertices, 3), "float") or _finite("mesh.rest", mesh.rest)
    return faults + _faces("mesh.faces", mesh.faces, vertices)


def _rest(rest: RestMesh, topology: str) -> list[str]:
    """Faults of the mesh that a ContactPrior brings along."""
    faults = _kind("rest", rest, RestMesh)
    if faults:
        return faults
    vertices = _rows_in(rest.vertices)
    if rest.topology != topology:
        faults.append(f"rest must be the mesh {topology!r} that the probabilities are on, got {rest.topology!r}")
    faults += _array("rest.vertices", rest.vertices, (vertices, 3), "float")
    if not faults:
        faults += _finite("rest.vertices", rest.vertices)
    return faults + _faces("rest.faces", rest.faces, vertices)


def _faces(name: str, faces: Any, vertices: int) -> list[str]:
    """Faults of triangles (F, 3), integers of any width, over ``vertices`` vertices."""
    count = _rows_in(faces)
    if getattr(faces, "dtype", None) is not None and faces.dtype.kind not in "iu":
        return [f"{name} must be integers, got {faces.dtype}"]
    faults = _array(name, faces, (count, 3), str(getattr(faces, "dtype", "")))
    if not faults and count and not 0 <= int(faces.min()) <= int(faces.max()) < vertices:
        faults.append(
            f"{name} must number the {vertices} vertices from 0, got {int(faces.min())} to {int(faces.max())}"
        )
    return faults


def _camera(camera: Intrinsics | None, height: int, width: int) -> list[str]:
    """Faults of a camera that a backend may give with its answer, and which must be that of the image it was shown."""
    if camera is None:
        return []
    faults = _kind("intrinsics", camera, Intrinsics)
    if faults:
        return faults
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not all(isinstance(v, Real) and math.isfinite(v) for v in numbers) or min(camera.fx, camera.fy) <= 0:
        told = ", ".join(map(str, numbers))
        faults.append(f"intrinsics must be finite numbers fx, fy, cx, cy with fx > 0 and fy > 0, got {told}")
    if (camera.width, camera.height) != (width, height):
        faults.append(f"intrinsics must be for {width} x {height} px, got {camera.width} x {camera.height}")
    return faults + _kind("intrinsics.source", camera.source, str)


def _notes(notes: Any) -> list[str]:
    fine = isinstance(notes, tuple | list) and all(isinstance(note, str) for note in notes)
    return [] if fine else [f"notes must be a tuple of texts, got {notes!r}"]


def _kind(name: str, value: Any, kind: type) -> list[str]:
    return [] if isinstance(value, kind) else [f"{name} must be {kind.__name__}, got {type(value).__name__}"]


def _rows_in(value: Any) -> int:
    """How many rows an array has; 0 where it is none."""
    return len(value) if getattr(value, "ndim", 0) else 0


def _unit_range(name: str, value: Any) -> list[str]:
    low, high = float(value.min(initial=0)), float(value.max(initial=0))
    return [] if low >= 0 and high <= 1 else [f"{name} must lie in [0, 1], got {low:g} to {high:g}"]


def _finite(name: str, value: Any) -> list[str]:
    import numpy as np

    return (
        []
        if np.isfinite(value).all()
        else [f"{name} must be finite, {int((~np.isfinite(value)).sum())} values are not"]
    )


def _shape(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ")"
