"""Fit the lifter of the body fit to motions that are projected as cameras would see them.

    python -m benchmarks lifter MOTIONS [--steps 2500] [--seed 0] [--write]

MOTIONS is an npz file: ``P`` (n, 12, 3), joints of people in any unit, y up, in the order left
shoulder, elbow, wrist, the same of the right arm, left hip, knee, ankle, the same of the right leg;
and ``clip`` (n,), the motion that each belongs to. Each pose gets the bone lengths of the embedded
body, a camera, keypoints with the detector's errors, and a body with the errors of the body fit:
bones turned in depth, a lean, wrong lengths. The network learns to undo them. Every tenth motion is
left out, and its error printed. With ``--write`` the numbers go into the plugin.

The sizes of the errors are round numbers, near to those measured: before the lifter, ``_DEPTH`` is
0.26, 0.41, 0.16 and 0.16 for 42 bodies of panoptic and roundtable. Sizes half as large again gained
no more on films for fits.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import nn

from physic_core.body import JOINT_INDEX, load_body
from physic_core.files.npz import read_arrays
from physic_core.geometry.rotations import unit
from physic_embedded.body_fit.lifter import (
    BONES,
    HIPS,
    LIMB_SUM_M,
    NUMBERS,
    LimbView,
    network_inputs,
)
from physic_embedded.body_fit.limb_keypoints import LIMBS

from .fits import parser_of

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

WIDTH = 192
LAYERS = 6
BATCH = 512
LEARNING_RATE = 2e-3
LEFT_OUT = 10
"""Every so manieth motion is left out of the fit."""

_IN_FILE = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_SHOULDERS = [LIMBS.index("left_shoulder"), LIMBS.index("right_shoulder")]
_UPPER, _LOWER = np.array(BONES).T
_SWAPPED = [row ^ 1 for row in range(len(LIMBS))]

# Cameras: degrees, and metres to the person.
_PITCH = 14.0
_MAX_PITCH = 40.0
_ROLL = 4.0
_NEAR = 1.8
_FAR = 14.0
# Standard deviations of logarithms of people's lengths; of a fitted body's against the person's.
_BONE = 0.05
_WIDTH_OF_HIPS = 0.08
_WIDTH_OF_SHOULDERS = 0.06
_TRUNK = 0.05
_FITTED_BONE = 0.04
# Keypoints: metres at the person, how much more hidden ones and hips, and the share of outliers.
_POINT = 0.012
_HIDDEN_POINT = 4.0
_SURFACE_HIP = 1.6
_OUTLIERS = 0.05
# Shares of hidden joints, and of people cut by the lower border of the picture.
_HIDDEN_SHARE = 0.12
_CUT_SHARE = 0.3
# Fitted bodies, degrees: lean of the body, of trunk and legs alone, and turns about the vertical.
_LEAN = 7.0
_TRUNK_LEAN = 6.0
_LEG_LEAN = 6.0
_TWIST = 8.0
_HIP_TWIST = 14.0
_SHOULDER_TWIST = 10.0
# Directions of fitted bones: error in depth by kind of bone, across, and the share of bones that
# are mirrored in depth.
_DEPTH = np.repeat([0.25, 0.32, 0.18, 0.2], 2)
_SHRUNK = 0.9
_HIDDEN_DEPTH = 0.8
_ACROSS = 0.04
_TURNED = np.repeat([0.06, 0.03], 4)
# Up: degrees, and the share of photos in which it is unknown.
_UP = 4.0
_UNKNOWN_UP = 0.25


def main() -> int:
    """Fit, print the error on motions left out, and write."""
    parser = parser_of("lifter", __doc__)
    parser.add_argument("motions", type=Path)
    parser.add_argument("--steps", type=int, default=2500, help="batches of the fit")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    poses, clips = read_motions(given.motions)
    apart = np.unique(clips, return_inverse=True)[1] % LEFT_OUT == LEFT_OUT - 1
    network = fit(poses[~apart], clips[~apart], given.steps, given.seed)
    rng = np.random.default_rng(given.seed + 1)
    observed, truth = project(poses[apart][rng.integers(0, apart.sum(), 4000)], rng)
    with torch.no_grad():
        moved = network(_tensor(network_inputs(observed))).numpy().reshape(truth.shape)
    before, after = (
        1000 * np.linalg.norm(joints - truth, axis=-1).mean()
        for joints in (observed[0], observed[0] + moved)
    )
    print(
        f"{len(poses)} poses of {len(np.unique(clips))} motions, {apart.sum()} left out: "
        f"{before:.1f} mm of a joint before, {after:.1f} mm after"
    )
    if given.write:
        linear = [layer for layer in network.modules() if isinstance(layer, nn.Linear)]
        arrays: dict[str, Any] = {}
        for k, layer in enumerate(linear):
            arrays[f"weight{k}"] = layer.weight.detach().numpy().astype(np.float16)
            arrays[f"bias{k}"] = layer.bias.detach().numpy().astype(np.float16)
        np.savez(NUMBERS, **arrays)
        print(f"wrote {NUMBERS}")
    return 0


class Lifter(nn.Module):
    """Residual network from inputs (N, 76) to moves (N, 36)."""

    def __init__(self, num_inputs: int) -> None:
        super().__init__()
        widths = [num_inputs, *[WIDTH] * (LAYERS - 1)]
        hidden = [nn.Linear(a, b) for a, b in pairwise(widths)]
        last = nn.Linear(WIDTH, 3 * len(LIMBS))
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.layers = nn.ModuleList([*hidden, last])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return the moves (N, 36)."""
        hidden = torch.relu(self.layers[0](x))
        for k in range(1, LAYERS - 1, 2):
            hidden = hidden + torch.relu(self.layers[k + 1](torch.relu(self.layers[k](hidden))))
        told: torch.Tensor = self.layers[-1](hidden)
        return told


def fit(poses: Array, clips: NDArray[np.int64], steps: int, seed: int) -> Lifter:
    """Return the network fitted to poses (n, 12, 3) of motions (n,); a long motion weighs as the
    root of its length.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    _, motion, counts = np.unique(clips, return_inverse=True, return_counts=True)
    share = 1 / np.sqrt(counts[motion])
    share /= share.sum()
    network = Lifter(network_inputs(project(poses[:BATCH], rng)[0]).shape[1])
    optimiser = torch.optim.Adam(network.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, total_steps=steps)
    for _ in range(steps):
        observed, truth = project(poses[rng.choice(len(poses), BATCH, p=share)], rng)
        wanted = _tensor((truth - observed[0]).reshape(BATCH, -1))
        loss = (network(_tensor(network_inputs(observed))) - wanted).square().sum(1).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return network


def read_motions(file: Path) -> tuple[Array, NDArray[np.int64]]:
    """Return poses (n, 12, 3) in the order of LIMBS, and the motion (n,) of each."""
    with file.open("rb") as stream:
        arrays = read_arrays(stream)
    order = [
        3 * ((name.startswith("right_")) + 2 * (_IN_FILE.index(joint) > 2))
        + _IN_FILE.index(joint) % 3
        for name in LIMBS
        for joint in [name.partition("_")[2]]
    ]
    return arrays["P"][:, order].astype(np.float64), arrays["clip"].astype(np.int64)


def project(poses: Array, rng: Generator) -> tuple[LimbView, Array]:
    """Return what the lifter would see of poses (N, 12, 3), and the true joints (N, 12, 3)."""
    count = len(poses)
    person = _proportions(rng, count)
    people = _with_lengths(poses, *person)
    mirrored = rng.random(count) < 0.5
    people[mirrored] = (people[mirrored] * [-1, 1, 1])[:, _SWAPPED]
    pitch = np.clip(_PITCH * rng.standard_normal(count), -_MAX_PITCH, _MAX_PITCH)
    camera = (
        _about("z", _ROLL * rng.standard_normal(count))
        @ _about("x", pitch)
        @ np.diag([1.0, -1.0, -1.0])
        @ _about("y", rng.uniform(0, 360, count))
    )
    truth = people @ camera.transpose(0, 2, 1)
    depth = np.exp(rng.uniform(np.log(_NEAR), np.log(_FAR), count))
    confidence, points = _detected(truth, depth, rng)
    joints = _fitted(truth, person[0], confidence, rng)
    up = camera[:, :, 1] + np.radians(_UP) * rng.standard_normal((count, 3))
    up = unit(up)
    up[rng.random(count) < _UNKNOWN_UP] = 0
    return LimbView(joints, points, confidence, up, depth), truth


def _detected(truth: Array, depth: Array, rng: Generator) -> tuple[Array, Array]:
    """Return confidences (N, 12) and keypoints (N, 12, 2) on the plane of the hips; below the
    border of the picture, joints are hidden.
    """
    count = len(truth)
    points = truth[..., :2] * (depth[:, None] / (truth[..., 2] + depth[:, None]))[..., None]
    confidence = np.clip(1 - 0.08 * np.abs(rng.standard_normal((count, 12))), 0.02, 1)
    hidden = rng.random((count, 12)) < _HIDDEN_SHARE
    confidence = np.where(hidden, rng.uniform(0.05, 0.9, (count, 12)), confidence)
    border = np.where(rng.random(count) < _CUT_SHARE, rng.uniform(-0.1, 0.9, count), np.inf)
    cut = points[..., 1] > border[:, None]
    confidence = np.where(cut, rng.uniform(0.02, 0.05, (count, 12)), confidence)
    sigma = _POINT * (1 + _HIDDEN_POINT * (1 - confidence))
    sigma[:, HIPS] *= _SURFACE_HIP
    sigma[rng.random((count, 12)) < _OUTLIERS] *= 3
    return confidence, points + sigma[..., None] * rng.standard_normal((count, 12, 2))


def _fitted(truth: Array, lengths: Array, confidence: Array, rng: Generator) -> Array:
    """Return joints (N, 12, 3) of bodies with the errors of the body fit."""
    count = len(truth)
    bones = unit(truth[:, _LOWER] - truth[:, _UPPER])
    hidden = 1 - confidence[:, _LOWER]
    whole = _turn(rng, count, "x", _LEAN) @ _turn(rng, count, "y", _TWIST)
    bones = bones @ whole.transpose(0, 2, 1)
    bones[:, 4:] = bones[:, 4:] @ _turn(rng, count, "x", _LEG_LEAN).transpose(0, 2, 1)
    rough = np.where(rng.random((count, 8)) < 0.1, 2, 1) * (1 + _HIDDEN_DEPTH * hidden)
    bones[..., 2] = _SHRUNK * bones[..., 2] + _DEPTH * rough * rng.standard_normal((count, 8))
    bones[..., 2] *= np.where(rng.random((count, 8)) < _TURNED, -1, 1)
    bones[..., :2] += _ACROSS * (1 + 3 * hidden[..., None]) * rng.standard_normal((count, 8, 2))
    hips, shoulders = (
        (whole @ _turn(rng, count, "y", twist) @ (truth[:, a] - truth[:, b])[..., None])[..., 0]
        for (a, b), twist in ((HIPS, _HIP_TWIST), (_SHOULDERS, _SHOULDER_TWIST))
    )
    trunk = whole @ _turn(rng, count, "x", _TRUNK_LEAN) @ truth[:, _SHOULDERS].mean(1)[..., None]
    grown = lengths * np.exp(_FITTED_BONE * rng.standard_normal((count, 8)))
    return _assembled(hips, shoulders, trunk[..., 0], bones, grown)


def _proportions(rng: Generator, count: int) -> tuple[Array, Array, Array, Array]:
    """Return lengths of the eight bones (N, 8), widths of hips and shoulders, and length of the
    trunk (N, 1) each, metres, around those of the embedded body.
    """
    lengths, hips, shoulders, trunk = _embedded_lengths()
    return (
        lengths * np.exp(_BONE * rng.standard_normal((count, 4))).repeat(2, 1),
        hips * np.exp(_WIDTH_OF_HIPS * rng.standard_normal((count, 1))),
        shoulders * np.exp(_WIDTH_OF_SHOULDERS * rng.standard_normal((count, 1))),
        trunk * np.exp(_TRUNK * rng.standard_normal((count, 1))),
    )


@cache
def _embedded_lengths() -> tuple[Array, float, float, float]:
    """Return the lengths of the bones (8,) of the embedded body, the widths of its hips and
    shoulders, and the length of its trunk, in metres of the lifter.
    """
    model = load_body("embedded")
    with torch.no_grad():
        rest = model(*model.zero_pose(1), joints_only=True).joints[0].double().numpy()
    rest = rest[[JOINT_INDEX[name] for name in LIMBS]]
    lengths = np.linalg.norm(rest[_LOWER] - rest[_UPPER], axis=-1)
    rest *= LIMB_SUM_M / lengths.sum()
    trunk = rest[_SHOULDERS].mean(0) - rest[HIPS].mean(0)
    return (
        np.asarray(lengths * LIMB_SUM_M / lengths.sum()),
        float(np.ptp(rest[HIPS, 0])),
        float(np.ptp(rest[_SHOULDERS, 0])),
        float(np.linalg.norm(trunk)),
    )


def _with_lengths(
    poses: Array, lengths: Array, hips: Array, shoulders: Array, trunk: Array
) -> Array:
    """Return poses (N, 12, 3) with other lengths and the same directions."""
    left, right = (unit(poses[:, a] - poses[:, b]) for a, b in (HIPS, _SHOULDERS))
    spine = unit(poses[:, _SHOULDERS].mean(1) - poses[:, HIPS].mean(1))
    bones = unit(poses[:, _LOWER] - poses[:, _UPPER])
    return _assembled(hips * left, shoulders * right, trunk * spine, bones, lengths)


def _assembled(hips: Array, shoulders: Array, trunk: Array, bones: Array, lengths: Array) -> Array:
    """Return joints (N, 12, 3) from right to left hip and shoulder, the trunk (N, 3 each), and
    directions (N, 8, 3) and lengths (N, 8) of the bones.
    """
    joints = np.zeros((len(hips), len(LIMBS), 3))
    bones = lengths[..., None] * unit(bones)
    for (left, right), across in ((HIPS, hips), (_SHOULDERS, shoulders)):
        joints[:, left] = across / 2
        joints[:, right] = -across / 2
    joints[:, _SHOULDERS] += trunk[:, None]
    for k, (upper, lower) in enumerate(BONES):
        joints[:, lower] = joints[:, upper] + bones[:, k]
    return joints


def _turn(rng: Generator, count: int, axis: str, degrees: float) -> Array:
    """Return rotations (N, 3, 3) by normally distributed angles."""
    return _about(axis, degrees * rng.standard_normal(count))


def _about(axis: str, degrees: Array) -> Array:
    """Return rotations (N, 3, 3) about an axis by angles (N,)."""
    return np.asarray(Rotation.from_euler(axis, degrees[:, None], degrees=True).as_matrix())


def _tensor(values: NDArray[np.floating]) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))
