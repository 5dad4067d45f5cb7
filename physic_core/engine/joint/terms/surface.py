"""Surface terms, evaluated together, with soles and mesh.

They share the distances to scene and floor, and are one autograd function with analytic
derivatives. The arrays are small: the overhead of autograd for a hundred operations exceeds their
cost, a quarter of stage 3. Arrays are (B, 3, n), since reductions over a last axis of three are
slow.

Distances are divided by the scene's scale, so that shrinking scene and people together does not
lower the energy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import (
    PosedBodies,
    RobustSum,
    Snapshot,
    SurfacePlace,
    SurfaceResidual,
    SurfaceTerm,
    Term,
)
from physic_core.engine.joint.terms.body import RegularisationTerm
from physic_core.engine.joint.terms.picture import MIN_DEPTH_M
from physic_core.engine.joint.terms.scene import SoleTerm, lowest_sole_indices
from physic_core.geometry.floor import PlaneFit


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs of the surface terms for B people and n subsampled vertices, constant between two
    refreshes.

    Attributes:
        terms: those that are on, with their robust sums.
        mesh_weight: (B, n) of the squared deviation of a vertex from the start, in the root's
            frame.
        relative: (B, 3, n) at the start in the root's frame, metres.
        normals: (B, 3, n) of the nearest scene points; None without a scene.
        plane_distance: (B, n) from the camera to the planes through those points, unscaled.
        floor: unscaled; None without one.
        last_scale: of the scene, at the last refresh.
        soles: rows of the left and the right sole's vertices.
    """

    terms: tuple[tuple[SurfaceTerm, RobustSum], ...]
    mesh_weight: Tensor
    relative: Tensor
    normals: Tensor | None
    plane_distance: Tensor
    floor: PlaneFit | None
    last_scale: float
    soles: tuple[Tensor, Tensor]


class _SurfaceEnergies(torch.autograd.Function):
    """Weighted energy of each surface term, and of the mesh; differentiable once.

    Args:
        data: inputs since the last refresh.
        vertices: (B, n, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3) rotation of the root.
        log_scale: () of the scene, or (B,) the same for each person, for the derivatives by person.
        offset: (B,) logarithm of the depth offset of each person.

    Returns:
        energies: (T + 1, B) of the T terms of the inputs, and of the mesh.
        lowest: (B, 2) height of the left and the right sole, in the unit of the scene; 0 without a
            sole.
    """

    @staticmethod
    def forward(ctx: Any, data: SurfaceInputs, *variables: Tensor) -> tuple[Tensor, Tensor]:
        vertices, pelvis, root, log_scale, offset = variables
        points = vertices.mT.contiguous()
        none = torch.zeros_like(offset)
        unit = 1.0 / log_scale.exp().reshape(-1, 1)
        ahead, over = _projections(data, points, unit)
        offset_m = 0.0 if data.floor is None else data.floor.offset
        at = SurfacePlace(
            scene=ahead if data.normals is None else ahead - data.plane_distance,
            floor=over + offset_m,
            last_floor=over + unit * (offset_m * data.last_scale),
            log_depth=points[:, 2].clamp(min=MIN_DEPTH_M).log(),
            log_scale=(log_scale + offset)[:, None],
        )
        residuals = [term.residual(at) for term, _ in data.terms]
        found = [
            total.value_and_slope(residual.value)
            for (_, total), residual in zip(data.terms, residuals, strict=True)
        ]
        # In the camera frame: a rotation does not change the length.
        deviation = (points - pelvis[..., None]) - root @ data.relative
        mesh_slope = 2.0 * data.mesh_weight[:, None] * deviation
        mesh = 0.5 * (mesh_slope * deviation).sum((1, 2))
        feet = [_lowest(sole, at.floor) for sole in data.soles]
        lowest = [none if foot is None else at.floor.gather(1, foot).mean(1) for foot in feet]

        ctx.data = data
        ctx.residuals = residuals
        ctx.slopes = [slope for _, slope in found]
        ctx.mesh_slope = mesh_slope
        ctx.feet = feet
        ctx.of_scale = log_scale.shape
        ctx.save_for_backward(points, ahead, over, unit)
        return torch.stack([*(energy for energy, _ in found), mesh]), torch.stack(lowest, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        data: SurfaceInputs = ctx.data
        points, ahead, over, unit = ctx.saved_tensors
        of_terms = gradients[0][..., None].unbind(0)
        by_scale = torch.zeros_like(points[:, 0, 0])
        by_offset = None
        slopes = [own * slope for own, slope in zip(of_terms, ctx.slopes, strict=False)]
        by_signed, by_height, by_last, by_log = _by_distances(
            ctx.residuals, slopes, torch.zeros_like(ahead)
        )
        for foot, of_foot in zip(ctx.feet, gradients[1].unbind(1), strict=True):
            by_height = _with_foot(by_height, foot, of_foot)

        by_point = torch.zeros_like(points)
        if data.normals is not None:
            by_point = (unit * by_signed)[:, None] * data.normals
            by_scale = by_scale - (by_signed * ahead).sum(1)
        if data.floor is not None:
            by_point = (
                by_point + (unit * (by_height + by_last))[:, None] * data.floor.normal[:, None]
            )
            by_scale = by_scale - (by_height * over).sum(1)
        by_deviation = of_terms[-1][..., None] * ctx.mesh_slope
        by_point = by_point + by_deviation
        by_pelvis = -by_deviation.sum(2)
        by_root = -by_deviation @ data.relative.transpose(1, 2)
        if by_log is not None:
            away = points[:, 2]
            by_point[:, 2] += torch.where(away > MIN_DEPTH_M, by_log / away, 0.0)
            by_offset = -by_log.sum(1)
            by_scale = by_scale + by_offset
        return (
            None,
            by_point.transpose(1, 2),
            by_pelvis,
            by_root,
            by_scale.sum_to_size(ctx.of_scale),
            by_offset,
        )


surface_energies: Callable[
    [SurfaceInputs, Tensor, Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]
] = _SurfaceEnergies.apply
"""The function of :class:`_SurfaceEnergies`."""


def _lowest(sole: Tensor, height: Tensor) -> Tensor | None:
    """Return the columns (B, k) of the lowest vertices of a sole; None without vertices."""
    return sole[lowest_sole_indices(height[:, sole])] if len(sole) else None


def _with_foot(by_height: Tensor, foot: Tensor | None, of_foot: Tensor) -> Tensor:
    """Add the gradient (B,) by a foot's mean height to that of its lowest vertices."""
    if foot is None:
        return by_height
    own = (of_foot / foot.shape[1])[:, None].expand_as(foot)
    return by_height.scatter_add(1, foot, own)


def _projections(data: SurfaceInputs, points: Tensor, unit: Tensor) -> tuple[Tensor, Tensor]:
    """Return unscaled lengths (B, n) of points along the normals of scene and floor; 0 without
    one.
    """
    ahead = over = torch.zeros_like(data.plane_distance)
    if data.normals is not None:
        ahead = unit * (data.normals * points).sum(1)
    if data.floor is not None:
        over = unit * (data.floor.normal @ points)
    return ahead, over


def _by_distances(
    residuals: Sequence[SurfaceResidual], slopes: Sequence[Tensor], none: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor | None]:
    """Return the gradients (B, n) by the distance to the scene, by the height over the floor, by
    that height at the last scale, and by the logarithm of depth, if a term has one.
    """
    by_signed = by_height = by_last = none
    by_log = None
    for own, residual in zip(slopes, residuals, strict=True):
        if residual.by_scene is not None:
            by_signed = by_signed + residual.by_scene * own
        if residual.by_floor is not None:
            by_height = by_height + residual.by_floor * own
        if residual.by_last_floor is not None:
            by_last = by_last + residual.by_last_floor * own
        if residual.by_depth is not None:
            by_own = residual.by_depth * own
            by_log = by_own if by_log is None else by_log + by_own
    return by_signed, by_height, by_last, by_log


class SurfaceTerms(Term):
    """Surface terms, soles and regularisation as one term.

    Attributes:
        terms: the surface terms.
        surface: inputs since the last refresh.
        energies: function of the energies.
    """

    def __init__(
        self,
        sampling: Sampling,
        terms: Sequence[SurfaceTerm],
        soles: SoleTerm,
        regularisation: RegularisationTerm,
    ) -> None:
        self.sampling = sampling
        self.terms = tuple(terms)
        self.soles = soles
        self.regularisation = regularisation
        self.energies = surface_energies
        self.surface: SurfaceInputs

    def refresh(self, snapshot: Snapshot) -> None:
        """Refresh all terms and collect the inputs of the energies."""
        sampling = self.sampling
        contacts = snapshot.contacts
        parts: list[SurfaceTerm | SoleTerm | RegularisationTerm] = [*self.terms, self.soles]
        parts.append(self.regularisation)
        for part in parts:
            part.refresh(snapshot)
        self.weights = {name: weight for part in parts for name, weight in part.weights.items()}
        sums = [(term, term.robust_sum()) for term in self.terms]
        normals = contacts.normals
        plane_distance = contacts.plane_distance
        self.surface = SurfaceInputs(
            terms=tuple((term, total) for term, total in sums if total is not None),
            mesh_weight=self.weights["regularisation"],
            relative=sampling.relative.transpose(1, 2).contiguous(),
            normals=None if normals is None else normals.transpose(1, 2).contiguous(),
            plane_distance=torch.zeros_like(sampling.area)
            if plane_distance is None
            else plane_distance,
            floor=sampling.around.floor,
            last_scale=snapshot.scale,
            soles=sampling.soles,
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of each term that is not off: name -> (B,)."""
        surface = self.surface
        e = bodies.estimate
        values, lowest = self.energies(
            surface, bodies.vertices, bodies.joints[:, 0], e.rotations[:, 0], e.log_scales, e.offset
        )
        energies = {term.name: values[i] for i, (term, _) in enumerate(surface.terms)}
        if self.soles.is_on:
            energies["soles"] = self.soles.energy(lowest)
        energies["regularisation"] = self.regularisation.energy(values[-1], bodies.deviation)
        return energies
