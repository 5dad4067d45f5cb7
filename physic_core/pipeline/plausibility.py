"""What makes the results of a backend doubtful that neither ships with the project nor has passed
the conformance kit: the frequent mistakes of honest authors that a run can see.

The kit finds more, since it knows the truth. Each doubt is the end of a sentence that begins with
the name of the backend.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces.comparison import describe_difference, is_sigmoid_of_probability
from physic_core.judge.trust import relative_excess
from physic_core.types.observations import LEAST_PROBABILITY

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hands, Reconstruction, UInt8Array

_MOST_BENT_DEG = 150.0  # of a finger's joint; no healthy one bends over 125
_MOST_TURNED_DEG = 100.0  # of a wrist from where the body has it
_FEWEST_DEPTHS = 256  # of a map; those of 8 bits have as many
_LARGE_MAP_PX = 10_000
_EDGE_PX = 2
_STEP_AT_EDGE = 3.0  # times the photo's own steps beside it, and
_LEAST_STEP = 16.0  # grey levels
_FEWEST_NEAR = 0.4  # of the vertices that touch by the prior, and
_LEAST_LIFT = 1.3  # times the share of all vertices: in another order both are the same
_SOME_NEAR = 0.05  # of all vertices; a body that is near nothing tells nothing
_FEWEST_VERTICES = 30
_BOX = 1.2  # times the sides of a box: where its person's points lie
_FEWEST_IN_BOXES = 0.6  # share of certain points; a choice, not fitted to photos
_OF_ONE_PHOTO = (
    *("inpainter", "metric_depth", "relative_pointmap"),
    *("keypoint_detector", "body_estimator"),
)
_ANSWERS_OF = {
    "photo_alignment": ("inpainter", "relative_pointmap"),
    "depth_scale": ("metric_depth",),
    "depth_order": ("metric_depth", "relative_pointmap"),
    "focal_agreement": ("relative_pointmap", "metric_depth"),
    "heads": ("segmenter",),
    "limb_keypoints": ("keypoint_detector", "body_estimator"),
    "body_in_mask": ("segmenter", "keypoint_detector", "body_estimator"),
    "support": ("relative_pointmap", "body_estimator"),
    "low_depth": ("relative_pointmap", "keypoint_detector", "body_estimator"),
}
"""Check -> interfaces whose answers it compares with those of others."""
_EQUAL = "two people have the same values: is the result of one person repeated for all?"


def implausibilities(interface: str, request: Any, result: Any) -> Iterator[str]:
    """Yield what makes one result doubtful, by itself and its request."""
    if interface == "inpainter":
        yield from _implausible_fill(request.image, request.mask, result)
    elif interface in ("metric_depth", "relative_pointmap"):
        z = result.depth if interface == "metric_depth" else result.points[..., 2][result.valid]
        known = z[np.isfinite(z)]
        count = len(np.unique(known)) if known.size > _LARGE_MAP_PX else _FEWEST_DEPTHS
        if 1 < count < _FEWEST_DEPTHS:
            yield f"{known.size:,} pixels have {count} different depths: are they rounded?"
        if interface == "relative_pointmap" and result.up is not None and result.up[1] > 0:
            yield "its up points down in the picture: is it the direction of gravity?"
    elif interface == "hand_estimator":
        bent = np.degrees(np.linalg.norm(result.rotvecs, axis=-1))[
            result.confidence > LEAST_PROBABILITY
        ]
        if bent.size and np.nanmax(bent) > _MOST_BENT_DEG:
            yield (
                f"a finger is bent by {np.nanmax(bent):.0f} degrees: are rotations in radians, and "
                f"at most pi?"
            )
    elif interface == "segmenter":
        if result.masks[:, [0, 0, -1, -1], [0, -1, 0, -1]].all(1).any():
            yield "the mask of a person covers the four corners of the photo: is it inverted?"
    elif interface == "body_estimator":
        if _all_rows_equal(result.parameters.body_pose):
            yield _EQUAL
    elif interface in ("keypoint_detector", "contact_prior"):
        is_contact = interface == "contact_prior"
        values = result.probability if is_contact else result.confidence
        if is_contact and _all_rows_equal(values):
            yield _EQUAL
        elif not is_contact:
            yield from _implausible_points(
                request.people.boxes, result.points[values > LEAST_PROBABILITY]
            )
        if values.size and np.ptp(values) and is_sigmoid_of_probability(values):
            yield (
                f"all values are from {values.min():.2f} to {values.max():.2f}: is a sigmoid "
                f"applied twice?"
            )


def _implausible_points(boxes: FloatArray, points: FloatArray) -> Iterator[str]:
    """Yield whether the points (K, 2) that are certain are not where the people are."""
    start, end = boxes[:, None, :2], boxes[:, None, 2:]
    near = np.abs(points - (start + end) / 2) < _BOX * (end - start) / 2
    share = float(near.all(2).any(0).mean()) if len(boxes) and len(points) else 1.0
    if share < _FEWEST_IN_BOXES:
        yield (
            f"{share:.0%} of its certain points lie in the boxes of people: are they px of the "
            f"photo, x before y?"
        )


def _all_rows_equal(values: FloatArray) -> bool:
    """Return whether two people have the same values, which vary."""
    rows = values.reshape(len(values), -1)
    rows = rows[np.ptp(rows, axis=1) > 0]
    return len(np.unique(rows, axis=0)) < len(rows)


def repetition_warnings(
    interface: str, image: UInt8Array, result: Any, next_image: UInt8Array, next_result: Any
) -> Iterator[str]:
    """Yield whether a backend gives one result for two photos that cannot have the same."""
    if (
        interface in _OF_ONE_PHOTO
        and not np.array_equal(image, next_image)
        and not describe_difference(result, next_result)
    ):
        yield "two photos have the same result: is that of the last photo kept?"


def _implausible_fill(image: UInt8Array, mask: BoolArray, filled: UInt8Array) -> Iterator[str]:
    """Yield whether the colours of the fill do not go on where the photo ends."""
    import cv2

    if mask.any() and (filled == image)[mask].all(1).mean() > _FEWEST_IN_BOXES:
        yield "it leaves the photo in the hole as it is: is the mask inverted?"
        return
    hole = mask.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    grown = [cv2.dilate(hole, kernel, iterations=n * _EDGE_PX) for n in (1, 2)]
    eroded = cv2.erode(hole, kernel, iterations=_EDGE_PX, borderValue=1)
    rings = [(hole > 0) & (eroded == 0), (grown[0] > 0) & ~mask, (grown[1] > 0) & (grown[0] == 0)]
    if not all(ring.any() for ring in rings):
        return
    inside, beside, beyond = (
        _values_along_ring(ring, filled.astype(np.float64), rings[1]) for ring in rings
    )
    step, usual = (float(np.median(np.abs(one - beside).max(1))) for one in (inside, beyond))
    if step > max(_LEAST_STEP, _STEP_AT_EDGE * usual):
        exchanged = float(np.median(np.abs(inside[:, ::-1] - beside).max(1)))
        why = "are red and blue swapped?" if exchanged < 0.5 * step else "is its range right?"
        yield (
            f"at the edge of the hole, its colors differ by {step:.0f} gray levels from the "
            f"photo, which changes by {usual:.0f} there: {why}"
        )


def _values_along_ring(ring: BoolArray, picture: FloatArray, edge: BoolArray) -> FloatArray:
    """Return the colours (K, 3) of the pixels of a ring that are nearest to those of an edge."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~ring, return_distances=False, return_indices=True)
    colours: FloatArray = picture[nearest[0][edge], nearest[1][edge]]
    return colours


def implausible_wrists(hands: Hands, turned_deg: FloatArray) -> str:
    """Return whether the wrists (N, 2) are so far from those of the bodies that they are none; ""
    if they are not.
    """
    certain = turned_deg[(hands.confidence > LEAST_PROBABILITY) & np.isfinite(turned_deg)]
    if not certain.size or np.median(certain) <= _MOST_TURNED_DEG:
        return ""
    return (
        f"wrists are turned by {np.median(certain):.0f} degrees from those of the bodies, and are "
        f"not used: are they rotations from the T-pose to the camera's frame?"
    )


def disagreement_with_other_backends(
    result: Reconstruction, interfaces: Collection[str]
) -> tuple[str, str]:
    """Return which of these interfaces has the answer that is furthest from those of the others,
    and by what; "" twice if no check and no size of a person contradicts one of them.

    The distance is the sum of the loads of failed checks that compare the answer.
    """
    loads: dict[str, list[tuple[float, str]]] = {name: [] for name in interfaces}
    for interface, load, what in _distances(result):
        if interface in loads:
            loads[interface].append((load, what))
    furthest = max(loads, key=lambda name: sum(load for load, _ in loads[name]), default="")
    if not loads.get(furthest):
        return "", ""
    what = max(loads[furthest])[1]
    return furthest, f"its answer is the furthest from those of the other backends ({what})"


def _distances(result: Reconstruction) -> Iterator[tuple[str, float, str]]:
    """Yield interface, load and words of what its answer contradicts."""
    from physic_core.engine.ground.report import SIZES_DISAGREE

    for check in result.checks:
        if check.failed:
            load = relative_excess(check.value, check.threshold, check.direction, check.unit)
            who = "" if check.person is None else f"person {check.person}, "
            for interface in _ANSWERS_OF.get(check.name, ()):
                yield interface, load or 0.0, f"{who}{check}"
    for row in result.diagnostics["witnesses"].get("scale", ()):
        away = row["log_ratio"]
        if (
            row["by"] in ("size", "soles")
            and abs(away) > SIZES_DISAGREE
            and row["right"] < LEAST_PROBABILITY
        ):
            person = row["person"]
            says_child = (result.people[person].child_probability or 0.0) > LEAST_PROBABILITY
            yield (
                "person_observer" if says_child else "body_estimator",
                abs(away) / SIZES_DISAGREE,
                f"floor and others make person {person} {math.exp(-away):.2g} times as tall",
            )


def implausible_contact_places(result: Reconstruction, probability: FloatArray) -> str:
    """Return whether vertices that touch by the contact prior (N, V) are far from everything; "" if
    they are not.
    """
    from physic_core.engine.contact.distances import SEARCH_RADIUS_M

    for index, (person, likely) in enumerate(zip(result.people, probability, strict=True)):
        wanted = likely >= LEAST_PROBABILITY
        near = (np.abs(person.distance) < SEARCH_RADIUS_M) | person.contact
        share = float(near[wanted].mean()) if wanted.sum() >= _FEWEST_VERTICES else 1.0
        if near.mean() > _SOME_NEAR and share < min(_FEWEST_NEAR, _LEAST_LIFT * near.mean()):
            return (
                f"of the vertices of person {index} that touch something by its probabilities, "
                f"{share:.0%} are near anything: are they in the order of the mesh, and of the "
                f"people?"
            )
    return ""
