"""Run the tool on one sample, as a user would, and keep of the result what is measured."""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.processes import run_measured
from physic_bench.scoring import LIMB_JOINTS

from .measures import depth_errors, depths_inside_cm
from .sets import Sample, picture_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Person, Reconstruction, Skeleton

    Array = NDArray[np.float64]

NO_RESULT = (3, 5)
"""Exit codes of ``physic run`` that concern one photo: it is of no use, or a backend failed on
it.
"""


def answer_of(
    sample: Sample, out: Path, options: list[str], with_camera: bool = True
) -> dict[str, Any]:
    """The answer that an earlier run left in ``out``, or a new one.

    Raises:
        RuntimeError: the command failed for another reason than the photo.
    """
    arguments = [*options]
    if sample.K is not None and with_camera:
        arguments += [
            "--intrinsics",
            ",".join(f"{v:.6g}" for v in sample.K[[0, 1, 0, 1], [0, 1, 2, 2]]),
        ]
    key = hashlib.sha256(
        json.dumps([arguments, str(sample.source), sample.frame]).encode()
    ).hexdigest()
    file = out / "answers" / sample.set / f"{sample.name}.json"
    if file.exists():
        earlier: dict[str, Any] = json.loads(file.read_text())
        if earlier["key"] == key:
            return earlier
    answer = {"set": sample.set, "photo": sample.name, "key": key, **_run(sample, arguments)}
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(answer))
    part.replace(file)
    return answer


def _run(sample: Sample, arguments: list[str]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        photo = sample.source
        results = Path(folder) / "results"
        if sample.changed:
            import cv2

            photo = Path(folder) / f"{sample.name}.png"
            cv2.imwrite(str(photo), picture_of(sample))
        command = [sys.executable, "-m", "physic_core", "run", str(photo), *arguments]
        command += ["--out", str(results), "--no-cache"]
        with (Path(folder) / "log").open("w+") as log:
            cost = run_measured(command, output=log, check=False)
            log.seek(0)
            lines = log.read().strip().splitlines()
        if cost.code in NO_RESULT:
            error = lines[-1] if lines else ""
            return {"error": error, "people": [], "floor": None, "cpu_s": cost.cpu_s}
        if cost.code:
            raise RuntimeError(
                "\n".join([f"{' '.join(command)} ended with {cost.code}:", *lines[-20:]])
            )
        from physic_core import load_reconstruction

        return {
            "error": "",
            **measured_fields(load_reconstruction(str(results)), _size(photo), sample),
            "cpu_s": cost.cpu_s,
        }


def _size(photo: Path) -> tuple[int, int]:
    from PIL import Image

    with Image.open(photo) as opened:
        width, height = opened.size
    return width, height


def measured_fields(
    result: Reconstruction, size: tuple[int, int], sample: Sample
) -> dict[str, Any]:
    """What is measured of a result, in px of the photo of ``size`` (width, height)."""
    camera = result.intrinsics.resized(*size)
    factor = np.array([size[0] / result.intrinsics.width, size[1] / result.intrinsics.height])
    floor = result.scene.floor
    answer = {
        "people": [
            {**_person(person, result.skeleton, factor), "distance_sigma": sigma}
            for person, sigma in zip(result.people, result.distance_sigmas, strict=True)
        ],
        "depths_inside_cm": depths_inside_cm(result.people),
        "camera": [camera.fx, camera.fy, camera.cx, camera.cy],
        "floor": None
        if floor is None
        else [*(float(v) for v in floor.normal), float(floor.offset)],
        "scale_sigma": result.scene.scale_sigma,
        "up": None if result.scene.up is None else result.scene.up.tolist(),
        "up_sigma": result.scene.up_sigma,
    }
    if "depth_file" in sample.truth:
        answer |= _depth(result, sample)
    return answer


def _person(person: Person, skeleton: Skeleton | str, factor: Array) -> dict[str, Any]:
    """What is measured of a person, in px of the result times ``factor`` (2,)."""
    from physic_core.types import skeleton_named

    names = skeleton_named(skeleton).names
    keypoints = np.full((len(LIMB_JOINTS), 3), np.nan)
    for row, name in enumerate(LIMB_JOINTS):
        if name in names:
            k = names.index(name)
            pixel = (person.keypoints[k] + 0.5) * factor - 0.5
            keypoints[row] = (*pixel, person.keypoint_confidence[k])
    return {
        "box": (np.asarray(person.box, np.float64) * np.tile(factor, 2)).tolist(),
        "joints": np.round(person.joints.astype(np.float64), 5).tolist(),
        "keypoints": np.round(keypoints, 4).tolist(),
        "joint_sigma": None if person.joint_sigma is None else person.joint_sigma.tolist(),
        "parts": dict(person.world_contact or {}),
        "usable": list(person.usable),
        "stature_sigma": person.stature_sigma,
    }


def _depth(result: Reconstruction, sample: Sample) -> dict[str, float]:
    import cv2

    truth = (
        cv2.imread(str(sample.truth["depth_file"]), cv2.IMREAD_UNCHANGED).astype(np.float64) / 1000
    )
    depth = np.where(result.scene.valid, result.scene.points[..., 2], np.nan).astype(np.float32)
    size = (truth.shape[1], truth.shape[0])
    return depth_errors(
        cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST).astype(np.float64), truth
    )
