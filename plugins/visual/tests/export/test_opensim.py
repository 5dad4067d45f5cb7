"""OpenSim: markers are the joints, and the coordinates pose the limbs as the result does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def test_markers_are_the_joints_in_millimetres(export, result, in_frame):
    for path, person in zip(export("a.trc").files, result.people, strict=True):
        lines = [line.split("\t") for line in path.read_text().splitlines()]
        header = dict(zip(lines[1], lines[2], strict=True))
        assert (header["Units"], header["NumMarkers"], header["NumFrames"]) == ("mm", "22", "1")
        names = lines[3][2::3]
        assert names[:2] == ["pelvis", "left_hip"]
        points = np.array(lines[6][2:], float).reshape(-1, 3)
        assert len(lines[4][2:]) == 3 * len(points)
        np.testing.assert_allclose(points, 1000 * in_frame(person.joints[:22], "y"), atol=0.01)


def turned(values, *names):
    return Rotation.from_euler("ZXY", [values[name] for name in names], degrees=True).as_matrix()


@pytest.mark.parametrize(("side", "letter"), [("left", "l"), ("right", "r")])
def test_coordinates_turn_the_limbs_as_the_result(export, result, in_frame, side, letter):
    for path, person in zip(export("a.mot").files, result.people, strict=True):
        head, body = path.read_text().split("endheader\n")
        assert "inDegrees=yes" in head
        names, numbers = (line.split("\t") for line in body.splitlines())
        assert f"nColumns={len(names)}" in head
        values = dict(zip(names, map(float, numbers), strict=True))
        joint = {n: in_frame(person.joint(f"{side}_{n}"), "y") for n in ("hip", "knee", "ankle")}
        pelvis = turned(values, "pelvis_tilt", "pelvis_list", "pelvis_rotation")
        hip = (f"hip_{turn}_{letter}" for turn in ("flexion", "adduction", "rotation"))
        signs = {"l": [1, -1, -1], "r": [1, 1, 1]}[letter]
        angles = np.array([values[name] for name in hip]) * signs
        thigh = pelvis @ Rotation.from_euler("ZXY", angles, degrees=True).as_matrix()
        bone = joint["knee"] - joint["hip"]
        assert thigh @ [0, -1, 0] @ bone / np.linalg.norm(bone) > np.cos(np.deg2rad(5))
        bend = Rotation.from_euler("Z", -values[f"knee_angle_{letter}"], degrees=True).as_matrix()
        bone = joint["ankle"] - joint["knee"]
        assert thigh @ bend @ [0, -1, 0] @ bone / np.linalg.norm(bone) > np.cos(np.deg2rad(12))
        hips = in_frame(person.joints[1:3], "y").mean(0)
        place = [values[f"pelvis_t{axis}"] for axis in "xyz"]
        np.testing.assert_allclose(pelvis.T @ (place - hips), [0.056276, 0.07849, 0], atol=1e-5)
