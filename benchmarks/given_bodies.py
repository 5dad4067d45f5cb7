"""What the engine makes of given bodies: true ones with errors, before and after.

    python -m benchmarks given_bodies DATA --out given-results [--sets mpi_inf_3dhp,panoptic]
    [--triangulated FILE] [--set KEY=VALUE]

Bodies are fitted to the true joints of photos with a camera, turned by 5 degrees about a common
axis and by independent angles at each joint that move joints by 50 mm (root mean square, relative
to the pelvis), and given to the tool. Truth of ``panoptic`` and ``roundtable`` is
that of ``--triangulated``, which ``truth`` writes. One row for each person, then the means.
"""

from __future__ import annotations

import json
import math
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.fits import parser_of
from physic_core import write_bodies
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations, pose_from_parameters
from physic_core.conversion import convert_bodies
from physic_core.geometry.rotations import rotvec_to_rotmat_numpy
from physic_core.prepare.bodies import turn_sigmas
from physic_core.types import Bodies, BodyParameters, Intrinsics

from .truth.builds import ROOT, asked, build_of, measured_of, question_of
from .truth.joints import BODY_ROWS, limb_joints
from .truth.measures import pose_errors
from .truth.scores import MIN_VISIBLE, floor_record, joints_of, matched_people, projected
from .truth.sets import SETS, Sample, camera_of
from .truth.triangulation import visible_joints

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .truth.builds import Ask

    Array = NDArray[np.float64]

SIGMA_M = 0.05
TURN_DEG = 5.0
DISTANCE_SIGMA = 0.01  # stated; places are true
ERRORS = {"mpjpe": "mpjpe_mm", "root": "root_aligned_mm", "pa": "pa_mpjpe_mm"}
_BODY = 22


def main() -> None:
    """Run, compare, print."""
    parser = parser_of("given_bodies", __doc__, fits=False)
    add = parser.add_argument
    add("data", type=Path, help="folder that holds the data sets")
    add("--out", type=Path, default=Path("given-results"), help="for bodies and answers")
    add("--sets", default="mpi_inf_3dhp", help="data sets, with commas between them")
    add("--triangulated", type=Path, metavar="FILE", help="joints of a run of truth")
    add("--photos", type=int, help="the first N of each data set")
    setting = {"dest": "settings", "action": "append", "metavar": "KEY=VALUE"}
    add("--set", default=[], help="a setting", **setting)
    given = parser.parse_args()
    with asked(build_of(ROOT, "embedded", given.settings), given.out) as ask:
        rows = [
            row for sample, truth in _samples(given) for row in _rows(sample, truth, ask, given.out)
        ]
    for row in rows:
        print(*(v if isinstance(v, str) else f"{v:.1f}" for v in row.values()), sep="\t")
    for name in {str(row["set"]) for row in rows}:
        own = [row for row in rows if row["set"] == name]
        keys = [key for key in own[0] if key not in ("set", "photo")]
        means = (f"{key} {np.nanmean([row[key] for row in own]):.1f}" for key in keys)
        better = np.mean([row["mpjpe_out"] < row["mpjpe_in"] for row in own])
        print(f"{name}: {len(own)} people, output better {better:.0%}; {', '.join(means)}")
    (given.out / "rows.json").write_text(json.dumps(rows, indent=1))


def _samples(given: Namespace) -> Iterator[tuple[Sample, list[Array]]]:
    """Yield samples with a camera, and the true joints (12, 3) of their people in its frame, m."""
    triangulated = json.loads(given.triangulated.read_text()) if given.triangulated else {}
    for name in given.sets.split(","):
        for sample in SETS[name](given.data / name)[: given.photos]:
            if "joints" in sample.truth and sample.K is not None:
                yield sample, [limb_joints(sample.truth["joints"], 3)]
            elif (key := f"{name}/{sample.group}") in triangulated:
                camera = camera_of(sample)
                people = [np.array(one, np.float64) for one in triangulated[key]]
                seen = [one for one in people if visible_joints(camera, one).sum() >= MIN_VISIBLE]
                yield sample, [camera.to_camera(one) for one in seen]


def _rows(
    sample: Sample, truth: list[Array], ask: Ask, out: Path
) -> Iterator[dict[str, float | str]]:
    """Run the tool on the bodies of a sample, and yield the errors of each person."""
    question = question_of(sample)
    assert question.camera is not None
    height, width = question.picture.shape[:2]
    parameters, before = _with_errors(truth, seed=sum(map(ord, sample.name)))
    path = out / "bodies" / sample.set / f"{sample.name}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    camera = Intrinsics(*question.camera, width, height)
    write_bodies(path, parameters, "embedded", camera, SIGMA_M, DISTANCE_SIGMA)
    answer = measured_of(ask(replace(question, bodies=path)), sample)
    up = sample.truth.get("up")
    if "camera" in sample.truth:
        up = camera_of(sample).R @ up
    floor = math.nan
    if up is not None:
        floor = floor_record(sample, answer, np.array(up), math.nan)["floor_angle_deg"]
    for i, person in matched_people(
        answer, [projected(one, question.camera) for one in truth]
    ).items():
        errors = [pose_errors(one, truth[i]) for one in (before[i][BODY_ROWS], joints_of(person))]
        yield {
            "set": sample.set,
            "photo": sample.name,
            **{
                f"{name}_{way}": of[key]
                for name, key in ERRORS.items()
                for way, of in zip(("in", "out"), errors, strict=True)
            },
            "depth_out_%": 100 * (errors[1]["pelvis_depth_ratio"] - 1),
            "floor_deg": floor,
        }


def _with_errors(truth: list[Array], seed: int) -> tuple[BodyParameters, Array]:
    """Return bodies (N) of the embedded model at true joints with errors, and their joints
    (N, 55, 3).
    """
    import torch

    model = load_body("embedded").double
    joints = np.full((len(truth), 55, 3), np.nan)
    joints[:, BODY_ROWS] = truth
    rotations, betas, transl = model.zero_pose(len(truth))
    zero = parameters_from_rotations(rotations, betas, None, transl)
    fitted = convert_bodies(Bodies(zero, "joints", joints=joints), load_body()).bodies
    rotations, betas, transl, _ = pose_from_parameters(fitted.parameters, dtype=torch.float64)
    start = model(rotations, betas, transl).joints.numpy()
    rng = np.random.default_rng(seed)
    axes = rng.standard_normal((len(truth), _BODY, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    angles = turn_sigmas(start, SIGMA_M)[..., None] * rng.standard_normal((len(truth), _BODY, 1))
    common = rng.standard_normal(3)
    common *= math.radians(TURN_DEG) / np.linalg.norm(common)
    angles[:, 0] = 0
    turned = rotations.numpy().copy()
    turned[:, :_BODY] = turned[:, :_BODY] @ rotvec_to_rotmat_numpy(axes * angles)
    turned[:, 0] = rotvec_to_rotmat_numpy(common) @ turned[:, 0]
    rotations = torch.from_numpy(turned)
    after = model(rotations, betas, transl).joints.numpy()
    return parameters_from_rotations(rotations, betas, None, transl), after
