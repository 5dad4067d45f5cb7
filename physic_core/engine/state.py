"""What is known of one photo in the engine: the estimates of all backends, and the state that the
stages complete. OpenCV camera frame, metres and pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.engine.scene.state import SceneState
from physic_core.engine.sizes.evidence import MeasuredScale
from physic_core.engine.sizes.known_sizes import KnownGeometry
from physic_core.engine.stance import Stance
from physic_core.geometry.alignment import Alignment
from physic_core.geometry.floor import FloorSearch
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Intrinsics,
    Keypoints,
    KnownSizes,
    People,
    Pointmap,
)
from physic_core.types.arrays import shape
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import Skeleton

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array


@dataclass(frozen=True)
class OtherView(ShortRepr):
    """View of the B people of a problem from another camera.

    Cameras and scene have one scale: with the factor s of stage 3 on the scene, a point x of the
    problem's frame is ``rotation @ x + s * translation`` in the frame of this camera. Equal factors
    on scene, cameras and people change no pixel of any photo: the photos show proportions, and
    sizes of people and metric depth give the scale.

    Attributes:
        rotation: (3, 3).
        translation: (3,) metres, before the factor on the scene.
        K: (3, 3) px.
        keypoints: (B, J, 2) px, of the problem's skeleton; non-finite ones count as not visible.
        keypoint_confidence: (B, J) in [0, 1]; 0 for people who are not in the photo.
        masks: (B, H, W) bool, visible pixels of each person; empty for people who are not in the
            photo.
        observed: (B, 55) bool, visible joints.
    """

    rotation: Tensor
    translation: Tensor
    K: Tensor
    keypoints: Tensor
    keypoint_confidence: Tensor
    masks: Tensor
    observed: Tensor

    def to_camera(self, points: Tensor, scale: Tensor | float = 1.0) -> Tensor:
        """Transform points (..., 3) of the problem's frame to that of this camera, at a scale of
        the scene.
        """
        return points @ self.rotation.T + scale * self.translation


@dataclass(frozen=True)
class Estimates(ShortRepr):
    """Results of all backends for one photo, in the camera frame of ``intrinsics``.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        camera_given: whether the user or the file gave ``intrinsics``.
        hole: (H, W) bool, inpainted pixels.
        inpainted: (H, W, 3) uint8 RGB, the photo without its people and what they hold.
        scene: relative point map of ``inpainted``.
        original: relative point map of ``image``.
        floor: in the scene.
        stance: of N people, NaN and without labels for those without a body.
        bodies: N bodies with their hands, of the configured body model.
        contact: contact prior, zero if no backend was configured.
        depth: metric depth of ``inpainted``.
        missing_results: per person, the interfaces whose backend returned no valid values for them.
            Such a person has keypoints of confidence 0, a body of NaN, flat hands or no prior
            contact.
        known: sizes that the user knows, in px of ``image``.
        statures: (N,) known ones, metres, NaN where unknown; None if no stature is known.
        objects: (K, H, W) bool, visible pixels of objects in hands and on laps; None if the
            segmenter does not detect objects.
        ages: (N,) known ones, years, NaN where unknown; None if no age is known.
        measured_scale: of the scene by a measured metric depth; ``depth`` then has the scale of the
            people.
        scale_guess: warning that the scale of ``depth`` is a guess, or "".
        scale_by_people: whether the sizes of people give the scale of ``depth``.
        views: what other cameras show of the same people.
        given_keypoints: (N, J), which of ``keypoints`` the user gave; None if none.
        contradicted_px: (N, J), how far mask and detector contradict them, px; None if none.
        file_px: px of the photo file in one px of ``image``, stated if ``given_keypoints`` are.
    """

    image: UInt8Array
    intrinsics: Intrinsics
    camera_given: bool
    people: People
    keypoints: Keypoints
    hole: BoolArray
    inpainted: UInt8Array
    scene: Pointmap
    original: Pointmap
    floor: FloorSearch
    stance: Stance
    bodies: Bodies
    contact: ContactProbability
    depth: DepthMap
    missing_results: tuple[tuple[str, ...], ...] = ()
    known: KnownSizes = field(default_factory=KnownSizes)
    measured_scale: MeasuredScale | None = None
    statures: FloatArray | None = None
    objects: BoolArray | None = None
    ages: FloatArray | None = None
    scale_guess: str = ""
    scale_by_people: bool = False
    views: tuple[OtherView, ...] = ()
    given_keypoints: BoolArray | None = None
    contradicted_px: FloatArray | None = None
    file_px: float = 1.0


@dataclass(frozen=True)
class State(ShortRepr):
    """Scene and N people of a photo; a stage returns the state with what it has found.

    Tensors of people have the floating-point type and the device of the body model. Fields of a
    stage that has not run are None.

    Attributes:
        model: body model of all people.
        skeleton: of the J keypoints; each has a landmark on the body.
        keypoints: (N, J, 2) px; non-finite ones count as not visible.
        keypoint_confidence: (N, J) in [0, 1].
        masks: (N, H, W) bool, visible pixels of each person.
        observed: (N, 55) bool, visible joints.
        contact_prior: (N, V) in [0, 1], of the contact prior.
        rotations: (N, 55, 3, 3).
        betas: (N, K).
        expression: (N, E), never changed; E = 0 if the body has none.
        transl: (N, 3) metres.
        rotation_sigma: (N, 22) radians, stated errors of the rotations of pelvis and body joints,
            NaN where unknown; None if the body estimator states none.
        stance: of the people; None if unknown.
        scene: of stage 1, scaled to the sizes that the user knows.
        scale_sigma: standard deviation of log(scale) of the scene, or None.
        known: sizes that the user knows; None without any.
        views: views of the same people from other cameras; their start is then based on all photos.
        photo_alignment: of the photo's point map to the scene, by stage 2 as all below.
        photo_depth: (H, W) metres along z of the photo with its people, aligned to the scene, NaN
            where unknown; None if the photo has no background in common with the scene.
        human_points: per person (M_i, 3) metres, aligned to the scene; None as ``photo_depth``.
        estimated_transl: (N, 3) metres, by the body estimator.
        keypoint_transl: (N, 3) metres, by the keypoints alone (Eq. 2).
        foot_touch: (N, 2) probability that the left and right foot touch something, which weights
            their attraction to the ground; None counts as 1.
        size_ratio: (N,) factor by which to enlarge people so that a scene of known size matches
            the photo, NaN where unknown; None if the size of the scene is unknown.
        unplaced: per person, why keypoints, depth and floor did not place the body, or "".
    """

    model: BodyModel
    skeleton: Skeleton
    keypoints: Tensor = field(metadata=shape("N", "J", 2))
    keypoint_confidence: Tensor = field(metadata=shape("N", "J"))
    masks: Tensor = field(metadata=shape("N", "H", "W"))
    observed: Tensor = field(metadata=shape("N", 55))
    contact_prior: Tensor = field(metadata=shape("N", "V"))
    rotations: Tensor = field(metadata=shape("N", 55, 3, 3))
    betas: Tensor = field(metadata=shape("N", "K"))
    expression: Tensor = field(metadata=shape("N", "E"))
    transl: Tensor = field(metadata=shape("N", 3))
    rotation_sigma: Tensor | None = field(default=None, metadata=shape("N", 22))
    stance: Stance | None = None
    scene: SceneState | None = None
    scale_sigma: float | None = None
    known: KnownGeometry | None = None
    views: tuple[OtherView, ...] = ()
    photo_alignment: Alignment | None = None
    photo_depth: Tensor | None = field(default=None, metadata=shape("H", "W"))
    human_points: tuple[Tensor, ...] | None = None
    estimated_transl: Tensor | None = field(default=None, metadata=shape("N", 3))
    keypoint_transl: Tensor | None = field(default=None, metadata=shape("N", 3))
    foot_touch: Tensor | None = field(default=None, metadata=shape("N", 2))
    size_ratio: Tensor | None = field(default=None, metadata=shape("N"))
    unplaced: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.transl)
