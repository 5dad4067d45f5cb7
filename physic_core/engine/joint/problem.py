"""Input and result of the joint optimisation: torch tensors on one device, camera frame, metres and
pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.engine.state import OtherView
from physic_core.errors import PhysicError
from physic_core.geometry.tensors import to_device
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES, Skeleton

if TYPE_CHECKING:
    from physic_core.engine.sizes.known_sizes import KnownGeometry


def _shape(shape: str) -> dict[str, tuple[str, ...]]:
    """Return metadata with the shape of a tensor, such as "B 55 3": numbers, and letters of
    :meth:`JointProblem.check`.

    A shape that begins with B has a row for each person.
    """
    return {"shape": tuple(shape.split())}


@dataclass(frozen=True)
class JointProblem(ShortRepr):
    """Input of the joint optimisation: one photo with B people, placed in their scene by stages 1
    and 2.

    Other cameras may show the same people at the same moment; everything is in the frame of the
    photo's camera.

    Attributes:
        model: body model of all people.
        rotations0: (B, 55, 3, 3) at the start.
        betas0: (B, K) at the start.
        expression0: (B, E), unchanged; E = 0 if the body has none.
        transl0: (B, 3) metres, at the start.
        keypoints: (B, J, 2) px; non-finite ones count as not visible.
        keypoint_confidence: (B, J) in [0, 1].
        skeleton: of the J keypoints.
        K: (3, 3) px.
        masks: (B, H, W) bool, visible pixels of each person.
        scene_points: (M, 3) metres, valid points only.
        scene_normals: (M, 3) unit towards the camera, zero where unreliable.
        contact_probability: (B, V) in [0, 1].
        observed: (B, 55) bool, visible joints.
        rotation_sigma: (B, 22) radians, stated errors of the rotations of pelvis and body joints,
            NaN where unknown; None if the body estimator states none.
        scene_depth: (H, W) metres along z of the scene points, NaN where unknown; or None.
        floor_normal: (3,) unit, up; None if no floor was found.
        floor_offset: height of the camera above the floor, metres: the height of X is
            ``floor_normal . X + floor_offset``.
        floor_points: (F, 3) samples of the plane, or None.
        human_depth: (H, W) metres along z of the original photo, aligned to the scene, NaN where
            unknown; or None.
        human_points: per person (M_i, 3) metres, aligned to the scene; or None.
        scale_sigma: standard deviation of log(scale) given with the metric depth, or None.
        foot_touch: (B, 2) probability that the left and right foot touch something, which weights
            their attraction to the ground (:mod:`physic_core.engine.stance`); None means 1.
        estimated_transl: (B, 3) metres, by the body estimator; None means ``transl0``. Used by
            preset "release".
        keypoint_transl: (B, 3) metres, translation from keypoints alone (Eq. 2); None means
            ``transl0``. Used by preset "release".
        known: sizes that the user knows, or None.
        views: views of the same people from other cameras; their start is then based on all photos.
    """

    model: BodyModel
    rotations0: Tensor = field(metadata=_shape("B 55 3 3"))
    betas0: Tensor = field(metadata=_shape("B K"))
    expression0: Tensor = field(metadata=_shape("B E"))
    transl0: Tensor = field(metadata=_shape("B 3"))
    keypoints: Tensor = field(metadata=_shape("B J 2"))
    keypoint_confidence: Tensor = field(metadata=_shape("B J"))
    skeleton: Skeleton
    K: Tensor = field(metadata=_shape("3 3"))
    masks: Tensor = field(metadata=_shape("B H W"))
    scene_points: Tensor = field(metadata=_shape("M 3"))
    scene_normals: Tensor = field(metadata=_shape("M 3"))
    contact_probability: Tensor = field(metadata=_shape("B V"))
    observed: Tensor = field(metadata=_shape("B 55"))
    rotation_sigma: Tensor | None = field(default=None, metadata=_shape("B 22"))
    scene_depth: Tensor | None = field(default=None, metadata=_shape("H W"))
    floor_normal: Tensor | None = field(default=None, metadata=_shape("3"))
    floor_offset: float = 0.0
    floor_points: Tensor | None = None
    human_depth: Tensor | None = field(default=None, metadata=_shape("H W"))
    human_points: tuple[Tensor, ...] | None = None
    scale_sigma: float | None = None
    foot_touch: Tensor | None = field(default=None, metadata=_shape("B 2"))
    estimated_transl: Tensor | None = field(default=None, metadata=_shape("B 3"))
    keypoint_transl: Tensor | None = field(default=None, metadata=_shape("B 3"))
    known: KnownGeometry | None = None
    views: tuple[OtherView, ...] = ()

    def __len__(self) -> int:
        return len(self.transl0)

    def check(self, name: str = "joint optimisation") -> None:
        """Raise PhysicError if fields have wrong shapes; the message starts with the name and lists
        all such fields.
        """
        j = self.keypoints.shape[1]
        height, width = self.masks.shape[-2:]
        model = self.model
        sizes = {"B": len(self), "J": j, "H": height, "W": width, "M": len(self.scene_points)}
        sizes |= {"K": model.num_betas, "E": model.num_expression, "V": model.num_vertices}
        faults = []
        for each in fields(self):
            value = getattr(self, each.name)
            shape = each.metadata.get("shape")
            if value is not None and shape is not None:
                expected = tuple(sizes[part] if part in sizes else int(part) for part in shape)
                if tuple(value.shape) != expected:
                    faults.append(f"{each.name} must be {expected}, got {tuple(value.shape)}")
        if self.human_points is not None and len(self.human_points) != len(self):
            faults.append(f"human_points must be {len(self)} tensors, got {len(self.human_points)}")
        if faults:
            raise PhysicError(f"{name}: " + "; ".join(faults))
        for i, view in enumerate(self.views):
            self.seen_by(view).check(f"{name}, view {i}")

    def seen_by(self, view: OtherView) -> JointProblem:
        """Return a copy with the camera and the detections of another view.

        Bodies stay in the problem's frame, and joints count as visible that are visible in any
        photo.
        """
        shown = {
            name: getattr(view, name) for name in ("K", "keypoints", "keypoint_confidence", "masks")
        }
        observed = self.observed_anywhere
        return replace(
            self, **shown, observed=observed, scene_depth=None, human_depth=None, views=()
        )

    @property
    def observed_anywhere(self) -> Tensor:
        """Joints (B, 55) bool that are visible in any photo."""
        return torch.stack(
            [self.observed.bool(), *(view.observed.bool() for view in self.views)]
        ).any(0)

    @property
    def photos(self) -> Tensor:
        """Number of photos (B,) that show each person; at least 1, for the photo of the problem."""
        shown = [(view.keypoint_confidence > 0).any(1) for view in self.views]
        return torch.stack(
            [torch.ones(len(self), device=self.K.device, dtype=torch.bool), *shown]
        ).sum(0)

    def to_model_dtype(self) -> JointProblem:
        """Return a copy with all tensors in the floating-point type and on the device of the body
        model.
        """
        model = self.model
        names = [field.name for field in fields(self) if field.name not in ("model", "skeleton")]
        return replace(
            self,
            **{name: to_device(getattr(self, name), model.device, model.dtype) for name in names},
        )

    def weight_of_feet(self) -> Tensor:
        """Return the probability (B, V) that the foot of each vertex touches something; 1
        elsewhere.
        """
        model = self.model
        weight = torch.ones(
            len(self), model.num_vertices, dtype=self.transl0.dtype, device=self.transl0.device
        )
        if self.foot_touch is not None:
            for foot, side in enumerate(SIDES):
                part = model.part_of_vertex == model.part_names.index(f"{side}_foot")
                weight[:, part] = self.foot_touch[:, foot, None].to(weight)
        return weight

    def select_people(self, rows: Tensor) -> JointProblem:
        """Return a copy with a selection of the people, (n,) int64."""
        own = (f.name for f in fields(self) if f.metadata.get("shape", ("",))[0] == "B")
        changed = {
            name: getattr(self, name)[rows] for name in own if getattr(self, name) is not None
        }
        if self.human_points is not None:
            changed["human_points"] = tuple(self.human_points[i] for i in rows.tolist())
        if self.known is not None:
            changed["known"] = self.known.select_people(rows)
        of_people = ("keypoints", "keypoint_confidence", "masks", "observed")
        changed["views"] = tuple(
            replace(v, **{name: getattr(v, name)[rows] for name in of_people}) for v in self.views
        )
        return replace(self, **changed)


@dataclass(frozen=True)
class JointResult(ShortRepr):
    """Result of the joint optimisation: people and scale of the scene.

    Attributes:
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        transl: (B, 3) metres.
        scene_scale: factor on all scene points, human points and on the floor's offset.
        vertices: (B, V, 3) metres.
        joints: (B, 55, 3) metres.
        depth_offset: (B,) log of the ratio of the depth map to the person's depth; NaN if the start
            was not optimised.
        losses: term -> its weighted value at the start and at the end, both under the visibility at
            the end.
        failures: per person, the reason why the start was not optimised; "" if it was.
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps of the optimiser.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    scene_scale: float
    vertices: Tensor
    joints: Tensor
    depth_offset: Tensor
    losses: Mapping[str, tuple[float, float]]
    failures: tuple[str, ...]
    evaluations: int
    steps: int


def people_with_valid_start(problem: JointProblem) -> Tensor:
    """Return which people (B,) bool have finite start parameters, and start in front of the camera
    that shows them.
    """
    fine = (problem.transl0[:, 2] > 0) | ~problem.masks.flatten(1).any(1)
    for name in ("rotations0", "betas0", "transl0"):
        fine = fine & torch.isfinite(getattr(problem, name)).flatten(1).all(1)
    return fine
