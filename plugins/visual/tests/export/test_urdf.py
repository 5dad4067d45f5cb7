"""URDF: MuJoCo reads the robots, and with the angles beside them they have the pose of the
photo.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from physic_core.body.joints import JOINT_NAMES

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("urdf")
    result.export(str(folder / "a.urdf"))
    return folder


def read(folder, person, angles=True):
    """MuJoCo's model and data of a person in the pose of the photo, or of a T-pose."""
    model = mujoco.MjModel.from_xml_path(str(folder / f"a_{person}.urdf"))
    data = mujoco.MjData(model)
    pose = json.loads((folder / f"a_{person}.json").read_text())
    assert {model.joint(number).name for number in range(model.njnt)} == set(pose["joints"])
    for name, angle in pose["joints"].items() if angles else ():
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    return model, data, pose


def test_the_robot_with_the_angles_beside_it_has_the_pose_of_the_photo(result, folder, in_frame):
    for index, person in enumerate(result.people):
        model, data, pose = read(folder, index)
        assert model.njnt == 51
        w, x, y, z = pose["base"]["quaternion_wxyz"]
        turn = Rotation.from_quat([x, y, z, w])
        place = np.array(pose["base"]["position_m"])
        wanted = in_frame(person.joints[:22])
        np.testing.assert_allclose(place, wanted[0], atol=1e-5)
        joints = np.stack([turn.apply(data.body(name).xpos) + place for name in JOINT_NAMES[1:22]])
        np.testing.assert_allclose(joints, wanted[1:], atol=1e-4)  # 0.1 mm
        hand = trimesh.load(folder / "meshes" / f"a_{index}_left_wrist_skin.obj")
        frame = data.body("left_wrist").xmat.reshape(3, 3)
        skin = turn.apply(hand.vertices @ frame.T + data.body("left_wrist").xpos) + place
        assert cKDTree(in_frame(person.vertices)).query(skin)[0].max() < 2e-4
        limits = model.jnt_range
        assert (limits[:, 0] <= data.qpos).all()
        assert (data.qpos <= limits[:, 1]).all()


def test_the_scene_is_a_robot_of_one_link_that_collides(result, folder, in_frame):
    model = mujoco.MjModel.from_xml_path(str(folder / "a_scene.urdf"))
    assert model.njnt == 0
    assert mujoco.mjtGeom.mjGEOM_BOX in model.geom_type
    points = in_frame(result.scene.points[result.scene.valid])
    surface = trimesh.load(folder / "meshes" / "a_scene_surface.obj")
    assert cKDTree(points).query(surface.vertices)[0].max() < 0.01
    assert {file.suffix for file in folder.iterdir() if file.is_file()} == {
        ".urdf",
        ".json",
        ".srdf",
    }


def test_the_robot_with_all_angles_zero_is_in_a_t_pose(folder):
    _, data, _ = read(folder, 0, angles=False)
    arm = data.body("left_wrist").xpos - data.body("left_shoulder").xpos
    leg = data.body("right_hip").xpos - data.body("right_ankle").xpos
    assert arm[0] == pytest.approx(np.linalg.norm(arm), rel=0.02)
    assert leg[1] == pytest.approx(np.linalg.norm(leg), rel=0.02)


@pytest.mark.parametrize("person", [0, 1])
def test_no_shapes_of_a_robot_overlap_but_those_that_its_srdf_names(folder, person):
    pinocchio = pytest.importorskip("pinocchio")
    path = str(folder / f"a_{person}.urdf")
    model, shapes, _ = pinocchio.buildModelsFromUrdf(path, [str(folder)])
    shapes.addAllCollisionPairs()
    pinocchio.removeCollisionPairs(model, shapes, path.replace(".urdf", ".srdf"))
    assert len(shapes.collisionPairs) > 500
    pose = json.loads((folder / f"a_{person}.json").read_text())["joints"]
    for angles in ([pose[name] for name in list(model.names)[1:]], np.zeros(model.nq)):
        data, collisions = model.createData(), shapes.createData()
        met = pinocchio.computeCollisions(model, data, shapes, collisions, np.array(angles), False)
        assert not met
