"""PLY and OBJ: colours, normals, metres; read by plyfile and trimesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from physic_visual.palette import contact_legend


def test_plyfile_reads_points_colours_normals_and_contact(export, result):
    plyfile = pytest.importorskip("plyfile")
    data = plyfile.PlyData.read(str(export("a.ply", up="camera").files[0]))
    rows = data["vertex"].data
    scene = rows["object"] == -1
    is_person = rows["object"] == 1
    valid = result.scene.valid
    points = np.stack([rows[name] for name in "xyz"], 1)
    np.testing.assert_array_equal(points[scene], result.scene.points[valid])
    np.testing.assert_array_equal(
        np.stack([rows[c] for c in ("red", "green", "blue")], 1)[scene], result.scene.colors[valid]
    )
    normals = np.stack([rows[f"n{name}"] for name in "xyz"], 1)
    np.testing.assert_allclose(normals[scene], result.scene.normals[valid], atol=1e-6)
    np.testing.assert_array_equal(points[is_person], result.people[1].vertices)
    np.testing.assert_array_equal(rows["contact"][is_person], result.people[1].contact)
    probability = result.people[1].contact_probability
    np.testing.assert_array_equal(rows["quality"][is_person], probability)
    assert not rows["quality"][scene].any()
    floor = result.scene.floor
    numbers = next(c for c in data.comments if c.startswith("floor")).split()
    np.testing.assert_allclose(
        [float(numbers[k]) for k in (1, 4, 7, 10)], [*floor.normal, floor.offset], atol=1e-5
    )


@pytest.mark.parametrize(("name", "up"), [("a.ply", "y"), ("a.obj", "z")])
def test_trimesh_reads_closed_bodies_whose_normals_point_out(export, result, name, up, in_frame):
    path = export(name, up=up, scene=False, person=0, skin="contact").files[0]
    mesh = trimesh.load(path, process=False, force="mesh", skip_materials=True)
    wanted = in_frame(result.people[0].vertices, up)
    assert cKDTree(mesh.vertices).query(wanted)[0].max() < 2e-5
    assert mesh.volume == pytest.approx(
        trimesh.Trimesh(wanted, result.faces, process=False).volume, rel=1e-3
    )
    assert mesh.volume > 0
    legend = contact_legend(result)
    assert legend
    head = path.read_bytes()[:2000].decode("ascii", "replace")
    for label, (red, green, blue) in legend.items():
        assert (
            f"{'comment' if name == 'a.ply' else '#'} contact: {label} is sRGB {red} {green} "
            f"{blue}\n" in head
        )


@pytest.mark.parametrize("name", ["a.obj", "a.stl"])
def test_bodies_are_closed_where_a_program_merges_equal_places(export, result, name):
    for index in range(len(result.people)):
        path = export(f"{index}-{name}", scene=False, person=index).files[0]
        mesh = trimesh.load(path, force="mesh", process=False, skip_materials=True)
        places, corners = np.unique(mesh.vertices, axis=0, return_inverse=True)
        whole = trimesh.Trimesh(places, corners[mesh.faces], process=False)
        assert len(places) == len(result.people[index].vertices)
        assert whole.is_watertight
        metres = 1000 if name == "a.stl" else 1
        volume = result.people[index].mesh().volume
        assert whole.volume == pytest.approx(volume * metres**3, rel=1e-3)


def test_an_obj_has_a_picture_for_each_material(export, result):
    done = export("a.obj")
    names = {file.name for file in done.files}
    materials = next(file for file in done.files if file.suffix == ".mtl").read_text()
    pictures = {line.split()[1] for line in materials.splitlines() if line.startswith("map_Kd")}
    assert pictures == {
        *(
            "a_scene.jpg",
            "a_person_0.jpg",
            "a_person_1.jpg",
            "a_person_0_contact.png",
            "a_person_1_contact.png",
        )
    }
    assert names == pictures | {"a.obj", "a.mtl", "a_person_0_filled.png", "a_person_1_filled.png"}
    used = [line for line in done.files[0].read_text().splitlines() if line.startswith("usemtl")]
    assert used == ["usemtl scene", "usemtl person_0_photo", "usemtl person_1_photo"]
    assert len(trimesh.load_scene(done.files[0]).geometry) == 3


def test_a_scene_without_a_valid_pixel_leaves_people(export, result):
    empty = replace(result, scene=replace(result.scene, valid=np.zeros_like(result.scene.valid)))
    for name in ("a.ply", "a.obj", "a.glb"):
        assert export(name, of=empty, person=0).files[0].stat().st_size > 1000
