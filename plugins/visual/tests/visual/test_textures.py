"""Texture coordinates of bodies, and the texels of their triangles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from physic_core.body import load_body
from physic_core.errors import BodyModelError
from physic_visual.textures.raster import (
    load_texture_coordinates,
    rasterize_texture,
    split_at_seams,
)


def test_split_vertices_keep_the_vertex_of_the_body():
    faces = load_body("embedded").faces.numpy()
    mesh = load_texture_coordinates("embedded", faces)
    assert_array_equal(mesh.vertex[:13348], np.arange(13348))
    assert_array_equal(mesh.vertex[mesh.faces], faces)
    assert len(mesh.uv) == len(mesh.vertex) == 14485
    assert 0 <= mesh.uv.min() < mesh.uv.max() <= 1


def test_a_smplx_file_without_texture_coordinates_is_refused(tmp_path):
    np.savez(tmp_path / "SMPLX_NEUTRAL.npz", v_template=np.zeros((1, 3)))
    with pytest.raises(BodyModelError, match="has no usable texture coordinates"):
        load_texture_coordinates(tmp_path / "SMPLX_NEUTRAL.npz", np.zeros((1, 3), int))


def test_texture_coordinates_of_the_corners_come_from_the_smplx_file(tmp_path):
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    corners = np.array([[0, 1, 2], [3, 1, 4]])
    uv = np.random.default_rng(0).random((5, 2))
    np.savez(tmp_path / "a.npz", vt=uv, ft=corners)
    mesh = load_texture_coordinates(tmp_path / "a.npz", faces)
    assert_allclose(mesh.uv[mesh.faces], uv[corners], atol=1e-7)
    assert_array_equal(mesh.vertex, [0, 1, 2, 3, 2])


def test_the_texels_of_a_triangle_are_those_inside():
    mesh = split_at_seams(
        np.array([[0, 1, 2]]), np.array([[0, 1, 2]]), np.array([[0, 0], [1, 0], [0, 1.0]])
    )
    raster = rasterize_texture(mesh, 8)
    u = (raster.columns + 0.5) / 8
    v = 1 - (raster.rows + 0.5) / 8
    assert len(u) == 8 * 9 / 2
    assert_allclose(raster.interpolate(mesh.faces, mesh.uv), np.stack([u, v], 1), atol=1e-7)
