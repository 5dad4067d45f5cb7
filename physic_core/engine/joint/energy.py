"""The joint energy (paper Eq. 5): which terms there are, what they weigh, and what each is evaluated on."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.joint import terms
from physic_core.engine.joint.contact_state import WANDER_M, Touch, feel, scene_near
from physic_core.engine.joint.context import prepare
from physic_core.engine.joint.leg_symmetry import leg_asymmetry
from physic_core.engine.joint.point_clouds import HumanCloud
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.released_regularisation import without_root
from physic_core.engine.joint.released_reprojection import released_reprojection
from physic_core.engine.joint.released_visibility import look_once
from physic_core.engine.joint.state import Estimate, State
from physic_core.engine.joint.surface_terms import SURFACE_TERMS, RobustSum, Surface, surface_terms
from physic_core.engine.joint.visibility import Shadows, Visible, look, occluded
from physic_core.engine.scene.stature import stature_of, stature_prior
from physic_core.engine.settings import JointSettings
from physic_core.errors import PhysicError
from physic_core.geometry.camera import project
from physic_core.geometry.robust import robust

__all__ = ["JointEnergy"]


class JointEnergy:
    """Eq. 5 of B people and their scene, as a function of its :attr:`state`.

    Between two calls of :meth:`refresh` who is visible stays fixed, and with ``nearest_every_step`` off who is nearest
    to whom as well: the energy is then smooth, as a line search wants it.

    Args:
        problem: with finite people only.
        settings: of stage 3.

    Attributes:
        state: what may move.
        fixed: what stays as it is for the whole run.
        visible: what the photo shows, since the last refresh.
        touch: what is near, since the last refresh or evaluation.
        scene: the surface round the people, to search in.
        evaluations: calls so far.

    Raises:
        PhysicError: the depth term lacks the depth or the points that its form needs.
    """

    def __init__(self, problem: JointProblem, settings: JointSettings) -> None:
        self.problem, self.settings = problem, settings
        self.evaluations = 0
        with torch.no_grad():
            start = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
        self.fixed = prepare(problem, settings, start)
        offset_sigma = _offset_sigma(problem, settings, self.fixed.feet_seen)
        self._offset_free = offset_sigma > 0
        self.state = _state(problem, settings, start.joints[:, 0], offset_sigma, len(self.fixed.surface))
        self._prior_weights = self.state.per_number(
            {
                "root": settings.root_weight,
                "pose": settings.pose_weight,
                "hands": settings.hands_weight,
                "betas": settings.shape_weight,
                "translation": 0.0 if self._is_released else settings.translation_weight,
                "offset": 1.0,
                "warp": 1.0,
            }
        )
        self._cloud = _cloud(problem, settings)
        self._legs_unseen, self._feet_unseen = bool(self.fixed.legs_unseen.any()), not bool(self.fixed.feet_seen.all())
        self._stature = stature_of(problem.model, problem.betas0) if settings.stature_weight else None
        self._unturned: Tensor  # (B, n, 3) the tracked vertices at the start, without root rotation
        if self._is_released:
            with torch.no_grad():
                at = self.state.unpack()
                self._unturned = without_root(self.fixed.pose, at.rotations, at.betas, problem.expression0)
        self._gathered = start.vertices
        self.scene = scene_near(self.fixed, settings, start.vertices, 1.0)
        self._shadows = Shadows(problem, settings)
        self.visible: Visible
        self._has_looked = False
        self.touch: Touch
        self._normals: Tensor  # (B, n, 3) of the nearest scene points
        self._along: Tensor  # (B, n) distance of their planes from the camera, unscaled
        self._scale: float  # of the scene, at the last look
        plane = settings.contact_metric == settings.penetration_metric == "plane"
        self._written_out = plane and settings.depth_form == "pixels" and not self._is_released
        self._surface: Surface
        self.refresh()

    @torch.no_grad()
    def refresh(self) -> None:
        """Look at the people as they are now: visibility, self-occlusion, nearest points."""
        problem, settings = self.problem, self.settings
        estimate = self.state.unpack()
        output = problem.model(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
        scale = float(estimate.log_scale.exp())
        unscaled = output.vertices / scale
        if not (unscaled - self._gathered).abs().amax() < WANDER_M - 0.1:
            self._gathered = unscaled
            self.scene = scene_near(self.fixed, settings, output.vertices, scale)
        if settings.visibility == "released":
            before = self.visible if self._has_looked else None
            self.visible = look_once(problem, settings, self.fixed, output, self._shadows, before)
        else:
            seen = look(problem, settings, self.fixed, output, self._shadows)
            # "The camera-facing mask remains stable throughout optimization" (sec. 4.1).
            stable = settings.depth_form == "chamfer" and self._has_looked
            self.visible = replace(seen, facing=self.visible.facing) if stable else seen
        self._has_looked = True
        self._feel(output.vertices[:, self.fixed.ids], scale, estimate.warp)

    def occluded(self, vertices: Tensor) -> Tensor:
        """(B, V) bool, which of all vertices (B, V, 3) the camera does not see."""
        return occluded(self.problem, self.settings, self.fixed, vertices, self._shadows)

    def _feel(self, vertices: Tensor, scale: float, warp: Tensor) -> None:
        self._scale = scale
        self.touch = feel(self.problem, self.settings, self.fixed, self.visible, self.scene, vertices, scale, warp)
        if len(self.scene.points):
            self._normals = self.scene.normals[self.touch.near]
            self._along = (self._normals * self.scene.points[self.touch.near]).sum(-1)
        if self._written_out:
            self._surface = self._gather()

    def _gather(self) -> Surface:
        """What the terms of vertices take from the last look."""
        problem, settings, fixed, visible, touch = self.problem, self.settings, self.fixed, self.visible, self.touch
        has_scene, has_plane = len(self.scene.points) > 0, self._has_plane
        depth_weight = visible.depth_weight / visible.depth_weight.sum(1, keepdim=True).clamp(min=1e-9)
        depth = partial(RobustSum.of, settings.depth_loss, settings.depth_scale, settings.depth_sigma)
        contact = partial(RobustSum.of, settings.contact_loss, settings.contact_scale, settings.contact_sigma_m)
        solid = partial(RobustSum.of, settings.penetration_loss, settings.penetration_scale)
        inside = settings.penetration_weight * touch.penetration_weight
        under = settings.floor_weight * touch.floor_weight
        return Surface(
            depth=depth(self._depth_weight()[:, None] * depth_weight) if settings.depth_weight else None,
            contact=contact(settings.contact_weight * touch.contact_weight) if settings.contact_weight else None,
            penetration=solid(settings.penetration_sigma_m, inside) if settings.penetration_weight else None,
            floor=solid(settings.floor_sigma_m, under) if has_plane and settings.floor_weight else None,
            mesh_weight=self._mesh_weight() if settings.regularisation_weight else None,
            log_seen=visible.log_seen,
            on_scene=touch.on_scene,
            penetration_slack=settings.penetration_slack_m,
            ruler=visible.in_play,
            relative=fixed.relative.transpose(1, 2).contiguous(),
            normals=self._normals.transpose(1, 2).contiguous() if has_scene else None,
            along=self._along if has_scene else torch.zeros_like(fixed.area),
            warp_share=touch.warp_share if "warp" in self.state.free else None,
            plane=problem.floor_normal if has_plane else None,
            offset=problem.floor_offset,
            last_scale=self._scale,
            in_scene_units=settings.scene_unit == "scene",
            soles=fixed.soles,
        )

    def _depth_weight(self) -> Tensor:
        """(B,) of the depth term: of those whose depth offset is free only the relief counts."""
        settings = self.settings
        weight = torch.where(self._offset_free, settings.depth_relief_weight, settings.depth_weight)
        return weight.to(self.fixed.area.dtype)

    def _mesh_weight(self) -> Tensor:
        """(B, n) of the mesh's deviation, more where the photo does not show it."""
        settings = self.settings
        strong = ~self.visible.in_play
        if settings.occlusion_aware:
            strong = strong | self.visible.hidden
        share = torch.where(strong, settings.occluded_weight, settings.visible_weight).to(self.fixed.area.dtype)
        return share * self.fixed.area / settings.regularisation_sigma_m**2

    def __call__(self) -> dict[str, Tensor]:
        """Weighted terms at the present state: name -> (B,), and "scale" -> (1,). Differentiable."""
        problem, settings, fixed = self.problem, self.settings, self.fixed
        self.evaluations += 1
        estimate = self.state.unpack()
        posed = fixed.pose(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
        vertices, joints = posed["vertices"], posed["joints"]
        if settings.nearest_every_step and (settings.contact_weight or settings.penetration_weight):
            self._feel(vertices.detach(), float(estimate.log_scale.detach().exp()), estimate.warp.detach())
        energies: dict[str, Tensor] = {}
        if settings.reprojection_weight:
            energies["reprojection"] = self._reprojection(posed[problem.skeleton])
        if self._written_out:
            energies.update(self._on_the_surface(vertices, joints, estimate))
        else:
            if settings.depth_weight:
                energies["depth"] = self._depth(vertices, estimate)
            energies.update(self._contact_and_penetration(vertices, estimate))
            if settings.regularisation_weight:
                energies["mesh"] = self._mesh(vertices, joints, estimate)
        energies.update(self._regularisation(energies.pop("mesh", None), estimate.transl))
        if settings.limit_weight:
            energies["limits"] = settings.limit_weight * terms.joint_limits(estimate.rotations)
        energies.update(self._anatomy(estimate))
        if settings.balance_weight and self._has_plane:
            assert problem.floor_normal is not None
            rho = partial(robust, "cauchy", c=1.0)
            mass = (fixed.area[:, None] @ vertices)[:, 0] / fixed.area.sum(1, keepdim=True)
            lean = terms.balance(mass, joints, problem.floor_normal, self.touch.balanced, rho)
            energies["balance"] = settings.balance_weight * lean
        return energies

    def _reprojection(self, landmarks: Tensor) -> Tensor:
        settings, fixed = self.settings, self.fixed
        seen = project(landmarks, self.problem.K)
        if settings.reprojection_form == "released":
            size = fixed.unit[0]
            return settings.reprojection_weight * released_reprojection(
                seen, fixed.keypoints, fixed.keypoint_weight, size, len(seen)
            )
        rho = partial(robust, settings.reprojection_loss, c=settings.reprojection_scale)
        return settings.reprojection_weight * terms.reprojection(
            seen,
            fixed.keypoints,
            fixed.keypoint_weight,
            fixed.unit,
            rho,
            per_axis=settings.reprojection_per_axis,
        )

    def _on_the_surface(self, vertices: Tensor, joints: Tensor, estimate: Estimate) -> dict[str, Tensor]:
        """The terms of vertices where all distances are along normals, faster."""
        settings, surface = self.settings, self._surface
        values, lowest = surface_terms(
            surface,
            vertices,
            joints[:, 0],
            estimate.rotations[:, 0],
            estimate.log_scale,
            estimate.offset,
            estimate.warp,
        )
        there = (surface.depth, surface.contact, surface.penetration, surface.floor, surface.mesh_weight)
        energies = {n: v for n, v, on in zip(SURFACE_TERMS, values, there, strict=True) if on is not None}
        if self._has_plane and (settings.sole_weight or settings.lower_sole_weight or settings.unseen_sole_weight):
            energies["soles"] = self._soles(lowest)
        return energies

    def _depth(self, vertices: Tensor, estimate: Estimate) -> Tensor:
        settings = self.settings
        if self._cloud is not None:
            return settings.depth_weight * self._cloud(vertices, self.visible.facing, estimate.log_scale)
        rho = partial(robust, settings.depth_loss, c=settings.depth_scale)
        return self._depth_weight() * terms.depth_at_pixels(
            vertices[..., 2],
            self.visible.log_seen,
            self.visible.depth_weight,
            estimate.log_scale,
            estimate.offset,
            settings.depth_sigma,
            rho,
        )

    def _contact_and_penetration(self, vertices: Tensor, estimate: Estimate) -> dict[str, Tensor]:
        problem, settings, touch, scene = self.problem, self.settings, self.touch, self.scene
        scale = estimate.log_scale.exp()
        energies: dict[str, Tensor] = {}
        to_floor = vertices.new_zeros(vertices.shape[:2])
        signed, axes = to_floor, vertices.new_zeros(vertices.shape)
        if len(scene.points):
            # n . (v - s p), with what stays as it is between two looks gathered once.
            factor = scale
            if "warp" in self.state.free:
                factor = scale * torch.exp(estimate.warp[:, None] * touch.warp_share)
            signed = (self._normals * vertices).sum(-1) - factor * self._along
            if not settings.contact_metric == settings.penetration_metric == "plane":
                axes = (vertices - scene.points[touch.near] * factor[..., None]).square()
        has_plane = self._has_plane
        if has_plane:
            assert problem.floor_normal is not None
            to_floor = terms.plane_height(vertices, problem.floor_normal, problem.floor_offset * scale)
        unit = scale if settings.scene_unit == "scene" else torch.ones_like(scale)
        signed, axes, to_floor = signed / unit, axes / unit.square(), to_floor / unit
        if settings.contact_weight:
            rho = partial(robust, settings.contact_loss, c=settings.contact_scale)
            to_scene = _components(settings.contact_metric, signed, axes)
            to_plane = torch.nn.functional.pad(to_floor.square()[..., None], (0, to_scene.shape[-1] - 1))
            nearest = torch.where(touch.on_scene[..., None], to_scene, to_plane) / settings.contact_sigma_m**2
            touching = terms.contact(nearest, touch.contact_weight, partial(terms.sum_of_axes, rho))
            energies["contact"] = settings.contact_weight * touching
        rho = partial(robust, settings.penetration_loss, c=settings.penetration_scale)
        if settings.penetration_weight and settings.penetration_metric != "plane":
            way = _components(settings.penetration_metric, signed, axes) / settings.penetration_sigma_m**2
            over_axes = partial(terms.sum_of_axes, rho)
            inside = terms.penetration_by_points(way, signed, touch.penetration_weight, over_axes)
            energies["penetration"] = settings.penetration_weight * inside
        elif settings.penetration_weight:
            inside = terms.penetration(
                signed, touch.penetration_weight, settings.penetration_slack_m, settings.penetration_sigma_m, rho
            )
            energies["penetration"] = settings.penetration_weight * inside
        if has_plane and settings.floor_weight:
            # Legs that nobody sees may be pushed up, but are no ruler: the scale of the last look stands.
            guessed = (to_floor * unit + problem.floor_offset * (self._scale - scale)) / unit.detach()
            height = torch.where(self.visible.in_play, to_floor, guessed)
            under = terms.penetration(height, touch.floor_weight, 0.0, settings.floor_sigma_m, rho)
            energies["floor"] = settings.floor_weight * under
        if has_plane and (settings.sole_weight or settings.lower_sole_weight or settings.unseen_sole_weight):
            lowest = [
                terms.lowest_height(to_floor.index_select(1, rows)) if len(rows) else torch.zeros_like(to_floor[:, 0])
                for rows in self.fixed.soles
            ]
            energies["soles"] = self._soles(torch.stack(lowest, 1))
        return energies

    def _soles(self, lowest: Tensor) -> Tensor:
        """Of the heights (B, 2) of both soles."""
        settings, touch = self.settings, self.touch

        def near(squared: Tensor) -> Tensor:
            return robust("geman_mcclure", squared / settings.sole_sigma_m**2, settings.sole_scale)

        def far(squared: Tensor) -> Tensor:
            return robust("cauchy", squared / settings.lower_sole_sigma_m**2, 2.0)

        seen = terms.soles(
            lowest,
            settings.sole_weight * touch.sole_weight,
            settings.lower_sole_weight * touch.lower_sole_weight,
            near,
            far,
        )
        if not self._feet_unseen:
            return seen
        unseen = robust("geman_mcclure", (lowest / settings.unseen_sole_sigma_m).square(), 3.0)
        return seen + settings.unseen_sole_weight * (touch.unseen_sole_weight * unseen).sum(1)

    def _anatomy(self, estimate: Estimate) -> dict[str, Tensor]:
        """What bodies can be like, whatever the scene."""
        settings = self.settings
        energies: dict[str, Tensor] = {}
        if settings.unseen_symmetry_weight and self._legs_unseen:
            unlike = self.fixed.legs_unseen.to(estimate.betas.dtype) * leg_asymmetry(estimate.rotations)
            energies["symmetry"] = settings.unseen_symmetry_weight * unlike
        if self._stature is not None:
            height = self._stature(estimate.betas)
            prior = stature_prior(height, self._stature.height, settings.stature_sigma)
            energies["stature"] = settings.stature_weight * prior
        return energies

    def _mesh(self, vertices: Tensor, joints: Tensor, estimate: Estimate) -> Tensor:
        """(B,) how far the mesh has left its start."""
        fixed = self.fixed
        if self._is_released:
            unturned = without_root(fixed.pose, estimate.rotations, estimate.betas, self.problem.expression0)
            return terms.mesh_deviation(unturned, self._unturned, self._mesh_weight())
        relative = terms.root_relative(vertices, joints[:, 0], estimate.rotations[:, 0])
        return terms.mesh_deviation(relative, fixed.relative, self._mesh_weight())

    def _regularisation(self, mesh: Tensor | None, transl: Tensor) -> dict[str, Tensor]:
        """Of the mesh's deviation (B,) and of the parameters."""
        settings = self.settings
        weight = settings.regularisation_weight
        if mesh is None:
            return {}
        people, scale = self.state.strayed()
        mesh = mesh + terms.prior(people, self._prior_weights)
        if self._is_released:
            problem = self.problem
            expected = problem.transl0 if problem.estimated_transl is None else problem.estimated_transl
            mesh = mesh + settings.translation_weight * (transl - expected).square().sum(-1)
        return {
            "regularisation": weight * mesh,
            "scale": weight * settings.scale_weight * scale.square().reshape(1),
        }

    @property
    def _is_released(self) -> bool:
        return self.settings.regularisation_form == "released"

    @property
    def _has_plane(self) -> bool:
        return self.problem.floor_normal is not None and self.settings.floor == "plane"


def _components(metric: str, signed: Tensor, axes: Tensor) -> Tensor:
    """(B, V, 1 or 3) squared parts of the way to the nearest point, each of which the robust loss takes by itself.

    Args:
        metric: of the settings.
        signed: (B, V) along the normal.
        axes: (B, V, 3) squared, along the axes.
    """
    if metric == "plane":
        return signed.square()[..., None]
    return axes if metric == "axes" else axes.sum(-1, keepdim=True)


def _offset_sigma(problem: JointProblem, settings: JointSettings, feet_seen: Tensor) -> Tensor:
    """(B,) expected spread of each person's depth offset, 0 where it is tied."""
    alone = torch.full_like(problem.transl0[:, 2], settings.depth_offset_alone_sigma)
    if "offset" in settings.frozen:
        return torch.zeros_like(alone)
    if problem.floor_normal is None or settings.floor != "plane":
        return alone
    stands = feet_seen.any(1) if problem.grounded is None else feet_seen.any(1) & problem.grounded
    return torch.where(stands, settings.depth_offset_sigma, alone)


def _state(problem: JointProblem, settings: JointSettings, pelvis: Tensor, offset_sigma: Tensor, surface: int) -> State:
    frozen = set(settings.frozen)
    if not offset_sigma.any():
        frozen.add("offset")
    if surface == 0 or not settings.warp_sigma:
        frozen.add("warp")
    if surface == 0 and problem.floor_normal is None:
        frozen.add("scale")  # nothing is left that shows the scale
    return State(
        problem.rotations0,
        problem.betas0,
        problem.transl0,
        pelvis,
        whitened=settings.parameters == "whitened",
        frozen=sorted(frozen),
        scale_sigma=settings.scale_sigma if problem.scale_sigma is None else problem.scale_sigma,
        offset_sigma=offset_sigma,
        offset_free=offset_sigma > 0,
        warp_sigma=settings.warp_sigma,
    )


def _cloud(problem: JointProblem, settings: JointSettings) -> HumanCloud | None:
    if not settings.depth_weight:
        return None
    if settings.depth_form == "chamfer":
        return HumanCloud.of(problem, settings.max_human_points)
    if problem.human_depth is None:
        raise PhysicError(
            "the depth term compares pixels, but there is no human_depth: give it, or set depth_form = 'chamfer' with"
            " human_points, or depth_weight = 0"
        )
    return None
