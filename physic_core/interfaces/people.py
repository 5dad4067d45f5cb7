"""Interfaces Segmenter, KeypointDetector and PersonObserver: masks of people, floor and surfaces;
2D keypoints of the people; and what they do.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    METRES,
    PIXELS,
    check_array,
    check_fields,
    check_finite,
    check_limit,
    check_type,
    check_unit_range,
    length,
    rows_to_check,
    valid_rows,
    within_limit,
)
from physic_core.types import (
    CARRIER_NAMES,
    SURFACE_NAMES,
    Carrier,
    Keypoints,
    Observations,
    People,
    Skeleton,
    SurfaceLabels,
    UnposedPerson,
    skeleton_named,
)
from physic_core.types.observations import CHOICES, PROBABILITIES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, PeoplePrompt, UInt8Array


@dataclass(frozen=True)
class SegmenterRequest(Request[People]):
    """Input of a Segmenter: the photo, and the people whom the user chose in it.

    ``prompt`` is None without a choice, and always for a backend that does not set
    ``takes_prompt``.
    """

    prompt: PeoplePrompt | None = field(default=None, kw_only=True)

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Return the arguments of ``infer``: the image, and the prompt if there is one."""
        return (self.image,) if self.prompt is None else (self.image, self.prompt)


class Segmenter(Backend):
    """Segments people, optionally the floor and surfaces by their kind (paper: GroundingDINO +
    SAM2).

    Attributes:
        takes_prompt: whether ``infer`` also takes ``prompt: PeoplePrompt | None = None`` as second
            argument. With a prompt it returns exactly one person per prompt, in the order of the
            prompts, and keeps the given masks. It raises NoPersonError for a prompt without a
            person. Without ``takes_prompt``, the pipeline selects the chosen people from all people
            that the backend finds.
    """

    interface = "segmenter"
    api = 1
    Request = SegmenterRequest
    Result = People
    takes_prompt: ClassVar[bool] = False

    @abstractmethod
    def infer(self, image: UInt8Array) -> People:
        """Segment the people in an image, best score first; N = 0 without people.

        Scores rank people and are reported; they need not be calibrated. Leave out all but people:
        every returned person is reconstructed.

        Example: a person in columns 2 and 3 and rows 5 to 9 has the box (2, 5, 4, 10), and
        ``mask[5:10, 2:4]`` holds all of the mask.
        """

    @classmethod
    def check(cls, result: People, request: SegmenterRequest) -> Iterator[str]:
        """Check masks (disjoint), boxes and scores of N people, and all optional fields."""
        height, width = request.image.shape[:2]
        n = length(result.masks)
        wrong = check_fields(result, N=n, H=height, W=width)
        for mask in result.floor_candidates:
            wrong += check_array("floor_candidates", mask, (height, width), "bool")
        yield from wrong
        yield from _check_boxes("unposed", result.unposed, UnposedPerson)
        yield from _check_boxes("carriers", result.carriers, Carrier)
        if not wrong and n:
            yield from _check_values(result, height, width)
        if request.prompt is not None and n != len(request.prompt):
            yield f"one person per prompt is needed, {len(request.prompt)} in all, got {n}"
        if result.keypoints is not None:
            wrong_type = list(check_type(result.keypoints, Keypoints, "keypoints"))
            yield from wrong_type or keypoint_violations(result.keypoints, n)
        if result.surfaces is not None:
            wrong_type = list(check_type(result.surfaces, SurfaceLabels, "surfaces"))
            yield from wrong_type or _check_surfaces(result.surfaces, height, width)


def _check_surfaces(surfaces: SurfaceLabels, height: int, width: int) -> Iterator[str]:
    names = surfaces.names
    wrong = check_fields(surfaces, "surfaces.", H=height, W=width)
    if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
        wrong.append(f"surfaces.names must be a tuple of texts, got {names!r}")
    elif unknown := [name for name in names if name not in SURFACE_NAMES]:
        known = ", ".join(SURFACE_NAMES)
        wrong.append(
            f"surfaces.names has {', '.join(map(repr, unknown))}; the names of surfaces are {known}"
        )
    elif len(set(names)) < len(names):
        wrong.append("surfaces.names must not name a surface twice")
    yield from wrong
    if not wrong and surfaces.labels.size and (highest := int(surfaces.labels.max())) >= len(names):
        yield f"surfaces.labels must be below the {len(names)} names, got {highest}"


def _check_boxes(name: str, found: Any, kind: type[UnposedPerson | Carrier]) -> Iterator[str]:
    if not (isinstance(found, tuple | list) and all(isinstance(one, kind) for one in found)):
        yield f"{name} must be a tuple of {kind.__name__}, got {found!r}"
        return
    for one in found:
        if not (0 <= one.score <= 1 and one.box[0] < one.box[2] and one.box[1] < one.box[3]):
            yield (
                f"{name} needs boxes x0 y0 x1 y1 and scores in [0, 1], got {one.box} and "
                f"{one.score}"
            )
        if isinstance(one, Carrier) and one.name not in CARRIER_NAMES:
            names = ", ".join(CARRIER_NAMES)
            yield f"carriers has {one.name!r}; the names of carriers are {names}"


def _check_values(people: People, height: int, width: int) -> Iterator[str]:
    yield from check_unit_range("scores", people.scores)
    empty = [i for i in range(len(people)) if not people.masks[i].any()]
    if empty:
        yield f"every person needs at least one pixel, masks {empty} are empty"
    wrong = [*check_finite("boxes", people.boxes)]
    yield from wrong
    if people.masks.sum(0, dtype="int64").max() > 1:
        yield "masks of two people overlap: every pixel belongs to one person at most"
    elif not (empty or wrong):
        yield from _check_boxes_of_masks(people.boxes, people.masks)


_HELD = 0.3  # least share of most masks that their boxes hold
_AGREES = 0.8  # least IoU with the masks of boxes that are in another notation
_LESS = 0.15  # least loss of IoU of such boxes, read as x0 y0 x1 y1


def _check_boxes_of_masks(boxes: FloatArray, masks: BoolArray) -> Iterator[str]:
    """Check that boxes (N, 4) are inside the image and hold their masks (N, H, W), none empty.

    A box may be larger than its mask, as that of a person who is hidden in part.
    """
    import numpy as np

    height, width = masks.shape[1:]
    spans = np.array([_mask_box(mask) for mask in masks])
    corner, rest = boxes[:, :2], boxes[:, 2:]
    notations = {
        "x, y, width, height": np.hstack([corner, corner + rest]),
        "center, width, height": np.hstack([corner - rest / 2, corner + rest / 2]),
        "y0, x0, y1, x1": boxes[:, [1, 0, 3, 2]],
        "shares of the image": boxes * [width, height, width, height],
    }
    fits = {name: _mean_iou(read, spans) for name, read in notations.items()}
    likely = max(fits, key=fits.__getitem__)
    is_other = fits[likely] > max(_AGREES, _mean_iou(boxes, spans) + _LESS)
    held = np.array([_share_in_box(*one) for one in zip(boxes, masks, strict=True)])
    outside = (boxes < 0).any(1) | (boxes[:, 2] > width) | (boxes[:, 3] > height) | (held == 0)
    if outside.any() or np.median(held) < _HELD or is_other:
        i = int(np.argmin(np.where(outside, -1.0, held)))
        yield (
            f"boxes must be x0 y0 x1 y1 around their masks, inside the {width} x {height} px "
            f"image, got {boxes[i].round(1).tolist()} of a mask in {spans[i].tolist()}"
            + (f": they look like {likely}" if is_other else "")
        )


def _mask_box(mask: BoolArray) -> list[int]:
    """Return the tight box x0 y0 x1 y1 of a mask."""
    import numpy as np

    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    return [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1]


def _share_in_box(box: FloatArray, mask: BoolArray) -> float:
    x0, y0, x1, y1 = (max(0, round(float(edge))) for edge in box)
    return float(mask[y0:y1, x0:x1].sum() / mask.sum())


def _mean_iou(boxes: FloatArray, others: FloatArray) -> float:
    import numpy as np

    both = np.minimum(boxes[:, 2:], others[:, 2:]) - np.maximum(boxes[:, :2], others[:, :2])
    common = np.maximum(both, 0).prod(1)
    areas = [np.maximum(one[:, 2:] - one[:, :2], 0).prod(1) for one in (boxes, others)]
    return float((common / (sum(areas) - common)).mean())


@dataclass(frozen=True)
class KeypointDetectorRequest(Request[Keypoints]):
    """Input of a KeypointDetector: the photo and N people."""

    people: People


class KeypointDetector(Backend):
    """Detects the 2D keypoints of segmented people (paper: ViTPose whole-body)."""

    interface = "keypoint_detector"
    api = 1
    Request = KeypointDetectorRequest
    Result = Keypoints

    @abstractmethod
    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Detect the keypoints of N people in an image.

        A confidence c says how likely the point is right: about half of the points with c = 0.5
        are. In the standard preset points weigh as much as their confidence, those below 0.3 a
        tenth of it, and those with 0 nothing. A detector that knows its own errors states them in
        ``sigma`` and ``depth_sigma``.

        Example: a heat map of 48 x 64 cells over a crop of 192 x 256 px from (x0, y0) on has its
        maximum in cell (i, j): the point is (x0 + 4 (i + 0.5) - 0.5, y0 + 4 (j + 0.5) - 0.5).
        """

    @classmethod
    def check(cls, result: Keypoints, request: KeypointDetectorRequest) -> Iterator[str]:
        """Check the keypoints of N people; points with a confidence above 0 must be within
        limits.
        """
        yield from keypoint_violations(result, len(request.people))


def keypoint_violations(keypoints: Keypoints, people: int) -> Iterator[str]:
    """Yield one sentence for each fault of the keypoints of ``people`` people, of a
    KeypointDetector or a Segmenter.
    """
    joints = keypoints.points.shape[1] if getattr(keypoints.points, "ndim", 0) == 3 else None
    wrong = [
        *_check_skeleton(keypoints.skeleton, joints),
        *check_fields(keypoints, N=people),
    ]
    if keypoints.depth_sigma is not None and keypoints.world is None:
        wrong.append("depth_sigma needs world: it is the error of its depths")
    yield from wrong
    if wrong:
        return
    rows = rows_to_check(valid_keypoint_rows(keypoints))
    confidence = keypoints.confidence[rows]
    yield from check_unit_range("confidence", confidence)
    yield from check_limit("points", keypoints.points[rows][confidence > 0], PIXELS, "px")
    if keypoints.world is not None:
        yield from check_limit("world", keypoints.world[rows][confidence > 0], METRES, "m")
    if keypoints.world_spread is not None and (keypoints.world_spread < 0).any():
        yield "world_spread must be at least 0, or NaN where unknown"
    for name, sigma in _sigmas(keypoints):
        if not (sigma[rows][confidence > 0] > 0).all():
            yield f"{name} must be above 0 where confidence is"


def _sigmas(keypoints: Keypoints) -> list[tuple[str, FloatArray]]:
    """Return name and values of the standard deviations that are given."""
    sigmas = (("sigma", keypoints.sigma), ("depth_sigma", keypoints.depth_sigma))
    return [(name, sigma) for name, sigma in sigmas if sigma is not None]


def _check_skeleton(skeleton: object, joints: int | None) -> Iterator[str]:
    if not isinstance(skeleton, Skeleton | str):
        yield (
            f"skeleton must be a Skeleton or the name of a standard one, got "
            f"{type(skeleton).__name__}"
        )
        return
    try:
        names = skeleton_named(skeleton).names
    except ValueError as error:
        yield str(error)
        return
    if joints is not None and len(names) != joints:
        yield f"points must be those of the skeleton, {len(names)} a person, got {joints}"


def valid_keypoint_rows(keypoints: Keypoints) -> BoolArray:
    """Return (N,) bool: True for people with finite confidence, and points and errors in limits
    where it is above 0.
    """
    undetected = keypoints.confidence <= 0
    valid = valid_rows([(keypoints.confidence, math.inf)], len(keypoints.points))
    valid &= (within_limit(keypoints.points, PIXELS).all(-1) | undetected).all(1)
    if keypoints.world is not None:
        valid &= (within_limit(keypoints.world, METRES).all(-1) | undetected).all(1)
    for _, sigma in _sigmas(keypoints):
        valid &= (within_limit(sigma, PIXELS) & (sigma > 0) | undetected).all(1)
    return valid


@dataclass(frozen=True)
class PersonObserverRequest(Request[Observations]):
    """Input of a PersonObserver: the photo, N people, their keypoints, and the camera."""

    people: People
    keypoints: Keypoints
    intrinsics: Intrinsics


class PersonObserver(Backend):
    """Estimates what each person does, which limbs touch something, and where the face points
    (paper: none).
    """

    interface = "person_observer"
    api = 1
    Request = PersonObserverRequest
    Result = Observations

    @abstractmethod
    def infer(
        self, image: UInt8Array, people: People, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Observations:
        """Return calibrated probabilities for N people; NaN for whatever the backend does not
        tell.

        Start from ``Observations.unknown(len(people))``. Give each probability with its share, the
        frequency of "yes" in the labels that it was fitted on.

        Example: a network fitted on people of whom a tenth sit on something, who therefore have a
        ``touch_share`` of (0.1, 0, 0, 0, 0.9) for the seat, returns this row as ``touch[i, 4]`` for
        whom it cannot judge: that says nothing.
        """

    @classmethod
    def check(cls, result: Observations, request: PersonObserverRequest) -> Iterator[str]:
        """Check shapes; probabilities in [0, 1] with a share in (0, 1), postures and answers of
        touch that sum to 1, and directions of length 1 with a sigma above 0. NaN is allowed.
        """
        wrong = check_fields(result, N=len(request.people))
        for name in ("child_share", "away_share"):
            if not isinstance(share := getattr(result, name), Real):
                wrong.append(f"{name} must be a number or NaN, got {share!r}")
        yield from wrong
        if not wrong:
            for name in PROBABILITIES:
                yield from _check_probability(name, result)
            yield from _check_head(result)


def _check_probability(name: str, result: Observations) -> Iterator[str]:
    import numpy as np

    value = getattr(result, name)
    share = getattr(result, f"{name}_share")
    is_known = value == value
    yield from check_unit_range(name, value[is_known])
    if name in CHOICES:
        rows = is_known.any(-1)
        sums = [*value[rows].sum(-1), *np.broadcast_to(share, value.shape)[rows].sum(-1)]
        if any(not abs(float(each) - 1) <= 1e-3 for each in sums):
            yield f"each row of {name}, and {name}_share, must sum to 1; a row may be NaN"
    elif not ((share > 0) & (share < 1) | ~is_known).all():
        yield f"{name}_share must lie between 0 and 1 where {name} is given, got {share}"


def _check_head(result: Observations) -> Iterator[str]:
    has_head = (result.head == result.head).any(1)
    squares = (result.head[has_head].astype(float) ** 2).sum(1)
    if not (abs(squares - 1) <= 2e-3).all():  # False for a row that is NaN in part
        yield "each row of head must be a unit vector, or NaN"
    if not (result.head_sigma[has_head] > 0).all():
        yield "head_sigma must be above 0 where head is given"
