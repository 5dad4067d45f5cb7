"""GLB of the plugin: textures, variants, names of the bones, T-pose and pose."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image

from physic_core.errors import ConfigError
from physic_export.skeleton import bone_names

pygltflib = pytest.importorskip("pygltflib")


def read(done):
    return pygltflib.GLTF2().load(str(done.files[0]))


@pytest.fixture(scope="module")
def tree(result, tmp_path_factory):
    file = tmp_path_factory.mktemp("textured") / "a.glb"
    return read(result.export(str(file), names="unity", texture_size="512"))


def test_contact_is_a_picture_on_request(export):
    done = export("a.glb", contact_texture=True, texture_size="512", person=1)
    assert [file.name for file in done.files] == ["a.glb", "a_contact_1.png"]
    with Image.open(done.files[1]) as picture:
        assert picture.size == (512, 512)


def test_the_animation_has_a_t_pose_and_the_pose(tree):
    (animation,) = tree.animations
    skin = tree.skins[0]
    # Blender gives keys of STEP constant interpolation, so that keys set after them would jump.
    assert {sampler.interpolation for sampler in animation.samplers} == {"LINEAR"}
    rotated = [
        c
        for c in animation.channels
        if c.target.path == "rotation" and c.target.node in skin.joints
    ]
    assert len(rotated) == 55
    for channel in rotated:
        sampler = animation.samplers[channel.sampler]
        accessor = tree.accessors[sampler.output]
        start = tree.bufferViews[accessor.bufferView].byteOffset or 0
        first, second = np.frombuffer(tree.binary_blob(), np.float32, 8, start).reshape(2, 4)
        if channel.target.node != skin.joints[0]:
            np.testing.assert_allclose(np.abs(first), [0, 0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(second, tree.nodes[channel.target.node].rotation, atol=1e-6)


def test_bones_have_the_names_of_the_option(tree, export):
    assert [tree.nodes[joint].name for joint in tree.skins[0].joints] == list(bone_names("unity"))
    other = read(export("a.glb", names="mixamo", scene=False, person=0))
    names = [other.nodes[joint].name for joint in other.skins[0].joints]
    assert names[:2] == ["mixamorig:Hips", "mixamorig:LeftUpLeg"]
    ends = ["HeadTop_End", "LeftToe_End", "RightHandPinky4"]
    assert {f"mixamorig:{name}" for name in ends} < set(names[55:])
    assert len(names) == 68


def test_the_root_of_unreals_skeleton_is_on_the_floor_below_the_pelvis(export, result, in_frame):
    done = export("a.glb", names="unreal", scene=False)
    tree = read(done)
    places = trimesh.load_scene(done.files[0]).graph
    for skin, person in zip(tree.skins, result.people, strict=True):
        root, pelvis = skin.joints[:2]
        assert [tree.nodes[node].name for node in (root, pelvis)] == ["root", "pelvis"]
        assert tree.nodes[root].children == [pelvis]
        wanted = in_frame(person.joints[0], "y")
        foot, top = np.cumsum([tree.nodes[node].translation for node in (root, pelvis)], axis=0)
        np.testing.assert_allclose(top, wanted, atol=1e-5)
        np.testing.assert_allclose(foot, wanted * [1, 0, 1], atol=1e-5)
    np.testing.assert_allclose(places["root"][0][:3, 3] * [0, 1, 0], 0, atol=1e-6)


UNITY = """Hips LeftUpperLeg RightUpperLeg LeftLowerLeg RightLowerLeg LeftFoot RightFoot Spine Chest UpperChest Neck
Head LeftShoulder RightShoulder LeftUpperArm RightUpperArm LeftLowerArm RightLowerArm LeftHand RightHand LeftToes
RightToes LeftEye RightEye Jaw LeftThumbProximal LeftThumbIntermediate LeftThumbDistal LeftIndexProximal
LeftIndexIntermediate LeftIndexDistal LeftMiddleProximal LeftMiddleIntermediate LeftMiddleDistal LeftRingProximal
LeftRingIntermediate LeftRingDistal LeftLittleProximal LeftLittleIntermediate LeftLittleDistal RightThumbProximal
RightThumbIntermediate RightThumbDistal RightIndexProximal RightIndexIntermediate RightIndexDistal RightMiddleProximal
RightMiddleIntermediate RightMiddleDistal RightRingProximal RightRingIntermediate RightRingDistal RightLittleProximal
RightLittleIntermediate RightLittleDistal"""  # noqa: E501
"""HumanBodyBones of Unity 2020.1 to 2023.1, docs.unity3d.com/ScriptReference/HumanBodyBones.html,
without LastBone.
"""

UNREAL = """pelvis spine_01 spine_02 spine_03 clavicle_l upperarm_l lowerarm_l hand_l index_01_l index_02_l index_03_l
middle_01_l middle_02_l middle_03_l pinky_01_l pinky_02_l pinky_03_l ring_01_l ring_02_l ring_03_l thumb_01_l thumb_02_l
thumb_03_l neck_01 head thigh_l calf_l foot_l ball_l"""  # noqa: E501
"""Bones of Unreal Engine's mannequin, left side, without twist and IK bones."""


def test_the_names_are_those_that_unity_publishes():
    assert sorted(bone_names("unity")) == sorted(UNITY.split())


def test_the_names_of_vrm_are_unitys_with_the_metacarpal_of_the_thumb():
    names = dict(zip(bone_names("unity"), bone_names("vrm"), strict=True))
    thumbs = {unity: vrm for unity, vrm in names.items() if "LeftThumb" in unity}
    assert thumbs == {
        "LeftThumbProximal": "leftThumbMetacarpal",
        "LeftThumbIntermediate": "leftThumbProximal",
        "LeftThumbDistal": "leftThumbDistal",
    }
    others = {unity: vrm for unity, vrm in names.items() if "Thumb" not in unity}
    assert all(vrm == unity[0].lower() + unity[1:] for unity, vrm in others.items())


def test_a_plain_file_has_no_attributes_of_its_own(export):
    tree = read(export("a.glb", plain=True, person=0))
    names = {
        name
        for mesh in tree.meshes
        for part in mesh.primitives
        for name, value in vars(part.attributes).items()
        if value is not None
    }
    assert "POSITION" in names
    assert not any(name.startswith("_") for name in names)


def test_the_names_are_those_of_unreals_mannequin():
    wanted = UNREAL.split()
    wanted += [f"{name[:-2]}_r" for name in wanted if name.endswith("_l")]
    # The mannequin has no jaw and no eyes.
    assert sorted(bone_names("unreal")) == sorted({*wanted, "jaw", "eye_l", "eye_r"})


def test_names_that_a_format_does_not_have_are_refused(export):
    with pytest.raises(ConfigError, match="one of smplx, mixamo, unreal, unity, vrm, "):
        export("a.glb", names="rigify")
