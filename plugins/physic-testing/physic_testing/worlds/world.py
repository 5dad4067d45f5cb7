"""Worlds: synthetic scenes of people in rooms and outdoors, with the truth of everything that PhySIC estimates.

A world is the same for the same name, seed and size. Everything is in the camera's frame (OpenCV: x right, y down,
z forward) and in metres, except what says "room". The scene is ground, walls and furniture: contact and signed distance
are those to the scene, and other people do not count as scene.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.types import BodyParameters, Intrinsics, Plane
from physic_testing.worlds import labels, storage
from physic_testing.worlds.rendering import pixel_rays
from physic_testing.worlds.skeletons import SKELETONS

# What builds a world needs torch and is imported where it is used: names and types of worlds do not.
if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_testing.worlds.cameras import Camera
    from physic_testing.worlds.rooms import Room

__all__ = ["CONTACT_DISTANCE", "WORLDS", "World", "benchmark_worlds", "build_world"]

WORLDS: tuple[str, ...] = (
    "stand",
    "walk",
    "sit_on_chair",
    "sit_on_sofa",
    "sit_on_stool",
    "sit_on_floor",
    "lie",
    "lean_on_wall",
    "lean_on_table",
    "kneel",
    "squat",
    "climb_step",
    "sit_behind_table",
    "stand_behind_counter",
    "hug",
    "sit_side_by_side",
    "group",
    "slope",
    "outdoor_steps",
)
"""Names of the worlds: what their people do."""

CONTACT_DISTANCE = 0.02
"""Metres: a vertex touches when a surface is this near, or when it lies inside (the rule of the paper's code)."""


@dataclass(frozen=True)
class World:
    """A photo and its truth. N people, V vertices, H and W image rows and columns. Arrays are read-only.

    Attributes:
        name: one of WORLDS.
        seed: of everything drawn.
        image: (H, W, 3) uint8 RGB, the photo, with its label (``physic_testing.worlds.labels``).
        empty_image: (H, W, 3) uint8 RGB, the same without people and their shadows, with the same label.
        intrinsics: of the camera.
        camera: its place in the room.
        room: ground, walls and furniture, in the room's frame; outdoors it has no walls.
        action: what each of the N people does.
        depth: (H, W) float32 along z; inf in the sky.
        empty_depth: (H, W) float32, of the scene without people.
        normals: (H, W, 3) float32 unit, towards the camera; zero in the sky.
        empty_normals: (H, W, 3) float32.
        masks: (N, H, W) bool, visible pixels.
        whole_masks: (N, H, W) bool, as if nothing stood in front; what the frame cuts off is no part of them.
        boxes: (N, 4) float64 px, x0 y0 x1 y1 half open, of ``masks``.
        floor_mask: (H, W) bool, visible ground.
        empty_floor_mask: (H, W) bool, of the scene without people.
        floor: the plane of the ground, in front of steps too.
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
        residual: (N,) metres by which at most the settled body misses its contacts, or lies inside the scene.
    """

    name: str
    seed: int
    image: UInt8Array
    empty_image: UInt8Array
    intrinsics: Intrinsics
    camera: Camera
    room: Room
    action: tuple[str, ...]
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
        """The point map (H, W, 3) float32, with or without the people; inf in the sky."""
        depth = self.depth if people else self.empty_depth
        rays = pixel_rays(self.intrinsics).reshape(*depth.shape, 3)
        with np.errstate(invalid="ignore"):  # a ray of x = 0 into the sky
            points: FloatArray = np.where(np.isfinite(depth)[..., None], rays * depth[..., None], np.inf)
        return points.astype(np.float32)


def build_world(name: str = "stand", seed: int = 0, size: tuple[int, int] = (320, 240)) -> World:
    """Build a world, or take it from memory or from the disk (``physic_testing.worlds.storage``).

    Args:
        name: one of WORLDS.
        seed: draws shapes, postures, furniture, camera, light and colours; from 0 to 2^64 - 1.
        size: width and height of the photo, px.

    Raises:
        InputError: there is no such world, or the size is too small for a label.
    """
    if name not in WORLDS:
        raise InputError(f"There is no world named {name!r}: choose one of {', '.join(WORLDS)}.")
    if min(size) < labels.SMALLEST_PX:
        raise InputError(
            f"A world needs a photo of at least {labels.SMALLEST_PX} x {labels.SMALLEST_PX} px, "
            f"got {size[0]} x {size[1]} px."
        )
    return _remembered(name, int(seed), (int(size[0]), int(size[1])))


_COLOURS = 9  # of the random numbers of clothes and light


def benchmark_worlds(count: int, seed: int) -> tuple[tuple[str, int], ...]:
    """Names and seeds of ``count`` worlds: the names in turn, so that each comes equally often, the seeds drawn."""
    seeds = np.random.default_rng(seed).integers(0, 1 << 31, count)
    return tuple((WORLDS[i % len(WORLDS)], int(own)) for i, own in enumerate(seeds))


@lru_cache(maxsize=24)
def _remembered(name: str, seed: int, size: tuple[int, int]) -> World:
    from physic_testing.worlds.cameras import Camera
    from physic_testing.worlds.rooms import Room, Walls
    from physic_testing.worlds.solids import Block, Ground
    from physic_testing.worlds.textures import Decoration, Patch

    world = storage.kept(
        storage.key_of("world", name, seed, *size),
        World,
        (Intrinsics, Camera, Room, Walls, Ground, Block, Patch, Decoration, Plane, BodyParameters),
        lambda: _build(name, seed, size),
    )
    _freeze(world)
    return world


def _build(name: str, seed: int, size: tuple[int, int]) -> World:
    import torch

    from physic_core.body import load_body
    from physic_testing.worlds.arithmetic import apply, dot
    from physic_testing.worlds.staging import set_stage
    from physic_testing.worlds.truth import place_bodies, project, seen_by_camera, take_pictures

    model = load_body("embedded").to(dtype=torch.float64)
    stage = set_stage(model, name, seed, size)
    intrinsics, rng = stage.intrinsics, np.random.default_rng([seed, zlib.crc32(name.encode()), _COLOURS])
    bodies = place_bodies(model, stage, tuple(SKELETONS.values()))
    pictures = take_pictures(model, stage, intrinsics, bodies.vertices, rng)
    distance = stage.room.signed_distance(stage.camera.to_room(bodies.vertices))
    up = np.array(stage.room.ground.normal)

    def seen(points: FloatArray, names: tuple[str, ...]) -> BoolArray:
        return seen_by_camera(model, points, names, pictures, bodies.vertices, intrinsics)

    return World(
        name=name,
        seed=seed,
        image=labels.stamp(pictures.image, name, seed),
        empty_image=labels.stamp(pictures.empty_image, name, seed),
        intrinsics=intrinsics,
        camera=stage.camera,
        room=stage.room,
        action=tuple(actor.action for actor in stage.actors),
        depth=pictures.seen.depth.astype(np.float32),
        empty_depth=pictures.empty.depth.astype(np.float32),
        normals=pictures.seen.normals.astype(np.float32),
        empty_normals=pictures.empty.normals.astype(np.float32),
        masks=pictures.masks,
        whole_masks=pictures.whole_masks,
        boxes=np.stack([_box(mask) for mask in pictures.masks]),
        floor_mask=pictures.floor_mask,
        empty_floor_mask=pictures.empty_floor_mask,
        floor=Plane(apply(stage.camera.rotation, up), float(dot(stage.camera.position, up))),
        keypoints={name: project(points, intrinsics) for name, points in bodies.landmarks.items()},
        visible={name: seen(points, SKELETONS[name].names) for name, points in bodies.landmarks.items()},
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
            elif is_dataclass(array):
                _freeze(array)
