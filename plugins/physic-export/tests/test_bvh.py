"""BVH: the joints that follow from offsets and rotations are those of the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physic_core import Reconstruction
from physic_core.body.joints import JOINT_NAMES
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame
from physic_export.bvh import bvh_name


def read_bvh(path: Path) -> dict[str, np.ndarray]:
    """Positions of the joints in the one frame, by the rules of the format alone."""
    words = iter(path.read_text().split())
    stack: list[str] = []
    joints: list[tuple[str, str | None, np.ndarray, int]] = []
    channels: list[str] = []
    pending, offset = "", np.zeros(3)
    for word in words:
        if word in ("ROOT", "JOINT", "End"):
            pending = next(words)
        elif word == "{":
            stack.append(pending)
        elif word == "}":
            stack.pop()
        elif word == "OFFSET":
            offset = np.array([float(next(words)) for _ in range(3)])
        elif word == "CHANNELS":
            count = int(next(words))
            channels += [next(words) for _ in range(count)]
            joints.append((stack[-1], stack[-2] if len(stack) > 1 else None, offset, count))
        elif word == "Time:":
            next(words)
            break
    numbers = iter(zip(channels, map(float, words), strict=True))
    poses: dict[str, np.ndarray] = {}
    for name, parent, place, count in joints:
        pose = np.eye(4)
        pose[:3, 3] = place
        for _ in range(count):
            channel, value = next(numbers)
            axis, step = "XYZ".index(channel[0]), np.eye(4)
            if channel.endswith("position"):
                step[axis, 3] = value
            else:
                i, j = [(1, 2), (2, 0), (0, 1)][axis]
                c, s = np.cos(np.deg2rad(value)), np.sin(np.deg2rad(value))
                step[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            pose = pose @ step
        poses[name] = pose if parent is None else poses[parent] @ pose
    return {name: pose[:3, 3] for name, pose in poses.items()}


@pytest.mark.parametrize("up", ["y", "z"])
def test_joints_are_where_the_result_has_them(export, result: Reconstruction, up: str):
    files = export("a.bvh", up=up).files
    matrix = export_frame(result.scene.floor, up).from_camera
    for path, person in zip(files, result.people, strict=True):
        found = read_bvh(path)
        wanted = transform_points(matrix, person.joints)
        np.testing.assert_allclose([found[bvh_name(name)] for name in JOINT_NAMES], wanted, atol=1e-4)


def test_names_are_those_of_mixamo():
    names = [bvh_name(name) for name in JOINT_NAMES]
    assert len(set(names)) == 55
    assert names[:6] == ["Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg"]
    assert {"LeftToeBase", "RightForeArm", "LeftHandThumb1", "RightHandPinky3", "Spine2", "Head"} <= set(names)


def test_a_bone_without_children_has_an_end(export):
    text = export("a.bvh", person=0).files[0].read_text()
    # Toes, jaw, eyes and the last joint of each finger.
    assert text.count("End Site") == 2 + 3 + 10
    assert text.count("{") == text.count("}")
    assert "Frames: 1\n" in text
