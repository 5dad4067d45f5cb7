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
    SurfaceSlopes,
    SurfaceTerm,
    Term,
    VertexDistances,
)
from physic_core.engine.joint.terms.priors import RegularisationTerm
from physic_core.engine.joint.terms.reprojection_and_depth import MIN_DEPTH_M
from physic_core.engine.joint.terms.scene_contact import SoleTerm, lowest_sole_indices


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs of the surface terms for B people and n subsampled vertices, constant between two
    refreshes.

    Attributes:
        terms: those that are on, with their robust sums.
        mesh_weight: (B, n) of the squared deviation of a vertex from the start, in the root's
            frame.
        relative: (B, 3, n) at the start in the root's frame, metres.
        normals: (B, 3, n) of the nearest scene points; 0 without a scene.
        plane_distance: (B, n) from the camera to the planes through those points, unscaled.
        floor_normal: (3,) unit; 0 without a floor.
        floor_offset: of the floor, metres, unscaled.
        last_scale: of the scene, at the last refresh.
        soles: rows of the left and the right sole's vertices.
    """

    terms: tuple[tuple[SurfaceTerm, RobustSum], ...]
    mesh_weight: Tensor
    relative: Tensor
    normals: Tensor
    plane_distance: Tensor
    floor_normal: Tensor
    floor_offset: float
    last_scale: float
    soles: tuple[Tensor, ...]


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
        lowest: (B, 2) height of the left and the right sole, in the unit of the scene.
    """

    @staticmethod
    def forward(ctx: Any, data: SurfaceInputs, *variables: Tensor) -> tuple[Tensor, Tensor]:
        vertices, pelvis, root, log_scale, offset = variables
        points = vertices.mT.contiguous()
        unit = 1.0 / log_scale.exp().reshape(-1, 1)
        ahead = unit * (data.normals * points).sum(1)
        over = unit * (data.floor_normal @ points)
        distances = VertexDistances(
            scene=ahead - data.plane_distance,
            floor=over + data.floor_offset,
            last_floor=over + unit * (data.floor_offset * data.last_scale),
            log_depth=points[:, 2].clamp(min=MIN_DEPTH_M).log(),
            log_scale=(log_scale + offset)[:, None],
        )
        residuals = [term.residual(distances) for term, _ in data.terms]
        sums = [
            total.values_and_slopes(residual.value)
            for (_, total), residual in zip(data.terms, residuals, strict=True)
        ]
        # In the camera frame: a rotation does not change the length.
        deviation = (points - pelvis[..., None]) - root @ data.relative
        mesh_slope = 2.0 * data.mesh_weight[:, None] * deviation
        mesh = 0.5 * (mesh_slope * deviation).sum((1, 2))
        feet = [sole[lowest_sole_indices(distances.floor[:, sole])] for sole in data.soles]
        lowest = [distances.floor.gather(1, foot).mean(1) for foot in feet]

        ctx.data = data
        ctx.residuals = residuals
        ctx.slopes = [slope for _, slope in sums]
        ctx.mesh_slope = mesh_slope
        ctx.feet = feet
        ctx.of_scale = log_scale.shape
        ctx.save_for_backward(points, ahead, over, unit)
        return torch.stack([*(values.sum(1) for values, _ in sums), mesh]), torch.stack(lowest, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        data: SurfaceInputs = ctx.data
        points, ahead, over, unit = ctx.saved_tensors
        *of_terms, of_mesh = gradients[0][..., None].unbind(0)
        by_place = dict.fromkeys(SurfaceSlopes._fields, torch.zeros_like(ahead))
        for of_term, slope, residual in zip(of_terms, ctx.slopes, ctx.residuals, strict=True):
            by_value = of_term * slope
            for name, by in residual.slopes._asdict().items():
                if by is not None:
                    by_place[name] = by_place[name] + by * by_value
        by_scene = by_place["scene"]
        by_floor = by_place["floor"]
        by_log_depth = by_place["log_depth"]
        for foot, of_foot in zip(ctx.feet, gradients[1].unbind(1), strict=True):
            # of the mean height of its lowest vertices
            by_vertex = (of_foot / foot.shape[1])[:, None].expand_as(foot)
            by_floor = by_floor.scatter_add(1, foot, by_vertex)

        by_point = (unit * by_scene)[:, None] * data.normals
        by_height = unit * (by_floor + by_place["last_floor"])
        by_point = by_point + by_height[:, None] * data.floor_normal[:, None]
        by_deviation = of_mesh[..., None] * ctx.mesh_slope
        by_point = by_point + by_deviation
        away = points[:, 2]
        by_point[:, 2] += torch.where(away > MIN_DEPTH_M, by_log_depth / away, 0.0)
        by_offset = -by_log_depth.sum(1)
        by_scale = -(by_scene * ahead).sum(1) - (by_floor * over).sum(1) + by_offset
        return (
            None,
            by_point.transpose(1, 2),
            -by_deviation.sum(2),
            -by_deviation @ data.relative.transpose(1, 2),
            by_scale.sum_to_size(ctx.of_scale),
            by_offset,
        )


surface_energies: Callable[
    [SurfaceInputs, Tensor, Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]
] = _SurfaceEnergies.apply
"""The function of :class:`_SurfaceEnergies`."""


class SurfaceTerms(Term):
    """Surface terms, soles and regularisation as one term.

    Attributes:
        terms: the surface terms that are on.
        surface: inputs since the last refresh.
    """

    def __init__(
        self,
        sampling: Sampling,
        terms: Sequence[SurfaceTerm],
        soles: SoleTerm,
        regularisation: RegularisationTerm,
    ) -> None:
        self.sampling = sampling
        self.terms = tuple(term for term in terms if term.weight)
        self.soles = soles
        self.regularisation = regularisation
        self.surface: SurfaceInputs

    def refresh(self, snapshot: Snapshot) -> None:
        """Refresh all terms and collect the inputs of the energies."""
        sampling = self.sampling
        floor = sampling.surroundings.floor
        terms = tuple((term, term.refresh(snapshot)) for term in self.terms)
        self.soles.refresh(snapshot)
        self.regularisation.refresh(snapshot)
        weights = {term.name: total.weight for term, total in terms}
        self.weights = weights | self.soles.weights | self.regularisation.weights
        self.surface = SurfaceInputs(
            terms=terms,
            mesh_weight=self.weights["regularisation"],
            relative=sampling.relative.transpose(1, 2).contiguous(),
            normals=snapshot.contacts.normals.transpose(1, 2).contiguous(),
            plane_distance=snapshot.contacts.plane_distance,
            floor_normal=sampling.area.new_zeros(3) if floor is None else floor.normal,
            floor_offset=0.0 if floor is None else floor.offset,
            last_scale=snapshot.scale,
            soles=sampling.soles,
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of each term that is not off: name -> (B,)."""
        surface = self.surface
        e = bodies.estimate
        values, lowest = surface_energies(
            surface, bodies.vertices, bodies.joints[:, 0], e.rotations[:, 0], e.log_scales, e.offset
        )
        energies = {term.name: values[i] for i, (term, _) in enumerate(surface.terms)}
        if self.soles.is_on:
            energies["soles"] = self.soles.energy(lowest)
        energies["regularisation"] = self.regularisation.energy(values[-1], bodies.deviation)
        return energies
