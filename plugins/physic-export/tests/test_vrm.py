"""VRM 1.0: an avatar in a T-pose with the bones that the specification names, and the pose as an animation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core import Reconstruction
from physic_core.body.joints import JOINT_NAMES, PARENTS
from physic_core.visual.export.request import export_frame
from physic_export.bone_names import bone_names

pygltflib = pytest.importorskip("pygltflib")

REQUIRED = """hips spine head leftUpperLeg leftLowerLeg leftFoot rightUpperLeg rightLowerLeg rightFoot leftUpperArm
leftLowerArm leftHand rightUpperArm rightLowerArm rightHand"""
"""Bones that VRMC_vrm 1.0 requires: github.com/vrm-c/vrm-specification, specification/VRMC_vrm-1.0/humanoid.md."""

OPTIONAL = [
    *("chest", "upperChest", "neck", "leftEye", "rightEye", "jaw"),
    *("leftToes", "rightToes", "leftShoulder", "rightShoulder"),
    *(
        f"{side}{bone}"
        for side in ("left", "right")
        for bone in (
            *("ThumbMetacarpal", "ThumbProximal", "ThumbDistal"),
            *(f"{f}{s}" for f in ("Index", "Middle", "Ring", "Little") for s in ("Proximal", "Intermediate", "Distal")),
        )
    ),
]


@pytest.fixture(scope="module")
def files(result: Reconstruction, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return result.export(str(tmp_path_factory.mktemp("vrm") / "a.vrm"), texture_size="512").files


def load(path: Path):
    return pygltflib.GLTF2().load_from_bytes(path.read_bytes())


def bones(tree, extension: str) -> dict[str, int]:
    return {name: one["node"] for name, one in tree.extensions[extension]["humanoid"]["humanBones"].items()}


def values(tree, accessor: int) -> np.ndarray:
    entry = tree.accessors[accessor]
    start = tree.bufferViews[entry.bufferView].byteOffset or 0
    width = {"VEC3": 3, "VEC4": 4}[entry.type]
    return np.frombuffer(tree.binary_blob(), np.float32, entry.count * width, start).reshape(-1, width)


def test_there_is_an_avatar_and_an_animation_for_each_person(files: list[Path]):
    assert [file.name for file in files] == ["a_0.vrm", "a_0.vrma", "a_1.vrm", "a_1.vrma"]


def test_the_bones_are_those_of_the_specification(files: list[Path]):
    found = bones(load(files[0]), "VRMC_vrm")
    assert set(REQUIRED.split()) <= set(found)
    assert set(found) == {*REQUIRED.split(), *OPTIONAL}
    assert len(set(found.values())) == len(found)
    assert set(bone_names("vrm")) == set(found)


def test_the_avatar_stands_at_the_origin_in_a_t_pose(files: list[Path], result: Reconstruction):
    for file, person in zip(files[::2], result.people, strict=True):
        tree = load(file)
        named = bones(tree, "VRMC_vrm")
        for node in named.values():
            np.testing.assert_allclose(np.abs(tree.nodes[node].rotation), [0, 0, 0, 1], atol=1e-6)
        places = standing_joints(tree, named)
        at = dict(zip(bone_names("vrm"), places, strict=True))
        np.testing.assert_allclose(at["hips"][[0, 2]], 0, atol=1e-6)
        assert at["leftHand"][0] > 0.4
        assert at["leftToes"][2] > at["leftFoot"][2] + 0.05  # it faces +z
        limbs = [(JOINT_NAMES.index(a), JOINT_NAMES.index(b)) for a, b in (("left_hip", "left_knee"), ("neck", "head"))]
        for one, other in limbs:
            wanted = np.linalg.norm(person.joints[one] - person.joints[other])
            assert np.linalg.norm(places[one] - places[other]) == pytest.approx(wanted, abs=1e-4)
        (mesh,) = tree.meshes
        assert mesh.primitives[0].attributes.JOINTS_0 is not None


def standing_joints(tree, named: dict[str, int]) -> np.ndarray:
    """Positions (55, 3) of the joints of an avatar whose rotations are zero."""
    offsets = [np.array(tree.nodes[named[name]].translation) for name in bone_names("vrm")]
    places: list[np.ndarray] = []
    for joint, parent in enumerate(PARENTS):
        places.append(offsets[joint] + (places[parent] if parent >= 0 else 0))
    return np.stack(places)


def test_the_file_has_what_vrm_requires_and_not_what_it_does_not_use(files: list[Path]):
    tree = load(files[0])
    assert {"VRMC_vrm", "KHR_materials_unlit"} <= set(tree.extensionsUsed)
    entry = tree.extensions["VRMC_vrm"]
    assert entry["specVersion"] == "1.0"
    assert entry["meta"] == {"name": "person 0", "authors": ["unknown"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    assert tree.cameras == []
    assert tree.animations == []


def test_the_animation_has_the_pose_of_the_photo(files: list[Path], result: Reconstruction):
    frame = export_frame(result.scene.floor, "y").from_camera
    for file, avatar, person in zip(files[1::2], files[::2], result.people, strict=True):
        tree = load(file)
        named = bones(tree, "VRMC_vrm_animation")
        assert set(REQUIRED.split()) <= set(named)
        assert not {"leftEye", "rightEye"} & set(named)  # the specification forbids them
        (animation,) = tree.animations
        moved = [c.target.node for c in animation.channels if c.target.path == "translation"]
        assert moved == [named["hips"]]
        turns, hips = {}, np.zeros(3)
        for channel in animation.channels:
            keys = values(tree, animation.samplers[channel.sampler].output)
            np.testing.assert_array_equal(keys[0], keys[-1])
            if channel.target.path == "rotation":
                turns[channel.target.node] = Rotation.from_quat(keys[0]).as_matrix()
            else:
                hips = keys[0].astype(float)
        rest = standing_joints(load(avatar), bones(load(avatar), "VRMC_vrm"))
        places, poses = [hips], [turns[named["hips"]]]
        for joint, parent in enumerate(PARENTS[:22]):
            if parent >= 0:
                places.append(places[parent] + poses[parent] @ (rest[joint] - rest[parent]))
                poses.append(poses[parent] @ turns[named[bone_names("vrm")[joint]]])
        made, wanted = np.stack(places), person.joints[:22] @ frame[:3, :3].T + frame[:3, 3]
        np.testing.assert_allclose(made[:, 1], wanted[:, 1], atol=1e-4)  # the height over the floor
        apart = [np.linalg.norm(one[:, None] - one, axis=2) for one in (made, wanted)]
        np.testing.assert_allclose(*apart, atol=1e-4)


def test_the_skin_can_be_neutral(export):
    tree = load(export("a.vrm", skin="neutral", person=1).files[0])
    assert tree.materials[tree.meshes[0].primitives[0].material].name == "body"


def test_a_note_asks_for_author_and_permissions(export):
    assert export("a.vrm", person=0).notes == (
        "author and permissions of a .vrm are 'unknown' and the least that https://vrm.dev/licenses/1.0/ allows: "
        "state your own",
    )
