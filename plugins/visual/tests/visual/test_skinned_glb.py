"""GLB with skinned bodies: read by pygltflib and trimesh, and checked by Khronos' validator."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from physic_core.body.joints import JOINT_NAMES
from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points
from physic_visual.palette import contact_legend
from physic_visual.textures.dressed import GUESSED, dressed_bodies

DTYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@pytest.fixture(scope="module")
def file(result, tmp_path_factory):
    return result.export(str(tmp_path_factory.mktemp("glb") / "a.glb")).files[0]


@pytest.fixture(scope="module")
def tree(file):
    pygltflib = pytest.importorskip("pygltflib")
    return pygltflib.GLTF2().load(str(file))


def array(tree, index):
    accessor = tree.accessors[index]
    view = tree.bufferViews[accessor.bufferView]
    width = WIDTH[accessor.type]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    values = np.frombuffer(
        tree.binary_blob(), DTYPES[accessor.componentType], accessor.count * width, start
    )
    return values.reshape(accessor.count, width)


def node_poses(tree):
    poses = {}

    def visit(index, parent):
        node = tree.nodes[index]
        local = np.eye(4)
        if node.rotation:
            local[:3, :3] = Rotation.from_quat(node.rotation).as_matrix()
        if node.translation:
            local[:3, 3] = node.translation
        poses[index] = parent @ local
        for child in node.children or ():
            visit(child, poses[index])

    for index in tree.scenes[0].nodes:
        visit(index, np.eye(4))
    return poses


def named(tree, name):
    (index,) = (i for i, node in enumerate(tree.nodes) if node.name == name)
    return index, tree.nodes[index]


def mesh_of(tree, person):
    return tree.meshes[named(tree, f"person_{person}")[1].mesh]


def set_last_keys(tree):
    """Set the nodes to the end of the animation."""
    (animation,) = tree.animations
    for channel in animation.channels:
        values = array(tree, animation.samplers[channel.sampler].output)
        setattr(tree.nodes[channel.target.node], channel.target.path, values[-1].tolist())


@pytest.fixture(scope="module")
def resting(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("rest") / "a.glb"
    return result.export(str(path), rest_pose=True, scene=False).files[0]


def test_with_the_rest_pose_nodes_are_where_the_mesh_is_bound_and_people_stand(tree, resting):
    tree = type(tree)().load(str(resting))
    poses = node_poses(tree)
    for person, skin in enumerate(tree.skins):
        inverse = array(tree, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        bones = np.stack([poses[joint] for joint in skin.joints]) @ inverse
        assert_allclose(bones, np.tile(np.eye(4), (len(bones), 1, 1)), atol=1e-5)
        points = array(tree, mesh_of(tree, person).primitives[0].attributes.POSITION)
        assert_allclose(points[:, 1].min(), 0, atol=1e-4)
        assert np.ptp(points[:, 1]) > 1.5


@pytest.mark.parametrize("kind", ["exported", "saved", "at rest"])
@pytest.mark.parametrize("person", [0, 1])
def test_vertices_skinned_from_the_file_are_the_posed_vertices(
    tree, saved_pair, resting, result, person, kind
):
    if kind != "exported":
        path = resting if kind == "at rest" else saved_pair / "combined.glb"
        tree = type(tree)().load(str(path))
    if kind == "at rest":
        set_last_keys(tree)
    _, node = named(tree, f"person_{person}")
    skin = tree.skins[node.skin]
    attributes = mesh_of(tree, person).primitives[0].attributes
    inverse = array(tree, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    poses = node_poses(tree)
    bones = np.stack([poses[joint] for joint in skin.joints]) @ inverse
    joints = array(tree, attributes.JOINTS_0)
    weights = array(tree, attributes.WEIGHTS_0).astype(np.float64)
    points = np.pad(array(tree, attributes.POSITION), ((0, 0), (0, 1)), constant_values=1.0)
    posed = np.einsum("vk,vkij,vj->vi", weights, bones[joints], points)[:, :3]
    frame = export_frame(result.scene.floor, "y")
    wanted = transform_points(frame.from_camera, result.people[person].vertices)
    split = len(posed) - len(wanted)  # vertices on the seams of the texture are in the file twice
    assert 1000 < split < 1200
    assert_allclose(posed[: len(wanted)], wanted, atol=1e-5)
    assert cKDTree(wanted).query(posed[len(wanted) :])[0].max() < 1e-5
    assert_allclose(weights.sum(1), 1.0, atol=1e-6)
    wanted = transform_points(frame.from_camera, result.people[person].joints)
    assert_allclose(np.stack([poses[j][:3, 3] for j in skin.joints]), wanted, atol=1e-5)
    assert [tree.nodes[joint].name for joint in skin.joints] == list(JOINT_NAMES)


@pytest.mark.parametrize("person", [0, 1])
def test_readers_without_skinning_show_people_of_the_combined_file_at_their_place(
    saved_pair, result, person
):
    mesh = trimesh.load_scene(saved_pair / "combined.glb", process=False).geometry[
        f"person_{person}"
    ]
    vertices = result.people[person].vertices
    wanted = transform_points(export_frame(result.scene.floor, "y").from_camera, vertices)
    assert_allclose(mesh.vertices[: len(wanted)], wanted, atol=1e-5)
    assert mesh.volume > 0.03


def test_no_array_is_sparse_which_some_readers_refuse(tree):
    assert all(accessor.bufferView is not None for accessor in tree.accessors)
    assert all(accessor.sparse is None for accessor in tree.accessors)


def test_contact_is_an_attribute_and_no_colour(tree, result):
    for index, person in enumerate(result.people):
        attributes = mesh_of(tree, index).primitives[0].attributes
        contact = array(tree, attributes._CONTACT)[: len(person.contact), 0]
        assert 0 < person.contact.sum() < len(person.contact)
        assert_array_equal(contact, person.contact)
        assert attributes.COLOR_0 is None
    legend = {label: list(rgb) for label, rgb in contact_legend(result).items()}
    assert legend
    assert tree.scenes[0].extras["contact_colors"] == legend
    assert "no_skeleton" not in tree.scenes[0].extras


def test_the_combined_file_shows_people_in_the_photo_s_colours_with_two_other_skins(
    result, tmp_path
):
    gltf = pytest.importorskip("pygltflib").GLTF2()
    # Of the result as loaded: rounding on saving moves vertices across the edge of a mask.
    result.save(str(tmp_path / "out"), "pictures")
    tree = gltf.load(str(tmp_path / "out" / "combined.glb"))
    variants = tree.extensions["KHR_materials_variants"]["variants"]
    assert [variant["name"] for variant in variants] == ["photo", "neutral", "contact"]
    dressed = dressed_bodies(result).people
    for index in (0, 1):
        primitive = mesh_of(tree, index).primitives[0]
        photo, neutral, contact = (
            tree.materials[one["material"]]
            for one in primitive.extensions["KHR_materials_variants"]["mappings"]
        )
        assert tree.materials[primitive.material] == photo
        assert "KHR_materials_unlit" in photo.extensions
        photo_texture, no_texture, contact_texture = (
            one.pbrMetallicRoughness.baseColorTexture for one in (photo, neutral, contact)
        )
        assert photo_texture.index != contact_texture.index
        assert no_texture is None
        assert photo.extras["share_from_photo"] == pytest.approx(
            dressed[index].shown_share, abs=1e-4
        )
    assert tree.scenes[0].extras["colors_of_people"] == f"those of the photo; {GUESSED}"


def test_the_camera_of_the_file_sees_what_the_photo_shows(tree, result):
    """A vertex, projected by the camera node with its field of view, lands on its pixel."""
    index, node = named(tree, "camera")
    perspective = tree.cameras[node.camera].perspective
    pose = node_poses(tree)[index]
    frame = export_frame(result.scene.floor, "y")
    vertices = result.people[0].vertices.astype(np.float64)
    in_camera = transform_points(np.linalg.inv(pose), transform_points(frame.from_camera, vertices))
    half = np.tan(perspective.yfov / 2)
    camera = result.intrinsics
    size = np.array([camera.width, camera.height])
    share = in_camera[:, :2] / -in_camera[:, 2:] / (half * np.array([perspective.aspectRatio, -1]))
    pixels = (share + 1) / 2 * size - 0.5
    wanted = vertices @ camera.matrix.T
    shift = [camera.cx, camera.cy] - (size - 1) / 2
    assert_allclose(pixels + shift, wanted[:, :2] / wanted[:, 2:], atol=1e-3)


VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
    .then(report => console.log(JSON.stringify(report.issues)));
"""


@pytest.mark.parametrize("kind", ["exported", "saved"])
def test_khronos_validator_has_nothing_to_report(file, saved_pair, kind):
    file = file if kind == "exported" else saved_pair / "combined.glb"
    node = shutil.which("node")
    npm = shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("needs node and npm")
    modules = subprocess.run(
        [npm, "root", "-g"], capture_output=True, text=True, check=True
    ).stdout.strip()
    if not (Path(modules) / "gltf-validator").is_dir():
        pytest.skip("needs `npm install -g gltf-validator`")
    command = [node, "-e", VALIDATE, str(file)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={"NODE_PATH": modules}
    )
    issues = json.loads(done.stdout)
    assert issues["messages"] == []
    assert not any(issues[f"num{kind}"] for kind in ("Errors", "Warnings", "Infos", "Hints"))
