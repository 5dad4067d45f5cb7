"""What is known of one photo in the engine: the estimates of all backends, and the state that the
stages complete. OpenCV camera frame, metres and pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.engine.ground.carriers import Carried
from physic_core.engine.ground.floor_and_scale import Ground
from physic_core.engine.limbs import observed_parts
from physic_core.engine.photo_content import PhotoContent
from physic_core.engine.scene_state import SceneState, Surroundings
from physic_core.engine.sizes.known_sizes import LocatedSizes
from physic_core.engine.skin_contact import SkinContact
from physic_core.errors import PhysicError
from physic_core.geometry.alignment import Alignment
from physic_core.geometry.depth_comparison import Comparison
from physic_core.types import Bodies, ContactProbability, DepthMap, KnownSizes
from physic_core.types.arrays import PER_PERSON, select_people, shape, wrong_rows
from physic_core.types.contacts import BodyContact, ContactPartner, Support
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES, Skeleton

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array


@dataclass(frozen=True)
class OtherView(ShortRepr):
    """View of the N people of a photo from another camera.

    Cameras and scene have one scale: with the factor s of stage 3 on the scene, a point x of the
    photo's frame is ``rotation @ x + s * translation`` in the frame of this camera. Equal factors
    on scene, cameras and people change no pixel of any photo: the photos show proportions, and
    sizes of people and metric depth give the scale.

    Attributes:
        rotation: (3, 3).
        translation: (3,) metres, before the factor on the scene.
        K: (3, 3) px.
        keypoints: (N, J, 2) px, of the photo's skeleton; non-finite ones count as not visible.
        keypoint_confidence: (N, J) in [0, 1]; 0 for people who are not in the photo.
        masks: (N, H, W) bool, visible pixels of each person; empty for people who are not in the
            photo.
        observed: (N, 55) bool, visible joints.
    """

    rotation: Tensor
    translation: Tensor
    K: Tensor
    keypoints: Tensor = field(metadata=PER_PERSON)
    keypoint_confidence: Tensor = field(metadata=PER_PERSON)
    masks: Tensor = field(metadata=PER_PERSON)
    observed: Tensor = field(metadata=PER_PERSON)

    def to_camera(self, points: Tensor, scale: Tensor | float = 1.0) -> Tensor:
        """Transform points (..., 3) of the photo's frame to that of this camera, at a scale of
        the scene.
        """
        return points @ self.rotation.T + scale * self.translation


@dataclass(frozen=True)
class MatchedBodies(ShortRepr):
    """Bodies that the user gives, of N people.

    Attributes:
        source: what states them, in words.
        has_given_body: (N,) bool, people whose body it is.
        joints: (N, 55, 3) metres, camera frame, as given; NaN of others.
    """

    source: str
    has_given_body: BoolArray = field(metadata=shape("N"))
    joints: FloatArray = field(metadata=shape("N", 55, 3))


@dataclass(frozen=True)
class Estimates(ShortRepr):
    """Results of all backends for one photo, in the frame of its camera.

    All arrays of people, and those of the views, have a row for each of the N people.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        camera_by_user_or_file: whether the user or the file gave the camera.
        photo: what it shows.
        inpainted: (H, W, 3) uint8 RGB, the photo without its people and what they hold.
        ground: floor, stance and scale; average feet for those without a body.
        bodies: N bodies with their hands, of the configured body model.
        contact: contact prior, zero if no backend was configured.
        depth: metric depth of ``inpainted``.
        depth_backend: name of what estimated it, in messages.
        missing_results: per person, the interfaces whose backend returned no valid values for them.
            Such a person has keypoints of confidence 0, a body of NaN, flat hands or no prior
            contact.
        known: sizes that the user knows, in px of ``image``.
        views: what other cameras show of the same people.
        is_given_keypoint: (N, J), which of the keypoints the user gave; None if none.
        contradicted_px: (N, J), how far mask and detector contradict them, px; None if none.
        given_bodies: the bodies that the user gives, in the frame of the camera; None if none.
        file_px_per_px: px of the photo file in one px of ``image``, stated if keypoints are given.
        depth_comparison: how a depth or point map of the user's fits the photo; None without one.
    """

    image: UInt8Array
    camera_by_user_or_file: bool
    photo: PhotoContent = field(metadata=PER_PERSON)
    inpainted: UInt8Array
    ground: Ground = field(metadata=PER_PERSON)
    bodies: Bodies = field(metadata=PER_PERSON)
    contact: ContactProbability = field(metadata=PER_PERSON)
    depth: DepthMap
    missing_results: tuple[tuple[str, ...], ...] = field(metadata=PER_PERSON)
    depth_backend: str = "metric depth"
    known: KnownSizes = field(default_factory=KnownSizes)
    views: tuple[OtherView, ...] = ()
    is_given_keypoint: BoolArray | None = field(default=None, metadata=PER_PERSON)
    contradicted_px: FloatArray | None = field(default=None, metadata=PER_PERSON)
    file_px_per_px: float = 1.0
    given_bodies: MatchedBodies | None = field(default=None, metadata=PER_PERSON)
    depth_comparison: Comparison | None = None

    def __post_init__(self) -> None:
        count = len(self.photo.people)
        wrong = [*wrong_rows(self, count)]
        for i, view in enumerate(self.views):
            wrong += wrong_rows(view, count, f"views[{i}].")
        if wrong:
            raise PhysicError(f"estimates of {count} people: {'; '.join(wrong)}")


@dataclass(frozen=True)
class Contact(ShortRepr):
    """Contact of N people.

    Attributes:
        probability: (N, V) of contact with the partner of the vertex, and without one with scene
            or floor; None if the method estimates none.
        distance: (N, V) signed distance to scene and floor, metres; inf beyond the search radius.
        partner: (N, V) int16, index into ``partners``; -1 without contact.
        partners: everything that people touch.
        contacts: per person, contacts by body part, most probable first.
        supports: per person, their support; None for non-finite vertices.
        part_probability: body part -> (N,) probability that it touches scene, floor or a hidden
            support; empty if the method estimates none.
    """

    probability: Tensor | None
    distance: Tensor
    partner: Tensor
    partners: tuple[ContactPartner, ...]
    contacts: tuple[tuple[BodyContact, ...], ...]
    supports: tuple[Support | None, ...]
    part_probability: Mapping[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class JointResult(ShortRepr):
    """What stage 3 found of N people and the scale of their scene.

    Attributes:
        vertices: (N, V, 3) metres; NaN for people without a body.
        joints: (N, 55, 3) metres.
        depth_offset: (N,) log of the ratio of the depth map to the person's depth; NaN if the
            person was not changed.
        failures: per person, the reason why they were not changed, or "".
        released: parts that touch each other by what is observed of both, but that were not pulled
            together, since this would have moved a body off its keypoints.
        scene_scale: factor on all lengths of scene, photo and floor, which do not have it.
        losses: term -> its weighted value at the start and at the end, both under the visibility
            at the end.
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps of the optimiser.
    """

    vertices: Tensor
    joints: Tensor
    depth_offset: Tensor
    failures: tuple[str, ...]
    released: tuple[SkinContact, ...] = ()
    scene_scale: float = 1.0
    losses: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    evaluations: int = 0
    steps: int = 0


@dataclass(frozen=True)
class State(ShortRepr):
    """Scene and N people of a photo; a stage returns the state with what it has found.

    Tensors of people have the floating-point type of the body model. Fields of a
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
        scene: of stage 1, scaled to the sizes that the user knows.
        K: (3, 3) px, camera of the scene.
        rotation_sigma: (N, 22) radians, stated errors of the rotations of pelvis and body joints,
            NaN where unknown; None if the body estimator states none.
        joint_sigma: (N, 55) metres, stated errors of the joints in the body's own frame; None if
            the body estimator states none.
        lean_sigma: (N,) radians, stated errors of the lean towards the camera, NaN where unknown;
            None if the body estimator states none.
        distance_sigma: (N,) stated errors of the logarithm of distance of bodies that the user
            gives, inf if unknown, NaN of others; None without any.
        head: (N, 3) unit vectors in which the faces look by the person observer, NaN where unknown;
            None if unknown of all.
        head_sigma: (N,) radians, its errors.
        stand_probability: (N, 2) that the foot stands on the floor; None if unknown.
        rest_probability: (N,) that the lowest skin rests on the floor, of people who lie, plank or
            are on all fours; NaN of others; None if unknown.
        observed_touch: (N, 10, 5) as ``touch`` of
            :class:`~physic_core.engine.ground.stance.Stance`; None if unknown.
        observed_floor: (N, 2) as its ``on_floor``; None if unknown.
        limb_touch_probability: (N, 5) by the picture that feet, hands and seat touch something; by
            stage 2 less for feet of people who ride. It weights their attraction to floor and
            scene; None counts as 1.
        carried: what people ride, and boards below their feet; None without any in the picture.
        scale_sigma: standard deviation of log(scale) of the scene, or None.
        known: sizes that the user knows; None without any.
        views: views of the same people from other cameras; their start is then based on all photos.
        photo_alignment: of the photo's point map to the scene, by stage 2 as all below.
        photo_depth: (H, W) metres along z of the photo with its people, aligned to the scene, NaN
            where unknown; None if the photo has no background in common with the scene.
        human_points: per person (M_i, 3) metres, aligned to the scene; None as ``photo_depth``.
        estimated_transl: (N, 3) metres, by the body estimator.
        keypoint_transl: (N, 3) metres, by the keypoints alone (Eq. 2).
        size_ratio: (N,) factor by which to enlarge people so that a scene of known size matches
            the photo, NaN where unknown; None if the size of the scene is unknown.
        placement_failures: per person, why keypoints, depth and floor did not place them, or "".
        joint: of stage 3.
        contact: by stage 4, with the scene before inpainted points were moved out of people.
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
    scene: SceneState
    K: Tensor = field(metadata=shape(3, 3))
    rotation_sigma: Tensor | None = field(default=None, metadata=shape("N", 22))
    joint_sigma: Tensor | None = field(default=None, metadata=shape("N", 55))
    lean_sigma: Tensor | None = field(default=None, metadata=shape("N"))
    distance_sigma: Tensor | None = field(default=None, metadata=shape("N"))
    head: Tensor | None = field(default=None, metadata=shape("N", 3))
    head_sigma: Tensor | None = field(default=None, metadata=shape("N"))
    stand_probability: Tensor | None = field(default=None, metadata=shape("N", 2))
    rest_probability: Tensor | None = field(default=None, metadata=shape("N"))
    observed_touch: Tensor | None = field(default=None, metadata=shape("N", 10, 5))
    observed_floor: Tensor | None = field(default=None, metadata=shape("N", 2))
    limb_touch_probability: Tensor | None = field(default=None, metadata=shape("N", 5))
    carried: Carried | None = None
    scale_sigma: float | None = None
    known: LocatedSizes | None = None
    views: tuple[OtherView, ...] = ()
    photo_alignment: Alignment | None = None
    photo_depth: Tensor | None = field(default=None, metadata=shape("H", "W"))
    human_points: tuple[Tensor, ...] | None = None
    estimated_transl: Tensor | None = field(default=None, metadata=shape("N", 3))
    keypoint_transl: Tensor | None = field(default=None, metadata=shape("N", 3))
    size_ratio: Tensor | None = field(default=None, metadata=shape("N"))
    placement_failures: tuple[str, ...] | None = None
    joint: JointResult | None = None
    contact: Contact | None = None

    def __len__(self) -> int:
        return len(self.transl)

    @property
    def vertices(self) -> Tensor:
        """Vertices (N, V, 3) metres, of stage 3."""
        assert self.joint is not None
        return self.joint.vertices

    @property
    def joints(self) -> Tensor:
        """Joints (N, 55, 3) metres, of stage 3."""
        assert self.joint is not None
        return self.joint.joints

    @property
    def unapplied_scene_scale(self) -> float:
        """Factor of stage 3 on all lengths of scene, photo and floor, which do not have it; 1
        before.
        """
        return 1.0 if self.joint is None else self.joint.scene_scale

    @property
    def surroundings(self) -> Surroundings:
        """Surfaces of the scene, without the factor of stage 3."""
        return Surroundings.of(self.scene, self.transl)

    @property
    def is_given(self) -> Tensor:
        """Bodies (N,) bool that the user gives."""
        if self.distance_sigma is None:
            return torch.zeros(len(self), dtype=torch.bool)
        return ~torch.isnan(self.distance_sigma)

    @property
    def finite_people(self) -> Tensor:
        """People (N,) bool whose vertices are finite; the others touch nothing."""
        return torch.isfinite(self.vertices).flatten(1).all(1)

    @property
    def up(self) -> Tensor:
        """Unit vector (3,): the normal of the floor, and up without one."""
        floor = self.scene.floor
        up: Tensor = self.scene.up.direction if floor is None else floor.normal
        return up.to(self.transl)

    @property
    def observed_in_any_photo(self) -> Tensor:
        """Joints (N, 55) bool that are visible in any photo."""
        observed = [self.observed.bool(), *(view.observed.bool() for view in self.views)]
        return torch.stack(observed).any(0)

    @property
    def visible_vertices(self) -> Tensor:
        """Vertices (N, V) bool of limbs that any photo shows."""
        parts = observed_parts(self.model.part_names, self.observed_in_any_photo)
        return parts[:, self.model.part_of_vertex]

    @property
    def photo_counts(self) -> Tensor:
        """Number of photos (N,) that show each person; at least 1, for the photo of the state."""
        here = torch.ones(len(self), dtype=torch.bool)
        shown = [(view.keypoint_confidence > 0).any(1) for view in self.views]
        return torch.stack([here, *shown]).sum(0)

    def from_view(self, view: OtherView) -> State:
        """Return a copy with the camera and the detections of another view.

        Bodies stay in the photo's frame, and joints count as visible that are visible in any photo.
        """
        return replace(
            self,
            K=view.K,
            keypoints=view.keypoints,
            keypoint_confidence=view.keypoint_confidence,
            masks=view.masks,
            observed=self.observed_in_any_photo,
            head=None,
            head_sigma=None,
            photo_depth=None,
            views=(),
        )

    def touch_weights(self) -> Tensor:
        """Return the probability (N, V) that the part of each vertex touches something: of feet,
        hands, thighs, buttocks, and of the back that of the seat; 1 elsewhere.
        """
        model = self.model
        weight = self.transl.new_ones(len(self), model.num_vertices)
        if self.limb_touch_probability is None:
            return weight
        for name in ("thighs", "gluteus", "back"):
            weight[:, model.contact_sets[name]] = self.limb_touch_probability[:, 4:].to(weight)
        limbs = [f"{side}_{limb}" for limb in ("foot", "hand") for side in SIDES]
        for column, name in enumerate(limbs):
            part = model.part_of_vertex == model.part_names.index(name)
            weight[:, part] = self.limb_touch_probability[:, column, None].to(weight)
        return weight

    def select_people(self, rows: Tensor) -> State:
        """Return a copy before stage 3 with a selection of the people, (n,) int64."""
        changed: dict[str, Any] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            if each.metadata.get("shape", ("",))[0] == "N" and value is not None:
                changed[each.name] = value[rows]
        if self.human_points is not None:
            changed["human_points"] = tuple(self.human_points[i] for i in rows.tolist())
        if self.known is not None:
            changed["known"] = self.known.select_people(rows)
        changed["joint"] = None
        changed["views"] = tuple(select_people(view, rows) for view in self.views)
        return replace(self, **changed)
