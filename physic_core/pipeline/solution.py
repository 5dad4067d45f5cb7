"""Result of the engine as NumPy arrays: scaled scene, posed people, contact map and measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from physic_core.body.bones import parameters_from_rotations
from physic_core.body.joints import NUM_JOINTS
from physic_core.engine.contact.partner import DECIMALS
from physic_core.engine.measures import Measures, measure_people
from physic_core.engine.scene.solve import alignment_diagnostics
from physic_core.engine.sizes.stature import size_sigmas
from physic_core.types import NO_PARTNER, BodyParameters, CameraTrust, Intrinsics, Plane, Scene
from physic_core.types.known_sizes import KnownPeople
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from physic_core.engine.state import Contact, Estimates, State
    from physic_core.types import BodyContact, BoolArray, ContactPartner, FloatArray, Support


@dataclass(frozen=True)
class Solution(ShortRepr):
    """Result of the engine for N people, in the camera frame of ``intrinsics``, metres.

    Attributes:
        intrinsics: the camera of all projections.
        scene: without people, its final scale applied.
        parameters: of N bodies.
        vertices: (N, V, 3) float32.
        joints: (N, 55, 3) float32.
        contact: (N, V) bool.
        distance: (N, V) float32, signed, metres, negative inside; inf beyond the search radius.
        contact_probability: (N, V) float16, of contact with anything; None if the preset estimates
            none.
        contact_partner: (N, V) int16, index into ``partners``, ``NO_PARTNER`` for vertices not in
            contact.
        partners: everything that people touch.
        contacts: per person, contacts by body part.
        supports: per person, their support; None without a finite body.
        world_contact: per person, body part -> probability that it touches floor, scene or a hidden
            support; None without a finite body, and if the preset estimates none.
        people: measures of each person.
        failures: per person, reason why stage 3 left pose and position unchanged, or "".
        diagnostics: numbers by stage; without people, only those of the scene.
    """

    intrinsics: Intrinsics
    scene: Scene
    parameters: BodyParameters
    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    distance: FloatArray
    contact_probability: NDArray[np.float16] | None
    contact_partner: NDArray[np.int16]
    partners: tuple[ContactPartner, ...]
    contacts: tuple[tuple[BodyContact, ...], ...]
    supports: tuple[Support | None, ...]
    world_contact: tuple[Mapping[str, float] | None, ...]
    people: tuple[Measures, ...]
    failures: tuple[str, ...]
    diagnostics: Mapping[str, Any]


def assemble_solution(estimates: Estimates, state: State) -> Solution:
    """Convert the state of a photo with people, with its contact, to arrays and diagnostics."""
    sigma, touch = state.scale_sigma, state.contact
    assert touch is not None
    assert state.photo_alignment is not None
    stature, years = KnownPeople(estimates.ages, estimates.statures).filled(len(state))
    sized = sigma if state.views or state.size_ratio is not None else None
    measured = estimates.measured_scale is not None
    if sized is not None and measured and not estimates.intrinsics.known:
        # lengths across a measured depth
        sized = math.hypot(sized, estimates.intrinsics.focal_sigma or 0.0)
    people = tuple(
        replace(measures, size_sigma=size)
        for measures, size in zip(
            measure_people(estimates, state),
            size_sigmas(stature, years, sized).tolist(),
            strict=True,
        )
    )
    likely = touch.probability
    losses = {name: {"start": a, "end": b} for name, (a, b) in state.losses.items()}
    return Solution(
        intrinsics=_intrinsics(state.scene.K, estimates),
        scene=_scene(estimates, state),
        parameters=parameters_from_rotations(
            state.rotations, state.betas, state.expression, state.transl
        ),
        vertices=state.vertices.float().cpu().numpy(),
        joints=state.joints.float().cpu().numpy(),
        contact=touch.touches.cpu().numpy(),
        distance=touch.distance.float().cpu().numpy(),
        contact_probability=None if likely is None else likely.cpu().numpy().astype(np.float16),
        contact_partner=touch.partner.cpu().numpy(),
        partners=touch.partners,
        contacts=touch.contacts,
        supports=touch.supports,
        world_contact=tuple(_world_contact(touch, i) for i in range(len(state))),
        people=people,
        failures=state.failures,
        diagnostics={
            "scene": dict(state.scene.diagnostics),
            "placement": {"alignment": alignment_diagnostics(state.photo_alignment)},
            "joint": {
                "losses": losses,
                "scene_scale": state.scene_scale,
                "steps": state.steps,
                "evaluations": state.evaluations,
            },
        },
    )


def _world_contact(touch: Contact, person: int) -> Mapping[str, float] | None:
    """Return body part -> probability of contact with the world; None without any."""
    if touch.supports[person] is None:
        return None
    found = {name: round(float(p[person]), DECIMALS) for name, p in touch.parts.items()}
    return found or None


def scene_alone(estimates: Estimates, state: State) -> Solution:
    """Return the solution of a photo without people: the scene of stage 1, and arrays for N = 0
    people.
    """
    scene, model = state.scene, state.model
    return Solution(
        intrinsics=_intrinsics(scene.K, estimates),
        scene=_scene(estimates, state),
        parameters=estimates.bodies.parameters,
        vertices=np.zeros((0, model.num_vertices, 3), np.float32),
        joints=np.zeros((0, NUM_JOINTS, 3), np.float32),
        contact=np.zeros((0, model.num_vertices), bool),
        distance=np.zeros((0, model.num_vertices), np.float32),
        contact_probability=None,
        contact_partner=np.full((0, model.num_vertices), NO_PARTNER, np.int16),
        partners=(),
        contacts=(),
        supports=(),
        world_contact=(),
        people=(),
        failures=(),
        diagnostics={"scene": dict(scene.diagnostics)},
    )


def _intrinsics(K: Tensor, estimates: Estimates) -> Intrinsics:
    height, width = estimates.hole.shape
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    for camera in (estimates.intrinsics, estimates.depth.intrinsics):
        if camera is not None and torch.equal(K, torch.from_numpy(camera.matrix)):
            return Intrinsics(
                fx, fy, cx, cy, width, height, camera.source, camera.trust, camera.focal_sigma
            )
    return Intrinsics(
        fx, fy, cx, cy, width, height, "point map and metric depth", CameraTrust.ESTIMATED
    )


def _scene(estimates: Estimates, state: State) -> Scene:
    """Convert the scene, multiplied by the scale of stage 3."""
    scene, scale, floor = state.scene, state.scene_scale, None
    if scene.floor is not None:
        floor = Plane(scene.floor.normal.numpy(), float(scene.floor.offset * scale))
    return Scene(
        points=(scene.points * scale).float().numpy(),
        normals=scene.normals.float().numpy(),
        colors=estimates.inpainted,
        valid=scene.valid.numpy(),
        floor=floor,
        floor_points=(scene.floor_points * scale).float().numpy(),
        scale=scale,
        scale_sigma=state.scale_sigma,
        measured=estimates.measured_scale is not None,
    )
