"""Checks of a CameraSolver on moments with ground truth: who is who, directions of cameras, and metres."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.interfaces.camera_solver import CameraSolver, CameraSolverRequest
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.moment import build_moment, true_cameras

if TYPE_CHECKING:
    from physic_core.types import FloatArray, SolvedCameras
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MAX_ROTATION_DEG = 20.0
MAX_SCALE = 1.3
_MOMENTS = ("one person", "several people")


def check_people_are_who_they_are(subject: BackendUnderTest) -> None:
    """Each row of `people` is one person in all photos."""
    found = subject.result("several people")
    wrong = [row.tolist() for row in found.people if len(set(row[row >= 0].tolist())) > 1]
    expect(not wrong, "the same person in each row of people", f"others in {wrong}")


def check_rotations_are_from_the_reference(subject: BackendUnderTest) -> None:
    """Rotations turn points of the reference frame to each camera, and are not inverse or of an OpenGL camera."""
    for name in _MOMENTS:
        found, kept, rotation, _ = _with_truth(subject, name)
        off = _angles_deg(found.rotation[kept], rotation[kept]).max()
        flip = np.diag([1.0, -1.0, -1.0])
        readings = {
            "inverse": found.rotation[kept].transpose(0, 2, 1),
            "of an OpenGL camera": flip @ found.rotation[kept] @ flip,
        }
        likely = [w for w, turned in readings.items() if _angles_deg(turned, rotation[kept]).max() < off / 2]
        hint = f"They are right if they are {likely[0]}." if likely else ""
        expected = f"rotations within {MAX_ROTATION_DEG:g} degrees of the truth in the moment '{name}'"
        expect(off < MAX_ROTATION_DEG, expected, f"{off:.0f} degrees off", hint)


def check_camera_distances_are_metres(subject: BackendUnderTest) -> None:
    """Distances between cameras are in metres: those of the people, whose sizes are known."""
    for name in _MOMENTS:
        found, kept, rotation, translation = _with_truth(subject, name)
        others = [v for v in kept if v != found.reference]
        true = _centres(rotation, translation)[others]
        own = _centres(found.rotation, found.translation)[others]
        factor = float(np.median(np.linalg.norm(own, axis=1) / np.linalg.norm(true, axis=1)))
        expect(
            1 / MAX_SCALE < factor < MAX_SCALE,
            f"distances between cameras within a factor of {MAX_SCALE:g} in the moment '{name}'",
            f"{factor:.2g} times the true ones",
            "Is a translation in the reference frame, and are lengths in the units of a network?",
        )


def check_points_are_the_keypoints(subject: BackendUnderTest) -> None:
    """`points` project onto the keypoints of each photo: within a tenth of the person's box."""
    found, kept, _, _ = _with_truth(subject, "several people")
    views = build_moment(subject.case("several people"))
    worst = 0.0
    for v in kept:
        for person in np.flatnonzero(found.people[:, v] >= 0):
            row = found.people[person, v]
            seen = np.isfinite(found.points[person]).all(1) & (views[v].keypoints.confidence[row] > 0.5)
            local = found.points[person][seen] @ found.rotation[v].T + found.translation[v]
            pixels = local @ found.intrinsics[v].matrix.T
            away = np.linalg.norm(pixels[:, :2] / pixels[:, 2:] - views[v].keypoints.points[row][seen], axis=1)
            box = views[v].people.boxes[row]
            if seen.any():
                worst = max(worst, float(np.median(away)) / float((box[2:] - box[:2]).max()))
    expect(worst < 0.1, "points within a tenth of the person's box from the keypoints", f"{worst:.2f} of the box")


def check_known_poses_are_kept(subject: BackendUnderTest) -> None:
    """Photos with known poses, two of three, keep the motion between them."""
    case = subject.case("several people")
    rotation, translation = true_cameras(case, 0)
    photos = list(build_moment(case))
    for v in (0, 2):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation[v].T, -rotation[v].T @ translation[v]
        photos[v] = replace(photos[v], pose=pose)

    found = subject.infer(subject.loaded(case), case, (tuple(photos),))
    faults = list(CameraSolver.check(found, CameraSolverRequest(tuple(photos))))
    expect(not faults, "the known motion between photos 0 and 2 of the moment 'several people'", "; ".join(faults))


def _with_truth(subject: BackendUnderTest, name: str) -> tuple[SolvedCameras, list[int], FloatArray, FloatArray]:
    """Return a result, its photos that are not skipped, and the true rotations and translations."""
    found: SolvedCameras = subject.result(name)
    skipped = {one.index for one in found.skipped}
    kept = [v for v in range(len(found.rotation)) if v not in skipped]
    return found, kept, *true_cameras(subject.case(name), found.reference)


def _angles_deg(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the angles (...) between rotations (..., 3, 3), degrees."""
    trace = np.einsum("...ij,...ij->...", one, two)
    angles: FloatArray = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    return angles


def _centres(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    centres: FloatArray = -np.einsum("vji,vj->vi", rotation, translation)
    return centres


_READ = "physic_core.interfaces.CameraSolver"
CHECKS: tuple[Check, ...] = (
    Check(check_people_are_who_they_are, _READ),
    Check(check_rotations_are_from_the_reference, _READ),
    Check(check_camera_distances_are_metres, _READ, after=("rotations_are_from_the_reference",)),
    Check(check_known_poses_are_kept, _READ, after=("camera_distances_are_metres",)),
    Check(check_points_are_the_keypoints, _READ, after=("camera_distances_are_metres",)),
)
"""Checks of a CameraSolver, in order of execution."""
