"""People whom one photo shows elsewhere than the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_scene.bundle import adjust, energy, keypoint_block, robust_weights

if TYPE_CHECKING:
    from physic_scene.bundle import Bundle, BundleSettings, Observations

_PHOTOS, _PEOPLE = 3, 3  # with fewer photos of a person, or people of a photo, nothing shows which of them differs


def likeliest_elsewhere(
    observations: Observations, bundle: Bundle, reference: int, settings: BundleSettings, odds: float
) -> tuple[int, int] | None:
    """Return the photo, and the person whom it shows elsewhere than the other photos; None without clear evidence.

    For each person of each photo, cameras and points are adjusted without these keypoints, and the person is placed
    anew in this photo alone. Half of what the energy loses is the logarithm of the ratio of likelihoods.

    Args:
        observations: of all photos.
        bundle: their cameras and points with the least energy.
        reference: index of the camera whose pose stays.
        settings: of the energy.
        odds: logarithm of the prior odds that a photo shows a person where the others do, which the ratio must exceed.
    """
    shown, before = observations.shown, energy(observations, bundle, reference, settings)
    # The start is near: the widest round is needless.
    near = replace(settings, rounds=settings.rounds[1:] or settings.rounds, steps=settings.steps // 2)
    gain = {}
    for view, person in zip(*np.nonzero(shown), strict=True):
        if shown[:, person].sum() < _PHOTOS or shown[view].sum() < _PEOPLE:
            continue
        confidence = observations.confidence.copy()
        confidence[view, person] = 0
        others = replace(observations, confidence=confidence)
        found = adjust(others, bundle, reference, near)
        after = energy(others, found, reference, settings) + _placed_anew(observations, found, view, person, settings)
        gain[int(view), int(person)] = (before - after) / 2
    likeliest = max(gain, key=lambda one: gain[one], default=None)
    return likeliest if likeliest is not None and gain[likeliest] > odds else None


def _placed_anew(observations: Observations, bundle: Bundle, view: int, person: int, settings: BundleSettings) -> float:
    """Return the least energy of a person's keypoints in a photo over the person's place."""
    damping, place = 1e-2, np.zeros(3)

    def at(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        points = bundle.points.copy()
        points[person] += place
        block = keypoint_block(observations, replace(bundle, points=points), view, person, settings)
        weight, found = robust_weights(block, settings.outlier)
        jacobian = block.jacobian[:, :, 6:9]
        normal = np.einsum("nij,n,nik->jk", jacobian, weight, jacobian)
        return normal, np.einsum("nij,n,ni->j", jacobian, weight, block.residual), found

    normal, gradient, least = at(place)
    for _ in range(2 * settings.steps):
        # One or two keypoints do not give a place.
        step = -np.linalg.solve(normal + damping * np.diag(normal.diagonal()) + 1e-6 * np.eye(3), gradient)
        trial = at(place + step)
        if trial[2] >= least:
            damping *= 6
            if damping > 1e5:
                break
            continue
        gain = least - trial[2]
        place, (normal, gradient, least), damping = place + step, trial, max(damping / 4, 1e-9)
        if gain < 1e-5 * least:
            break
    return least
