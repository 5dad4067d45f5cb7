"""What the engine makes of given bodies: true ones with errors, before and after.

    python -m benchmarks given_bodies DATA --out given-results [--sets mpi_inf_3dhp,panoptic]
    [--triangulated FILE] [--blazepose] [--set KEY=VALUE]

Bodies are fitted to the true joints of photos with a camera, turned by 5 degrees about a common
axis and by independent angles at each joint that move joints by 50 mm (root mean square, relative
to the pelvis), and given to the tool. People whose joints do not determine a body are left out.
With ``--blazepose``, bodies are fitted to what the benchmark ``blazepose`` places, as a user would
make them. Truth of ``panoptic`` and ``roundtable`` is that of ``--triangulated``, which ``truth``
writes. One row for each person, then the means: errors of joints in mm, of the pelvis' depth in %,
of the floor in degrees, and of the height of the lower foot in cm, against that of the body that is
fitted to the true joints.
"""

from __future__ import annotations

import json
import math
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from benchmarks.fits import parser_of
from physic_core import write_bodies
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations, pose_from_parameters
from physic_core.conversion import convert_bodies
from physic_core.geometry.rotations import rotvec_to_rotmat_numpy
from physic_core.prepare.bodies import rotation_sigmas
from physic_core.types import Bodies, BodyParameters, Intrinsics
from physic_embedded.keypoint_detector import EmbeddedKeypoints
from physic_embedded.segmenter import EmbeddedSegmenter

from . import blazepose
from .truth.builds import ROOT, Question, asked, build_of, measured_of, question_of
from .truth.joints import BODY_ROWS, limb_joints
from .truth.measures import box_of, match_people, pose_errors
from .truth.scores import MIN_VISIBLE, floor_record, people_of, projected
from .truth.sets import SETS, Sample, camera_of, picture_of
from .truth.triangulation import visible_joints

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .truth.builds import Ask

    Array = NDArray[np.float64]

SIGMA_M = 0.05
TURN_DEG = 5.0
DISTANCE_SIGMA = 0.01  # stated; places are true
ERRORS = {"mpjpe": "mpjpe_mm", "root": "root_aligned_mm", "pa": "pa_mpjpe_mm"}
_UNTRUE_M = 0.15  # from a true joint, from which on a fitted body is not the true one
_FEET = slice(10, 12)
_BODY = 22


def main() -> None:
    """Run, compare, print."""
    parser = parser_of("given_bodies", __doc__, fits=False)
    add = parser.add_argument
    add("data", type=Path, help="folder that holds the data sets")
    add("--out", type=Path, default=Path("given-results"), help="for bodies and answers")
    add("--sets", default="mpi_inf_3dhp", help="data sets, with commas between them")
    add("--triangulated", type=Path, metavar="FILE", help="joints of a run of truth")
    add("--blazepose", action="store_true", help="bodies of BlazePose's landmarks by PnP")
    add("--photos", type=int, help="the first N of each data set")
    setting = {"dest": "settings", "action": "append", "metavar": "KEY=VALUE"}
    add("--set", default=[], help="a setting", **setting)
    given = parser.parse_args()
    with asked(build_of(ROOT, "embedded", given.settings), given.out) as ask:
        rows = [
            row for sample, truth in _samples(given) for row in _rows(sample, truth, ask, given)
        ]
    for row in rows:
        print(*(v if isinstance(v, str) else f"{v:.1f}" for v in row.values()), sep="\t")
    for name in {str(row["set"]) for row in rows}:
        of_set = [row for row in rows if row["set"] == name]
        keys = [key for key in of_set[0] if key not in ("set", "photo")]
        means = (f"{key} {np.nanmean([abs(row[key]) for row in of_set]):.1f}" for key in keys)
        better = np.mean([row["mpjpe_out"] < row["mpjpe_in"] for row in of_set])
        print(f"{name}: {len(of_set)} people, output better {better:.0%}; {', '.join(means)}")
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
                visible_people = [
                    one for one in people if visible_joints(camera, one).sum() >= MIN_VISIBLE
                ]
                yield sample, [camera.to_camera(one) for one in visible_people]


def _rows(
    sample: Sample, truth: list[Array], ask: Ask, given: Namespace
) -> Iterator[dict[str, float | str]]:
    """Run the tool on the bodies of a sample, and yield the errors of each person."""
    question = question_of(sample)
    assert question.camera is not None
    truth, start = _true_bodies(truth)
    if not truth:
        return
    parameters = _of_blazepose(sample) if given.blazepose else _with_errors(start, sample.name)
    path = given.out / "bodies" / sample.set / f"{sample.name}.npz"
    sigmas = () if given.blazepose else (SIGMA_M, DISTANCE_SIGMA)
    _write(path, parameters, question, sigmas)
    answer = measured_of(ask(replace(question, bodies=path)), sample)
    before, true = _joints(parameters), _joints(start)
    after = np.reshape([person["joints"] for person in people_of(answer)], (-1, 55, 3))
    into, out = (_matched(joints, truth, question.camera) for joints in (before, after))
    up = _up(sample)
    floor = math.nan
    if up is not None:
        floor = floor_record(sample, answer, up, math.nan)["floor_angle_deg"]
    for i in sorted(into.keys() & out.keys()):
        ways = {"in": before[into[i]], "out": after[out[i]]}
        errors = {way: _errors(one, truth[i], true[i], up) for way, one in ways.items()}
        yield {
            "set": sample.set,
            "photo": sample.name,
            **{f"{key}_{way}": of[key] for key in errors["in"] for way, of in errors.items()},
            "floor_deg": floor,
        }


def _true_bodies(truth: list[Array]) -> tuple[list[Array], BodyParameters]:
    """Return the joints to which a body can be fitted, and the bodies: not without both hips, and
    not where the arm of an unknown elbow is elsewhere.
    """
    start = _fitted(np.array(truth))
    apart = np.linalg.norm(_joints(start)[:, BODY_ROWS] - truth, axis=-1)
    is_fitted = np.isfinite(start.transl).all(1) & ~(apart > _UNTRUE_M).any(1)
    return [truth[i] for i in np.flatnonzero(is_fitted)], start[is_fitted]


def _write(
    path: Path, parameters: BodyParameters, question: Question, sigmas: Sequence[float]
) -> None:
    """Write bodies in the camera of a question, with the errors that the file states."""
    assert question.camera is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = question.picture.shape[:2]
    fx, fy, cx, cy = question.camera
    camera = Intrinsics(fx, fy, cx, cy, width, height)
    write_bodies(path, parameters, "embedded", camera, *sigmas)


def _matched(joints: Array, truth: list[Array], camera: tuple[float, ...]) -> dict[int, int]:
    """Return true person -> person of joints (M, 55, 3), by their places in the picture."""
    estimated, true = (
        [projected(one, camera) for one in some] for some in (joints[:, BODY_ROWS], truth)
    )
    boxes, of_truth = ([box_of(one).tolist() for one in some] for some in (estimated, true))
    return match_people(boxes, estimated, of_truth, true)


def _errors(joints: Array, truth: Array, fitted: Array, up: Array | None) -> dict[str, float]:
    """Return the errors of joints (55, 3) against true ones (12, 3) and a body fitted to these."""
    errors = pose_errors(joints[BODY_ROWS], truth)
    low = [math.nan if up is None else float((one[_FEET] @ up).min()) for one in (joints, fitted)]
    return {name: errors[key] for name, key in ERRORS.items()} | {
        "depth_%": 100 * (errors["pelvis_depth_ratio"] - 1),
        "foot_cm": 100 * (low[0] - low[1]),
    }


def _up(sample: Sample) -> Array | None:
    """Return the true direction up (3,) in the camera's frame."""
    if sample.truth.get("up") is None:
        return None
    up = np.array(sample.truth["up"], np.float64)
    return camera_of(sample).R @ up if "camera" in sample.truth else up


def _fitted(limbs: Array) -> BodyParameters:
    """Return bodies (N) of the embedded model fitted to joints (N, 12, 3), NaN where unknown."""
    joints = np.full((len(limbs), 55, 3), np.nan)
    joints[:, BODY_ROWS] = limbs
    model = load_body()
    rotations, betas, transl = model.zero_pose(len(limbs))
    zero = parameters_from_rotations(rotations, betas, None, transl)
    return convert_bodies(Bodies(zero, "joints", joints=joints), model).bodies.parameters


def _joints(bodies: BodyParameters) -> Array:
    """Return the joints (N, 55, 3) of bodies of the embedded model."""
    pose = pose_from_parameters(bodies, dtype=torch.float64)
    joints: Array = load_body("embedded").double(*pose).joints.numpy()
    return joints


def _of_blazepose(sample: Sample) -> BodyParameters:
    """Return bodies (N) fitted to BlazePose's landmarks, placed by PnP."""
    segmenter, detector = EmbeddedSegmenter(), EmbeddedKeypoints()
    segmenter.load()
    detector.load()
    picture = np.ascontiguousarray(picture_of(sample)[..., ::-1])
    people = segmenter.infer(picture)
    told = blazepose.answer_of(people, detector.infer(picture, people), sample)["people"]
    return _fitted(np.reshape([person["joints"][BODY_ROWS] for person in told], (-1, 12, 3)))


def _with_errors(start: BodyParameters, name: str) -> BodyParameters:
    """Return bodies (N) of the embedded model with errors, which follow from a name."""
    rotations, betas, transl, _ = pose_from_parameters(start, dtype=torch.float64)
    rng = np.random.default_rng(sum(map(ord, name)))
    axes = rng.standard_normal((len(rotations), _BODY, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    angles = rotation_sigmas(_joints(start), SIGMA_M)[..., None]
    angles = angles * rng.standard_normal(angles.shape)
    common = rng.standard_normal(3)
    common *= math.radians(TURN_DEG) / np.linalg.norm(common)
    angles[:, 0] = 0
    turned = rotations.numpy().copy()
    turned[:, :_BODY] = turned[:, :_BODY] @ rotvec_to_rotmat_numpy(axes * angles)
    turned[:, 0] = rotvec_to_rotmat_numpy(common) @ turned[:, 0]
    return parameters_from_rotations(torch.from_numpy(turned), betas, None, transl)
