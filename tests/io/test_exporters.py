"""Exporters of plugins: how they are found and called, messages about missing ones, and the frame
that they get.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from physic_core import Reconstruction, find_exporter
from physic_core.errors import ConfigError, InputError, PackageMissingError, PluginError
from physic_core.export import camera_pose, export_frame
from physic_core.files import has_mark
from physic_core.geometry.world_frame import transform_points

PLUGIN = """
from physic_core import ExporterRecord, hookimpl

@hookimpl
def physic_exporters():
    target = "physic_box_export:"
    return [
        ExporterRecord("box", (".box",), target + "box", "Boxes", "corners", needs="a ruler"),
        ExporterRecord("fbx", (".fbx",), target + "box", ups=("camera",), per_person=True),
        ExporterRecord("far", (".far",), target + "box", packages=("no_such_module",), extra="far"),
        ExporterRecord("lost", (".lost",), "physic_box_nowhere:lost"),
        ExporterRecord("ends", (".ends",), target + "ends"),
        ExporterRecord("text", (".text", ".ends"), target + "text"),
        ExporterRecord("photo", (".jpg", ".png"), target + "photo"),
    ]
"""
EXPORTER = """
from physic_core import ExportedFiles

def box(request):
    lines = [f"{i} {request.frame.up} {person.vertices.shape[0]}" for i, person in request.chosen()]
    return ExportedFiles({f"{request.stem}{request.suffix}": "\\n".join(lines).encode()}, ("corners are round",))

def ends(request):
    raise SystemExit(3)

def text(request):
    return "text"

def photo(request):
    import io
    from PIL import Image
    files = {}
    exif = Image.Exif()
    exif[0x0112] = 1
    for name, form in {"a.jpg": {}, "b.jpg": {"exif": exif}, "a.png": {}}.items():
        Image.fromarray(request.result.image).save(stream := io.BytesIO(), Image.EXTENSION[name[1:]], **form)
        files[name] = stream.getvalue()
    return ExportedFiles(files)
"""  # noqa: E501


@pytest.fixture(scope="session")
def result(saved_pair):
    return Reconstruction.load(str(saved_pair))


@pytest.fixture
def plugin(site):
    site.install("physic-box", PLUGIN)
    (site.folder / "physic_box_export.py").write_text(EXPORTER)
    return site


def test_pictures_of_a_format_carry_the_mark_that_keeps_them_out_of_batches(
    plugin, result, tmp_path
):
    files = result.export(str(tmp_path), "photo").files
    assert sorted(file.name for file in files) == ["a.jpg", "a.png", "b.jpg"]
    for file in files:
        assert has_mark(file)
        with Image.open(file) as picture:
            assert picture.size == result.image.shape[1::-1]
            assert np.abs(np.asarray(picture) - result.image.astype(float)).mean() < 9


def test_a_plugin_adds_a_format(plugin, saved_pair, result, tmp_path, physic):
    lines = physic("export", "--list").output.splitlines()
    (line,) = [line for line in lines if line.startswith("box ")]
    assert line.split("  ")[-1].strip() == "a ruler"
    file = tmp_path / "a.box"
    done = physic("export", saved_pair, "-o", file)
    assert done.exit_code == 0
    assert done.output.splitlines() == ["note: corners are round", f"{file}  (0 kB)"]
    count = len(result.people[0].vertices)
    assert file.read_text() == f"0 y {count}\n1 y {count}"
    assert result.export(str(tmp_path), "box").files == (tmp_path / "box.box",)


def test_a_missing_package_names_the_extra_of_the_plugin(plugin):
    with pytest.raises(PackageMissingError, match="needs no_such_module"):
        find_exporter("far")


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("lost", "ModuleNotFoundError"),
        ("ends", r"SystemExit: 3 \(physic_box_export.py:9\)"),
        ("text", "ExportedFiles, got str"),
    ],
)
def test_a_broken_exporter_names_its_plugin(plugin, result, tmp_path, name, fault):
    with pytest.raises(PluginError, match=f"'{name}' of physic-box 1.0 .*{fault}"):
        result.export(str(tmp_path / "out"), name)
    assert not (tmp_path / "out").exists()


def test_a_suffix_of_two_formats_is_refused(plugin):
    with pytest.raises(ConfigError, match="can be ends of physic-box or text of physic-box"):
        find_exporter(None, ".ends")


def test_a_format_that_two_plugins_offer_is_refused(plugin):
    plugin.install("physic-other", PLUGIN)
    for wanted in (("box", ""), (None, ".box")):
        with pytest.raises(ConfigError, match="box of physic-box or box of physic-other"):
            find_exporter(*wanted)


BY_BLENDER = "docs/exports.md"


@pytest.mark.parametrize(
    ("plugins", "arguments", "words"),
    [
        (
            "metricbody-testing",
            ("--to", "glb"),
            "not an export format: formats are in metricbody-visual",
        ),
        ("metricbody-visual", ("--to", "fbx"), BY_BLENDER),
        ("metricbody-visual", ("-o", "a.fbx"), BY_BLENDER),
        ("metricbody-visual", ("-o", "a.E57"), "PLY, then CloudCompare"),
        ("metricbody-visual", ("-o", "a.c3d"), "TRC, then Mokka"),
    ],
)
def test_a_format_that_no_plugin_writes_is_refused_with_the_way_to_it(
    monkeypatch, saved_pair, plugins, arguments, words, physic
):
    monkeypatch.setenv("PHYSIC_PLUGINS", plugins)
    done = physic("export", saved_pair, *arguments)
    assert (done.exit_code, words in done.output) == (2, True)


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_frames_stand_on_the_floor(result, up, axis):
    floor = result.scene.floor
    frame = export_frame(floor, up)
    points = np.random.default_rng(0).normal(size=(5, 3))
    heights = points @ floor.normal + floor.offset
    assert_allclose(transform_points(frame.from_camera, points)[:, axis], heights, atol=1e-6)
    # The camera looks along its -z: a point ahead of it in the photo is there.
    ahead = transform_points(frame.from_camera, np.array([[0, 0, 2.0]]))
    to_camera = np.linalg.inv(camera_pose(frame))
    assert_allclose(transform_points(to_camera, ahead), [[0, 0, -2]], atol=1e-9)


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_without_a_floor_frames_are_level_if_edges_tell_up(result, up, axis):
    above = np.array([0.0, -0.8, -0.6])
    scene = replace(result.scene, floor=None, up=above, up_sigma=1.5)
    frame = export_frame(scene.level, up)
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert_allclose(transform_points(frame.from_camera, points)[:, axis], points @ above, atol=1e-9)
    assert "origin at the camera" in frame.axes
    unsure = replace(scene, up_sigma=13.0)
    assert unsure.level is None
    assert replace(unsure, floor=result.scene.floor).level is result.scene.floor
    with pytest.raises(InputError, match="z up"):
        export_frame(unsure.level, "z")
