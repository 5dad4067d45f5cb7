"""How far harmless changes of a picture move the answers of the embedded observer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from physic_core.types import Keypoints, Observations
from physic_embedded.person_observer import fitted_numbers, observed, tokens_of_questions
from physic_testing.conformance.truth import mirrored_order

from .sample import Array, Encoder, Picture, Seen

SMALLER = 0.9
SHOWN = ("touch", "holds", "in_air", "child", "posture")
_MIRRORED = {"touch": [1, 0, 3, 2, 4], "holds": [1, 0]}


@dataclass(frozen=True)
class Variant:
    """A changed picture, and where its people are.

    Attributes:
        picture: (H, W, 3) RGB.
        keypoints: of N people.
        boxes: (N, 4) px.
        mirrored: whether left and right change places.
    """

    picture: Picture
    keypoints: Keypoints
    boxes: Array
    mirrored: bool = False


def variants(picture: Picture, seen: Seen) -> dict[str, Variant]:
    """Return the mirror image, the grey and the smaller picture, and one with a column less."""
    plain = Variant(picture, seen.keypoints, seen.boxes)
    height, width = picture.shape[:2]
    other = mirrored_order(seen.keypoints.joint_set.names)
    flipped = seen.keypoints.points[:, other] * [-1, 1] + [width - 1, 0]
    mirror = replace(
        seen.keypoints,
        points=flipped.astype(np.float32),
        confidence=seen.keypoints.confidence[:, other],
    )
    boxes = seen.boxes[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [width, 0, width, 0]
    size = round(width * SMALLER), round(height * SMALLER)
    factor = np.array(size) / [width, height]
    small = replace(seen.keypoints, points=(seen.keypoints.points + 0.5) * factor - 0.5)
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    shrunk = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return {
        "unchanged": plain,
        "mirror": Variant(picture[:, ::-1].copy(), mirror, boxes, mirrored=True),
        "grey": replace(plain, picture=grey),
        "smaller": Variant(shrunk, small, seen.boxes * np.tile(factor, 2)),
        "a column less": replace(plain, picture=picture[:, :-1].copy()),
    }


def moved(
    pictures: Iterable[tuple[Picture, Seen]], encoder: Encoder, others: Mapping[str, Encoder]
) -> dict[tuple[str, str], list[float]]:
    """Return how far each probability moves: change and field -> absolute differences.

    Args:
        pictures: and what was seen in them.
        encoder: sees every variant.
        others: further encoders by name, which see the unchanged picture.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for picture, seen in pictures:
        changed = variants(picture, seen)
        usual = _answers(encoder, changed["unchanged"])
        answers = {name: _answers(encoder, one) for name, one in changed.items()}
        answers |= {name: _answers(one, changed["unchanged"]) for name, one in others.items()}
        for name, own in answers.items():
            for field in SHOWN:
                off = np.abs(np.asarray(own[field]) - usual[field])
                found.setdefault((name, field), []).extend(off[np.isfinite(off)].tolist())
    return found


def _answers(encoder: Encoder, variant: Variant) -> dict[str, Array]:
    tokens = encoder(variant.picture)
    answers: Observations = observed(
        tokens_of_questions(tokens, variant.boxes, variant.keypoints), fitted_numbers()
    )
    found = {name: np.asarray(getattr(answers, name), np.float64) for name in SHOWN}
    if variant.mirrored:
        found |= {name: found[name][:, columns] for name, columns in _MIRRORED.items()}
    return found


def lines_of(found: Mapping[tuple[str, str], Sequence[float]]) -> list[str]:
    """Return a line for each change and field: number of answers, median and 90th percentile."""
    return [
        f"{name:16} {field:8} {len(off):5} {np.median(off):.4f} {np.quantile(off, 0.9):.4f}"
        for (name, field), off in found.items()
        if len(off)
    ]
