"""Worlds: small synthetic scenes of people in a room, with the truth of everything that PhySIC estimates.

A world is the same for the same name, seed and size. Everything is in the camera's frame (OpenCV: x right, y down,
z forward) and in metres, except what says "room".
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.testing.rendering import pixel_rays
from physic_core.testing.rooms import Room
from physic_core.testing.staging import WORLDS, Camera, set_stage
from physic_core.testing.truth import place_bodies, project, seen_by_camera, take_pictures
from physic_core.types import BodyParameters, Intrinsics, Plane

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array

__all__ = ["CONTACT_DISTANCE", "SKELETONS", "WORLDS", "World", "build_world"]

CONTACT_DISTANCE = 0.02
"""Metres: a vertex touches when a surface is this near, or when it lies inside (the rule of the paper's code)."""

SKELETONS = ("coco17", "coco23", "blazepose33")
"""Joint sets whose keypoints a world knows."""


@dataclass(frozen=True)
class World:
    """A photo and its truth. N people, V vertices, H and W image rows and columns. Arrays are read-only.

    Attributes:
        name: one of WORLDS.
        seed: of everything drawn.
        image: (H, W, 3) uint8 RGB, the photo.
        empty_image: (H, W, 3) uint8 RGB, the same without people and their shadows.
        intrinsics: of the camera.
        camera: its place in the room.
        room: floor, walls and furniture, in the room's frame.
        depth: (H, W) float32 along z.
        empty_depth: (H, W) float32, of the scene without people.
        normals: (H, W, 3) float32 unit, towards the camera.
        empty_normals: (H, W, 3) float32.
        masks: (N, H, W) bool, visible pixels.
        whole_masks: (N, H, W) bool, as if nothing stood in front.
        boxes: (N, 4) float64 px, x0 y0 x1 y1 half open, of ``masks``.
        floor_mask: (H, W) bool, visible floor.
        empty_floor_mask: (H, W) bool, of the scene without people.
        floor: the floor's plane.
        keypoints: joint set -> (N, J, 2) float64 px.
        visible: joint set -> (N, J) bool: in the image, and hidden by nothing but the own skin or the own limb.
        joints_visible: (N, 55) bool, the same of the body's joints.
        parameters: of the N bodies.
        body_model: name of the body model.
        topology: name of its mesh.
        faces: (F, 3) int32.
        outer: (V,) bool, False inside mouth, nose and eyes.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool, by CONTACT_DISTANCE, of outer vertices.
        distance: (N, V) float32 to the nearest surface of the scene, negative inside.
        residual: (N,) metres by which at most a sole misses the floor, or a vertex lies inside the scene.
    """

    name: str
    seed: int
    image: UInt8Array
    empty_image: UInt8Array
    intrinsics: Intrinsics
    camera: Camera
    room: Room
    depth: FloatArray
    empty_depth: FloatArray
    normals: FloatArray
    empty_normals: FloatArray
    masks: BoolArray
    whole_masks: BoolArray
    boxes: FloatArray
    floor_mask: BoolArray
    empty_floor_mask: BoolArray
    floor: Plane
    keypoints: Mapping[str, FloatArray]
    visible: Mapping[str, BoolArray]
    joints_visible: BoolArray
    parameters: BodyParameters
    body_model: str
    topology: str
    faces: NDArray[np.int32]
    outer: BoolArray
    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    distance: FloatArray
    residual: FloatArray

    def points(self, *, people: bool) -> FloatArray:
        """The point map (H, W, 3) float32, with or without the people."""
        depth = self.depth if people else self.empty_depth
        rays = pixel_rays(self.intrinsics).reshape(*depth.shape, 3)
        return (rays * depth[..., None]).astype(np.float32)


def build_world(name: str = "standing", seed: int = 0, size: tuple[int, int] = (320, 240)) -> World:
    """Build a world; the last few are kept.

    Args:
        name: "standing", "sitting" (on a stool) or "two_people" (one partly behind the other).
        seed: draws shapes, postures, places, camera and colours.
        size: width and height of the photo, px.

    Raises:
        InputError: there is no such world.
    """
    return _build(name, seed, size)


@lru_cache(maxsize=8)
def _build(name: str, seed: int, size: tuple[int, int]) -> World:
    import torch

    from physic_core.body import load_body
    from physic_core.body.landmarks import SKELETONS as LANDMARKS

    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    intrinsics = Intrinsics.from_focal(size[0] * rng.uniform(0.85, 1.3), *size, source="world")
    model = load_body("embedded").to(dtype=torch.float64)
    stage = set_stage(model, name, rng, intrinsics, seed)
    bodies = place_bodies(model, stage, SKELETONS)
    pictures = take_pictures(model, stage, intrinsics, bodies.vertices, rng)
    distance = stage.room.signed_distance(stage.camera.to_room(bodies.vertices))

    def seen(points: FloatArray, names: tuple[str, ...]) -> BoolArray:
        return seen_by_camera(model, points, names, pictures, bodies.vertices, intrinsics)

    world = World(
        name=name,
        seed=seed,
        image=pictures.image,
        empty_image=pictures.empty_image,
        intrinsics=intrinsics,
        camera=stage.camera,
        room=stage.room,
        depth=pictures.seen.depth.astype(np.float32),
        empty_depth=pictures.empty.depth.astype(np.float32),
        normals=pictures.seen.normals.astype(np.float32),
        empty_normals=pictures.empty.normals.astype(np.float32),
        masks=pictures.masks,
        whole_masks=pictures.whole_masks,
        boxes=np.stack([_box(mask) for mask in pictures.masks]),
        floor_mask=pictures.floor_mask,
        empty_floor_mask=pictures.empty_floor_mask,
        floor=Plane(stage.camera.rotation[:, 1].copy(), float(stage.camera.position[1])),
        keypoints={name: project(points, intrinsics) for name, points in bodies.landmarks.items()},
        visible={name: seen(points, LANDMARKS[name]) for name, points in bodies.landmarks.items()},
        joints_visible=seen(bodies.joints, model.joint_names),
        parameters=bodies.parameters,
        body_model=model.name,
        topology=model.topology,
        faces=model.faces.numpy().astype(np.int32),
        outer=model.outer.numpy().copy(),
        vertices=bodies.vertices.astype(np.float32),
        joints=bodies.joints.astype(np.float32),
        contact=(distance <= CONTACT_DISTANCE) & model.outer.numpy(),
        distance=distance.astype(np.float32),
        residual=np.array([actor.residual for actor in stage.actors]),
    )
    _freeze(world)
    return world


def _box(mask: BoolArray) -> FloatArray:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)


def _freeze(thing: object) -> None:
    """Worlds are shared: whoever writes into one gets an error."""
    for field in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, field.name)
        for array in value.values() if isinstance(value, Mapping) else (value,):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
            elif isinstance(array, BodyParameters | Plane):
                _freeze(array)
