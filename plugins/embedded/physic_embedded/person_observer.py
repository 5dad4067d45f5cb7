"""Observe posture, touch and age of people, and who is seen from behind, in the tokens of the depth
network's encoder, and where they look by a mesh of the face.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel, Field
from scipy.special import expit, softmax

from physic_core.files import read_arrays
from physic_core.interfaces import Options, PersonObserver
from physic_core.types import SIDES, TOUCH_PARTS, TOUCHED, Observations
from physic_embedded.body_fit.observations import rotation_to_ray
from physic_embedded.limb_nearness import joint_positions, limb_geometry, posture_geometry
from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.depth_anything import TOKENS, patch_tokens
from physic_embedded.networks.face_mesh import KEYPOINTS, face_square, predict_face_direction
from physic_embedded.networks.sessions import (
    PackagedBackend,
    Products,
    graph_name,
    open_packaged_session,
)
from physic_networks.onnx_sessions import select_provider
from physic_networks.runtime import onnxruntime

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from physic_core.types import (
        BoolArray,
        Float32Array,
        FloatArray,
        Intrinsics,
        Keypoints,
        People,
        UInt8Array,
    )
    from physic_embedded.networks.patch_tokens import PatchTokens
    from physic_networks.onnx_sessions import OnnxSession

NUMBERS = Path(__file__).with_suffix(".npz")
"""Fitted numbers: question -> (K, C + 2), for each of its K answers the weights of C numbers, a
constant, and the share of "yes" in the fitted data.
"""

_DEPTH = "depth_anything_v2_vits"
_FACE = "face_landmark"

_HEAD_SIGMA_DEG = 8.0
"""Error of the direction of a face that is seen, in each of two directions."""

REGIONS = {
    "foot": ("foot",),
    "hand": ("hand", "fingers"),
    "seat": ("hips", "box"),
    "knee": ("knee",),
    "forearm": ("elbow",),
    "back": ("hips", "box"),
    "on_floor": ("foot", "hips"),
    "child": ("head", "shoulders", "hips"),
    "posture": ("box",),
    "away": ("upper_body",),
}
"""Question -> the regions whose tokens answer it; it is not answered where the photo does not have
the first one. "on_floor" is asked of feet that touch.
"""

GEOMETRY = {"hand": "hand", "knee": "knee", "forearm": "elbow", "posture": "", "back": ""}
"""Question that numbers of :mod:`physic_embedded.limb_nearness` answer, too -> limb; "" for those
of the posture.
"""

ANSWERS = {
    "foot": ("world",),
    "hand": TOUCHED,
    "seat": ("world",),
    "knee": ("world",),
    "forearm": ("world", "own body", "nothing"),
    "back": ("world",),
}
"""Question about touch -> its answers; others are "nothing"."""

LIMBS = {
    "foot": ("ankle", "heel", "foot_tip", "big_toe", "small_toe"),
    "hand": ("wrist", "pinky1", "index1"),
    "knee": ("knee",),
    "elbow": ("elbow",),
}
"""Limb -> its keypoints without the side; those that the detector has are averaged."""

_UPPER_BODY = np.array([[0.7, 0, 0.3, 0], [0, 1, 0, 0.5], [0.3, 0, 0.7, 0], [0, 0, 0, 0.5]])
"""A box x0 y0 x1 y1 times this is the middle of its upper half, which shows little background."""

_OTHERS = {
    "hips": ("left_hip", "right_hip"),
    "shoulders": ("left_shoulder", "right_shoulder"),
    "head": (
        "nose",
        "left_ear_surface",
        "right_ear_surface",
        "left_eye_surface",
        "right_eye_surface",
    ),
}


class EmbeddedPersonObserverOptions(Options):
    """Settings of :class:`EmbeddedPersonObserver`.

    With those of the embedded point map, the encoder runs once for both.
    """

    short_side: int = Field(
        406, ge=70, le=4096, description="px of the short side that the network sees"
    )
    max_tokens: int = Field(3600, ge=64, le=100_000, description="cap on 14 px patches")
    products: Products = Field(
        "float32",
        description="arithmetic of the network's matrix products; auto is int8 on the CPU and "
        "float32 elsewhere",
    )
    threads: int = Field(
        2, ge=0, le=256, description="threads of the network; 0: one for each core of the process"
    )


class EmbeddedPersonObserver(PackagedBackend, PersonObserver):
    """Observer by logistic regressions on the tokens of the encoder of Depth Anything V2 (DINOv2),
    and by MediaPipe's face mesh.

    It takes the tokens of the pass that the embedded point map makes for the photo with its people;
    where there is none, it runs the network itself. The direction of the head is that of the face,
    NaN where the face mesh sees none, and for keypoints without eyes, ears and mouth.
    """

    written_for = 1
    weights_license = "Apache-2.0 (Depth Anything V2 Small, DINOv2, MediaPipe Face Mesh)"
    Options = EmbeddedPersonObserverOptions
    options: EmbeddedPersonObserverOptions

    networks = (_DEPTH, _FACE)

    def __init__(self, options: BaseModel | None = None, **given: Any) -> None:
        super().__init__(options, **given)
        TOKENS.readers.add(self)

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Check the device; a network is opened for the first photo that needs it."""
        select_provider("auto", device, onnxruntime().get_available_providers())
        return {}

    def infer(
        self, image: UInt8Array, people: People, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Observations:
        """Observe N people; what the photo does not show of them is NaN."""
        graph = graph_name(_DEPTH, self.options.products, self.device)
        tokens = patch_tokens(
            graph, self._open, image, self.options.short_side, self.options.max_tokens
        )
        said = observations_from_features(
            features_of_questions(tokens, people.boxes, keypoints), fitted_numbers()
        )
        head = self._face_directions(image, keypoints, intrinsics)
        seen = np.isfinite(head).all(1)
        return replace(
            said, head=head, head_sigma=np.where(seen, _HEAD_SIGMA_DEG, np.nan).astype(np.float32)
        )

    def _face_directions(
        self, image: UInt8Array, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Float32Array:
        """Return the unit vectors (N, 3) in which the faces look, camera frame; NaN without."""
        directions = np.full((len(keypoints.points), 3), np.nan, np.float32)
        row = {name: j for j, name in enumerate(keypoints.joint_set.names)}
        if not len(directions) or not row.keys() >= set(KEYPOINTS):
            return directions
        session = self._open(_FACE)
        picture = ImagePyramid.from_image(image)
        inverse = np.linalg.inv(intrinsics.matrix)
        for i, points in enumerate(keypoints.points):
            keypoint_px = {name: points[row[name]] for name in KEYPOINTS}
            if not np.isfinite(list(keypoint_px.values())).all():
                continue
            look = predict_face_direction(session, picture, face_square(keypoint_px))
            if look is not None:
                middle, forward = look
                directions[i] = rotation_to_ray(inverse @ [*middle, 1.0]) @ forward
        return directions

    def _open(self, graph: str) -> OnnxSession:
        """Return the open network of a graph."""
        if graph not in self.network:
            self.network[graph] = open_packaged_session(graph, self.options.threads, self.device)
        session: OnnxSession = self.network[graph]
        return session


@cache
def fitted_numbers() -> Mapping[str, Float32Array]:
    """Return the arrays of :data:`NUMBERS` by question."""
    with NUMBERS.open("rb") as stream:
        return read_arrays(stream)


def observations_from_features(
    features: Mapping[str, FloatArray], numbers: Mapping[str, FloatArray]
) -> Observations:
    """Return the answers of N people from what :func:`features_of_questions` returns and the
    numbers of :data:`NUMBERS`.
    """

    def answer(question: str) -> FloatArray:
        logits = features[question] @ numbers[question][:, :-2].T + numbers[question][:, -2]
        p = softmax(logits, axis=-1) if logits.shape[-1] > 1 else expit(logits)
        return np.asarray(p, np.float32)

    def share(question: str) -> FloatArray:
        return numbers[question][:, -1].astype(np.float32)

    unknown = Observations.unknown(len(features["posture"]))
    touch, touch_share = unknown.touch.copy(), unknown.touch_share.copy()
    for question, answers in ANSWERS.items():
        _set_touch(touch, question, answers, answer(question))
        _set_touch(touch_share, question, answers, share(question))
    return replace(
        unknown,
        posture=answer("posture")[:, 0],
        touch=touch,
        on_floor=answer("on_floor")[..., 0],
        child=answer("child")[:, 0, 0],
        away=answer("away")[:, 0, 0],
        posture_share=share("posture"),
        touch_share=touch_share,
        on_floor_share=share("on_floor").repeat(2),
        child_share=float(share("child")[0]),
        away_share=float(share("away")[0]),
    )


def _set_touch(
    touch: FloatArray, question: str, answers: Iterable[str], values: FloatArray
) -> None:
    """Set the rows of a question in (..., 10, 5): the values (..., A) of its answers, 0 for others,
    and the rest for "nothing".
    """
    rows = [i for i, part in enumerate(TOUCH_PARTS) if part.rpartition("_")[2] == question]
    touch[..., rows, :] = 0 * values[..., :1]
    touch[..., rows, -1] = 1 - values.sum(-1)
    for name, column in zip(answers, np.moveaxis(values, -1, 0), strict=True):
        touch[..., rows, TOUCHED.index(name)] = column


def features_of_questions(
    tokens: PatchTokens, boxes: FloatArray, keypoints: Keypoints
) -> dict[str, FloatArray]:
    """Return the numbers that answer each question: the mean tokens of its :data:`REGIONS`, and
    its :data:`GEOMETRY`.

    Args:
        tokens: of the photo.
        boxes: (N, 4) x0 y0 x1 y1 px of N people.
        keypoints: of the same people.

    Returns:
        Question -> (N, sides, C), (N, 2, C) for feet and hands, left and right. A region is a
        square of 3 x 3 patches, but the box, and the middle of its upper half. NaN where the photo
        does not have the first region.
    """
    names = {
        limb: [[f"{side}_{one}" for one in first_tokens] for side in SIDES]
        for limb, first_tokens in LIMBS.items()
    }
    sides_of = names | {region: [first_tokens] for region, first_tokens in _OTHERS.items()}
    positions, _ = joint_positions(keypoints)
    fingers = [tokens.mean_around(np.nan_to_num(positions[f"{side}_fingers"])) for side in SIDES]
    everyone = np.ones((len(boxes), 1), bool)
    regions = {
        "box": (tokens.mean_in_boxes(boxes)[:, None], everyone),
        "upper_body": (tokens.mean_in_boxes(boxes @ _UPPER_BODY)[:, None], everyone),
        "fingers": (np.stack(fingers, 1), everyone),
    }
    for region, sides in sides_of.items():
        means, inside = zip(
            *(_mean_token_around(tokens, keypoints, first_tokens) for first_tokens in sides),
            strict=True,
        )
        regions[region] = np.stack(means, 1), np.stack(inside, 1)
    answered = {}
    for question, (first, *further_regions) in REGIONS.items():
        first_tokens, is_shown = regions[first]
        context = [
            np.broadcast_to(regions[region][0], first_tokens.shape) for region in further_regions
        ]
        if (limb := GEOMETRY.get(question)) is not None:
            people_geometry = boxes.astype(np.float64), keypoints
            context.append(
                limb_geometry(limb, *people_geometry)
                if limb
                else posture_geometry(*people_geometry)
            )
        answered[question] = np.where(
            is_shown[..., None], np.concatenate([first_tokens, *context], -1), np.nan
        )
    return answered


def _mean_token_around(
    tokens: PatchTokens, keypoints: Keypoints, names: Sequence[str]
) -> tuple[FloatArray, BoolArray]:
    """Return the mean token (N, C) around the middle of the keypoints with these names, and whether
    (N,) it is in the photo, of a person whom the detector found.
    """
    known = keypoints.joint_set.names
    columns = [known.index(name) for name in names if name in known]
    if not columns:
        count = len(keypoints.points)
        return np.zeros((count, tokens.grid.shape[2])), np.zeros(count, bool)
    middle = keypoints.points[:, columns].mean(1)
    height, width = tokens.photo.size
    shown = ((middle >= -0.5) & (middle < [width - 0.5, height - 0.5])).all(1)
    shown &= (keypoints.confidence[:, columns] > 0).any(1)
    return tokens.mean_around(np.nan_to_num(middle)), shown
