"""People in the image: masks, boxes, keypoints and labels of surfaces; and those whom the user
chose.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import compress
from typing import TYPE_CHECKING

from physic_core.types.arrays import PER_PERSON, per_person, shape, with_columns
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import Skeleton, mirrored_order, skeleton_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types.arrays import BoolArray, FloatArray, IntArray, UInt8Array


CARRIER_NAMES = (
    "bicycle",
    "motorcycle",
    "horse",
    "ski",
    "snowboard",
    "skateboard",
    "surfboard",
)
"""Names of :class:`Carrier`: what people ride, and boards that people stand on."""

SURFACE_NAMES = (
    "unknown",
    "floor",
    "ground",
    "rug",
    "stairs",
    "wall",
    "ceiling",
    "window",
    "seat",
    "bed",
    "table",
    "cabinet",
    "vehicle",
    "vegetation",
    "water",
    "sky",
    "object",
    "person",
)
"""Vocabulary of :class:`SurfaceLabels`.

"floor" is indoors, "ground" outdoors: road, pavement, grass, earth, sand. "wall" includes doors,
curtains, pictures and the outside of buildings. "seat" is a chair, armchair, sofa, bench or stool.
"cabinet" includes shelves and other storage. "vegetation" is trees and plants, and not grass.
"object" is anything without another name.
"""

GROUND_SURFACES = ("floor", "ground", "rug")
"""Names of :data:`SURFACE_NAMES` that are the floor."""


@dataclass(frozen=True)
class Keypoints(ShortRepr):
    """2D keypoints of N people; row i belongs to person i.

    Attributes:
        points: (N, J, 2) float px.
        confidence: (N, J) float in [0, 1]. 0 means not seen; the point is then ignored.
        skeleton: meaning of the J points: the name of a standard skeleton ("coco17", "coco23" with
            feet, "blazepose33", "halpe26", "coco_wholebody133": see
            :data:`physic_core.types.SKELETONS`), or a :class:`Skeleton` of the detector's own.
        world: (N, J, 3) meters, or None. Axes of a camera that looks straight at the person (x
            right, y down, z away), origin between the hips: what single-person pose networks call
            world landmarks. NaN for a keypoint that the user corrected.
        sigma: (N, J) px, standard deviation of each of a point's two coordinates, or None if the
            detector states none.
        depth_sigma: (N, J) meters, standard deviation of the depth (z) of ``world``, or None if the
            detector states none. If it does, x and y of ``world`` are the points in meters, without
            further information.
        world_spread: (N, J) m by which a point of ``world`` moves between looks of the detector
            at the same person, such as at the mirror image; NaN where unknown, None if it looks
            once.
    """

    points: FloatArray = field(metadata=shape("N", "J", 2))
    confidence: FloatArray = field(metadata=shape("N", "J"))
    skeleton: Skeleton | str
    world: FloatArray | None = field(default=None, metadata=shape("N", "J", 3))
    sigma: FloatArray | None = field(default=None, metadata=shape("N", "J"))
    depth_sigma: FloatArray | None = field(default=None, metadata=shape("N", "J"))
    world_spread: FloatArray | None = field(default=None, metadata=shape("N", "J"))

    @property
    def joint_set(self) -> Skeleton:
        """Skeleton of the keypoints; if ``skeleton`` is a name, the standard skeleton of this name.

        Raises:
            ValueError: no standard skeleton has this name.
        """
        return skeleton_named(self.skeleton)

    def take(self, columns: Sequence[int]) -> Keypoints:
        """Return the keypoints of these columns, in this order."""
        chosen = list(columns)
        taken = {name: value[:, chosen] for name, value in per_person(self)}
        return Keypoints(skeleton=self.joint_set.take(chosen), **taken)

    def mirrored_in_depth(self, rows: BoolArray) -> Keypoints:
        """Return keypoints of which those of the people whom ``rows``, (N,) bool, selects are of a
        body that looks the same in the picture and faces the other way: left and right are
        exchanged, and the depths of ``world`` reversed.
        """
        order = mirrored_order(self.joint_set.names)
        turned = with_columns(self, rows, {name: order for name, _ in per_person(self)})
        if turned.world is not None:
            turned.world[rows, :, 2] *= -1
        return turned


FOUND_TWICE = "found twice"
"""Reason of an :class:`UnposedPerson` that is a second detection of somebody with a body."""

HARDLY_VISIBLE = "hardly visible"
"""Reason of one that may be no person."""

NOT_CHOSEN = "not chosen"
"""Reason of one whom the user leaves out."""


@dataclass(frozen=True)
class UnposedPerson(ShortRepr):
    """A person-like box in a photo for which no body could be given.

    Attributes:
        box: x0, y0, x1, y1 px, half open.
        score: of the detection, in [0, 1].
        reason: why there is no body, a few words ("no pose fits the box"), or
            :data:`FOUND_TWICE`, :data:`HARDLY_VISIBLE` or :data:`NOT_CHOSEN`; a cure may follow
            after a colon.
    """

    box: tuple[float, float, float, float]
    score: float
    reason: str

    @property
    def kind(self) -> str:
        """The reason without a cure."""
        return self.reason.partition(":")[0]

    @property
    def is_another_person(self) -> bool:
        """Whether the box is no second one of a person with a body."""
        return self.kind != FOUND_TWICE

    @property
    def is_missing(self) -> bool:
        """Whether somebody surely lacks in the result."""
        return self.kind not in (FOUND_TWICE, HARDLY_VISIBLE, NOT_CHOSEN)


@dataclass(frozen=True)
class Carrier(ShortRepr):
    """Thing in a photo that may carry a person.

    Attributes:
        name: one of :data:`CARRIER_NAMES`.
        box: x0, y0, x1, y1 px, half open.
        score: of the detection, in [0, 1].
    """

    name: str
    box: tuple[float, float, float, float]
    score: float


@dataclass(frozen=True)
class People(ShortRepr):
    """Result of a Segmenter: masks, boxes and scores of N people; arrays of length N = 0, never
    None, without people.

    Attributes:
        masks: (N, H, W) bool, visible pixels of each person. Masks of two people do not overlap.
        boxes: (N, 4) float px, x0 y0 x1 y1, half open like a slice: ``mask[y0:y1, x0:x1]`` holds
            the person.
        scores: (N,) float in [0, 1].
        floor: (H, W) bool, pixels of the ground that people stand on, or None if the backend does
            not segment it.
        keypoints: joints that the person detector found along with the boxes, or None.
        surfaces: semantic labels of the pixels, or None if the backend does not segment them.
        unposed: everyone else who was detected, for the report of the result.
        unposed_mask: (H, W) bool, visible pixels of those who are missing; they are removed from
            the scene as those of people are. Or None.
        floor_candidates: (H, W) bool each, other masks that may be the ground, such as several
            beside the feet. The pipeline weighs them.
        carriers: boards, bicycles, motorcycles and horses in the photo, whether or not somebody is
            on them.
        heads: (N,) int, number of heads that the detector sees in each mask; two people may then be
            one. Or None if the backend does not count them.
        notes: plain sentences for the user ("left out what looks like a person ...").
    """

    masks: BoolArray = field(metadata=shape("N", "H", "W"))
    boxes: FloatArray = field(metadata=shape("N", 4))
    scores: FloatArray = field(metadata=shape("N"))
    floor: BoolArray | None = field(default=None, metadata=shape("H", "W"))
    keypoints: Keypoints | None = field(default=None, metadata=PER_PERSON)
    surfaces: SurfaceLabels | None = None
    unposed: tuple[UnposedPerson, ...] = ()
    unposed_mask: BoolArray | None = field(default=None, metadata=shape("H", "W"))
    floor_candidates: tuple[BoolArray, ...] = ()
    carriers: tuple[Carrier, ...] = ()
    heads: IntArray | None = field(default=None, metadata=shape("N"))
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.masks)


_OUTDOORS = ("sky", "vegetation", "ground", "water")
_INDOORS = ("floor", "rug", "ceiling", "seat", "bed", "table", "cabinet")


@dataclass(frozen=True)
class SurfaceLabels(ShortRepr):
    """Semantic label of each pixel.

    Attributes:
        labels: (H, W) uint8, index into ``names``.
        names: of the labels, each one of :data:`SURFACE_NAMES`. Names that the backend never uses
            may be omitted.
    """

    labels: UInt8Array = field(metadata=shape("H", "W"))
    names: tuple[str, ...] = SURFACE_NAMES

    def mask(self, *names: str) -> BoolArray:
        """Return the pixels (H, W) bool with one of some names, such as ``mask("floor", "rug")``.

        Raises:
            ValueError: a name is not one of :data:`SURFACE_NAMES`.
        """
        import numpy as np

        unknown = [name for name in names if name not in SURFACE_NAMES]
        if unknown:
            raise ValueError(
                f"no surface is named {', '.join(map(repr, unknown))}: use "
                f"{', '.join(SURFACE_NAMES)}"
            )
        chosen = np.array([name in names for name in self.names], bool)
        return chosen[self.labels]

    @property
    def ground(self) -> BoolArray:
        """Pixels (H, W) bool of the floor, the ground and rugs."""
        return self.mask(*GROUND_SURFACES)

    @property
    def outdoor_and_indoor_shares(self) -> tuple[float, float]:
        """Shares of the pixels with labels that are seen outdoors, and with those of rooms."""
        outdoors, indoors = (self.mask(*names).mean() for names in (_OUTDOORS, _INDOORS))
        return float(outdoors), float(indoors)


@dataclass(frozen=True)
class PeoplePrompt(ShortRepr):
    """The people whom the user chose or ignores in a photo, one for each point, box and mask.

    Results of chosen people are in the order of the prompts: points, then boxes, then masks.

    Attributes:
        points: x, y px of a pixel on each person.
        boxes: x0, y0, x1, y1 px around each person, half open like a slice.
        masks: (M, H, W) bool, visible pixels of each person; masks do not overlap. Or None.
        ignored: leave these people out, and reconstruct all others: reflections, pictures, figures.
    """

    points: tuple[tuple[float, float], ...] = ()
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    masks: BoolArray | None = None
    ignored: bool = False

    def __len__(self) -> int:
        return len(self.points) + len(self.boxes) + (0 if self.masks is None else len(self.masks))

    def select(self, rows: BoolArray) -> PeoplePrompt:
        """Return a selection (N,) of the points and boxes, with all masks."""
        points = tuple(compress(self.points, rows))
        boxes = tuple(compress(self.boxes, rows[len(self.points) :]))
        return replace(self, points=points, boxes=boxes)

    def describe(self, index: int) -> str:
        """Return the number and the px of a prompt as text for messages, such as "point 1 (310,
        42)".
        """
        if index < len(self.points):
            return f"point {index + 1} ({', '.join(f'{v:.0f}' for v in self.points[index])})"
        index -= len(self.points)
        if index < len(self.boxes):
            return f"box {index + 1} ({', '.join(f'{v:.0f}' for v in self.boxes[index])})"
        return f"mask {index - len(self.boxes) + 1}"
