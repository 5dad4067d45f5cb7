"""Reconstruct photos with the build of whichever interpreter runs this file, and write what both
builds of a comparison state.

It imports the standard library, NumPy and the public names of ``physic_core`` alone, since the
other build may be of any age. A line of JSON on the standard input is a job: "photo" and "out" are
files, "settings" are those of the photo, "depth" asks for the map. The first line has the preset,
the configuration, and settings. What a build does not state is left out.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

PERSON = (
    *("box", "score", "joints", "keypoints", "keypoint_confidence", "joint_sigma"),
    *("world_contact", "stature", "stature_sigma", "posture", "trust"),
    *("trust_pose", "trust_place", "trust_contact", "trust_size"),
)
SCENE = ("up", "up_sigma", "scale_sigma")
RESULT = ("warnings", "notes", "distance_sigma", "distance_sigmas")
CAMERA = ("fx", "fy", "cx", "cy", "width", "height")


def main() -> None:
    """Answer the jobs of the standard input, one after another."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no reply
    from physic_core import Pipeline, load_config

    start = json.loads(sys.stdin.readline())
    config = load_config(*start["config"], preset=start["preset"], overrides=start["settings"])
    with Pipeline(config) as pipeline:
        for line in sys.stdin:
            job = json.loads(line)
            record, arrays = answer(pipeline, job)
            part = f"{job['out']}.part.npz"
            np.savez_compressed(part, record=np.array(json.dumps(record)), **arrays)
            os.replace(part, job["out"])
            print("done", file=replies, flush=True)


def answer(pipeline: Any, job: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what is stated of a photo, and its masks and depth; "error" alone without a result."""
    try:
        result = pipeline(job["photo"], settings=job["settings"])
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}, {}
    masks = np.array([person.mask for person in result.people], bool)
    arrays = {"masks": np.packbits(masks, axis=-1) if len(masks) else masks}
    if job["depth"]:
        points = result.scene.points[..., 2]
        arrays["depth"] = np.where(result.scene.valid, points, np.nan).astype(np.float32)
    return record_of(result), arrays


def record_of(result: Any) -> dict[str, Any]:
    """Return the stated fields of a reconstruction, as JSON has them."""
    from physic_core.types import skeleton_named

    floor = result.scene.floor
    return {
        "error": "",
        **dict(stated(result, RESULT)),
        "skeleton": list(getattr(skeleton_named(result.skeleton), "names", ())),
        "camera": dict(stated(result.intrinsics, CAMERA)),
        "scene": dict(stated(result.scene, SCENE)),
        "floor": None if floor is None else plain([*floor.normal, floor.offset]),
        "people": [dict(stated(person, PERSON)) for person in result.people],
    }


def stated(owner: Any, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the fields that an object has."""
    for name in names:
        if hasattr(owner, name):
            yield name, plain(getattr(owner, name))


def plain(value: Any) -> Any:
    """Return a value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    return value if value is None or isinstance(value, (bool, int, float)) else str(value)


if __name__ == "__main__":
    main()
