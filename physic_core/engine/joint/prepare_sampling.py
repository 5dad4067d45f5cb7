"""Constants of one joint optimisation, computed from the state before it starts."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.joint.method import JointStageMethod
from physic_core.engine.joint.sampling import Sampling, root_relative
from physic_core.engine.state import OtherView, State
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import cluster_points, faces_around_vertices, vertex_areas
from physic_core.geometry.visibility import front_depth, inside_image
from physic_core.types.observations import LEAST_PROBABILITY
from physic_core.types.skeletons import SIDES

_ANKLES = joint_pair("ankle")
_STEPS_PER_M = float(1 << 20)  # resolution to which positions are rounded


def _log_depth(depth: Tensor | None) -> Tensor | None:
    """Return the logarithm of a depth map, NaN where depth is unknown."""
    return None if depth is None else torch.where(depth > 0, depth, torch.nan).log()


@torch.no_grad()
def precompute_sampling(state: State, method: JointStageMethod) -> Sampling:
    """Compute the constants of one joint optimisation of finite people."""
    person_weights = method.weigh_people(state)
    state, model = method.prepare(state), state.model
    start = model(state.rotations, state.betas, state.transl, state.expression)
    probability = torch.nan_to_num(state.contact_prior)
    is_contact = probability >= LEAST_PROBABILITY
    area = vertex_areas(start.vertices, model.faces)
    ids, area = subsample_vertices(
        model, is_contact.any(0), method.visibility.vertex_spacing_m, area
    )
    surroundings = method.select_surroundings(state)
    ankles = inside_image(project(start.joints[:, _ANKLES], state.K), *state.masks.shape[-2:])
    faces, faces_of_vertices = faces_around_vertices(model.faces, model.faces_of_vertices[ids])
    sampling = Sampling(
        state=state,
        surroundings=surroundings,
        person_weights=person_weights,
        visibility=method.visibility,
        ids=ids,
        faces=faces,
        faces_of_vertices=faces_of_vertices,
        pose=model.landmarks_only([state.skeleton], ids),
        area=method.weigh_vertices(area),
        contact_prior=probability[:, ids],
        is_contact=is_contact[:, ids],
        on_visible_part=state.visible_vertices[:, ids],
        soles=tuple(torch.searchsorted(ids, model.contact_sets[f"{side}_sole"]) for side in SIDES),
        keypoint_weights=method.weigh_keypoints(state),
        person_px=_person_px(state, start.joints[:, 0]),
        start=start,
        relative=root_relative(start.vertices[:, ids], start.joints[:, 0], state.rotations[:, 0]),
        feet_visible=state.observed_in_any_photo[:, _ANKLES] & ankles,
        log_depth=_log_depth(state.photo_depth),
        fronts=None if surroundings.depth is None else front_depth(surroundings.depth),
    )
    return replace(
        sampling, views=tuple(_sampling_of_view(sampling, view, method) for view in state.views)
    )


def _sampling_of_view(sampling: Sampling, view: OtherView, method: JointStageMethod) -> Sampling:
    """Return the constants with the camera and the detections of another view."""
    state = sampling.state.from_view(view)
    return replace(
        sampling,
        state=state,
        keypoint_weights=method.weigh_keypoints(state),
        person_px=_person_px(state, view.to_camera(sampling.start.joints[:, 0])),
        log_depth=None,
        fronts=None,
    )


def _person_px(state: State, pelvis: Tensor) -> Tensor:
    """Return the stature (B,) in px of people whose pelvis (B, 3) is at a position in the camera
    frame.
    """
    return state.K[1, 1] * state.model.stature(state.betas) / pelvis[:, 2].clamp(min=0.1)


def subsample_vertices(
    model: BodyModel, keep: Tensor, spacing: float, area: Tensor
) -> tuple[Tensor, Tensor]:
    """Subsample vertices: select one per grid cell and body part in the T-pose, with the summed
    area of its group.

    Args:
        keep: (V,) bool, vertices that are always selected.
        spacing: side of a cell, metres; 0 keeps all outer vertices.
        area: (B, V) of all vertices.

    Returns:
        ids: (n,) int64, ascending; soles and ``keep`` are always among them, cavities never.
        area: (B, n).
    """
    keep = (keep | model.contact_set_mask("left_sole", "right_sole")) & model.outer
    if spacing <= 0:
        ids = model.outer.nonzero(as_tuple=True)[0]
        return ids, area[:, ids]
    rest = (model.outer & ~keep).nonzero(as_tuple=True)[0]
    # Vertices of the midline lie on the border of two cells. Rounding puts them into the same cell
    # on every CPU.
    exact = model.double
    rounded = (
        torch.round(exact(*exact.zero_pose(1)).vertices[0, rest] * _STEPS_PER_M) / _STEPS_PER_M
    )
    group, chosen = cluster_points(rounded, model.part_of_vertex[rest], spacing)
    summed = area.new_zeros(len(area), len(chosen)).index_add(1, group, area[:, rest])
    kept_ids = keep.nonzero(as_tuple=True)[0]
    ids = torch.cat([kept_ids, rest[chosen]])
    order = ids.argsort()
    return ids[order], torch.cat([area[:, kept_ids], summed], 1)[:, order]
