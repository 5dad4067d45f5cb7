"""MJCF: closed convex meshes, what falls on floor and furniture stays there, and actuators hold the
photo's pose.
"""

from __future__ import annotations

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from physic_core.body.joints import JOINT_NAMES
from physic_export.tiles import FLAT_M, FLOOR_M, convex_tiles

mujoco = pytest.importorskip("mujoco")

RADIUS = 0.05


@pytest.fixture(scope="module")
def exported(result, tmp_path_factory):
    return result.export(str(tmp_path_factory.mktemp("mjcf") / "a.xml"))


@pytest.fixture(scope="module")
def file(exported):
    return exported.files[0]


@pytest.fixture(scope="module")
def opened(file, simulated):
    """MuJoCo's model and data of the file in the pose of the photo."""
    return simulated(file)


def test_every_tile_is_a_closed_convex_mesh_on_the_surface(result):
    tiles = convex_tiles(result)
    assert 20 < len(tiles) < 2500
    meshes = [trimesh.Trimesh(tile.vertices, tile.faces, process=False) for tile in tiles]
    for mesh in meshes:
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume > 0
    floor = result.scene.floor
    heights = result.scene.points @ floor.normal + floor.offset
    # The surface above the floor is in the tiles, which have no more than the tolerance in front of
    # it.
    is_above = result.scene.valid & (heights > 2 * FLOOR_M)
    above = result.scene.points[is_above][::40].astype(np.float64)
    every = trimesh.util.concatenate(meshes)
    hits = trimesh.ray.ray_pyembree.RayMeshIntersector(every).intersects_first(
        np.zeros_like(above), above
    )
    corner = every.triangles[hits, 0]
    apart = np.abs(((corner - above) * every.face_normals[hits]).sum(1))[hits >= 0]
    assert (hits >= 0).mean() > 0.97
    assert np.quantile(apart, 0.9) < 2 * FLAT_M


def test_a_ball_stays_on_the_floor_and_a_box_on_the_furniture(
    result, rays, export, in_frame, simulated
):
    """A table of 1 m x 0.6 m, 0.5 m over the floor, stands alone in front of the camera."""
    scene = result.scene
    floor = result.scene.floor
    depth = (0.5 - floor.offset) / (rays @ np.asarray(floor.normal, np.float64))
    points = rays * depth[..., None]
    table = (np.abs(points[..., 0]) < 0.5) & (depth > 0) & (np.abs(points[..., 2] - 2.0) < 0.3)
    normals = np.broadcast_to(np.float32(floor.normal), points.shape)
    alone = replace(scene, points=points.astype(np.float32), normals=normals, valid=table)
    file = export("a.xml", of=replace(result, scene=alone), person=0, rigid=True).files[0]
    seat = in_frame(np.median(points[table], axis=0))
    free = seat + np.array([1.5, 0.0, 0.0])
    bodies = (
        f'<body name="seat" pos="{seat[0]} {seat[1]} {seat[2] + 0.2}"><freejoint/>'
        f'<geom type="box" size="{RADIUS} {RADIUS} {RADIUS}"/></body>'
        f'<body name="floor" pos="{free[0]} {free[1]} 0.6"><freejoint/><geom type="sphere" '
        f'size="{RADIUS}"/></body>'
    )
    file.write_text(file.read_text().replace("</worldbody>", f"{bodies}</worldbody>"))
    _, data = simulated(file, 2.0)
    np.testing.assert_allclose(data.body("floor").xpos, [free[0], free[1], RADIUS], atol=0.01)
    assert data.body("seat").xpos[2] == pytest.approx(seat[2] + RADIUS, abs=0.04)


def placed_vertices(model, data, geom):
    """Vertices (V, 3) of the mesh of a geom, where it lies."""
    number = model.geom(geom).id
    mesh = model.geom_dataid[number]
    first = model.mesh_vertadr[mesh]
    local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return local @ data.geom_xmat[number].reshape(3, 3).T + data.geom_xpos[number]


def test_rigid_people_are_mocap_bodies_at_the_pelvis_with_a_hull_per_part(
    result, export, in_frame, simulated
):
    model, data = simulated(export("a.xml", rigid=True, scene=False).files[0])
    np.testing.assert_allclose(model.opt.gravity, [0, 0, -9.81])
    for index, person in enumerate(result.people):
        body = data.body(f"person_{index}")
        np.testing.assert_allclose(body.xpos, in_frame(person.joints[0]), atol=1e-5)
        assert model.body(f"person_{index}").mocapid[0] == index
        skin = placed_vertices(model, data, f"person_{index}_skin")
        np.testing.assert_allclose(skin, in_frame(person.vertices), atol=2e-4)
        geoms = [model.geom(i) for i in range(model.ngeom)]
        of_person = [one for one in geoms if one.name.startswith(f"person_{index}_")]
        assert sum(one.contype[0] > 0 for one in of_person) == 14


def joint_places(data, person):
    """Positions (22, 3) of the bodies of a person."""
    names = [f"person_{person}", *(f"person_{person}_{name}" for name in JOINT_NAMES[1:22])]
    return np.stack([data.body(name).xpos for name in names])


def test_people_have_joints_at_the_pose_within_their_limits(result, opened, in_frame):
    model, data = opened
    for index, person in enumerate(result.people):
        wanted = in_frame(person.joints[:22])
        np.testing.assert_allclose(joint_places(data, index), wanted, atol=1e-4)
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    angles = data.qpos[model.jnt_qposadr[hinges]]
    assert hinges.sum() == 2 * 51
    assert (model.jnt_range[hinges, 0] <= angles).all()
    assert (angles <= model.jnt_range[hinges, 1]).all()


@pytest.mark.parametrize("rigid", [False, True])
def test_each_body_states_its_mass_for_readers_that_skip_meshes(result, export, rigid):
    root = ElementTree.parse(export("a.xml", rigid=rigid, scene=False).files[0]).getroot()
    for index, person in enumerate(result.people):
        bodies = root.findall(f".//body[@name='person_{index}']")
        bodies += bodies[0].findall(".//body")
        stated = [body.find("inertial") for body in bodies]
        volume = person.mesh().volume
        masses = [float(one.get("mass")) for one in stated]
        assert sum(masses) == pytest.approx(1010 * volume, rel=1e-3)
        for one in stated:
            xx, yy, zz, xy, xz, yz = map(float, one.get("fullinertia").split())
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            assert 0 < moments[2] < moments[0] + moments[1]


def test_hinges_count_from_the_pose_with_the_limits_of_the_urdf(file, opened, export):
    model, _ = opened
    assert " ref=" not in file.read_text()  # Pinocchio leaves it out
    files = export("robot.urdf", scene=False).files
    robots = [path for path in files if path.suffix == ".urdf"]
    for index, robot in enumerate(robots):
        angles = json.loads(robot.with_suffix(".json").read_text())["joints"]
        assert len(angles) == 51
        for name, angle in angles.items():
            joint = model.joint(f"person_{index}_{name}")
            assert joint.qpos0[0] == 0
            assert model.key("t_pose").qpos[joint.qposadr[0]] == pytest.approx(-angle, abs=1e-5)
            limit = ElementTree.parse(robot).find(f"joint[@name='{name}']/limit")
            wanted = [float(limit.get(end)) - angle for end in ("lower", "upper")]
            np.testing.assert_allclose(joint.range, wanted, atol=1e-5)


def test_pinocchio_has_the_bodies_where_mujoco_has_them(export, simulated):
    pinocchio = pytest.importorskip("pinocchio")
    file = export("a.xml", person=0, scene=False).files[0]
    model, data = simulated(file)
    other = pinocchio.buildModelFromMJCF(str(file))
    other.jointPlacements[1] = pinocchio.SE3.Identity()  # docs/exports.md says why
    state = other.createData()
    for pose in (model.qpos0, model.key("t_pose").qpos):
        data.qpos = pose
        mujoco.mj_kinematics(model, data)
        pinocchio.framesForwardKinematics(other, state, pose[[0, 1, 2, 4, 5, 6, 3, *range(7, 58)]])
        for body in map(model.body, range(1, model.nbody)):
            place = state.oMf[other.getFrameId(body.name)].translation
            np.testing.assert_allclose(place, data.xpos[body.id], atol=1e-6)


def test_actuators_whose_controls_are_0_hold_the_pose(file, simulated):
    model, data = simulated(file)
    assert model.nu == 2 * 51
    roots = model.jnt_dofadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    # a pelvis that nothing moves; gravity bends the rest
    model.dof_armature[roots[:, None] + np.arange(6)] = 1e7
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    joints = model.actuator_trnid[:, 0]
    wanted = data.qpos[model.jnt_qposadr[joints]].copy()
    assert not data.ctrl.any()
    np.testing.assert_allclose(model.actuator_ctrlrange, model.jnt_range[joints])
    worst = 0.0
    while data.time < 2.0:
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[model.jnt_qposadr[joints]] - wanted).max()))
    assert np.rad2deg(worst) < 1.0


def test_hinges_and_actuators_have_one_limit_of_torque(opened):
    model, _ = opened
    joints = model.actuator_trnid[:, 0]
    assert model.jnt_actfrclimited[joints].all()
    np.testing.assert_allclose(model.jnt_actfrcrange[joints], model.actuator_forcerange)


def test_segments_that_overlap_in_the_pose_are_excluded(opened):
    model, _ = opened
    bodies = [(code >> 16, code & 0xFFFF) for code in model.exclude_signature.tolist()]
    pairs = [{model.body(one).name for one in pair} for pair in bodies]
    for person in ("person_0", "person_1"):
        for side in ("left", "right"):
            assert {f"{person}_spine3", f"{person}_{side}_shoulder"} in pairs


def test_no_tile_reaches_a_person_behind_it(result, rays):
    nearest = float(result.people[0].vertices[:, 2].min())
    scene = result.scene
    wall = (rays * (nearest - 0.05)).astype(np.float32)  # 5 cm before the first person
    walled = replace(result, scene=replace(scene, points=wall, valid=np.ones_like(scene.valid)))
    alone = convex_tiles(replace(walled, people=()))
    tiles = convex_tiles(walled)
    assert max(tile.vertices[:, 2].max() for tile in alone) == pytest.approx(
        nearest + 0.05, abs=1e-3
    )
    for one, other in zip(tiles, alone, strict=True):
        assert one.vertices[:, 2].min() == pytest.approx(other.vertices[:, 2].min(), abs=1e-6)
    skin = result.people[0].vertices
    assert any(reaches(tile, skin) for tile in alone)
    assert not any(reaches(tile, skin) for tile in tiles)


def reaches(tile, points):
    """True if one of the points is inside a tile."""
    planes = ConvexHull(tile.vertices).equations
    return bool(((planes[:, :3] @ points.T + planes[:, 3:]).max(0) < 0).any())
