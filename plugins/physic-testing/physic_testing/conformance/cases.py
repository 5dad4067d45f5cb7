"""Photos of the conformance kit, each with the inputs that the pipeline would pass to the
interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import Bodies, Keypoints, People, Plane, Pointmap, SceneScale
from physic_testing.worlds import BLAZEPOSE, load_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Intrinsics, UInt8Array
    from physic_testing.worlds import World

SIZE = (320, 240)
"""Default width and height of the standard photos, px."""

SCENE_UNIT = 1.7
"""Metres per unit of the relative point maps in the hints."""

CASES: dict[str, str] = {
    "one person": "one person, landscape",
    "several people": "people beside one another",
    "odd size": "a width and a height that no network likes, 131 x 97 px",
    "nobody": "a room without people",
    "blank": "one grey all over",
    "tiny": "32 x 24 px",
    "large": "four times as wide and high",
    "close": "one person, three times as wide and high",
    "walking": "one person who walks, higher than wide",
    "steps": "three people on steps outdoors, in no order of distance, under a sky",
    "squatting": "one person who squats",
    "leaning": "one person who leans on a wall",
    "striding": "one person who walks",
    "crouching": "one person who squats, with one hand hidden",
    "striding, large": "one person who walks, three times as wide and high",
    "sitting, large": "two people side by side on a seat, three times as wide and high",
    "crouching, large": "one person who squats, with one hand hidden, three times as wide and high",
}
"""Name of each photo -> description."""

EVIDENCE = ("one person", "several people", "walking", "steps", "squatting", "leaning")
"""Photos over which bias is measured: different people, poses, rooms, cameras and sizes."""

EVIDENCE_OF_HANDS = ("close", "striding, large", "sitting, large", "crouching, large")
"""The same for hands, which are too small in the others: at 320 x 240 px, a hand has 8 to 15 px."""

PAIRED = {
    "": ("several people", "walking", "leaning"),
    "hand_estimator": ("close", "sitting, large"),
}
"""Interface, or "" for all others -> photos that are changed, too."""

_LARGE = 3
_GLARE = 247

_WORLDS = {
    "one person": "stand_indoors",
    "several people": "group",
    "walking": "walk_portrait",
    "striding": "walk",
    "sitting": "sit_side_by_side",
    "steps": "outdoor_crowd",
    "squatting": "squat",
    "crouching": "squat_indoors",
    "leaning": "lean_on_wall",
}


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
        world: ground truth; None for a photo that was resampled or altered and has no ground truth.
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
    if name.endswith(", large"):
        larger = (_LARGE * size[0], _LARGE * size[1])
        return replace(_build(name.removesuffix(", large"), larger), name=name)
    width, height = size
    if name in _WORLDS:
        small = (width * 7 // 8, height * 7 // 8)
        return case_of_world(
            name, load_world(_WORLDS[name], small if name in ("squatting", "crouching") else size)
        )
    if name == "odd size":
        return case_of_world(name, load_world("stand_indoors", (131, 97)))
    if name == "close":
        return case_of_world(name, load_world("stand", (_LARGE * width, _LARGE * height)))
    person = _build("one person", size)
    if name == "nobody":
        return _without_people(person)
    if name == "blank":
        grey = np.full_like(person.photo, 128)
        return replace(person, name=name, photo=grey, empty=grey, world=None)
    return _resized(person, name, *((32, 24) if name == "tiny" else (4 * width, 4 * height)))


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
    people = case.people
    keypoints = case.keypoints
    bodies = case.bodies
    observed = None if bodies.observed is None else bodies.observed[:0]
    return replace(
        case,
        name="nobody",
        photo=case.empty,
        hole=np.zeros_like(case.hole),
        people=People(people.masks[:0], people.boxes[:0], people.scores[:0]),
        keypoints=Keypoints(keypoints.points[:0], keypoints.confidence[:0], keypoints.skeleton),
        bodies=Bodies(bodies.parameters[:0], bodies.body_model, observed),
        original=case.scene,
        world=None,
    )


def _resized(case: Case, name: str, width: int, height: int) -> Case:
    """Resample a case to another size."""
    from physic_testing.conformance.changes import Change, changed_case

    scale = np.array([width / case.intrinsics.width, height / case.intrinsics.height, 1])
    pixels = np.diag(scale)
    pixels[:, 2] += (scale - 1) / 2  # integer coordinates are pixel centres
    return replace(
        changed_case(case, Change(name, pixels, np.eye(3), case.intrinsics.resized(width, height))),
        name=name,
    )
