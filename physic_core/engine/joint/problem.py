"""Input and result of the joint optimisation: torch tensors on one device, camera frame, metres and pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.body.model import BodyModel
from physic_core.engine.known_sizes import KnownGeometry
from physic_core.errors import PhysicError
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import Skeleton

__all__ = ["JointProblem", "JointResult"]

_PER_PERSON = (
    "rotations0",
    "betas0",
    "expression0",
    "transl0",
    "keypoints",
    "keypoint_confidence",
    "masks",
    "contact_probability",
    "observed",
    "grounded",
    "lifted_feet",
    "estimated_transl",
    "keypoint_transl",
)


@dataclass(frozen=True)
class JointProblem(ShortRepr):
    """Input of the joint optimisation: one photo with B people, placed in their scene by stages 1 and 2.

    Attributes:
        model: body model of all people.
        rotations0: (B, 55, 3, 3) at the start.
        betas0: (B, K) at the start.
        expression0: (B, E), kept as it is; E = 0 where the body has none.
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
        scene_depth: (H, W) metres along z of the scene points, NaN where unknown; or None.
        floor_normal: (3,) unit, up; None if no floor was found.
        floor_offset: metres of the camera over the floor: the height of X is ``floor_normal . X + floor_offset``.
        floor_points: (F, 3) samples of the plane, or None.
        human_depth: (H, W) metres along z of the original photo, aligned to the scene, NaN where unknown; or None.
        human_points: per person (M_i, 3) metres, aligned to the scene; or None.
        scale_sigma: standard deviation of log(scale) given with the metric depth, or None.
        grounded: (B,) bool, people who may stand on the floor, not on or in an object; None is all people.
        lifted_feet: (B, 2) bool, left and right feet in the air, which touch nothing; None is no foot.
        estimated_transl: (B, 3) metres, by the body estimator; None is ``transl0``. Used by preset "release".
        keypoint_transl: (B, 3) metres, translation by the keypoints alone (Eq. 2); None is ``transl0``. Used by
            preset "release".
        known: sizes that the user knows, or None.
    """

    model: BodyModel
    rotations0: Tensor
    betas0: Tensor
    expression0: Tensor
    transl0: Tensor
    keypoints: Tensor
    keypoint_confidence: Tensor
    skeleton: Skeleton
    K: Tensor
    masks: Tensor
    scene_points: Tensor
    scene_normals: Tensor
    contact_probability: Tensor
    observed: Tensor
    scene_depth: Tensor | None = None
    floor_normal: Tensor | None = None
    floor_offset: float = 0.0
    floor_points: Tensor | None = None
    human_depth: Tensor | None = None
    human_points: tuple[Tensor, ...] | None = None
    scale_sigma: float | None = None
    grounded: Tensor | None = None
    lifted_feet: Tensor | None = None
    estimated_transl: Tensor | None = None
    keypoint_transl: Tensor | None = None
    known: KnownGeometry | None = None

    def __len__(self) -> int:
        return len(self.transl0)

    def check(self) -> None:
        """Raise PhysicError if a field has a wrong shape; the message lists all such fields."""
        b, j = len(self), self.keypoints.shape[1]
        height, width = self.masks.shape[-2:]
        expected: dict[str, tuple[int, ...]] = {
            "rotations0": (b, 55, 3, 3),
            "betas0": (b, self.model.num_betas),
            "expression0": (b, self.model.num_expression),
            "transl0": (b, 3),
            "keypoints": (b, j, 2),
            "keypoint_confidence": (b, j),
            "K": (3, 3),
            "masks": (b, height, width),
            "scene_points": (len(self.scene_points), 3),
            "scene_normals": (len(self.scene_points), 3),
            "contact_probability": (b, self.model.num_vertices),
            "observed": (b, 55),
            "floor_normal": (3,),
            "scene_depth": (height, width),
            "human_depth": (height, width),
            "grounded": (b,),
            "lifted_feet": (b, 2),
            "estimated_transl": (b, 3),
            "keypoint_transl": (b, 3),
        }
        faults = [
            f"{name} must be {shape}, got {tuple(value.shape)}"
            for name, shape in expected.items()
            if (value := getattr(self, name)) is not None and tuple(value.shape) != shape
        ]
        if self.human_points is not None and len(self.human_points) != b:
            faults.append(f"human_points must be {b} tensors, got {len(self.human_points)}")
        if faults:
            raise PhysicError("joint optimisation: " + "; ".join(faults))

    def to_model_dtype(self) -> JointProblem:
        """Return a copy with all tensors in the floating-point type and on the device of the body model."""

        def fit(value: Tensor) -> Tensor:
            return value.to(device=self.model.device, dtype=self.model.dtype if value.is_floating_point() else None)

        changed: dict[str, object] = {
            f.name: fit(value) for f in fields(self) if isinstance(value := getattr(self, f.name), Tensor)
        }
        if self.human_points is not None:
            changed["human_points"] = tuple(fit(points) for points in self.human_points)
        if self.known is not None:
            changed["known"] = self.known.to(self.transl0.to(self.model.device, self.model.dtype))
        return replace(self, **changed)  # type: ignore[arg-type]

    def feet_in_air(self) -> Tensor:
        """Return the vertices (B, V) bool of feet in the air."""
        model = self.model
        vertices = torch.zeros(len(self), model.num_vertices, dtype=torch.bool, device=self.transl0.device)
        if self.lifted_feet is not None:
            for foot, side in enumerate(SIDES):
                part = model.part_of_vertex == model.part_names.index(f"{side}_foot")
                vertices |= part & self.lifted_feet[:, foot, None]
        return vertices

    def select_people(self, rows: Tensor) -> JointProblem:
        """Return a copy with a selection of the people, (n,) int64."""
        changed = {name: getattr(self, name)[rows] for name in _PER_PERSON if getattr(self, name) is not None}
        if self.human_points is not None:
            changed["human_points"] = tuple(self.human_points[i] for i in rows.tolist())
        if self.known is not None:
            changed["known"] = self.known.select_people(rows)
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
        occluded: (B, V) bool, hidden by objects, other people or the own body, at the end.
        depth_inside: (B, V) metres of visible vertices inside the scene or under the floor, without dents; else 0.
        surface_share: (B, V) share of the visible surface of each vertex; 0 for vertices that were not tracked.
        losses: term -> its weighted value at the start and at the end, both under the visibility at the end.
        diagnostics: per person, name -> number; values that could not be measured are left out.
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
    occluded: Tensor
    depth_inside: Tensor
    surface_share: Tensor
    losses: Mapping[str, tuple[float, float]]
    diagnostics: tuple[Mapping[str, float], ...]
    failures: tuple[str, ...]
    evaluations: int
    steps: int


def people_with_valid_start(problem: JointProblem) -> Tensor:
    """Return which people (B,) bool have finite start parameters and start in front of the camera."""
    fine = problem.transl0[:, 2] > 0
    for name in ("rotations0", "betas0", "transl0"):
        fine = fine & torch.isfinite(getattr(problem, name)).flatten(1).all(1)
    return fine
