"""Detect several people with networks made for one person.

The pose detector expects one person in front of the camera. For groups, it also runs on overlapping tiles of the photo,
detections of the same body are merged, and the landmark network rejects false ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.detections import box_iou
from physic_embedded.networks.crops import ImagePyramid, letterbox_square
from physic_embedded.networks.pose import person_square, predict_pose
from physic_embedded.networks.single_shot_detection import Detection, anchor_centers, decode_detections

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from physic_core.adapters.onnx_sessions import OnnxSession
    from physic_embedded.networks.pose import Pose

    Float = NDArray[np.floating[Any]]

__all__ = ["detect_people", "detect_poses", "is_person", "is_same_person", "merge_candidates", "tiles"]

DETECTOR_SIZE = 224
DETECTOR_LAYERS = ((8, 2), (16, 2), (32, 6))
TORSO = [11, 12, 23, 24]


def detect_poses(
    detector: OnnxSession,
    landmarker: OnnxSession,
    image: NDArray[np.uint8],
    *,
    sure: float = 0.75,
    weak: float = 0.3,
    fractions: Sequence[float] = (0.6, 0.4),
    most: int = 20,
) -> list[tuple[Pose, float]]:
    """Detect the poses of all people in an image, and return them with their scores, best first.

    Of several candidates on one body, the one whose joints agree best with those of its mirror image stays.

    Args:
        detector: session of ``pose_detection``.
        landmarker: session of ``pose_landmark_heavy``.
        image: (H, W, 3).
        sure: detector score from which a candidate is a person, see :func:`is_person`.
        weak: detector score from which a candidate is looked at; 0.2 more in a tile, where a close view of anything
            looks more like a person.
        fractions: tile sides over the photo's long side.
        most: at most so many people.
    """
    picture = ImagePyramid.from_image(image)
    weak = min(weak, sure)
    seen = []
    for d in detect_people(detector, picture, weak, min(weak + 0.2, sure), fractions)[: 2 * most]:
        pose = predict_pose(landmarker, picture, person_square(d.keypoints[0], d.keypoints[1]))
        if is_person(pose, d.score, sure):
            seen.append((pose, d.score * pose.score))
    kept: list[tuple[Pose, float]] = []
    for pose, score in sorted(seen, key=lambda s: s[0].mirror_gap):
        if not any(is_same_person(pose, k) for k, _ in kept):
            kept.append((pose, score))
    return sorted(kept, key=lambda s: -s[1])[:most]


def tiles(width: int, height: int, fractions: Sequence[float], smallest: int = 160) -> Iterator[tuple[int, int, int]]:
    """Yield overlapping squares (x, y, side) that cover a photo.

    Args:
        width: of the photo, px.
        height: of the photo, px.
        fractions: sides over the photo's long side; 1 is the whole photo and is not a tile.
        smallest: no tile has a side below this, px.
    """
    for fraction in fractions:
        side = int(fraction * max(width, height))
        if side < smallest or fraction >= 1.0:
            continue

        def starts(length: int, side: int = side) -> list[int]:
            if length <= side:
                return [0]
            count = int(np.ceil((length - side) / (side / 2))) + 1
            return [int(v) for v in np.linspace(0, length - side, count)]

        for y in starts(height):
            for x in starts(width):
                yield x, y, side


def detect_people(
    session: OnnxSession, picture: ImagePyramid, threshold: float, tile_threshold: float, fractions: Sequence[float]
) -> list[Detection]:
    """Detect candidate people in the full photo, its tiles and their mirror images: photo px, best score first.

    Overlapping detections are merged. Keypoint 0 of a candidate lies between the hips, keypoint 1 at the radius that
    the landmark network needs.

    Args:
        session: of ``pose_detection``.
        picture: the photo.
        threshold: lowest score in the whole photo.
        tile_threshold: lowest score in a tile.
        fractions: tile sides over the photo's long side; the short side of a photo longer than all of them is added.
    """
    # People fill the height of a panorama, and the whole of it shows them too small.
    short = min(picture.width, picture.height) / max(picture.width, picture.height)
    if fractions and short < min(fractions):
        fractions = [*fractions, short]
    # The smallest copy of the photo whose tiles still fill the network's input.
    smallest = min([1.0, *fractions])
    image = [v for v in picture.levels if max(v.shape[:2]) * smallest >= DETECTOR_SIZE or v is picture.levels[0]][-1]
    h, w = image.shape[:2]
    scale = np.array([picture.width / w, picture.height / h])

    def to_photo(points: Float) -> Float:
        at: Float = (points + 0.5) * scale - 0.5
        return at

    anchors = anchor_centers(DETECTOR_SIZE, DETECTOR_LAYERS)
    found: list[Detection] = []
    for x, y, side, lowest in [(0, 0, max(h, w), threshold), *((*t, tile_threshold) for t in tiles(w, h, fractions))]:
        shown, square = letterbox_square(image[y : y + side, x : x + side], DETECTOR_SIZE, (x, y))
        for mirrored in (False, True):
            pixels = shown[:, ::-1] if mirrored else shown
            boxes, scores = session.run(["boxes", "scores"], {"image": pixels[None].astype(np.float32) / 127.5 - 1.0})
            for d in decode_detections(boxes[0], scores[0, :, 0], anchors, DETECTOR_SIZE, lowest):
                points = np.concatenate([d.box.reshape(2, 2), d.keypoints])
                if mirrored:
                    points[:, 0] = DETECTOR_SIZE - points[:, 0]
                    points[:2, 0] = points[1::-1, 0]
                points = to_photo(square.to_photo(points, DETECTOR_SIZE))
                found.append(Detection(points[:2].ravel(), points[2:], d.score))
    return merge_candidates(found)


def merge_candidates(found: Sequence[Detection], nearness: float = 0.35, overlap: float = 0.3) -> list[Detection]:
    """Merge detections of the same person and keep the best.

    Two candidates do when their mid hips are nearer than ``nearness`` times the larger body radius, or when their boxes
    overlap by more than ``overlap`` (intersection over union).
    """

    def radius(d: Detection) -> float:
        return float(np.linalg.norm(d.keypoints[1] - d.keypoints[0]))

    kept: list[Detection] = []
    for d in sorted(found, key=lambda d: -d.score):
        if all(
            np.linalg.norm(d.keypoints[0] - k.keypoints[0]) > nearness * max(radius(d), radius(k))
            and box_iou(d.box[None], k.box[None])[0, 0] < overlap
            for k in kept
        ):
            kept.append(d)
    return kept


def is_person(pose: Pose, detected: float, sure: float) -> bool:
    """Return whether a candidate is a person.

    From a detector score of ``sure`` on, the landmark network's score decides. That score alone also accepts armchairs.
    A weaker candidate must therefore look the same in the mirror image, and have a trunk of plausible length.

    Args:
        pose: what the landmark network made of it.
        detected: the detector's score.
        sure: such as 0.75.
    """
    if detected >= sure:
        return pose.score > 0.5
    steady = pose.mirror_gap < 0.015 and pose.mirror_mask_iou > 0.92
    return pose.score > 0.95 and steady and pose.torso_length > 0.15 * pose.square.side


def is_same_person(a: Pose, b: Pose) -> bool:
    """Return whether two poses belong to the same person.

    They are when their trunks' corners are on average nearer than half a trunk, or when their noses are nearer than a
    quarter of one: the hips of a person who is cut off by the photo's edge are a guess, the head is not.
    """
    length = max(a.torso_length, b.torso_length, 1e-6)
    apart = np.linalg.norm(a.points - b.points, axis=1)
    seen = min(a.visibility[0] * a.presence[0], b.visibility[0] * b.presence[0]) > 0.5
    return bool(apart[TORSO].mean() < 0.5 * length or (seen and apart[0] < 0.25 * length))
