"""Skeletons of pose networks: names of the keypoints and their positions on the body model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from physic_core.types.short_repr import ShortRepr

SIDES = ("left", "right")
SEEN_CONFIDENCE = 0.3
"""Least confidence of a keypoint that counts as detected."""
SURE_CONFIDENCE = 0.5
"""Least confidence of a keypoint whose place is believed against other evidence."""
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")

_FACE_POINTS = {
    36: "right_eye_outer_surface",
    39: "right_eye_inner_surface",
    42: "left_eye_inner_surface",
    45: "left_eye_outer_surface",
    48: "right_mouth_corner_surface",
    54: "left_mouth_corner_surface",
}
"""Those of 300-W's 68 face points that exist on the body model: not contour, brows, nose and
lips.
"""


@dataclass(frozen=True)
class Skeleton(ShortRepr):
    """Names, body positions and weights of the J keypoints of a detector.

    ``on_body`` calibrates points that differ from those of the body model: the engine fits
    ``(1 - sum(shares)) * point + sum(share * other_point)``.

    Attributes:
        name: for messages and results ("coco17").
        names: J names in the detector's order. Joints of SMPL-X ("left_knee") and picked surface
            points ("nose", "left_heel") lie on the body by their name: see
            ``physic_core.body.landmarks.BODY_POINTS``.
        on_body: point -> {point of the body: share of the distance from the point itself to it}. A
            point with a name of its own needs shares that sum to 1; ``{}`` means that the body
            model does not have the point: it is not fitted.
        weights: point -> factor on its confidence in the reprojection error; 1 where it is not
            given.

    Raises:
        ValueError: a name comes twice, a mapping names a point that is not in ``names``, or a
            number is not finite or negative.
    """

    name: str
    names: tuple[str, ...]
    on_body: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if twice := sorted({name for name in self.names if self.names.count(name) > 1}):
            raise ValueError(
                f"the skeleton {self.name!r} names {', '.join(twice)} twice: give each point its "
                f"own name"
            )
        if strange := sorted({*self.on_body, *self.weights} - set(self.names)):
            raise ValueError(
                f"the skeleton {self.name!r} lacks {', '.join(strange)}: add to its 'names'"
            )
        shares = [share for blend in self.on_body.values() for share in blend.values()]
        if not all(math.isfinite(number) for number in shares) or not all(
            math.isfinite(weight) and weight >= 0 for weight in self.weights.values()
        ):
            raise ValueError(
                f"the skeleton {self.name!r} needs finite shares, and finite weights of at least 0"
            )

    def __hash__(self) -> int:
        return hash((self.name, self.names))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def fitted(self) -> tuple[int, ...]:
        """Indices of the keypoints that have a position on the body model."""
        return tuple(i for i, name in enumerate(self.names) if self.on_body.get(name, name))

    def take(self, indices: Sequence[int]) -> Skeleton:
        """Return a skeleton of a subset of the points, in the order of ``indices``."""
        names = tuple(self.names[i] for i in indices)
        return Skeleton(
            self.name,
            names,
            {name: self.on_body[name] for name in names if name in self.on_body},
            {name: self.weights[name] for name in names if name in self.weights},
        )


def _left_and_right(*names: str, suffix: str = "") -> tuple[str, ...]:
    return tuple(f"{side}_{name}{suffix}" for name in names for side in SIDES)


def _hand(side: str) -> tuple[str, ...]:
    thumb = (f"{side}_thumb1", f"{side}_thumb2", f"{side}_thumb3", f"{side}_thumb_tip")
    fingers = (
        name
        for finger in ("index", "middle", "ring", "pinky")
        for name in (*(f"{side}_{finger}{k}" for k in (1, 2, 3)), f"{side}_{finger}_tip")
    )
    return (f"{side}_wrist", *thumb, *fingers)


_COCO17 = (
    "nose",
    *_left_and_right("eye", "ear", suffix="_surface"),
    *_left_and_right("shoulder", "elbow", "wrist", "hip", "knee", "ankle"),
)
_COCO23 = (
    *_COCO17,
    *(f"{side}_{name}" for side in SIDES for name in ("big_toe", "small_toe", "heel")),
)


def _standard(name: str, names: Sequence[str], not_on_body: Sequence[str] = ()) -> Skeleton:
    return Skeleton(name, tuple(names), {point: {} for point in not_on_body})


def _wholebody133() -> Skeleton:
    face = tuple(_FACE_POINTS.get(i, f"face_point_{i}") for i in range(68))
    # each wrist is marked twice, as the arm's end and as the hand's root
    roots = _left_and_right("hand_root")
    hands = tuple(
        name for side, root in zip(SIDES, roots, strict=True) for name in (root, *_hand(side)[1:])
    )
    absent = [name for name in face if name.startswith("face_point")]
    return _standard("coco_wholebody133", (*_COCO23, *face, *hands), (*absent, *roots))


_HALPE_OWN = ("head_top", "neck_base", "hips_middle")

_BLAZEPOSE33 = (
    "nose",
    *(f"{side}_{name}_surface" for side in SIDES for name in ("eye_inner", "eye", "eye_outer")),
    *_left_and_right("ear", "mouth_corner", suffix="_surface"),
    *_left_and_right(
        "shoulder",
        "elbow",
        "wrist",
        "pinky1",
        "index1",
        "thumb2",
        "hip",
        "knee",
        "ankle",
        "heel",
        "foot_tip",
    ),
)

SKELETONS: Mapping[str, Skeleton] = {
    skeleton.name: skeleton
    for skeleton in (
        _standard("coco17", _COCO17),
        _standard("coco23", _COCO23),
        _standard("blazepose33", _BLAZEPOSE33),
        _standard("openpose_hand21_left", _hand("left")),
        _standard("openpose_hand21_right", _hand("right")),
        _standard(
            "wholebody69",
            (*_COCO23, *_FACE_POINTS.values(), *_hand("left")[1:], *_hand("right")[1:]),
        ),
        _wholebody133(),
        _standard(
            "halpe26",
            (*_COCO17, *_HALPE_OWN, *_left_and_right("big_toe", "small_toe", "heel")),
            _HALPE_OWN,
        ),
    )
}
"""Standard skeletons by name, without calibration to a network.

"coco23" is COCO-17 with the six foot points of COCO-WholeBody; "wholebody69" are the points of
COCO-WholeBody that exist on the body model. A hand is the wrist, then thumb, index, middle, ring
and pinky, each from base to tip: the order of OpenPose and of MediaPipe.
"""


def other_side(name: str) -> str:
    """Return the name of the point on the other side of the body; that of a point without one."""
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


def mirrored_order(names: Sequence[str]) -> list[int]:
    """Return for each point the index (J,) of its left-right counterpart, or its own index."""
    place = {name: i for i, name in enumerate(names)}
    return [place.get(other_side(name), i) for i, name in enumerate(names)]


MAX_FINGER_KEYPOINTS = 10
"""A joint set with more has keypoints of all finger joints."""


def is_finger(name: str) -> bool:
    """Return whether a point is a joint or the tip of a finger, by its name ("left_index1",
    "right_thumb_tip").
    """
    finger = name.removeprefix("left_").removeprefix("right_")
    return finger.startswith(_FINGERS) and (finger[-1].isdigit() or finger.endswith("_tip"))


def keypoint_in_words(name: str) -> str:
    """Return the name of a point for messages: "left_eye_surface" is the "left eye"."""
    return name.removesuffix("_surface").replace("_", " ")


def skeleton_named(skeleton: Skeleton | str) -> Skeleton:
    """Return the standard skeleton with a name; a Skeleton is returned unchanged.

    Raises:
        ValueError: no standard skeleton has this name.
    """
    if isinstance(skeleton, Skeleton):
        return skeleton
    if skeleton not in SKELETONS:
        raise ValueError(
            f"no standard skeleton is named {skeleton!r}: choose one of {', '.join(SKELETONS)}, "
            "or give a physic_core.types.Skeleton of your own"
        )
    return SKELETONS[skeleton]
