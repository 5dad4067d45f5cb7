"""Synthetic scenes of people ("worlds") with ground truth for all estimates of PhySIC.

Name, seed and size determine a world completely. All values are in the camera frame (OpenCV: x
right, y down, z forward), in metres, unless stated as "room". The scene is ground, walls and
furniture: contact and signed distance refer to the scene, not to other people.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.types import BodyParameters, Intrinsics, Plane
from physic_testing.worlds import disk_cache, labels
from physic_testing.worlds.rendering import pixel_rays
from physic_testing.worlds.skeletons import SKELETONS
from physic_testing.worlds.views import VIEWS, split_name

# Building a world needs torch, so the builders are imported in the functions.
if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_testing.worlds.cameras import RoomCamera
    from physic_testing.worlds.ground_truth import WorldBodies
    from physic_testing.worlds.rooms import Room

__all__ = [
    "CHILD_WORLDS",
    "CONTACT_DISTANCE",
    "CONTACT_WORLDS",
    "OTHER_BODIES",
    "RAISED_FEET_WORLDS",
    "WORLDS",
    "World",
    "benchmark_worlds",
    "build_world",
    "is_world",
    "world_of",
]

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
"""Names of the worlds; each names the action of its people."""

CONTACT_WORLDS: tuple[str, ...] = (
    "cross_arms",
    "hands_on_hips",
    "hands_on_knees",
    "clasp_hands",
    "chin_on_hand",
    "lean_on_post",
    "sit_on_pedestal",
    "hang_from_bar",
    "on_all_fours",
    "sit_on_cushion",
    "lie_on_mattress",
    "laptop_on_lap",
    "hold_ball",
    "hold_cup",
    "hand_on_shoulder",
    "hold_hands",
    "back_to_back",
    "child_on_lap",
)
"""Names of the worlds whose people touch themselves, each other, hidden or soft supports, or small
objects.
"""

RAISED_FEET_WORLDS: tuple[str, ...] = ("jump", "raise_foot", "vault", "hold_bar", "sit_high")
"""Names of the worlds whose people have one or both feet 5 to 40 cm over the ground, on nothing."""

CHILD_WORLDS: tuple[str, ...] = (
    "child_stands",
    "child_sits",
    "child_stands_by_adult",
    "child_sits_by_adult",
    "child_by_the_hand",
)
"""Names of the worlds with a child of 1 to 15 years, alone or with an adult; the bodies of the
children are Anny's.
"""

OTHER_BODIES = "+other"
"""At the end of a world's name: its people have other proportions and skin than any shape of the
body model.
"""

CONTACT_DISTANCE = 0.02
"""Maximum distance of a contact vertex to a surface, m; vertices inside count too (rule of the
paper's code).
"""


@dataclass(frozen=True)
class World:
    """A photo and its ground truth.

    N people, V vertices, H and W image rows and columns. Arrays are read-only.

    Attributes:
        name: one of WORLDS, CONTACT_WORLDS or RAISED_FEET_WORLDS, followed by OTHER_BODIES or
            nothing, or one of CHILD_WORLDS; then a view of ``view_names`` or nothing.
        seed: seed of all random choices.
        image: (H, W, 3) uint8 RGB photo, with its label (``physic_testing.worlds.labels``).
        empty_image: (H, W, 3) uint8 RGB, the photo without people and their shadows, with the same
            label.
        intrinsics: camera intrinsics.
        camera: camera pose in the room frame.
        room: ground, walls and furniture in the room frame; no walls outdoors.
        action: action of each of the N people.
        depth: (H, W) float32 along z; inf in the sky.
        empty_depth: (H, W) float32, depth of the scene without people.
        normals: (H, W, 3) float32 unit, towards the camera; zero in the sky.
        empty_normals: (H, W, 3) float32, normals of the scene without people.
        masks: (N, H, W) bool, visible pixels.
        unoccluded_masks: (N, H, W) bool, pixels of each person without occluders, cropped by the
            image.
        boxes: (N, 4) float64 px, x0 y0 x1 y1 of ``masks``, end exclusive.
        floor_mask: (H, W) bool, visible ground.
        empty_floor_mask: (H, W) bool, visible ground without people.
        surfaces: (H, W) uint8, what each pixel shows, index into
            ``physic_core.types.SURFACE_NAMES``.
        empty_surfaces: (H, W) uint8, the same without people.
        floor: plane of the ground.
        keypoints: skeleton name -> (N, J, 2) float64 px.
        visible: skeleton name -> (N, J) bool, in the image and occluded at most by the person's own
            skin or limb.
        joints_visible: (N, 55) bool, the same for the body joints.
        parameters: parameters of the N bodies; of OTHER_BODIES, those of the body model in the same
            pose and with the same pelvis, whose vertices are not ``vertices``. The same holds for
            children of CHILD_WORLDS.
        ages: (N,) float32 years of the children of CHILD_WORLDS, NaN for the others.
        body_model: name of the body model.
        topology: name of its mesh topology.
        faces: (F, 3) int32.
        outer: (V,) bool, False inside mouth, nose and eyes.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool, outer vertices within CONTACT_DISTANCE of the scene.
        touched_surface: (N, V) uint8, the surface that a vertex in ``contact`` touches, index into
            ``SURFACE_NAMES``; 0 ("unknown") for the others.
        touched_own_part: (N, V) int16, part of the own body, index into ``parts``, that an outer
            vertex touches; -1 for none.
        touched_person: (N, V) int16, other person whom an outer vertex touches; -1 for none.
        touched_item: (N, V) int16, small object within CONTACT_DISTANCE, index into ``items``; -1
            for none.
        support: (N, V) bool, vertices that carry the person
            (``body_contacts.supporting_vertices``).
        dent: (N, V) float32 m, depth of each vertex below the undented surface of a soft block; 0
            elsewhere.
        parts: names of the body parts.
        items: names of the small objects, which belong to the photo and not to the empty scene.
        item_masks: (K, H, W) bool, visible pixels of each small object.
        distance: (N, V) float32, signed distance to the scene, negative inside.
    """

    name: str
    seed: int
    image: UInt8Array
    empty_image: UInt8Array
    intrinsics: Intrinsics
    camera: RoomCamera
    room: Room
    action: tuple[str, ...]
    depth: FloatArray
    empty_depth: FloatArray
    normals: FloatArray
    empty_normals: FloatArray
    masks: BoolArray
    unoccluded_masks: BoolArray
    boxes: FloatArray
    floor_mask: BoolArray
    empty_floor_mask: BoolArray
    surfaces: UInt8Array
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
    touched_own_part: NDArray[np.int16]
    touched_person: NDArray[np.int16]
    touched_item: NDArray[np.int16]
    support: BoolArray
    dent: FloatArray
    parts: tuple[str, ...]
    items: tuple[str, ...]
    item_masks: BoolArray
    distance: FloatArray

    def points(self, *, people: bool) -> FloatArray:
        """Return the point map (H, W, 3) float32, with or without people; inf in the sky."""
        depth = self.depth if people else self.empty_depth
        rays = pixel_rays(self.intrinsics).reshape(*depth.shape, 3)
        with np.errstate(invalid="ignore"):  # a ray of x = 0 into the sky
            points: FloatArray = np.where(
                np.isfinite(depth)[..., None], rays * depth[..., None], np.inf
            )
        return points.astype(np.float32)


def build_world(name: str = "stand", seed: int = 0, size: tuple[int, int] = (320, 240)) -> World:
    """Build a world, or load it from memory or disk (``physic_testing.worlds.disk_cache``).

    Args:
        name: one of WORLDS, CONTACT_WORLDS, RAISED_FEET_WORLDS or CHILD_WORLDS; with OTHER_BODIES
            after one of the first three, people have bodies that no shape of the body model has.
            Names of ``view_names`` show one moment from several cameras.
        seed: chooses a posed scene, and draws furniture, camera, light and colours; from 0 to 2^64
            - 1. Seeds with another remainder divided by 3 have no posed scene in common.
        size: width and height of the photo, px.

    Raises:
        InputError: no world has this name, or the size is too small for a label.
    """
    if not is_world(name):
        known = ", ".join((*WORLDS, *CONTACT_WORLDS, *RAISED_FEET_WORLDS, *CHILD_WORLDS))
        raise InputError(f"There is no world named {name!r}: choose one of {known}.")
    if min(size) < labels.SMALLEST_PX:
        raise InputError(
            f"A world needs a photo of at least {labels.SMALLEST_PX} x {labels.SMALLEST_PX} px, "
            f"got {size[0]} x {size[1]} px."
        )
    return _cached_world(name, int(seed), (int(size[0]), int(size[1])))


_COLOUR_STREAM = 9  # of the random numbers of clothes and light


def is_world(name: str) -> bool:
    """Return whether a world has this name."""
    base, view = split_name(name)
    bodies = (*WORLDS, *CONTACT_WORLDS, *RAISED_FEET_WORLDS)
    known = base.removesuffix(OTHER_BODIES) in bodies or base in CHILD_WORLDS
    return known and (view is None or 0 <= view < VIEWS)


def world_of(image: UInt8Array) -> World | None:
    """Return the world whose photo, with or without people, has the label of this image; None
    without such a label.
    """
    label = labels.read_label(image)
    return (
        build_world(*label, (image.shape[1], image.shape[0]))
        if label and is_world(label[0])
        else None
    )


def benchmark_worlds(
    count: int, seed: int, names: tuple[str, ...] = WORLDS
) -> tuple[tuple[str, int], ...]:
    """Return names and seeds of ``count`` benchmark worlds: all names in cyclic order, with random
    seeds.

    Args:
        count: of worlds.
        seed: of the seeds. Its remainder divided by 3 is that of all of them, and says which pool
            of posed scenes they choose from: 1 for development, 2 to choose settings, 0 to confirm
            them.
        names: WORLDS, CONTACT_WORLDS, RAISED_FEET_WORLDS or CHILD_WORLDS.
    """
    numbers = np.random.default_rng(seed).integers(0, (1 << 31) // 3, count)
    return tuple((names[i % len(names)], 3 * int(own) + seed % 3) for i, own in enumerate(numbers))


@lru_cache(maxsize=24)
def _cached_world(name: str, seed: int, size: tuple[int, int]) -> World:
    """Load a world from the disk cache, or build it."""
    from physic_testing.worlds.cameras import RoomCamera
    from physic_testing.worlds.dents import Dent
    from physic_testing.worlds.rooms import Room, Walls
    from physic_testing.worlds.solids import Block, Ground
    from physic_testing.worlds.textures import Decoration, Patch

    world = disk_cache.load_or_build(
        disk_cache.cache_key("world", name, seed, *size),
        World,
        (
            Intrinsics,
            RoomCamera,
            Room,
            Walls,
            Dent,
            Ground,
            Block,
            Patch,
            Decoration,
            Plane,
            BodyParameters,
        ),
        lambda: _build(name, seed, size),
    )
    _make_read_only(world)
    return world


def _build(name: str, seed: int, size: tuple[int, int]) -> World:
    """Build a world from its stored scene and photos, or from scratch."""
    import torch

    from physic_core.body import load_body
    from physic_testing.worlds.body_contacts import (
        supporting_vertices,
        touched_item,
        touched_own_part,
        touched_people,
        touched_surface,
    )
    from physic_testing.worlds.children import age_of
    from physic_testing.worlds.dents import press_dents
    from physic_testing.worlds.ground_truth import (
        pose_world_bodies,
        project,
        render_pictures,
        visible_landmarks,
    )
    from physic_testing.worlds.reproducible_math import apply, dot
    from physic_testing.worlds.scene_setup import set_up_scene
    from physic_testing.worlds.stored_worlds import load_stored

    fitted = load_body("embedded").to(dtype=torch.float64)
    base, view = split_name(name)
    stored = load_stored(name, seed, size)
    model, stage = (
        (fitted, stored.stage) if stored else set_up_scene(fitted, base, seed, size, view)
    )
    intrinsics = stage.intrinsics
    rng = np.random.default_rng([seed, zlib.crc32(base.encode()), _COLOUR_STREAM])
    bodies = pose_world_bodies(model, stage, tuple(SKELETONS.values()))
    parameters = bodies.parameters if model is fitted else _with_same_pelvis(fitted, bodies)
    in_room = stage.camera.to_room(bodies.vertices)
    outer = model.outer.numpy()
    dents = press_dents(stage.room.blocks, in_room, model.faces.numpy())
    stage = replace(stage, room=replace(stage.room, dents=dents))
    pictures = render_pictures(
        model, stage, bodies.vertices, rng, stored.images if stored else None
    )
    distance = stage.room.signed_distance(in_room)
    contact = (distance <= CONTACT_DISTANCE) & outer
    person = touched_people(model, in_room, CONTACT_DISTANCE)
    up = np.array(stage.room.ground.normal)

    def seen(points: FloatArray, names: tuple[str, ...]) -> BoolArray:
        return visible_landmarks(model, points, names, pictures, bodies.vertices, intrinsics)

    return World(
        name=name,
        seed=seed,
        image=labels.embed_label(pictures.image, name, seed),
        empty_image=labels.embed_label(pictures.empty_image, name, seed),
        intrinsics=intrinsics,
        camera=stage.camera,
        room=stage.room,
        action=tuple(actor.action for actor in stage.actors),
        depth=pictures.seen.depth.astype(np.float32),
        empty_depth=pictures.empty.depth.astype(np.float32),
        normals=pictures.seen.normals.astype(np.float32),
        empty_normals=pictures.empty.normals.astype(np.float32),
        masks=pictures.masks,
        unoccluded_masks=pictures.unoccluded_masks,
        boxes=np.stack([_box(mask) for mask in pictures.masks]),
        floor_mask=pictures.floor_mask,
        empty_floor_mask=pictures.empty_floor_mask,
        surfaces=pictures.surfaces,
        empty_surfaces=pictures.empty_surfaces,
        floor=Plane(apply(stage.camera.rotation, up), float(dot(stage.camera.position, up))),
        keypoints={name: project(points, intrinsics) for name, points in bodies.landmarks.items()},
        visible={
            name: seen(points, SKELETONS[name].names) for name, points in bodies.landmarks.items()
        },
        joints_visible=seen(bodies.joints, model.joint_names),
        parameters=parameters,
        ages=np.array([age_of(actor.betas) for actor in stage.actors], np.float32),
        body_model=model.name,
        topology=model.topology,
        faces=model.faces.numpy().astype(np.int32),
        outer=outer.copy(),
        vertices=bodies.vertices.astype(np.float32),
        joints=bodies.joints.astype(np.float32),
        contact=contact,
        touched_surface=touched_surface(stage.room, in_room, contact),
        touched_own_part=touched_own_part(model, in_room, CONTACT_DISTANCE),
        touched_person=person,
        touched_item=touched_item(stage.room, outer, in_room, CONTACT_DISTANCE),
        support=supporting_vertices(
            stage.room, model, in_room, stage.camera.to_room(bodies.joints), contact, person
        ),
        dent=_dent(stage.room, in_room).astype(np.float32),
        parts=model.part_names,
        items=stage.room.items,
        item_masks=pictures.item_masks,
        distance=distance.astype(np.float32),
    )


def _dent(room: Room, vertices: FloatArray) -> FloatArray:
    """Return the depth (N, V) of vertices (N, V, 3) below the undented surfaces of soft blocks,
    m.
    """
    if not room.dents:
        return np.zeros(vertices.shape[:2])
    depth = np.maximum(-room.signed_distance(vertices, dented=False), 0)
    return np.where(np.maximum(-room.signed_distance(vertices), 0) < depth, depth, 0)


def _with_same_pelvis(model: BodyModel, bodies: WorldBodies) -> BodyParameters:
    """Return the parameters of bodies of another model, moved so that this model has the pelvis at
    the same place.
    """
    from physic_testing.worlds.posing import rest_body

    betas = bodies.parameters.betas[:, : model.num_betas]
    rest = [rest_body(model, row)[1][0] for row in betas]
    return replace(
        bodies.parameters,
        betas=betas,
        transl=(bodies.joints[:, 0] - np.stack(rest)).astype(np.float32),
    )


def _box(mask: BoolArray) -> FloatArray:
    """Return the tight box x0 y0 x1 y1 of a mask, end exclusive."""
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)


def _make_read_only(thing: object) -> None:
    """Make all arrays of a dataclass read-only, because cached worlds are shared."""
    for field in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, field.name)
        for array in value.values() if isinstance(value, Mapping) else (value,):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
            elif is_dataclass(array):
                _make_read_only(array)
