"""Mock of the person observer: what people of a world do, as a calibrated network would say it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import softmax

from physic_core import interfaces
from physic_core.body import JOINT_INDEX
from physic_core.types import POSTURES, TOUCH_PARTS, TOUCHED, Observations
from physic_mock.noise import HEAD_DEG, LOG_ODDS, LOG_ODDS_SIGMA, Noise
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import (
        BoolArray,
        FloatArray,
        Intrinsics,
        Keypoints,
        People,
        UInt8Array,
    )
    from physic_testing.worlds import World


class MockPersonObserver(interfaces.PersonObserver):
    """Person observer that returns what people of a world touch, hold and do.

    The posture is known in worlds that are named after one, such as "sit_on_chair". All answers to
    a question are equally frequent in the data that its probabilities are said to be fitted on.
    """

    written_for = 1
    Options = MockOptions
    options: MockOptions

    def infer(
        self, image: UInt8Array, people: People, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Observations:
        """Return observations of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is not in it.
        """
        # torch, which checks of configurations do without
        from physic_testing.conformance.truth import true_observations

        recognised = recognise_world(image)
        rows = match_masks_to_world(recognised, people)
        world = recognised.world
        truth = true_observations(world)
        noise = Noise(world, self.options)
        rng = noise.rng("observations")

        def log_odds(truth: BoolArray) -> FloatArray:
            drawn = noise.factor * LOG_ODDS_SIGMA * rng.normal(size=truth.shape)
            return np.asarray(np.where(truth, LOG_ODDS, -LOG_ODDS) + drawn)[rows]

        def probability(truth: BoolArray) -> FloatArray:
            return np.asarray(1 / (1 + np.exp(-log_odds(truth))), np.float32)

        def choice(truth: FloatArray | BoolArray) -> FloatArray:
            return np.asarray(softmax(log_odds(truth > 0), -1) + 0 * truth[rows], np.float32)

        return replace(
            Observations.unknown(len(rows)),
            posture=choice(truth["posture"]),
            touch=choice(truth["touch"]),
            on_floor=probability(truth["on_floor"] > 0),
            child=probability(truth["child"] > 0),
            **_noisy_face_directions(world, truth["head"], rows, noise.factor, rng),
            **_answer_shares(),
        )


def _noisy_face_directions(
    world: World, head: FloatArray, rows: list[int], factor: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the directions of the faces of people in ``rows``, and their errors; NaN for a face
    that is turned away from the camera.
    """
    least, added = HEAD_DEG
    drawn = np.radians(factor * added) * rng.normal(size=head.shape)
    faces_camera = np.einsum("ni,ni->n", head, world.joints[:, JOINT_INDEX["head"]]) < 0
    head = np.where(faces_camera[:, None], head + drawn, np.nan)
    head = head / np.linalg.norm(head, axis=1, keepdims=True)
    sigma = np.where(faces_camera, np.hypot(least, factor * added), np.nan)
    return {"head": head[rows].astype(np.float32), "head_sigma": sigma[rows].astype(np.float32)}


def _answer_shares() -> dict[str, Any]:
    """Return the share of "yes" of each question: all answers are equally frequent."""
    return {
        "posture_share": np.full(len(POSTURES), 1 / len(POSTURES), np.float32),
        "touch_share": np.full((len(TOUCH_PARTS), len(TOUCHED)), 1 / len(TOUCHED), np.float32),
        "on_floor_share": np.full(2, 0.5, np.float32),
        "child_share": 0.5,
    }
