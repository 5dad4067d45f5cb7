"""Mocks of the body estimator and the hand estimator."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import Bodies, BodyParameters, Hands
from physic_mock.body_noise import (
    BONES,
    camera_rotations,
    draw_bone_errors,
    hidden_bones,
    line_of_sight_axes,
    local_rotations,
)
from physic_mock.noise import add_rotation_noise, bernoulli, seeded_rng
from physic_mock.recognition import MockOptions, match_people, recognise_world

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array
    from physic_testing.worlds import World

__all__ = ["BodyOptions", "HandOptions", "MockBodyEstimator", "MockHandEstimator"]

_WRISTS = (20, 21)


class BodyOptions(MockOptions):
    """Options of :class:`MockBodyEstimator`."""

    pose_noise_deg: float = Field(
        8.2,
        ge=0,
        le=60,
        description="How far bones lean towards or away from the camera: standard deviation about each of the two axes "
        "across the line of sight, degrees.",
    )
    plane_noise_deg: float = Field(
        3.5, ge=0, le=60, description="Standard deviation of bones' turns in the plane of the picture, degrees."
    )
    limb_share: float = Field(
        0.5, ge=0, le=1, description="Share of the variance of both that all bones of an arm, a leg or the trunk share."
    )
    trunk_factor: float = Field(0.5, ge=0, le=5, description="Factor on these errors of trunk, neck and head.")
    hidden_factor: float = Field(2.0, ge=0, le=5, description="Factor on these errors of bones whose end is hidden.")
    orient_noise_deg: float = Field(
        7.0, ge=0, le=90, description="Standard deviation of the root rotation about each axis, degrees."
    )
    shape_noise: float = Field(
        0.4, ge=0, le=3, description="Standard deviation of each shape component; those that change the stature less."
    )
    stature_noise: float = Field(0.04, ge=0, le=0.5, description="Standard deviation of the logarithm of stature.")
    depth_noise: float = Field(
        0.34,
        ge=0,
        le=1,
        description="Standard deviation of the logarithm of distance: people come out too near or too far.",
    )
    depth_share: float = Field(
        0.5, ge=0, le=1, description="Share of the variance of log distance that all people of a photo share."
    )
    lateral_noise_m: float = Field(
        0.03, ge=0, le=2, description="Standard deviation of the place across the line of sight, metres."
    )
    observed_errors: float = Field(0.03, ge=0, le=1, description="Share of joints whose reported visibility is wrong.")


class MockBodyEstimator(interfaces.BodyEstimator):
    """Body estimator that returns a world's bodies with errors typical of estimators.

    Hands are flat; the hand estimator returns their pose.
    """

    Options = BodyOptions

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Return the bodies of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is nobody of it.
        """
        assert isinstance(self.options, BodyOptions)
        options = self.options
        found = recognise_world(image)
        rows = match_people(found, people)
        world, rng = found.world, seeded_rng(found.world, options.noise_seed, "bodies")
        truth, count = world.parameters, len(world.vertices)
        placed = _noisy_translations(world, options, rng)
        posed = np.stack(
            [
                _noisy_pose(world, i, options, seeded_rng(world, options.noise_seed, f"pose of person {i}"))
                for i in range(count)
            ]
        )
        flips = bernoulli(options.observed_errors, options.noise, rng.random(world.joints_visible.shape))
        parameters = BodyParameters(
            global_orient=posed[:, 0],
            body_pose=posed[:, 1:].reshape(count, -1),
            left_hand_pose=np.zeros_like(truth.left_hand_pose),
            right_hand_pose=np.zeros_like(truth.right_hand_pose),
            jaw_pose=truth.jaw_pose.copy(),
            leye_pose=truth.leye_pose.copy(),
            reye_pose=truth.reye_pose.copy(),
            betas=_noisy_betas(world, options, rng),
            expression=truth.expression.copy(),
            transl=placed,
        )
        picked = replace(parameters, **{name: value[rows] for name, value in vars(parameters).items()})
        return Bodies(parameters=picked, body_model=world.body_model, observed=(world.joints_visible ^ flips)[rows])


def _noisy_translations(world: World, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return translations (N, 3) float32 with log-normal errors along the line of sight, normal across it."""
    pelvis = world.joints[:, 0].astype(np.float64)
    common, own = rng.normal(), rng.normal(size=len(pelvis))
    along = np.sqrt(options.depth_share) * common + np.sqrt(1 - options.depth_share) * own
    across = rng.normal(size=(len(pelvis), 2))
    moved = pelvis * np.exp(options.noise * options.depth_noise * along)[:, None]
    for i, point in enumerate(pelvis):
        moved[i] += options.noise * options.lateral_noise_m * across[i] @ line_of_sight_axes(point)[:2]
    placed: FloatArray = (world.parameters.transl + moved - pelvis).astype(np.float32)
    return placed


def _noisy_pose(world: World, person: int, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return rotation vectors (22, 3) float32 of one person's root and body joints, with errors."""
    from scipy.spatial.transform import Rotation

    truth = world.parameters
    local = np.concatenate([truth.global_orient[person], truth.body_pose[person]]).reshape(BONES, 3).astype(np.float64)
    whole = np.radians(options.noise * options.orient_noise_deg) * rng.normal(size=3)
    errors = draw_bone_errors(
        line_of_sight_axes(world.joints[person, 0].astype(np.float64)),
        hidden_bones(world.joints_visible[person]),
        options.noise * options.pose_noise_deg,
        options.noise * options.plane_noise_deg,
        options.limb_share,
        options.hidden_factor,
        options.trunk_factor,
        rng,
    )
    turn = Rotation.from_rotvec(whole)
    seen = [turn * Rotation.from_rotvec(e) * g for e, g in zip(errors, camera_rotations(local), strict=True)]
    return local_rotations(seen).astype(np.float32)


def _noisy_betas(world: World, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return betas (N, K) float32 with errors: ``stature_noise`` along stature, ``shape_noise`` across it."""
    betas = world.parameters.betas.astype(np.float64)
    growth = _log_stature_gradient(world.body_model)
    direction = growth / np.linalg.norm(growth)
    stature, others = rng.normal(size=(len(betas), 1)), rng.normal(size=betas.shape)
    others -= (others @ direction)[:, None] * direction
    errors = options.stature_noise / np.linalg.norm(growth) * stature * direction + options.shape_noise * others
    return (betas + options.noise * errors).astype(np.float32)


@lru_cache(maxsize=2)
def _log_stature_gradient(body_model: str) -> FloatArray:
    """Return the derivative (K,) of log stature with respect to betas, at the mean shape."""
    import torch

    from physic_core.body import load_body

    model = load_body(body_model).to(dtype=torch.float64)
    with torch.no_grad():
        one = torch.eye(model.num_betas, dtype=torch.float64)
        growth: FloatArray = (model.stature(one) / model.stature(-one)).log().div(2).numpy()
    return np.round(growth, 9)  # products of matrices differ in their last bit between CPUs


class HandOptions(MockOptions):
    """Options of :class:`MockHandEstimator`."""

    noise_deg: float = Field(
        10.0, ge=0, le=90, description="Standard deviation about each axis of each finger joint, degrees."
    )
    missed: float = Field(0.1, ge=0, le=1, description="Share of the hands in sight that are not found.")


class MockHandEstimator(interfaces.HandEstimator):
    """Hand estimator that returns a world's finger rotations with noise, for hands with a visible wrist."""

    Options = HandOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the hands of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is nobody of it.
        """
        assert isinstance(self.options, HandOptions)
        options = self.options
        found = recognise_world(image)
        rows = match_people(found, people)
        rng = seeded_rng(found.world, options.noise_seed, "hands")
        truth = found.world.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(-1, 2, 15, 3)
        rotvecs = add_rotation_noise(both, options.noise * options.noise_deg, rng)
        seen = found.world.joints_visible[:, list(_WRISTS)]
        seen = seen & ~bernoulli(options.missed, options.noise, rng.random(seen.shape))
        return Hands(rotvecs=rotvecs[rows], confidence=np.where(seen, 0.9, 0.0)[rows])
