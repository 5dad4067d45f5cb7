"""Observe posture, touch and age of people in the tokens of the depth network's encoder, and where
they look by a mesh of the face.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field
from scipy.special import expit, softmax

from physic_core.files import read_arrays
from physic_core.interfaces import Options, PersonObserver
from physic_core.types import SIDES, Observations
from physic_embedded.body_fit.observations import rotation_to_ray
from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.depth_anything import TOKENS, patch_tokens
from physic_embedded.networks.face_mesh import KEYPOINTS, face_square, look_of_face
from physic_embedded.networks.sessions import (
    PackagedBackend,
    Products,
    graph_name,
    open_packaged_session,
)
from physic_networks.onnx_sessions import select_provider

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Intrinsics, Keypoints, People, UInt8Array
    from physic_embedded.networks.patch_tokens import PatchTokens
    from physic_networks.onnx_sessions import OnnxSession

NUMBERS = Path(__file__).with_suffix(".npz")
"""Fitted numbers: question -> (K, C + 2), for each of its K answers the weights of a token of C
numbers, a constant, and the share of "yes" in the fitted data.
"""

_DEPTH = "depth_anything_v2_vits"
_FACE = "face_landmark"

_HEAD_SIGMA_DEG = 8.0
"""Error of the direction of a face that is seen, in each of two directions."""

REGIONS = {
    "foot": "foot",
    "hand": "hand",
    "seat": "hips",
    "holds": "hand",
    "in_air": "box",
    "child": "head",
    "posture": "box",
}
"""Question -> the region of :func:`regions` whose tokens answer it."""

LIMBS = {
    "foot": ("ankle", "heel", "foot_tip", "big_toe", "small_toe"),
    "hand": ("wrist", "pinky1", "index1"),
}
"""Limb -> its keypoints without the side; those that the detector has and sees are averaged."""

_LEAST_CONFIDENCE = 0.2
"""Least mean confidence of a region's keypoints: 93 % of the feet that readers judged have it, and
40 % of those that they could not judge.
"""

_HIPS = ("left_hip", "right_hip")
_HEAD = ("nose", "left_ear_surface", "right_ear_surface", "left_eye_surface", "right_eye_surface")


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
    Options: ClassVar[type[Options]] = EmbeddedPersonObserverOptions
    options: EmbeddedPersonObserverOptions

    networks = (_DEPTH, _FACE)

    def __init__(self, options: BaseModel | None = None, **given: Any) -> None:
        super().__init__(options, **given)
        TOKENS.readers.add(self)

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Check the device; a network is opened for the first photo that needs it."""
        from onnxruntime import get_available_providers

        select_provider("auto", device, get_available_providers())
        return {}

    def infer(
        self, image: UInt8Array, people: People, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Observations:
        """Observe N people; what no seen keypoint shows is NaN."""
        graph = graph_name(_DEPTH, self.options.products, self.device)
        tokens = patch_tokens(
            graph, self._open, image, self.options.short_side, self.options.max_tokens
        )
        said = observed(regions(tokens, people.boxes, keypoints), fitted_numbers())
        head = self._heads(image, keypoints, intrinsics)
        seen = np.isfinite(head).all(1)
        return replace(
            said, head=head, head_sigma=np.where(seen, _HEAD_SIGMA_DEG, np.nan).astype(np.float32)
        )

    def _heads(
        self, image: UInt8Array, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> NDArray[np.float32]:
        """Return the unit vectors (N, 3) in which the faces look, camera frame; NaN without."""
        found = np.full((len(keypoints.points), 3), np.nan, np.float32)
        row = {name: j for j, name in enumerate(keypoints.joint_set.names)}
        if not len(found) or not row.keys() >= set(KEYPOINTS):
            return found
        session = self._open(_FACE)
        picture = ImagePyramid.from_image(image)
        inverse = np.linalg.inv(intrinsics.matrix)
        for i, points in enumerate(keypoints.points):
            at = {name: points[row[name]] for name in KEYPOINTS}
            if not np.isfinite(list(at.values())).all():
                continue
            look = look_of_face(session, picture, face_square(at))
            if look is not None:
                middle, forward = look
                found[i] = rotation_to_ray(inverse @ [*middle, 1.0]) @ forward
        return found

    def _open(self, graph: str) -> OnnxSession:
        """Return the open network of a graph."""
        if graph not in self.network:
            self.network[graph] = open_packaged_session(graph, self.options.threads, self.device)
        session: OnnxSession = self.network[graph]
        return session


@cache
def fitted_numbers() -> Mapping[str, NDArray[np.float32]]:
    """Return the arrays of :data:`NUMBERS` by question."""
    with NUMBERS.open("rb") as stream:
        return read_arrays(stream)


def observed(found: Mapping[str, FloatArray], numbers: Mapping[str, FloatArray]) -> Observations:
    """Return the answers of N people from the tokens of :func:`regions` and the numbers of
    :data:`NUMBERS`.
    """

    def answer(question: str) -> FloatArray:
        tokens = found[REGIONS[question]]
        logits = tokens @ numbers[question][:, :-2].T + numbers[question][:, -2]
        p = softmax(logits, axis=-1)[:, 0] if logits.shape[-1] > 1 else expit(logits)[..., 0]
        return np.asarray(p, np.float32)

    def share(*questions: str) -> FloatArray:
        return np.concatenate([numbers[one][:, -1] for one in questions]).astype(np.float32)

    return replace(
        Observations.unknown(len(found["box"])),
        posture=answer("posture"),
        touch=np.concatenate([answer(part) for part in ("foot", "hand", "seat")], axis=1),
        holds=answer("holds"),
        in_air=answer("in_air")[:, 0],
        child=answer("child")[:, 0],
        posture_share=share("posture"),
        touch_share=share("foot", "foot", "hand", "hand", "seat"),
        holds_share=share("holds", "holds"),
        in_air_share=float(share("in_air")[0]),
        child_share=float(share("child")[0]),
    )


def regions(tokens: PatchTokens, boxes: FloatArray, keypoints: Keypoints) -> dict[str, FloatArray]:
    """Return the mean tokens of the places of all questions.

    Args:
        tokens: of the photo.
        boxes: (N, 4) x0 y0 x1 y1 px of N people.
        keypoints: of the same people.

    Returns:
        "foot" and "hand", (N, 2, C) left and right; "hips", "head" and "box", (N, 1, C). Each is a
        square of 3 x 3 patches, but the box. NaN where the detector does not see the keypoints.
    """
    found = {
        limb: np.stack(
            [_around(tokens, keypoints, [f"{side}_{name}" for name in names]) for side in SIDES],
            axis=1,
        )
        for limb, names in LIMBS.items()
    }
    for name, joints in (("hips", _HIPS), ("head", _HEAD)):
        found[name] = _around(tokens, keypoints, joints)[:, None]
    return {**found, "box": tokens.within(boxes)[:, None]}


def _around(tokens: PatchTokens, keypoints: Keypoints, names: Sequence[str]) -> FloatArray:
    """Return the mean token (N, C) around the middle of the keypoints with these names; NaN where
    their mean confidence is too low.
    """
    known = keypoints.joint_set.names
    columns = [known.index(name) for name in names if name in known]
    if not columns:
        return np.full((len(keypoints.points), tokens.grid.shape[2]), np.nan)
    middle = keypoints.points[:, columns].mean(1)
    seen = keypoints.confidence[:, columns].mean(1) >= _LEAST_CONFIDENCE
    seen &= np.isfinite(middle).all(1)
    means = tokens.around(np.where(seen[:, None], middle, 0))
    return np.where(seen[:, None], means, np.nan)
