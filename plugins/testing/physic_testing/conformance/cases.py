"""Photos of the conformance kit, each with the inputs that the pipeline would pass to the
interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from physic_core.types import (
    Bodies,
    Keypoints,
    Observations,
    People,
    Plane,
    Pointmap,
    SceneScale,
)
from physic_testing.worlds import BLAZEPOSE, load_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray, Intrinsics, UInt8Array
    from physic_testing.worlds import World

Values: TypeAlias = "dict[str, Any]"
"""An output in the form in which it is compared: names -> arrays."""

Truth: TypeAlias = "dict[str, Any]"
"""The same of the truth; ``case`` is the photo."""

SIZE = (320, 240)
"""Default width and height of the standard photos, px."""

FIRST_PHOTO = "odd size"
"""Name of the photo on which every backend is called first, so that no earlier call can affect its
result.
"""

SCENE_UNIT = 1.7
"""Metres per unit of the relative point maps in the hints."""

EVIDENCE = ("one person", "several people", "walking", "steps", "squatting", "leaning")
"""Photos over which bias is measured: different people, poses, rooms, cameras and sizes. The first
two have one size, so that a result kept from the last call shows.
"""

EVIDENCE_OF = {
    "hand_estimator": ("close", "striding", "sitting", "crouching"),
    "person_observer": (*EVIDENCE, "child"),
}
"""The same of an interface for which others are needed: at 320 x 240 px, a hand has 8 to 15 px."""


@dataclass(frozen=True)
class Photo:
    """A photo of the kit.

    Attributes:
        what: description.
        world: name of the world.
        scale: sides of the photo over the standard ones.
        size: width and height, px, in place of ``scale``.
    """

    what: str
    world: str
    scale: float = 1.0
    size: tuple[int, int] | None = None


CASES: dict[str, Photo] = {
    "one person": Photo("one person, landscape", "stand_indoors"),
    "several people": Photo("people beside one another", "group"),
    "odd size": Photo("131 x 97 px, which no network likes", "stand_indoors", size=(131, 97)),
    "nobody": Photo("a room without people", "stand_indoors"),
    "blank": Photo("one gray all over", "stand_indoors"),
    "tiny": Photo("32 x 24 px", "stand_indoors", size=(32, 24)),
    "large": Photo("one person, four times as wide and high", "stand_indoors", 4),
    "walking": Photo("one person who walks, higher than wide", "walk_portrait"),
    "steps": Photo("three people outdoors, in no order of distance, under a sky", "outdoor_crowd"),
    "squatting": Photo("one person who squats", "squat", 7 / 8),
    "leaning": Photo("one person who leans on a wall", "lean_on_wall"),
    "child": Photo("a child who holds the hand of an adult", "child_by_the_hand"),
    "close": Photo("one person, three times as wide and high", "stand", 3),
    "striding": Photo("one person who walks, three times as wide and high", "walk", 3),
    "sitting": Photo("two people on a seat, three times as wide and high", "sit_side_by_side", 3),
    "crouching": Photo(
        "one person with a hidden hand, three times as wide and high", "squat_indoors", 3 * 7 / 8
    ),
}
"""Name of each photo -> what it shows."""


@dataclass(frozen=True)
class Case:
    """One photo with all inputs of the interfaces and the ground truth.

    Attributes:
        name: key of CASES, or the name of a world.
        photo: (H, W, 3) uint8 RGB.
        empty: (H, W, 3) uint8 RGB, the photo without its people.
        hole: (H, W) bool, pixels to inpaint: people, and glare, which values above 255 come from.
        intrinsics: true camera intrinsics.
        people: N people with their true masks, without keypoints.
        keypoints: true keypoints of the N people, skeleton "blazepose33".
        bodies: true bodies, m.
        scene: true points of ``empty``, in units of SCENE_UNIT metres.
        original: true points of ``photo``, in the same unit.
        floor: floor plane, in the same unit.
        scale: of that unit.
        world: ground truth; None for a photo that was altered and has no ground truth.
    """

    name: str
    photo: UInt8Array
    empty: UInt8Array
    hole: BoolArray
    intrinsics: Intrinsics
    people: People
    keypoints: Keypoints
    bodies: Bodies
    scene: Pointmap
    original: Pointmap
    floor: Plane
    scale: SceneScale
    world: World | None

    @property
    def size(self) -> str:
        """Width and height as text."""
        return f"{self.photo.shape[1]} x {self.photo.shape[0]} px"

    @property
    def box_sides(self) -> FloatArray:
        """Larger side (N,) of each person's box, px."""
        sides: FloatArray = (self.people.boxes[:, 2:] - self.people.boxes[:, :2]).max(axis=1)
        return sides

    @property
    def up(self) -> FloatArray:
        """Unit vector (3,) against gravity."""
        return self.floor.normal

    @property
    def observations(self) -> Observations:
        """Of the N people: nothing is said of them."""
        return Observations.unknown(len(self.people))

    @property
    def truth(self) -> World:
        """World of a case with ground truth."""
        assert self.world is not None, f"the photo '{self.name}' has no truth"
        return self.world


def build_case(name: str, size: tuple[int, int] = SIZE) -> Case:
    """Build a case; recent cases are cached.

    Args:
        name: key of CASES.
        size: width and height of the standard photos, px; the sizes of the other photos depend on
            it.
    """
    return _build(name, size)


@lru_cache(maxsize=32)
def _build(name: str, size: tuple[int, int]) -> Case:
    photo = CASES[name]
    sides = photo.size or (round(photo.scale * size[0]), round(photo.scale * size[1]))
    case = case_of_world(name, load_world(photo.world, sides))
    if name == "nobody":
        return _without_people(case)
    if name == "blank":
        grey = np.full_like(case.photo, 128)
        return replace(case, photo=grey, empty=grey, world=None)
    return case


_GLARE = 247


def case_of_world(name: str, world: World) -> Case:
    """Build the case of a world's photo: true inputs for the backends of all interfaces."""
    import cv2

    height, width = world.image.shape[:2]
    radius = max(2, round(0.01 * max(height, width)))
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    hidden = world.masks.any(axis=0) | (world.empty_image.max(axis=2) > _GLARE)
    points = world.keypoints[BLAZEPOSE.name]
    visible = world.visible[BLAZEPOSE.name]
    scene, original = (
        world.points(people=people) / np.float32(SCENE_UNIT) for people in (False, True)
    )
    return Case(
        name=name,
        photo=world.image,
        empty=world.empty_image,
        hole=cv2.dilate(hidden.astype(np.uint8), brush) > 0,
        intrinsics=world.intrinsics,
        people=People(world.masks, world.boxes, np.linspace(0.95, 0.85, len(world.masks))),
        keypoints=Keypoints(points, np.where(visible, 0.95, 0.2), BLAZEPOSE),
        bodies=Bodies(world.parameters, world.body_model, world.joints_visible),
        scene=Pointmap(scene, np.isfinite(scene).all(axis=2), "scale", world.intrinsics),
        original=Pointmap(original, np.isfinite(original).all(axis=2), "scale", world.intrinsics),
        floor=Plane(world.floor.normal, world.floor.offset / SCENE_UNIT),
        scale=SceneScale(SCENE_UNIT, sigma=0.01),
        world=world,
    )


def _without_people(case: Case) -> Case:
    """Build the case of the same scene without people."""
    bare: Case = rows_of(replace(case, world=None), np.zeros(0, int), len(case.people))
    hole = np.zeros_like(case.hole)
    return replace(bare, photo=case.empty, hole=hole, floor=case.floor, original=case.scene)


def rows_of(thing: Any, order: IntArray, count: int) -> Any:
    """Take rows of all arrays that have one row for each of ``count`` people."""
    if isinstance(thing, np.ndarray):
        return thing[order].copy() if thing.ndim and len(thing) == count else thing
    if is_dataclass(thing) and not isinstance(thing, type):
        taken = {f.name: rows_of(getattr(thing, f.name), order, count) for f in fields(thing)}
        return replace(thing, **taken)
    return thing
