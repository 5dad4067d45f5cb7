"""MJCF: closed convex meshes, what falls on floor and furniture stays there, and actuators hold the photo's pose."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from physic_core import Reconstruction
from physic_core.body.joints import JOINT_NAMES
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame
from physic_export.tiles import FLAT_M, FLOOR_M, Tile, convex_tiles

RADIUS = 0.05


@pytest.fixture(scope="module")
def file(result: Reconstruction, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result.export(str(tmp_path_factory.mktemp("mjcf") / "a.xml")).files[0]


def opened(file: Path):
    """MuJoCo, and its model and data of a file in the pose of the photo."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco, model, data


def upright_points(result: Reconstruction) -> np.ndarray:
    matrix = export_frame(result.scene.floor, "z").from_camera
    points = transform_points(matrix, result.scene.points)
    return np.where(result.scene.valid[..., None], points, np.nan)


def test_every_tile_is_a_closed_convex_mesh_on_the_surface(result: Reconstruction):
    tiles = convex_tiles(result)
    assert 20 < len(tiles) < 2500
    for tile in tiles:
        mesh = trimesh.Trimesh(tile.vertices, tile.faces, process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume > 0
    floor = result.scene.floor
    heights = result.scene.points @ floor.normal + floor.offset
    # The surface above the floor is in the tiles, which have no more than the tolerance in front of it.
    above = result.scene.points[result.scene.valid & (heights > 2 * FLOOR_M)][::40].astype(np.float64)
    every = trimesh.util.concatenate([trimesh.Trimesh(tile.vertices, tile.faces, process=False) for tile in tiles])
    hits = trimesh.ray.ray_pyembree.RayMeshIntersector(every).intersects_first(np.zeros_like(above), above)
    corner = every.triangles[hits, 0]
    apart = np.abs(((corner - above) * every.face_normals[hits]).sum(1))[hits >= 0]
    assert (hits >= 0).mean() > 0.97
    assert np.quantile(apart, 0.9) < 2 * FLAT_M


def test_a_ball_stays_on_the_floor_and_a_box_on_the_furniture(result: Reconstruction, export):
    mujoco = pytest.importorskip("mujoco")
    result, table = with_table(result)
    file = export("a.xml", of=result, rigid=True).files[0]  # people with joints can fall onto the box
    points = upright_points(result).reshape(-1, 3)
    points = points[np.isfinite(points).all(1)]
    obstacles = np.concatenate([points[points[:, 2] > 0.05], *(p.reshape(-1, 3) for p in people_points(result))])
    low = points[np.abs(points[:, 2]) < 0.02]
    free = low[np.argmax(cKDTree(obstacles[:, :2]).query(low[:, :2])[0])]
    seat = middle_of_table(upright_points(result)[table])
    places = {"floor": (free[0], free[1], 0.6), "seat": (seat[0], seat[1], seat[2] + 0.2)}
    shapes = {"floor": f'type="sphere" size="{RADIUS}"', "seat": f'type="box" size="{RADIUS} {RADIUS} {RADIUS}"'}
    balls = "".join(
        f'<body name="{name}" pos="{x} {y} {z}"><freejoint/><geom {shapes[name]}/></body>'
        for name, (x, y, z) in places.items()
    )
    file.write_text(file.read_text().replace("</worldbody>", f"{balls}</worldbody>"))
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.body("floor").xpos, [free[0], free[1], RADIUS], atol=0.01)
    assert data.body("seat").xpos[2] == pytest.approx(seat[2] + RADIUS, abs=0.04)


def with_table(result: Reconstruction, height: float = 0.5) -> tuple[Reconstruction, np.ndarray]:
    """A result with a table in front of the people, over the whole width of the photo, and its pixels (H, W)."""
    scene, camera = result.scene, result.intrinsics
    rows, columns = np.indices(scene.valid.shape)
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], -1)
    with np.errstate(divide="ignore"):
        depth = (height - scene.floor.offset) / (rays @ np.asarray(scene.floor.normal, np.float64))
    nearest = min(float(person.vertices[:, 2].min()) for person in result.people)
    table = (depth > 0.4 * nearest) & (depth < nearest - 0.4)
    assert table.sum() > 500
    furnished = replace(
        scene,
        points=np.where(table[..., None], rays * depth[..., None], scene.points).astype(np.float32),
        normals=np.where(table[..., None], scene.floor.normal, scene.normals).astype(np.float32),
        valid=scene.valid | table,
    )
    return replace(result, scene=furnished), table


def people_points(result: Reconstruction) -> list[np.ndarray]:
    matrix = export_frame(result.scene.floor, "z").from_camera
    return [transform_points(matrix, person.vertices) for person in result.people]


def middle_of_table(points: np.ndarray) -> np.ndarray:
    """The point (3,) of a level, convex table with points (n, 3) that is farthest from all edges."""
    edges = ConvexHull(points[:, :2]).equations
    return points[np.argmin((points[:, :2] @ edges[:, :2].T + edges[:, 2]).max(axis=1))]


def test_rigid_people_are_mocap_bodies_at_the_pelvis_with_a_hull_per_part(result: Reconstruction, export):
    _, model, data = opened(export("a.xml", rigid=True).files[0])
    np.testing.assert_allclose(model.opt.gravity, [0, 0, -9.81])
    matrix = export_frame(result.scene.floor, "z").from_camera
    for index, person in enumerate(result.people):
        body = data.body(f"person_{index}")
        np.testing.assert_allclose(body.xpos, transform_points(matrix, person.joints[0]), atol=1e-5)
        assert model.body(f"person_{index}").mocapid[0] == index
        skin = model.geom(f"person_{index}_skin").id
        mesh = model.geom_dataid[skin]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = model.mesh_vert[first : first + count]
        posed = local @ data.geom_xmat[skin].reshape(3, 3).T + data.geom_xpos[skin]
        np.testing.assert_allclose(posed, transform_points(matrix, person.vertices), atol=2e-4)
        collide = [i for i in range(model.ngeom) if model.geom(i).name.startswith(f"person_{index}_")]
        assert sum(model.geom_contype[i] > 0 for i in collide) == 14


def joint_places(model, data, person: int) -> np.ndarray:
    """Positions (22, 3) of the bodies of a person."""
    names = [f"person_{person}", *(f"person_{person}_{name}" for name in JOINT_NAMES[1:22])]
    return np.stack([data.body(name).xpos for name in names])


def test_people_have_joints_at_the_pose_and_the_mass_of_their_volume(result: Reconstruction, file: Path):
    mujoco, model, data = opened(file)
    matrix = export_frame(result.scene.floor, "z").from_camera
    for index, person in enumerate(result.people):
        wanted = transform_points(matrix, person.joints[:22])
        np.testing.assert_allclose(joint_places(model, data, index), wanted, atol=1e-4)
        volume = trimesh.Trimesh(person.vertices, result.faces, process=False).volume
        assert model.body_subtreemass[model.body(f"person_{index}").id] == pytest.approx(1010 * volume, rel=1e-3)
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    angles = data.qpos[model.jnt_qposadr[hinges]]
    assert hinges.sum() == 2 * 51
    assert (model.jnt_range[hinges, 0] <= angles).all()
    assert (angles <= model.jnt_range[hinges, 1]).all()


def test_actuators_with_the_controls_of_the_keyframe_hold_the_pose(file: Path):
    mujoco, model, data = opened(file)
    assert model.nu == 2 * 51
    mujoco.mj_resetDataKeyframe(model, data, model.key("photo").id)
    np.testing.assert_allclose(data.qpos, model.qpos0, atol=1e-6)
    roots = model.jnt_dofadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    model.dof_armature[roots[:, None] + np.arange(6)] = 1e7  # a pelvis that nothing moves; gravity bends the rest
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    joints = model.actuator_trnid[:, 0]
    wanted = data.qpos[model.jnt_qposadr[joints]].copy()
    np.testing.assert_allclose(data.ctrl, wanted)
    np.testing.assert_allclose(model.actuator_ctrlrange, model.jnt_range[joints])
    worst = 0.0
    while data.time < 2.0:
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[model.jnt_qposadr[joints]] - wanted).max()))
    assert np.rad2deg(worst) < 1.0


def test_an_actuator_has_its_whole_torque_at_three_degrees(file: Path):
    _, model, _ = opened(file)
    knee = model.actuator("person_0_left_knee_x").id
    mass = model.body_subtreemass[model.body("person_0").id]
    assert model.actuator_forcerange[knee, 1] == pytest.approx(150 / 45 * mass, rel=1e-3)
    assert model.actuator_gainprm[knee, 0] * 0.05 == pytest.approx(model.actuator_forcerange[knee, 1], rel=1e-3)
    assert -model.actuator_biasprm[knee, 2] == pytest.approx(0.1 * model.actuator_gainprm[knee, 0], rel=1e-3)


def test_the_scene_is_one_textured_mesh_that_does_not_collide(result: Reconstruction, file: Path):
    _, model, data = opened(file)
    scene = model.geom("scene")
    assert (int(scene.contype[0]), int(scene.conaffinity[0]), int(scene.group[0])) == (0, 0, 2)
    assert {int(model.geom(f"scene_{number}").group[0]) for number in range(5)} == {3}
    height, width = result.scene.valid.shape
    assert (model.tex_height[0], model.tex_width[0]) == (height, width)
    mesh = int(scene.dataid[0])
    first, start = model.mesh_vertadr[mesh], model.mesh_texcoordadr[mesh]
    points = model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ data.geom_xmat[scene.id].reshape(3, 3).T
    points += data.geom_xpos[scene.id]
    camera, up = result.intrinsics, export_frame(result.scene.floor, "z").from_camera
    seen = transform_points(np.linalg.inv(up), points)
    columns = seen[:, 0] / seen[:, 2] * camera.fx + camera.cx
    rows = seen[:, 1] / seen[:, 2] * camera.fy + camera.cy
    places = model.mesh_texcoord[start : start + model.mesh_texcoordnum[mesh]]
    at = dict(zip(*(np.concatenate(pair).tolist() for pair in corners(model, mesh)), strict=True))
    uv = places[[at[number] for number in range(len(points))]]
    pixels = (uv * [width, height] - 0.5) * [camera.width / width, camera.height / height]
    assert np.median(np.abs(pixels - np.stack([columns, rows], 1))) < 1.0


def corners(model, mesh: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices (F, 3) of the vertices and of the texture coordinates of a mesh."""
    part = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    return model.mesh_face[part], model.mesh_facetexcoord[part]


def test_angles_of_zero_are_a_t_pose(file: Path):
    mujoco, model, data = opened(file)
    data.qpos[model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE]] = 0
    mujoco.mj_forward(model, data)
    pelvis = data.body("person_0")
    places = (joint_places(model, data, 0) - pelvis.xpos) @ pelvis.xmat.reshape(3, 3)
    at = dict(zip(JOINT_NAMES, places, strict=False))
    # Knees and elbows have fewer axes than the fitted rotations: a few degrees about the others remain.
    assert at["left_wrist"][0] - at["left_shoulder"][0] == pytest.approx(
        np.linalg.norm(at["left_wrist"] - at["left_shoulder"]), rel=0.02
    )
    assert at["right_hip"][1] - at["right_ankle"][1] == pytest.approx(
        np.linalg.norm(at["right_hip"] - at["right_ankle"]), rel=0.02
    )


def test_people_do_not_collide_with_themselves(file: Path):
    _, model, _ = opened(file)
    first, second, floor = (model.geom(name) for name in ("person_0_head", "person_1_head", "floor"))

    def collide(one, other) -> bool:
        return bool(one.contype[0] & other.conaffinity[0] or other.contype[0] & one.conaffinity[0])

    assert collide(first, second)
    assert collide(first, floor)
    assert not collide(first, model.geom("person_0"))


def test_no_tile_reaches_a_person_behind_it(result: Reconstruction):
    nearest = float(result.people[0].vertices[:, 2].min())
    scene, camera = result.scene, result.intrinsics
    rows, columns = np.indices(scene.valid.shape)
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], -1)
    wall = (rays * (nearest - 0.05)).astype(np.float32)  # 5 cm before the first person
    walled = replace(result, scene=replace(scene, points=wall, valid=np.ones_like(scene.valid)))
    alone = convex_tiles(replace(walled, people=()))
    tiles = convex_tiles(walled)
    assert max(tile.vertices[:, 2].max() for tile in alone) == pytest.approx(nearest + 0.05, abs=1e-3)
    for one, other in zip(tiles, alone, strict=True):
        assert one.vertices[:, 2].min() == pytest.approx(other.vertices[:, 2].min(), abs=1e-6)
    skin = result.people[0].vertices
    inside = sum(int((tile_depths(tile, skin) < 0).sum()) for tile in tiles)
    assert sum(int((tile_depths(tile, skin) < 0).sum()) for tile in alone) > 0
    assert inside == 0


def tile_depths(tile: Tile, points: np.ndarray) -> np.ndarray:
    """Distances (n,) of points outside the planes of a tile; negative inside."""
    hull = ConvexHull(tile.vertices)
    return (hull.equations[:, :3] @ points.T + hull.equations[:, 3:]).max(0)


def test_arms_are_capsules_and_feet_have_soles_on_one_level(result: Reconstruction, file: Path):
    mujoco, model, data = opened(file)
    for limb in ("left_shoulder", "right_elbow"):
        assert model.geom(f"person_0_{limb}").type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE
    for part in ("left_ankle", "right_foot"):
        spheres = [f"person_0_{part}_{number}" for number in range(1, 9)]
        heights = np.array([data.geom(name).xpos[2] for name in spheres])
        np.testing.assert_allclose(heights, heights[0], atol=1e-4)


def test_the_error_of_the_collision_mesh_is_stated(export):
    (note,) = export("a.xml").notes
    assert re.search(r"from the scene to the tiles: \d\.\d cm \(median\), \d+\.\d cm \(95 %\)", note)


def test_the_camera_has_the_field_of_view_of_the_photo(result: Reconstruction, file: Path):
    _, model, data = opened(file)
    camera = result.intrinsics
    assert model.cam("photo").fovy[0] == pytest.approx(
        2 * np.rad2deg(np.arctan(camera.height / camera.fy / 2)), abs=1e-4
    )
    up = export_frame(result.scene.floor, "z").from_camera
    np.testing.assert_allclose(data.cam("photo").xpos, up[:3, 3], atol=1e-5)
    np.testing.assert_allclose(-data.cam("photo").xmat.reshape(3, 3)[:, 2], up[:3, 2], atol=1e-5)


def test_a_result_without_a_surface_is_a_floor_with_people(export, result: Reconstruction):
    without = export("a.xml", scene=False, person=1).files[0].read_text()
    assert 'name="scene_0"' not in without
    assert 'name="person_1"' in without
    assert 'name="person_0"' not in without
    assert Path(export("b.mjcf", scene=False).files[0]).suffix == ".mjcf"
