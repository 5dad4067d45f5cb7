"""The fit of the lifter of limbs, on made-up poses."""

from __future__ import annotations

import numpy as np
import torch

from benchmarks.lifter import fit, project
from physic_embedded.body_fit.lifter import BONES, network_inputs
from physic_embedded.body_fit.limb_keypoints import LIMBS

STANCE = {
    "shoulder": (0.4, 1.0, 0.0),
    "elbow": (0.5, 0.4, 0.0),
    "wrist": (0.5, -0.1, 0.1),
    "hip": (0.2, 0.0, 0.0),
    "knee": (0.25, -0.9, 0.1),
    "ankle": (0.25, -1.8, 0.0),
}
"""Joints of the left side in lengths of the trunk: x to the left, y up, z ahead."""


def made_up(count):
    """Poses (n, 12, 3) near a stance, in the order of LIMBS."""
    rng = np.random.default_rng(0)
    rest = np.array([STANCE[name.partition("_")[2]] for name in LIMBS])
    rest[1::2, 0] *= -1
    return rest + rng.normal(0, 0.1, (count, *rest.shape))


def lengths(joints):
    return np.stack([np.linalg.norm(joints[:, a] - joints[:, b], axis=-1) for a, b in BONES], 1)


def test_projected_people_keep_their_size_and_show_it():
    (joints, points, confidence, up, depth), truth = project(made_up(300), np.random.default_rng(1))
    np.testing.assert_allclose(lengths(joints) / lengths(truth), 1, atol=0.2)
    in_picture = truth[..., :2] * (depth[:, None] / (truth[..., 2] + depth[:, None]))[..., None]
    off = np.linalg.norm(points - in_picture, axis=-1)
    assert np.median(off[confidence > 0.8]) < 0.03
    assert (off[confidence < 0.1]).mean() > 2 * off[confidence > 0.8].mean()
    known = np.linalg.norm(up, axis=-1)
    assert set(known.round(6)) == {0.0, 1.0}
    ahead = truth[:, [0, 1]].mean(1)
    assert (np.einsum("ni,ni->n", ahead, up)[known > 0] > 0).all()


def test_a_short_fit_undoes_errors_of_bodies_and_repeats_bit_by_bit():
    poses = made_up(200)
    clips = np.repeat(np.arange(10), 20)
    network, again = (fit(poses, clips, steps=60, seed=3) for _ in range(2))
    seen, truth = project(poses, np.random.default_rng(5))
    x = torch.from_numpy(network_inputs(seen).astype(np.float32))
    with torch.no_grad():
        moved = network(x)
        assert torch.equal(moved, again(x))
    before, after = (
        np.linalg.norm(found - truth, axis=-1).mean()
        for found in (seen[0], seen[0] + moved.double().numpy().reshape(truth.shape))
    )
    assert after < 0.8 * before
