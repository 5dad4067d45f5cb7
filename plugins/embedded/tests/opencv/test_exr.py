"""Depth of files that Blender 4.5 and 5.0, OpenCV 4.14, and Depth Anything 3 (0.1.1) wrote: its
channel has another name in each.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physic_core import InputError
from physic_opencv.depth_files import read_depth

OpenEXR = pytest.importorskip("OpenEXR")
FILES = Path(__file__).parent / "exr"


@pytest.mark.parametrize(
    "name", ["blender5_bw_V_depth", "blender5_rgba_depth", "blender5_parts", "blender45_multilayer"]
)
def test_a_plane_at_3_m_that_blender_rendered_is_at_3_m_and_nothing_is_unknown(name):
    depth, *_ = read_depth(FILES / f"{name}.exr", 1.0, None)
    assert depth.shape == (48, 64)
    assert np.nanmin(depth) == pytest.approx(3.0, abs=1e-5)
    assert np.nanmax(depth) < 1e3
    assert np.isnan(depth).any()


@pytest.mark.parametrize("name", ["opencv4_one.exr", "opencv4_three.exr", "depth_anything_3.npz"])
def test_depth_of_opencv_and_of_depth_anything_3_arrives_as_it_was(name):
    depth, *_ = read_depth(FILES / name, 1.0, None)
    assert depth.shape == (28, 42)
    assert depth == pytest.approx(np.linspace(1, 5, 28 * 42).reshape(28, 42), abs=1e-5)


def test_the_only_channel_z_is_depth():
    depth, *_ = read_depth(FILES / "Z.exr", 1.0, None)
    assert depth[0, 0] == 1.0
    assert depth[-1, -1] == 48.0


def test_a_position_is_no_depth():
    with pytest.raises(InputError, match="X, Y, Z"):
        read_depth(FILES / "XYZ.exr", 1.0, None)


def written(path, channels, **windows):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **windows}
    OpenEXR.File(header, channels).write(str(path))
    return path


@pytest.mark.parametrize(
    ("first", "display"),
    [((2, 1), ((0, 0), (7, 5))), ((-1, -1), ((0, 0), (2, 1))), ((11, 21), ((10, 20), (12, 24)))],
    ids=["cropped", "overscan", "displayed from another pixel"],
)
def test_depth_lies_where_the_windows_put_it(tmp_path, first, display):
    values = np.linspace(1, 8, 12, dtype=np.float32).reshape(3, 4)
    x, y = first
    window = {"dataWindow": (first, (x + 3, y + 2)), "displayWindow": display}
    depth, *_ = read_depth(written(tmp_path / "d.exr", {"Z": values}, **window), 1.0, None)
    (left, top), (right, bottom) = display
    plane = np.full((40, 40), np.nan, np.float32)  # from the pixel (-1, -1)
    plane[y + 1 : y + 4, x + 1 : x + 5] = values
    np.testing.assert_array_equal(depth, plane[top + 1 : bottom + 2, left + 1 : right + 2])


def test_a_data_window_beside_the_picture_is_refused(tmp_path):
    window = {"dataWindow": ((8, 0), (13, 3)), "displayWindow": ((0, 0), (5, 3))}
    path = written(tmp_path / "d.exr", {"Z": np.ones((4, 6), np.float32)}, **window)
    with pytest.raises(InputError, match="outside of its display window"):
        read_depth(path, 1.0, None)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_both_widths_are_read_and_the_largest_half_is_unknown(tmp_path, dtype):
    values = np.linspace(1, 8, 24, dtype=dtype).reshape(4, 6)
    values[0, 0] = 65504
    depth, *_ = read_depth(
        written(tmp_path / "d.exr", {"Depth.V": values, "Combined.A": values * 0}), 1.0, None
    )
    np.testing.assert_array_equal(depth.ravel()[1:], values.astype(np.float32).ravel()[1:])
    assert np.isnan(depth[0, 0])


def test_a_colour_picture_is_no_depth(tmp_path):
    colours = {
        name: np.full((4, 6), value, np.float32)
        for name, value in zip("RGB", (1, 2, 3), strict=True)
    }
    with pytest.raises(InputError, match="unclear which channel"):
        read_depth(written(tmp_path / "d.exr", colours), 1.0, None)


def test_a_file_that_claims_gigabytes_is_refused(tmp_path):
    path = written(tmp_path / "d.exr", {"Z": np.ones((4, 6), np.float32)})
    window = np.array([0, 0, 5, 3], "<i4").tobytes()
    huge = np.array([0, 0, 29_999, 29_999], "<i4").tobytes()
    path.write_bytes(path.read_bytes().replace(window, huge))
    with pytest.raises(InputError, match=r"GB, more than|damaged"):
        read_depth(path, 1.0, None)


@pytest.mark.parametrize("kept", [3, 4, 40])
def test_a_cut_file_is_refused(tmp_path, kept):
    path = written(tmp_path / "d.exr", {"Z": np.ones((4, 6), np.float32)})
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match="damaged"):
        read_depth(path, 1.0, None)
