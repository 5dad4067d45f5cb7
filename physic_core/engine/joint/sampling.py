"""Constants of the joint optimisation: subsampled vertices, keypoints and the scene's surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput, LandmarkModel
from physic_core.engine.scene_state import Surroundings
from physic_core.engine.state import State
from physic_core.geometry.visibility import FACING_DEG
from physic_core.types.bounds import Degrees, NotNegative

STATIC_CONTACT_PARTS = (
    "left_foot",
    "right_foot",
    "left_hand",
    "right_hand",
    "thighs",
    "gluteus",
    "back",
)
"""Parts of the body that usually touch the scene, after PROX."""

_FLOOR_BAND_M = 0.05  # scene points nearer to the floor's plane belong to the floor


@dataclass(frozen=True)
class VisibilitySettings:
    """Settings of the visibility of vertices."""

    vertex_spacing_m: NotNegative = 0.02
    """Vertices without contact are subsampled to this spacing, metres; 0 keeps all."""
    facing_deg: Degrees = FACING_DEG
    """A vertex faces the camera if its normal is within this angle of the direction to the
    camera.
    """
    mask_tolerance: NotNegative = 0.01
    """Tolerance outside the mask for visible vertices, as a share of the person."""
    occlusion_aware: bool = True
    """Hidden vertices are excluded from penetration and regularised more."""


@dataclass(frozen=True)
class Sampling:
    """Constants of one joint optimisation. B people, n subsampled vertices.

    Attributes:
        state: as the energy uses it (``JointStageMethod.prepare``), with finite people only.
        surroundings: surfaces that distances are measured to
            (``JointStageMethod.select_surroundings``).
        person_weights: (B,) weight of each person's terms.
        visibility: settings.
        ids: (n,) int64, indices of the subsampled vertices.
        faces: (f, 3) int64, those at the subsampled vertices.
        faces_of_vertices: (n, most) int64, adjacent ``faces`` of each subsampled vertex, padded
            with f.
        pose: poses keypoints, joints and subsampled vertices only.
        area: (B, n) weight of each subsampled vertex: its surface, square decimetres, in preset
            "default".
        contact_prior: (B, n) finite.
        is_contact: (B, n) bool, contact vertices, with a probability of at least one half.
        on_visible_part: (B, n) bool, on a visible limb.
        soles: rows of ``ids`` of the left and of the right sole.
        keypoint_weights: (B, J), 0 for keypoints that do not count.
        person_px: (B,) stature in px at the person's depth.
        start: posed bodies at the start, all vertices.
        relative: (B, n, 3) subsampled vertices at the start in the root's frame, metres.
        feet_visible: (B, 2) bool.
        log_depth: (H, W) logarithm of the depth map of the original photo, NaN where unknown; or
            None.
        fronts: of the scene, see :mod:`physic_core.geometry.visibility`; None without a depth of
            the scene.
        views: the same for each other camera, with its state (``State.from_view``), keypoints and
            sizes in px.
    """

    state: State
    surroundings: Surroundings
    person_weights: Tensor
    visibility: VisibilitySettings
    ids: Tensor
    faces: Tensor
    faces_of_vertices: Tensor
    pose: LandmarkModel
    area: Tensor
    contact_prior: Tensor
    is_contact: Tensor
    on_visible_part: Tensor
    soles: tuple[Tensor, ...]
    keypoint_weights: Tensor
    person_px: Tensor
    start: BodyOutput
    relative: Tensor
    feet_visible: Tensor
    log_depth: Tensor | None
    fronts: Tensor | None
    views: tuple[Sampling, ...] = ()


def select_surface(surroundings: Surroundings) -> Surroundings:
    """Return the surroundings with the scene points that have a reliable normal and do not belong
    to the floor's plane.
    """
    points = surroundings.points
    normals = surroundings.normals
    # a matrix product sums three columns several times faster than .sum()
    ones = points.new_ones(3)
    length = normals.square() @ ones
    chosen = torch.isfinite(points @ ones + length) & (length > 0.5)
    if surroundings.floor is not None:
        chosen = chosen & (surroundings.floor.height(points).abs() > _FLOOR_BAND_M)
    return replace(surroundings, points=points[chosen], normals=normals[chosen])


def with_static_contacts(state: State) -> State:
    """Return the state with contact of :data:`STATIC_CONTACT_PARTS` of all people, instead of the
    prior's.
    """
    static = state.model.contact_set_mask(*STATIC_CONTACT_PARTS)
    return replace(state, contact_prior=static.to(state.contact_prior).expand(len(state), -1))


def root_relative(vertices: Tensor, pelvis: Tensor, root: Tensor) -> Tensor:
    """Return vertices (B, V, 3) in the frame of the root joint: ``R^T (v - pelvis)``.

    ``pelvis`` is (B, 3), ``root`` the rotation (B, 3, 3).
    """
    return (vertices - pelvis[:, None]) @ root
