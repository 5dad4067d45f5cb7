"""People in the image: masks, boxes and 2D keypoints."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from physic_core.types.per_person import PER_PERSON
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import Skeleton, skeleton_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types.arrays import BoolArray, FloatArray
    from physic_core.types.surfaces import SurfaceLabels


@dataclass(frozen=True)
class Keypoints(ShortRepr):
    """2D keypoints of N people; row i belongs to person i.

    Attributes:
        points: (N, J, 2) float px.
        confidence: (N, J) float in [0, 1]. 0 means not seen; the point is then ignored.
        skeleton: meaning of the J points: the name of a standard skeleton ("coco17", "coco23" with feet, "blazepose33",
            "halpe26", "coco_wholebody133": see :data:`physic_core.types.SKELETONS`), or a :class:`Skeleton` of the
            detector's own.
        world: (N, J, 3) metres, or None. Axes of a camera that looks straight at the person (x right, y down, z away),
            origin between the hips: what single-person pose networks call world landmarks.
        sigma: (N, J) px, standard deviation of each of a point's two coordinates, or None if the detector states none.
        depth_sigma: (N, J) metres, standard deviation of the depth (z) of ``world``, or None if the detector states
            none. If it does, x and y of ``world`` are the points in metres, and say nothing that they do not say.
    """

    points: FloatArray = field(metadata=PER_PERSON)
    confidence: FloatArray = field(metadata=PER_PERSON)
    skeleton: Skeleton | str
    world: FloatArray | None = field(default=None, metadata=PER_PERSON)
    sigma: FloatArray | None = field(default=None, metadata=PER_PERSON)
    depth_sigma: FloatArray | None = field(default=None, metadata=PER_PERSON)

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
        names = ("points", "confidence", "world", "sigma", "depth_sigma")
        given = {name: value[:, chosen] for name in names if (value := getattr(self, name)) is not None}
        return Keypoints(skeleton=self.joint_set.take(chosen), **given)


@dataclass(frozen=True)
class UnposedPerson(ShortRepr):
    """A person-like box in a photo for which no body could be given.

    Attributes:
        box: x0, y0, x1, y1 px, half open.
        score: of the detection, in [0, 1].
        reason: why there is no body, a few words ("no pose fits the box").
    """

    box: tuple[float, float, float, float]
    score: float
    reason: str


@dataclass(frozen=True)
class People(ShortRepr):
    """Result of a Segmenter: masks, boxes and scores of N people; arrays of length N = 0, never None, without people.

    Attributes:
        masks: (N, H, W) bool, visible pixels of each person. Masks of two people do not overlap.
        boxes: (N, 4) float px, x0 y0 x1 y1, half open like a slice: ``mask[y0:y1, x0:x1]`` holds the person.
        scores: (N,) float in [0, 1].
        floor: (H, W) bool, pixels of the ground that people stand on, or None if the backend does not segment it.
        keypoints: joints that the person detector found along with the boxes, or None.
        surfaces: semantic labels of the pixels, or None if the backend does not segment them.
        unposed: person-like boxes that are not among the N people, for the report of the result.
        unposed_mask: (H, W) bool, visible pixels of all ``unposed``; they are removed from the scene as those of people
            are. Or None.
        objects: (K, H, W) bool, visible pixels of each thing that one person can carry: a ball, a cup, a bag, a laptop.
            Objects in hands and on laps are removed from the scene as people are. Or None if the backend does not look
            for objects.
        floor_candidates: (H, W) bool each, other masks that may be the ground, such as several beside the feet. The
            pipeline weighs them.
        notes: plain sentences for the user ("left out what looks like a person ...").
    """

    masks: BoolArray = field(metadata=PER_PERSON)
    boxes: FloatArray = field(metadata=PER_PERSON)
    scores: FloatArray = field(metadata=PER_PERSON)
    floor: BoolArray | None = None
    keypoints: Keypoints | None = field(default=None, metadata=PER_PERSON)
    surfaces: SurfaceLabels | None = None
    unposed: tuple[UnposedPerson, ...] = ()
    unposed_mask: BoolArray | None = None
    objects: BoolArray | None = None
    floor_candidates: tuple[BoolArray, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.masks)
