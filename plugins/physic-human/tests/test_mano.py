"""Hands of a network that knows right hands only."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.interfaces import HandEstimator
from physic_human.hands import hands_from_mano, mirror_rotvecs
from physic_testing import violations

RNG = np.random.default_rng(0)
FINGERS, WRISTS = RNG.normal(0, 0.4, (2, 15, 3)), RNG.normal(0, 1, (2, 1, 3))
BOTH = {"person": np.array([1, 1]), "right": np.array([False, True]), "confidence": np.array([0.8, 0.9])}


def test_left_comes_first_and_is_mirrored_back() -> None:
    hands = hands_from_mano(2, fingers=FINGERS, wrists=WRISTS, **BOTH)
    np.testing.assert_allclose(hands.rotvecs[1, 0], mirror_rotvecs(FINGERS[0]), atol=1e-6)
    np.testing.assert_allclose(hands.rotvecs[1, 1], FINGERS[1], atol=1e-6)
    assert hands.wrists is not None
    np.testing.assert_allclose(hands.wrists[1], [mirror_rotvecs(WRISTS[0, 0]), WRISTS[1, 0]], atol=1e-6)
    np.testing.assert_allclose(hands.confidence, [[0, 0], [0.8, 0.9]], atol=1e-6)
    assert violations(HandEstimator, hands, people=2) == []


def test_mano_rotations_may_be_matrices_or_vectors() -> None:
    matrices = Rotation.from_rotvec(FINGERS.reshape(-1, 3)).as_matrix().reshape(2, 15, 3, 3)
    whole = Rotation.from_rotvec(WRISTS.reshape(-1, 3)).as_matrix().reshape(2, 1, 3, 3)
    hands = hands_from_mano(2, fingers=matrices, wrists=whole, **BOTH)
    again = hands_from_mano(2, fingers=FINGERS, wrists=WRISTS, **BOTH)
    assert hands.wrists is not None
    assert again.wrists is not None
    np.testing.assert_allclose(hands.rotvecs, again.rotvecs, atol=1e-6)
    np.testing.assert_allclose(
        Rotation.from_rotvec(hands.wrists[1]).as_matrix(), Rotation.from_rotvec(again.wrists[1]).as_matrix(), atol=1e-6
    )


def test_the_hand_with_the_higher_confidence_counts() -> None:
    hands = hands_from_mano(1, np.zeros(2, int), np.array([True, True]), FINGERS, np.array([0.9, 0.3]))
    np.testing.assert_allclose(hands.rotvecs[0, 1], FINGERS[0], atol=1e-6)


def test_a_hand_that_is_not_a_number_was_not_found() -> None:
    broken = FINGERS.copy()
    broken[1, 3] = np.nan
    hands = hands_from_mano(2, fingers=broken, **BOTH)
    np.testing.assert_allclose(hands.confidence[1], [0.8, 0.0], atol=1e-6)
    assert np.isfinite(hands.rotvecs).all()


def test_mirrored_rotations_are_those_of_a_mirrored_world() -> None:
    vectors = np.random.default_rng(2).normal(0, 1, (20, 3))
    mirror = np.diag([-1.0, 1.0, 1.0])
    turned = mirror @ Rotation.from_rotvec(vectors).as_matrix() @ mirror
    np.testing.assert_allclose(Rotation.from_rotvec(mirror_rotvecs(vectors)).as_matrix(), turned, atol=1e-12)
