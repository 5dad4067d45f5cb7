"""Depth maps and point maps of the user's, from files."""

from __future__ import annotations

import base64
import io
import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from physic_core import InputError, load_config, reconstruct
from physic_core.errors import ConfigError, PackageMissingError
from physic_core.types import Hints
from physic_opencv.depth_files import read_depth, resize_nearest
from physic_opencv.from_file import DepthFile, DepthFileOptions, PointmapFile, PointmapFileOptions
from physic_testing import check_backend
from physic_testing.worlds import load_world

IMAGE = np.zeros((4, 6, 3), np.uint8)
DEPTH = np.arange(1, 25, dtype=np.float64).reshape(4, 6) / 4


def depth(path, hole=None, image=IMAGE, **options):
    return DepthFile(DepthFileOptions(path=path, **options)).infer(image, Hints(hole=hole))


def pointmap(path, hole=None, image=IMAGE, **options):
    return PointmapFile(PointmapFileOptions(path=path, **options)).infer(image, Hints(hole=hole))


# ---- depth
# --------------------------------------------------------------------------------------------------


def test_depth_of_an_array_is_nan_where_not_positive_and_in_the_hole(tmp_path):
    values = DEPTH.copy()
    hole = np.zeros((4, 6), bool)
    values[0, :4] = np.nan, np.inf, 0, -1
    hole[1:3, 2:4] = True
    np.save(tmp_path / "d.npy", values)
    found = depth(tmp_path / "d.npy", hole)
    values[0, :4] = np.nan
    values[hole] = np.nan
    np.testing.assert_array_equal(found.depth, values.astype(np.float32))
    assert (found.depth.dtype, found.scale_sigma, found.notes) == (np.float32, 0.01, ())


def test_a_16_bit_png_in_millimetres(tmp_path):
    stored = (DEPTH * 1000).astype(np.uint16)
    stored[0, 0] = 0
    stored[1, 1] = 65535
    cv2.imwrite(str(tmp_path / "d.png"), stored)
    found = depth(tmp_path / "d.png", scale=0.001).depth
    expected = DEPTH.copy()
    expected[0, 0] = expected[1, 1] = np.nan
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    cv2.imwrite(str(tmp_path / "d.png"), (DEPTH * 30).astype(np.uint8))
    with pytest.raises(InputError, match="16 bits in millimeters"):
        depth(tmp_path / "d.png")


def test_a_map_of_another_size_is_resized_by_the_nearest_pixel(tmp_path):
    np.save(tmp_path / "d.npy", np.array([[1.5, np.nan, 3.0], [4.0, 5.0, 6.0]]))
    found = depth(tmp_path / "d.npy")
    np.testing.assert_array_equal(found.depth[0], [1.5, 1.5, np.nan, np.nan, 3, 3])
    np.testing.assert_array_equal(found.depth[3], [4, 4, 5, 5, 6, 6])
    assert "from 3 x 2 to 6 x 4 px" in found.notes[0]


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("d.npy", np.zeros((4, 6)), "no known pixel"),
        ("d.npy", np.ones((4, 6, 3)), "one number per pixel"),
        ("d.npy", np.ones((4, 9)), "not the aspect ratio"),
        ("d.tif", np.ones((4, 6)), "ends in none of"),
        ("d.npy", np.arange(24, dtype=np.uint8).reshape(4, 6), "steps of 8% are too coarse"),
    ],
)
def test_unusable_depth_is_refused(tmp_path, name, values, message):
    with (tmp_path / name).open("wb") as file:
        np.save(file, values)
    with pytest.raises(InputError, match=message):
        depth(tmp_path / name)


def pfm(path, values, scale, end=None):
    order = "<f4" if scale < 0 else ">f4"
    head = f"Pf\n{values.shape[1]} {values.shape[0]}\n{scale}\n".encode()
    path.write_bytes(head + values[::-1].astype(order).tobytes()[:end])
    return path


@pytest.mark.parametrize("scale", [1.0, -1.0])
def test_the_rows_of_a_pfm_count_from_below_in_the_order_of_bytes_of_its_sign(tmp_path, scale):
    found = depth(pfm(tmp_path / "d.pfm", DEPTH, scale)).depth
    np.testing.assert_array_equal(found, DEPTH.astype(np.float32))


@pytest.mark.parametrize(
    ("scale", "end", "message"),
    [(-0.25, None, "states a scale of 0.25"), (-1.0, -8, "truncated"), (0.0, None, "damaged")],
)
def test_an_unclear_or_damaged_pfm_is_refused(tmp_path, scale, end, message):
    with pytest.raises(InputError, match=message):
        depth(pfm(tmp_path / "d.pfm", DEPTH, scale, end))


@pytest.mark.parametrize("setting", ["depth", "pointmap"])
def test_a_file_that_no_backend_reads_is_refused_before_anything_is_computed(
    tmp_path, stand, setting
):
    (tmp_path / "d.tif").write_bytes(b"II*\0")
    photo = {"photo": {setting: str(tmp_path / "d.tif")}}
    ran = []
    with pytest.raises(InputError, match="ends in none of"):
        reconstruct(
            stand.image,
            load_config(preset="mock", flags={"flag": photo}),
            progress=lambda name, *_: ran.append(name),
        )
    assert ran == []


def test_points_of_whole_meters_are_refused(tmp_path):
    np.save(tmp_path / "p.npy", np.arange(72.0).reshape(4, 6, 3) // 4)
    with pytest.raises(InputError, match="too coarse"):
        pointmap(tmp_path / "p.npy")


def test_damaged_and_missing_files_are_refused(tmp_path):
    for name, reader in (("d.npy", depth), ("d.png", depth), ("d.npz", pointmap)):
        (tmp_path / name).write_bytes(b"nothing of the kind")
        with pytest.raises(InputError, match="cannot read"):
            reader(tmp_path / name)
    pickled = np.array([{}], dtype=object)
    np.save(tmp_path / "p.npy", pickled, allow_pickle=True)
    with pytest.raises(InputError, match="not a NumPy array of numbers"):
        depth(tmp_path / "p.npy")
    with pytest.raises(InputError, match="there is no such file; check the path"):
        depth(tmp_path / "none.npy")
    (problem,) = DepthFile(DepthFileOptions(path=tmp_path / "none.npy")).missing()
    assert "set metric_depth.options.path" in problem


# ---- depth beside a phone's photo
# ------------------------------------------------------------------------------------

HEIC = Path(__file__).parent / "data" / "disparity.heic"
"""A grey photo of 64 x 48 px with a disparity of 32 x 24 px from 1/4 to 2 per metre, left to
right.
"""
DISPARITY = 0.25 + 1.75 * np.linspace(0, 255, 32).round() / 255
RELATIVE = b"<depthData:Accuracy>relative</depthData:Accuracy>"


def heic(tmp_path, old=b"", new=b"", end=b""):
    """A copy of the file with other bytes, and with a box at its end that readers skip."""
    pytest.importorskip("pi_heif")
    content = HEIC.read_bytes()
    assert content.count(old) == 1 or not old
    path = tmp_path / "IMG_1.HEIC"
    path.write_bytes(content.replace(old, new) + struct.pack(">I4s", 8 + len(end), b"free") + end)
    return path


def test_disparity_beside_a_photo_is_read_as_metres(tmp_path):
    found = depth(heic(tmp_path), image=np.zeros((24, 32, 3), np.uint8))
    np.testing.assert_allclose(found.depth, np.tile(1 / DISPARITY, (24, 1)), rtol=1e-6)
    assert (found.scale_sigma, found.notes) == (0.01, ())


def test_the_scale_of_relative_disparity_is_uncertain(tmp_path):
    photo = np.zeros((24, 32, 3), np.uint8)
    found = depth(heic(tmp_path, end=RELATIVE), image=photo, relative_sigma=0.3)
    assert found.scale_sigma == 0.3
    assert "relative" in found.notes[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"auxid:2", b"auxid:9", "has no depth map: take one in portrait mode"),
        # another kind of message than depth representation
        (b"\x4e\x01\xb1", b"\x4e\x01\xb2", "not disparity with its range"),
    ],
)
def test_a_photo_without_depth_or_its_range_is_refused(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        depth(heic(tmp_path, old, new))


def of_phone(tmp_path, *, form="RangeInverse", more=""):
    """A JPEG with a depth map of 1.5 to 20 m in its XMP data, from near to far."""
    file = io.BytesIO()
    shares = np.tile(np.arange(0, 256, 5, dtype=np.uint8), (24, 1))
    Image.fromarray(shares).save(file, "PNG")
    xmp = (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description GDepth:Format="{form}" '
        f'GDepth:Near="1.5" GDepth:Far="20" {more} '
        f'GDepth:Data="{base64.b64encode(file.getvalue()).decode()}"/></x:xmpmeta>'
    )
    path = tmp_path / "IMG_1.jpg"
    Image.fromarray(np.zeros((24, 52), np.uint8)).save(path, xmp=xmp.encode())
    return path, shares / 255


@pytest.mark.parametrize(
    ("form", "unit", "sigma"),
    [("RangeInverse", 'GDepth:Units="m"', 0.01), ("RangeLinear", "", 0.3)],
)
def test_depth_in_a_jpeg_of_a_phone_has_its_range_and_without_a_unit_no_sure_size(
    tmp_path, form, unit, sigma
):
    path, shares = of_phone(tmp_path, form=form, more=unit)
    found = depth(path, image=np.zeros((24, 52, 3), np.uint8), relative_sigma=0.3)
    far = 1 / (1 / 1.5 + shares * (1 / 20 - 1 / 1.5))
    wanted = far if form == "RangeInverse" else 1.5 + shares * 18.5
    np.testing.assert_allclose(found.depth, wanted, rtol=1e-5)
    assert found.scale_sigma == sigma


@pytest.mark.parametrize(
    ("form", "word"), [("Disparity", "range"), (None, "no depth map")], ids=["format", "plain"]
)
def test_a_jpeg_without_known_depth_is_refused(tmp_path, form, word):
    path = tmp_path / "IMG_1.jpg"
    if form:
        path, _ = of_phone(tmp_path, form=form)
    else:
        Image.fromarray(np.zeros((24, 52), np.uint8)).save(path)
    with pytest.raises(InputError, match=word):
        depth(path, image=np.zeros((24, 52, 3), np.uint8))


def test_a_heic_file_needs_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    with pytest.raises(PackageMissingError, match="run `pip install pi-heif`"):
        depth(HEIC)


# ---- point map
# --------------------------------------------------------------------------------------------------

X, Y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-0.6, 0.6, 4))
POINTS = np.stack([X * DEPTH, Y * DEPTH, DEPTH], -1)


def test_a_file_of_points_gives_points_and_validity(tmp_path):
    valid = np.ones((4, 6), bool)
    valid[0, 0] = False
    broken = POINTS.copy()
    broken[1, 1, 0] = np.nan
    broken[2, 2, 2] = -1
    np.savez(tmp_path / "p.npz", points=broken, valid=valid)
    hole = np.zeros((4, 6), bool)
    hole[3, 2:4] = True
    found = pointmap(tmp_path / "p.npz", hole, scale=2)
    valid[1, 1] = valid[2, 2] = False
    valid &= ~hole
    np.testing.assert_array_equal(found.valid, valid)
    np.testing.assert_allclose(found.points[valid], 2 * POINTS[valid], rtol=1e-6)
    assert (found.unknown, found.intrinsics) == ("scale", None)


COS, SIN = np.cos(0.3), np.sin(0.3)


@pytest.mark.parametrize(
    "points",
    [
        POINTS @ [[1, 0, 0], [0, COS, SIN], [0, -SIN, COS]],  # leveled
        POINTS @ [[COS, SIN, 0], [-SIN, COS, 0], [0, 0, 1]],
        POINTS + np.array([0.5, 0, 0]),
        POINTS[..., [1, 0, 2]],
        POINTS * [-1, 1, 1],
        POINTS * [1, -1, 1],
    ],
)
def test_points_in_another_frame_than_the_camera_s_are_refused(tmp_path, points):
    np.save(tmp_path / "p.npy", points)
    with pytest.raises(InputError, match="camera's frame"):
        pointmap(tmp_path / "p.npy")


# ---- in the pipeline and in the kit
# ----------------------------------------------------------------------------------


QUICK = ["run.cache=false", "engine.joint.optimiser.steps=5"]


@pytest.fixture(scope="module")
def stand():
    return load_world("stand_indoors", (160, 120))


def test_the_scene_and_people_of_a_run_have_the_shape_of_the_depth(tmp_path, stand):
    depth = stand.points(people=True)[..., 2] * np.linspace(1, 1.1, stand.depth.shape[1])[None]
    np.save(tmp_path / "depth.npy", depth)
    config = load_config(preset="mock", overrides=[*QUICK, "relative_pointmap.options.noise=0"])
    result = reconstruct(stand.image, config.with_photo({"depth": str(tmp_path / "depth.npy")}))
    near = cv2.dilate(stand.masks.any(0).astype(np.uint8), np.ones((9, 9))) > 0
    known = result.scene.valid & ~near & np.isfinite(depth)
    assert known.sum() > 0.9 * (~near & np.isfinite(depth)).sum()
    ratio = result.scene.points[..., 2][known] / depth[known]
    assert np.quantile(ratio, [0.05, 0.5, 0.95]) == pytest.approx(np.ones(3), abs=0.015)
    surface = np.median(depth[stand.masks[0]])  # the pelvis lies behind it
    assert surface < result.people[0].joints[0, 2] < surface + 0.25
    assert result.distance_sigma == result.scene.scale_sigma
    assert result.distance_sigmas == pytest.approx([result.scene.scale_sigma], abs=0.005)
    assert result.scene.scale_sigma == pytest.approx(0.01, abs=0.002)


def ray(camera):
    """Length of each pixel's ray up to a depth of 1 m."""
    y, x = np.mgrid[: camera.height, : camera.width]
    return np.hypot(1, np.hypot((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy))


OTHER_READINGS = {
    "disparity": lambda z, _: 30 / z,
    "mirrored": lambda z, _: z[:, ::-1],
    "upside down": lambda z, _: z[::-1],
    "turned by 180": lambda z, _: z[::-1, ::-1],
    "along the ray": lambda z, camera: z * ray(camera),
    "depth buffer": lambda z, _: 1.001 - 0.1 / z,
    "field of view": lambda z, _: np.roll(z, 14, 1),
    "mirrored, and a disparity": lambda z, _: 30 / z[:, ::-1],
}


@pytest.mark.parametrize("name", OTHER_READINGS)
@pytest.mark.parametrize("setting", ["depth", "pointmap"])
def test_a_file_that_shows_the_photo_otherwise_is_refused_and_named(tmp_path, stand, name, setting):
    points = stand.points(people=True)
    z = np.clip(points[..., 2], 0.1, 20)
    given = OTHER_READINGS[name](z, stand.intrinsics)
    file = {"depth": given, "pointmap": points / points[..., 2:] * given[..., None]}
    np.save(tmp_path / "a.npy", file[setting])
    config = load_config(preset="mock", overrides=QUICK)
    with pytest.raises(InputError, match=name):
        reconstruct(
            stand.image,
            config.with_photo({setting: str(tmp_path / "a.npy")}),
            intrinsics=stand.intrinsics,
        )


def test_the_flags_of_a_run_keep_the_options_of_a_chosen_file_backend():
    flags = {"--depth": {"photo": {"depth": "d.png"}}}
    png = str(Path("d.png").absolute())
    usual = load_config(preset="mock", flags=flags).choice("metric_depth").model_dump()
    assert usual == {"backend": "file", "options": {"scale": 0.001, "path": png}}
    chosen = [
        "metric_depth.backend=metricbody-embedded:file",
        "metric_depth.options={scale = 0.01, sigma = 0.1}",
    ]
    kept = load_config(preset="mock", overrides=chosen, flags=flags).choice("metric_depth").options
    assert kept == {"scale": 0.01, "sigma": 0.1, "path": png}


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("mm", 0.001), ("cm", 0.01), ("m", 1.0), ("ft", 0.3048), ("1/5000", 0.0002)],
)
def test_the_unit_of_a_depth_is_that_of_its_option(unit, metres):
    for name in ("d.png", "d.npy"):
        flags = {"photo": {"photo": {"depth": name, "depth_unit": unit}}}
        found = load_config(preset="mock", flags=flags).choice("metric_depth").options
        assert found["scale"] == metres


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"depth": "d.png", "depth_unit": "inch"}, "mm, cm, m, ft, or a part of a meter"),
        ({"depth": "d.png", "depth_unit": "1/0"}, "1/5000"),
        ({"depth": "d.png", "depth_unit": "5000"}, "1/5000"),
        ({"depth_unit": "mm"}, "without depth"),
        (
            {"depth": "d.png", "intrinsics": [9, 9, 5, 5], "distortion": [0.1, 0, 0, 0, 0]},
            "undistort both",
        ),
    ],
)
def test_a_depth_of_a_wrong_unit_or_of_a_distorted_photo_is_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        load_config(preset="mock", flags={"flags": {"photo": given}})


@pytest.mark.slow
def test_both_pass_the_conformance_kit(tmp_path):
    def options(world, values):
        path = tmp_path / f"{world.name}-{world.image.shape[1]}-{values.ndim}.npy"
        np.save(path, values)
        return {"path": str(path)}

    for interface, made in (
        ("metric_depth", lambda world: options(world, world.depth)),
        ("relative_pointmap", lambda world: options(world, world.points(people=True))),
    ):
        check_backend("file", interface, options=made, capabilities={"exact"}).raise_if_failed()


def test_files_that_claim_more_than_they_have_are_refused(tmp_path):
    for name, side, there, message in (
        ("huge.npy", 100_000, 0, r"huge\.npy: it is not a NumPy array of numbers"),
        ("sparse.npy", 20_000, 8 * 20_000**2, r"3\.2 GB, more than"),
    ):
        with (tmp_path / name).open("wb") as file:
            stated = {"descr": "<f8", "fortran_order": False, "shape": (side, side)}
            np.lib.format.write_array_header_1_0(file, stated)
            file.truncate(file.tell() + there)
        with pytest.raises(InputError, match=message):
            read_depth(tmp_path / name, 1.0, None)
    header = b"IHDR" + 2 * (30_000).to_bytes(4) + b"\x10\x00\x00\x00\x00"
    png = (
        b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0d"
        + header
        + zlib.crc32(header).to_bytes(4)
        + b"\0\0\0\0IDAT"
    )
    (tmp_path / "huge.png").write_bytes(png + zlib.crc32(b"IDAT").to_bytes(4))
    with pytest.raises(InputError, match="more than 150 megapixels"):
        read_depth(tmp_path / "huge.png", 1.0, None)


@pytest.mark.parametrize(
    ("photo", "made"), [((1080, 1920), (280, 504)), ((2532, 1170), (504, 238))]
)
def test_a_map_whose_sides_a_network_rounded_to_14_px_is_stretched(photo, made):
    values, notes = resize_nearest(
        np.arange(made[0] * made[1], dtype=float).reshape(made), *photo, Path("a.npy")
    )
    assert values.shape == photo
    assert values[0, 0] == 0
    assert values[-1, -1] == made[0] * made[1] - 1
    assert len(notes) == 1


def test_a_cropped_map_of_whole_patches_is_refused():
    with pytest.raises(InputError, match="aspect"):
        resize_nearest(np.ones((280, 448)), 1080, 1920, Path("a.npy"))


@pytest.mark.parametrize("lead", [(), (1,)], ids=["MoGe and Depth Pro", "Depth Anything 3"])
def test_a_depth_in_an_archive_of_arrays_is_read(tmp_path, lead):
    np.savez(tmp_path / "results.npz", depth=DEPTH.reshape(*lead, *DEPTH.shape), conf=np.ones(3))
    found = depth(tmp_path / "results.npz")
    np.testing.assert_allclose(found.depth, DEPTH, rtol=1e-6)
    assert "conf" in found.notes[0]


def test_what_an_archive_calls_not_valid_is_unknown(tmp_path):
    valid = np.median(DEPTH) < DEPTH
    np.savez(tmp_path / "d.npz", depth=DEPTH, valid=valid)
    found = depth(tmp_path / "d.npz")
    np.testing.assert_allclose(found.depth, np.where(valid, DEPTH, np.nan), rtol=1e-6)
    assert found.notes == ()
    np.savez(tmp_path / "d.npz", depth=DEPTH, valid=valid.astype(np.uint8))
    with pytest.raises(InputError, match='"valid" of'):
        depth(tmp_path / "d.npz")


def test_an_archive_without_depth_is_refused_with_its_arrays(tmp_path):
    np.savez(tmp_path / "a.npz", disparity=DEPTH)
    with pytest.raises(InputError, match="it has disparity"):
        depth(tmp_path / "a.npz")
