"""Mocks of the body estimator and the hand estimator."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.body.joints import JOINT_INDEX
from physic_core.types import Bodies, BodyParameters, Hands
from physic_mock.body_noise import (
    BONES,
    LIMBS,
    camera_rotations,
    depth_flip,
    draw_bone_errors,
    hidden_bones,
    line_of_sight_axes,
    local_rotations,
)
from physic_mock.noise import add_rotation_noise, bernoulli, seeded_rng
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array
    from physic_testing.worlds import World

_WRISTS = (20, 21)
_FLIPPABLE = {
    f"{side}_{joint}": f"{side}_{child}"
    for joint, child in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
    for side in ("left", "right")
}
"""Joint at the start of a limb segment -> joint at its end."""


class BodyOptions(MockOptions):
    """Options of :class:`MockBodyEstimator`."""

    VERSION_4: ClassVar = {
        "pose_noise_deg": 10.0,
        "plane_noise_deg": 6.0,
        "orient_noise_deg": 6.0,
        "lean_factor": 2.2,
        "turns_limbs": False,
        "person_spread": 0.3,
        "flipped": 0.06,
        "flipped_forearms": 0.15,
        "stature_noise": 0.045,
        "stature_bias": -0.06,
        "depth_noise": 0.05,
        "size_gives_depth": True,
        "children_as_adults": True,
    }

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
    limb_share: interfaces.Share = Field(
        0.5, description="Share of the variance of both that all bones of an arm, a leg or the trunk share."
    )
    trunk_factor: float = Field(0.5, ge=0, le=5, description="Factor on these errors of trunk, neck and head.")
    hidden_factor: float = Field(2.0, ge=0, le=5, description="Factor on these errors of bones whose end is hidden.")
    orient_noise_deg: float = Field(
        7.0, ge=0, le=90, description="Standard deviation of the root rotation about each axis, degrees."
    )
    lean_factor: float = Field(
        1.0, ge=0, le=5, description="Factor on that rotation about the two axes across the line of sight."
    )
    turns_limbs: bool = Field(
        True, description="Whether that rotation turns arms and legs, too, or the trunk between them alone."
    )
    person_spread: float = Field(
        0.0,
        ge=0,
        le=2,
        description="How unlike people fare: standard deviation of the logarithm of a person's factor on all of these "
        "rotations.",
    )
    flipped: interfaces.Share = Field(
        0.0, description="Share of upper arms, thighs and shanks that point towards the camera, not away."
    )
    flipped_forearms: interfaces.Share = Field(0.0, description="The same share of forearms.")
    shape_noise: float = Field(
        0.4, ge=0, le=3, description="Standard deviation of each shape component; those that change the stature less."
    )
    stature_noise: float = Field(0.04, ge=0, le=0.5, description="Standard deviation of the logarithm of stature.")
    stature_bias: float = Field(0.0, ge=-0.5, le=0.5, description="Mean of the logarithm of stature over the true one.")
    size_gives_depth: bool = Field(
        False,
        description="Whether distance follows from the size in the photo: the errors of stature and of focal length "
        "are errors of distance, too.",
    )
    children_as_adults: bool = Field(
        False,
        description="Whether children come out as adults who are farther away: with the mean adult's shape, and as "
        "large in the photo.",
    )
    depth_noise: interfaces.Share = Field(
        0.34, description="Standard deviation of the logarithm of distance: people come out too near or too far."
    )
    depth_share: interfaces.Share = Field(
        0.5, description="Share of the variance of log distance that all people of a photo share."
    )
    lateral_noise_m: float = Field(
        0.03, ge=0, le=2, description="Standard deviation of the place across the line of sight, metres."
    )
    observed_errors: interfaces.Share = Field(0.03, description="Share of joints whose reported visibility is wrong.")


class MockBodyEstimator(interfaces.BodyEstimator):
    """Body estimator that returns a world's bodies with errors typical of estimators.

    Hands are flat; the hand estimator returns their pose.
    """

    Options = BodyOptions
    options: BodyOptions

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Return the bodies of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is nobody of it.
        """
        options = self.options
        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        world, rng = found.world, seeded_rng(found.world, options.noise_seed, "bodies")
        truth, count = world.parameters, len(world.vertices)
        placed = _noisy_translations(world, options, rng, intrinsics)
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
            betas=_noisy_betas(world, options, rng, _stature_draws(world, options)),
            expression=truth.expression.copy(),
            transl=placed,
        )
        picked = replace(parameters, **{name: value[rows] for name, value in vars(parameters).items()})
        return Bodies(parameters=picked, body_model=world.body_model, observed=(world.joints_visible ^ flips)[rows])


def _stature_draws(world: World, options: BodyOptions) -> FloatArray | None:
    """Return a normal draw (N,) of each person's stature if it decides the distance, too; else None."""
    if not options.size_gives_depth:
        return None
    draws: FloatArray = seeded_rng(world, options.noise_seed, "statures", all_views=True).normal(
        size=len(world.vertices)
    )
    return draws


def _noisy_translations(world: World, options: BodyOptions, rng: np.random.Generator, camera: Intrinsics) -> FloatArray:
    """Return translations (N, 3) float32 with log-normal errors along the line of sight, normal across it."""
    pelvis = world.joints[:, 0].astype(np.float64)
    common, own = rng.normal(), rng.normal(size=len(pelvis))
    along = np.sqrt(options.depth_share) * common + np.sqrt(1 - options.depth_share) * own
    across = rng.normal(size=(len(pelvis), 2))
    moved = pelvis * np.exp(options.noise * options.depth_noise * along)[:, None]
    statures = _stature_draws(world, options)
    if statures is not None:
        moved *= np.exp(options.noise * (options.stature_bias + options.stature_noise * statures))[:, None]
        moved *= [1.0, 1.0, camera.fx / world.intrinsics.fx]  # the same pixel of the other camera
    moved *= _seen_shapes(world, options)[1][:, None]
    for i, point in enumerate(pelvis):
        moved[i] += options.noise * options.lateral_noise_m * across[i] @ line_of_sight_axes(point)[:2]
    placed: FloatArray = (world.parameters.transl + moved - pelvis).astype(np.float32)
    return placed


def _noisy_pose(world: World, person: int, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return rotation vectors (22, 3) float32 of one person's root and body joints, with errors."""
    from scipy.spatial.transform import Rotation

    truth = world.parameters
    local = np.concatenate([truth.global_orient[person], truth.body_pose[person]]).reshape(BONES, 3).astype(np.float64)
    sight = line_of_sight_axes(world.joints[person, 0].astype(np.float64))
    own = seeded_rng(world, options.noise_seed, f"how the pose of person {person} fares")
    fares = np.exp(options.person_spread * own.normal())
    root_error = fares * np.radians(options.noise * options.orient_noise_deg) * rng.normal(size=3)
    if options.lean_factor != 1:
        root_error = sight.T @ (sight @ root_error * [options.lean_factor, options.lean_factor, 1.0])
    errors = draw_bone_errors(
        sight,
        hidden_bones(world.joints_visible[person]),
        fares * options.noise * options.pose_noise_deg,
        fares * options.noise * options.plane_noise_deg,
        options.limb_share,
        options.hidden_factor,
        options.trunk_factor,
        rng,
    )
    turn = Rotation.from_rotvec(root_error)
    seen = [
        (turn if options.turns_limbs or limb == "trunk" else Rotation.identity()) * Rotation.from_rotvec(e) * g
        for e, g, limb in zip(errors, camera_rotations(local), LIMBS, strict=True)
    ]
    for joint, child in _FLIPPABLE.items():
        share = options.flipped_forearms if "elbow" in joint else options.flipped
        if bernoulli(share, options.noise, own.random(1))[0]:
            j = JOINT_INDEX[joint]
            bone = (world.joints[person, JOINT_INDEX[child]] - world.joints[person, j]).astype(np.float64)
            bone = turn.apply(bone) if options.turns_limbs else bone
            seen[j] = depth_flip(bone, sight[2]) * seen[j]
    return local_rotations(seen).astype(np.float32)


def _noisy_betas(
    world: World, options: BodyOptions, rng: np.random.Generator, statures: FloatArray | None
) -> FloatArray:
    """Return betas (N, K) float32 with errors: ``stature_noise`` along stature, ``shape_noise`` across it.

    ``statures`` (N,) are normal draws of stature, or None for new ones.
    """
    betas, _ = _seen_shapes(world, options)
    growth = _log_stature_gradient(world.body_model)
    direction = growth / np.linalg.norm(growth)
    drawn, others = rng.normal(size=(len(betas), 1)), rng.normal(size=betas.shape)
    stature: FloatArray = drawn if statures is None else statures[:, None]
    others -= (others @ direction)[:, None] * direction
    errors = options.stature_noise / np.linalg.norm(growth) * stature * direction + options.shape_noise * others
    errors += options.stature_bias / np.linalg.norm(growth) * direction
    return (betas + options.noise * errors).astype(np.float32)


def _seen_shapes(world: World, options: BodyOptions) -> tuple[FloatArray, FloatArray]:
    """Return betas (N, K), a mean adult's for children who come out as adults, and (N,) how much taller these are."""
    betas, taller = world.parameters.betas.astype(np.float64), np.ones(len(world.ages))
    children = np.isfinite(world.ages) & options.children_as_adults & (options.noise > 0)
    if children.any():
        import torch

        from physic_core.body import load_body

        own = torch.from_numpy(betas[children])
        model = load_body(world.body_model).to(dtype=torch.float64)
        with torch.no_grad():
            taller[children] = (model.stature(0 * own) / model.stature(own)).numpy()
        betas[children] = 0
    return betas, taller


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
    missed: interfaces.Share = Field(0.1, description="Share of the hands in sight that are not found.")


class MockHandEstimator(interfaces.HandEstimator):
    """Hand estimator that returns a world's finger rotations with noise, for hands with a visible wrist."""

    Options = HandOptions
    options: HandOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the hands of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is nobody of it.
        """
        options = self.options
        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        rng = seeded_rng(found.world, options.noise_seed, "hands")
        truth = found.world.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(-1, 2, 15, 3)
        rotvecs = add_rotation_noise(both, options.noise * options.noise_deg, rng)
        seen = found.world.joints_visible[:, list(_WRISTS)]
        seen = seen & ~bernoulli(options.missed, options.noise, rng.random(seen.shape))
        return Hands(rotvecs=rotvecs[rows], confidence=np.where(seen, 0.9, 0.0)[rows])
