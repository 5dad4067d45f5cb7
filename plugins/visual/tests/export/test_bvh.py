"""BVH: the joints that follow from offsets and rotations are those of the result."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import InputError
from physic_core.body.joints import JOINT_NAMES
from physic_export.skeleton import bone_names


def read_bvh(path, frame):
    """Poses (4, 4) of the joints in a frame, by the rules of the format alone."""
    words = iter(path.read_text().split())
    stack = []
    joints = []
    channels = []
    pending = ""
    offset = np.zeros(3)
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
    values = np.array(list(map(float, words))).reshape(-1, len(channels))[frame]
    numbers = iter(zip(channels, values, strict=True))
    poses = {}
    for name, parent, place, count in joints:
        pose = np.eye(4)
        pose[:3, 3] = place
        for _ in range(count):
            channel, value = next(numbers)
            axis = "XYZ".index(channel[0])
            step = np.eye(4)
            if channel.endswith("position"):
                step[axis, 3] = value
            else:
                i, j = [(1, 2), (2, 0), (0, 1)][axis]
                c = np.cos(np.deg2rad(value))
                s = np.sin(np.deg2rad(value))
                step[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            pose = pose @ step
        poses[name] = pose if parent is None else poses[parent] @ pose
    return poses


def joints_of(path, frame):
    return {name: pose[:3, 3] for name, pose in read_bvh(path, frame).items()}


@pytest.mark.parametrize("up", ["y", "z"])
def test_joints_are_where_the_result_has_them(export, result, up, in_frame):
    files = export("a.bvh", up=up).files
    for path, person in zip(files, result.people, strict=True):
        joints = joints_of(path, 1)
        wanted = in_frame(person.joints, up)
        np.testing.assert_allclose(
            [joints[name] for name in bone_names("mixamo")], wanted, atol=1e-4
        )


@pytest.mark.parametrize("names", ["smplx", "unreal"])
@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_frame_0_is_a_t_pose_on_the_floor_below_the_pose(export, up, axis, names):
    path = export("a.bvh", up=up, person=0, names=names).files[0]
    style = dict(zip(bone_names(names), JOINT_NAMES, strict=True))
    stands, posed = (
        {style[name]: place for name, place in joints_of(path, frame).items() if name != "root"}
        for frame in (0, 1)
    )
    arms = [
        stands[f"left_{name}"] - stands[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")
    ]
    assert np.linalg.norm(arms[2]) > 1.1
    for arm in arms:
        assert abs(arm[axis]) < 0.02
        assert arm @ arms[2] == pytest.approx(
            np.linalg.norm(arm) * np.linalg.norm(arms[2]), rel=1e-3
        )
    assert 0.05 < stands["left_ankle"][axis] < 0.12
    assert arms[2][0] > 1.1  # who faces the camera has the left at its right
    flat = [a for a in range(3) if a != axis]
    np.testing.assert_allclose(stands["pelvis"][flat], posed["pelvis"][flat], atol=1e-5)


def test_a_file_of_smplx_is_refused_for_bodies_of_another_model(result, tmp_path):
    (tmp_path / "SMPLX_NEUTRAL.npz").touch()
    with pytest.raises(InputError, match="leave it out"):
        result.export(str(tmp_path / "a.bvh"), body_model=tmp_path / "SMPLX_NEUTRAL.npz")
