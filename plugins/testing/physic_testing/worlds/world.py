"""Synthetic photos of people ("worlds") with ground truth for all estimates of PhySIC.

A file of ``data`` holds the photo, the mesh of the scene, the parameters of the people, and what
each vertex touches. Depth, masks and keypoints follow from these at any photo size.
``data/NOTICE.md`` says how the files were made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.backends.people import boxes_from_masks
from physic_core.errors import InputError
from physic_core.geometry import RayCaster
from physic_core.types import SURFACE_NAMES, BodyParameters, Intrinsics, Plane
from physic_testing.worlds import labels
from physic_testing.worlds.skeletons import SKELETONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray, Int64Array, Skeleton, UInt8Array

__all__ = ["WORLDS", "World", "load_world", "pixel_rays", "project", "world_of"]

_DATA = Path(__file__).with_name("data")
_STEP_M = 1e-4  # of lengths in the files
_RATIO = 4 / 3  # of the sides of all photos
_MOST_RATIO_ERROR = 0.02
_PARAMETERS = tuple(field.name for field in fields(BodyParameters))
_FACTS = (
    *("camera_rotation", "camera_position", "joints_visible", "ages", "contact"),
    *("touched_surface", "touched_own_part", "touched_person", "touched_item"),
)
"""Fields of a world that its file holds under their names."""

WORLDS: tuple[str, ...] = tuple(sorted(path.stem for path in _DATA.glob("*.npz")))
"""Names of the worlds: what people do, and ``_other`` where no shape of the body model fits."""


@dataclass(frozen=True)
class World:
    """A photo and its ground truth, camera frame (OpenCV: x right, y down, z forward), metres.

    N people, V vertices, H and W image rows and columns. Arrays are read-only. The scene is ground,
    walls and furniture: ``contact`` and ``distance`` refer to it, not to other people or to small
    objects.

    Attributes:
        name: one of WORLDS.
        image: (H, W, 3) uint8 RGB photo, with its label (``physic_testing.worlds.labels``).
        empty_image: (H, W, 3) uint8 RGB, the photo without people and their shadows, labelled, too.
        intrinsics: camera intrinsics.
        camera_rotation: (3, 3) room frame to camera frame. Worlds ``NAME_view1``, ``NAME_view2``,
            ... show one moment in one room.
        camera_position: (3,) place of the camera in the room frame.
        depth: (H, W) float32 along z; inf in the sky.
        empty_depth: (H, W) float32, depth of the scene without people.
        empty_normals: (H, W, 3) float32 unit normals of the scene without people, towards the
            camera; zero in the sky.
        masks: (N, H, W) bool, visible pixels.
        boxes: (N, 4) float64 px, x0 y0 x1 y1 of ``masks``, end exclusive.
        floor_mask: (H, W) bool, visible ground.
        empty_floor_mask: (H, W) bool, visible ground without people.
        empty_surfaces: (H, W) uint8, what each pixel shows without people, index into
            ``physic_core.types.SURFACE_NAMES``.
        floor: plane of the ground.
        keypoints: skeleton name -> (N, J, 2) float64 px.
        visible: skeleton name -> (N, J) bool, in the image and occluded at most by the person's own
            skin or limb.
        joints_visible: (N, 55) bool, the same for the body joints.
        parameters: parameters of the N bodies. The bodies of children and of ``_other`` worlds have
            other vertices than these parameters give, in the same pose and with the same pelvis.
        ages: (N,) float32 years of children, NaN for adults.
        body_model: name of the body model.
        topology: name of its mesh topology.
        faces: (F, 3) int32.
        outer: (V,) bool, False inside mouth, nose and eyes.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool, outer vertices at most 2 cm from the scene, or inside of it.
        touched_surface: (N, V) uint8, surface that a vertex in ``contact`` touches, index into
            ``SURFACE_NAMES``; 0 ("unknown") for the others.
        touched_own_part: (N, V) int8, part of the own body that an outer vertex touches, index into
            ``parts``; -1 for none.
        touched_person: (N, V) int8, other person whom an outer vertex touches; -1 for none.
        touched_item: (N, V) int8, small object within 2 cm, index into ``items``; -1 for none.
        parts: names of the body parts.
        items: names of the small objects, which are in the photo and not in the empty scene.
        item_masks: (K, H, W) bool, visible pixels of each small object.
        distance: (N, V) float32, signed distance to the scene in steps of a millimetre, negative
            inside; at most 0.127 m.
    """

    name: str
    image: UInt8Array
    empty_image: UInt8Array
    intrinsics: Intrinsics
    camera_rotation: FloatArray
    camera_position: FloatArray
    depth: FloatArray
    empty_depth: FloatArray
    empty_normals: FloatArray
    masks: BoolArray
    boxes: FloatArray
    floor_mask: BoolArray
    empty_floor_mask: BoolArray
    empty_surfaces: UInt8Array
    floor: Plane
    keypoints: Mapping[str, FloatArray]
    visible: Mapping[str, BoolArray]
    joints_visible: BoolArray
    parameters: BodyParameters
    ages: FloatArray
    body_model: str
    topology: str
    faces: NDArray[np.int32]
    outer: BoolArray
    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    touched_surface: UInt8Array
    touched_own_part: NDArray[np.int8]
    touched_person: NDArray[np.int8]
    touched_item: NDArray[np.int8]
    parts: tuple[str, ...]
    items: tuple[str, ...]
    item_masks: BoolArray
    distance: FloatArray

    def points(self, *, people: bool) -> FloatArray:
        """Return the point map (H, W, 3) float32, with or without people; inf in the sky."""
        depth = self.depth if people else self.empty_depth
        rays = pixel_rays(self.intrinsics)
        with np.errstate(invalid="ignore"):  # a ray of x = 0 into the sky
            points = np.where(np.isfinite(depth)[..., None], rays * depth[..., None], np.inf)
        return points.astype(np.float32)


def load_world(name: str = "stand", size: tuple[int, int] = (320, 240)) -> World:
    """Load a world; recent worlds are cached.

    Args:
        name: one of WORLDS.
        size: both sides of the photo, px, in the ratio 4 : 3 within 2 %. Which of them is the width
            depends on the world.

    Raises:
        InputError: no world has this name, or the size is too small or of another ratio.
    """
    if name not in WORLDS:
        raise InputError(f"There is no world named {name!r}: choose one of {', '.join(WORLDS)}.")
    long, short = int(max(size)), int(min(size))
    if short < labels.SMALLEST_PX or abs(long / short / _RATIO - 1) > _MOST_RATIO_ERROR:
        raise InputError(
            f"A world has photos in the ratio 4 : 3, of at least {labels.SMALLEST_PX} px, "
            f"got {long} x {short} px."
        )
    return _load_world(name, long, short)


def world_of(image: UInt8Array) -> World | None:
    """Return the world of an image's label, at the size of the image (H, W, 3), or None."""
    name = labels.read_label(image)
    return load_world(name, (image.shape[1], image.shape[0])) if name in WORLDS else None


def pixel_rays(intrinsics: Intrinsics) -> FloatArray:
    """Return the rays (H, W, 3) with z = 1 through the pixel centres."""
    v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
    x = (u - intrinsics.cx) / intrinsics.fx
    return np.stack([x, (v - intrinsics.cy) / intrinsics.fy, np.ones_like(x)], axis=-1)


def project(points: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Project points (..., 3) in the camera frame to pixels (..., 2)."""
    focal = np.array([intrinsics.fx, intrinsics.fy])
    uv: FloatArray = points[..., :2] / points[..., 2:] * focal + [intrinsics.cx, intrinsics.cy]
    return uv


@lru_cache(maxsize=24)
def _load_world(name: str, long: int, short: int) -> World:
    """Load a world at a photo size, and compute what depends on the size."""
    import torch

    from physic_core.body import load_body

    with np.load(_DATA / f"{name}.npz") as archive:
        file = dict(archive)
    model = load_body("embedded").to(dtype=torch.float64)
    fx, fy, cx, cy, width, height = file["intrinsics"].tolist()
    stored = Intrinsics(fx, fy, cx, cy, int(width), int(height))
    size = (long, short) if width > height else (short, long)
    intrinsics = stored.resized(*size)
    parameters = BodyParameters(**{name: file[name] for name in _PARAMETERS})
    vertices, joints = _posed(model, parameters, file)
    world = World(
        name=name,
        **_pictures(file, name, stored, size),
        intrinsics=intrinsics,
        **_visible_surfaces(file, vertices, model.faces.numpy(), intrinsics),
        floor=Plane(file["floor"][:3], float(file["floor"][3])),
        keypoints={
            key: project(_points_of(model, skeleton, vertices, joints), intrinsics)
            for key, skeleton in SKELETONS.items()
        },
        visible={key: file[f"visible_{key}"] for key in SKELETONS},
        parameters=parameters,
        body_model=model.name,
        topology=model.topology,
        faces=model.faces.numpy().astype(np.int32),
        outer=model.outer.numpy().copy(),
        vertices=vertices.astype(np.float32),
        joints=joints.astype(np.float32),
        parts=model.part_names,
        items=tuple(file["items"].tolist()),
        distance=file["distance_mm"].astype(np.float32) / 1000,
        **{name: file[name] for name in _FACTS},
    )
    _make_read_only(world)
    return world


def _posed(
    model: BodyModel, parameters: BodyParameters, file: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Return vertices (N, V, 3) and joints (N, 55, 3) of the people, m."""
    import torch

    from physic_core.body import rotations_from_parameters

    shape = [
        torch.from_numpy(value).double()
        for value in (parameters.betas, parameters.transl, parameters.expression)
    ]
    with torch.inference_mode():
        body = model(rotations_from_parameters(parameters, torch.float64), *shape)
        vertices = body.vertices.numpy()
        joints = body.joints.numpy()
    return vertices + _STEP_M * file["vertex_offset"], joints + _STEP_M * file["joint_offset"]


def _points_of(
    model: BodyModel, skeleton: Skeleton, vertices: FloatArray, joints: FloatArray
) -> FloatArray:
    """Return the points (N, J, 3) of a skeleton on posed bodies, m."""
    import torch

    regressor = model.regressor(skeleton)
    ends = torch.from_numpy(vertices[:, regressor.vertex_ids.numpy()])
    return regressor(torch.from_numpy(joints), ends).numpy()


def _pictures(
    file: Mapping[str, Any], name: str, stored: Intrinsics, size: tuple[int, int]
) -> dict[str, Any]:
    """Return the photos with and without people, with labels."""
    import cv2

    photo, empty = (
        np.asarray(cv2.imdecode(file[key], cv2.IMREAD_COLOR))[..., ::-1]
        for key in ("photo", "empty_photo")
    )
    shape = (stored.height, stored.width)
    changed = np.unpackbits(file["changed"], count=shape[0] * shape[1]).reshape(*shape, 1)
    how = cv2.INTER_AREA if size[0] < stored.width else cv2.INTER_LINEAR
    pictures = {}
    for key, picture in (("image", photo), ("empty_image", np.where(changed, empty, photo))):
        resized = cv2.resize(np.ascontiguousarray(picture), size, interpolation=how)
        pictures[key] = labels.embed_label(np.asarray(resized, np.uint8), name)
    return pictures


def _visible_surfaces(
    file: Mapping[str, Any], vertices: FloatArray, faces: Int64Array, intrinsics: Intrinsics
) -> dict[str, Any]:
    """Return depth, normals, masks and surfaces with and without people."""
    rays = pixel_rays(intrinsics)
    people = len(vertices)
    corners = _STEP_M * file["scene_vertices"]
    scene = file["scene_faces"].astype(np.int64)

    owner, item, surface = _facts_of_faces(file, people, len(faces))
    ground = np.isin(surface, [SURFACE_NAMES.index(name) for name in ("floor", "ground")])
    triangles_of = [faces + len(corners) + i * vertices.shape[1] for i in range(people)]
    everything = RayCaster(
        np.concatenate([corners, *vertices]), np.concatenate([scene, *triangles_of])
    )
    face, depth = _first_hits(everything, rays)
    scenery = np.append(np.flatnonzero(file["face_item"] < 0), len(owner) - 1)
    caster = RayCaster(corners, scene[scenery[:-1]])
    empty_face, empty_depth = _first_hits(caster, rays)
    normals = _normals_towards_camera(caster.normals, empty_face, rays)
    empty_face = scenery[empty_face]
    masks = np.stack([owner[face] == i for i in range(people)])
    return {
        "depth": depth.astype(np.float32),
        "empty_depth": empty_depth.astype(np.float32),
        "empty_normals": normals.astype(np.float32),
        "masks": masks,
        "boxes": boxes_from_masks(masks),
        "floor_mask": ground[face],
        "empty_floor_mask": ground[empty_face],
        "empty_surfaces": surface[empty_face],
        "item_masks": np.array([item[face] == k for k in range(len(file["items"]))], bool).reshape(
            -1, *face.shape
        ),
    }


def _first_hits(caster: RayCaster, rays: FloatArray) -> tuple[Int64Array, FloatArray]:
    """Return the first face (H, W) at each ray (H, W, 3) from the camera, -1 for none, and its
    depth.
    """
    hits = caster.first(np.zeros(3), rays.reshape(-1, 3))
    return hits.face.reshape(rays.shape[:2]), hits.distance.reshape(rays.shape[:2])


def _facts_of_faces(
    file: Mapping[str, Any], people: int, faces: int
) -> tuple[Int64Array, Int64Array, UInt8Array]:
    """Return person, small object (-1 for none) and surface of each face of the scene, of each of
    the ``faces`` of each person, and last of no face.
    """
    scene = len(file["scene_faces"])
    owner = np.concatenate([np.full(scene, -1), np.repeat(np.arange(people), faces), [-1]])
    others = people * faces + 1
    item = np.concatenate([file["face_item"], np.full(others, -1)])
    nothing = np.full(others, SURFACE_NAMES.index("sky"))
    return owner, item, np.concatenate([file["face_surface"], nothing]).astype(np.uint8)


def _normals_towards_camera(normals: FloatArray, face: Int64Array, rays: FloatArray) -> FloatArray:
    """Return the unit normals (H, W, 3) of the faces (H, W) at pixels; zero for face -1."""
    towards = np.where((face >= 0)[..., None], normals[face], 0)
    towards /= np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-12)
    towards *= -np.sign((towards * rays).sum(axis=-1, keepdims=True))
    return towards


def _make_read_only(thing: Any) -> None:
    """Make all arrays of a dataclass read-only, because cached worlds are shared."""
    for value in vars(thing).values():
        for part in value.values() if isinstance(value, Mapping) else (value,):
            if isinstance(part, np.ndarray):
                part.setflags(write=False)
            elif isinstance(part, BodyParameters | Plane):
                _make_read_only(part)
