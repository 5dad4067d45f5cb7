"""RRD: Rerun's own reader finds photo, depth, points, bodies and camera, and contact as the last
step.
"""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points
from physic_visual.palette import contact_colors

pytest.importorskip("rerun")


def read(path):
    """Return entity -> component -> its rows, in the order of the steps."""
    from rerun.chunk import RrdReader

    entities = {}
    for chunk in RrdReader(path).stream().to_chunks():
        columns = entities.setdefault(chunk.entity_path, {})
        for name, rows in chunk.to_record_batch().to_pydict().items():
            columns.setdefault(name, []).extend(rows)
    return entities


def test_rerun_reads_photo_scene_people_and_contact(export, result):
    entities = read(export("a.rrd", up="camera", skin="neutral").files[0])
    assert [row[0] for row in entities["/stages"]["TextLog:text"]] == [
        "photo",
        "scene",
        "people",
        "contact",
    ]
    photo = Image.open(
        io.BytesIO(bytes(entities["/world/camera/photo"]["EncodedImage:blob"][0][0]))
    )
    assert photo.size == (160, 120)
    scene = result.scene
    valid = result.scene.valid
    depth = np.frombuffer(
        bytes(entities["/world/camera/depth"]["DepthImage:buffer"][0][0]), np.float32
    )
    np.testing.assert_array_equal(depth.reshape(120, 160)[valid], scene.points[valid][:, 2])
    np.testing.assert_array_equal(
        entities["/world/scene"]["Points3D:positions"][0], scene.points[valid]
    )
    assert entities["/world/scene"]["stage"] == [1]
    assert "/world/backdrop" not in entities  # the room fills the photo
    for index, person in enumerate(result.people):
        body = entities[f"/world/person_{index}"]
        assert body["stage"] == [2, 3]
        np.testing.assert_array_equal(body["Mesh3D:vertex_positions"][0], person.vertices)
        np.testing.assert_array_equal(body["Mesh3D:triangle_indices"][0], result.faces)
        rgb = np.stack(
            [(np.array(body["Mesh3D:vertex_colors"][1]) >> shift) & 255 for shift in (24, 16, 8)], 1
        )
        np.testing.assert_array_equal(rgb, contact_colors(person, result.contact_partners))


def test_the_camera_stands_where_the_frame_says(export, result):
    entities = read(export("a.rrd", scene=False, person=1).files[0])
    pose = export_frame(result.scene.floor, "y").from_camera
    camera = entities["/world/camera"]
    np.testing.assert_allclose(camera["Transform3D:translation"][0][0], pose[:3, 3], atol=1e-6)
    np.testing.assert_allclose(
        np.reshape(camera["Transform3D:mat3x3"][0][0], (3, 3)).T, pose[:3, :3], atol=1e-6
    )
    matrix = np.reshape(camera["Pinhole:image_from_camera"][0][0], (3, 3)).T
    shifted = result.intrinsics.matrix + np.outer([0.5, 0.5, 0.0], [0, 0, 1])
    np.testing.assert_allclose(matrix, shifted, rtol=1e-6)
    vertices = transform_points(pose, result.people[1].vertices)
    np.testing.assert_allclose(
        entities["/world/person_1"]["Mesh3D:vertex_positions"][0], vertices, atol=1e-6
    )
    assert not {"/world/scene", "/world/person_0"} & entities.keys()
