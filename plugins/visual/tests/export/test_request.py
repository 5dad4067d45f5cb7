"""Formats, people and files of the exports, and what is refused."""

from __future__ import annotations

import hashlib
import os
import re
import stat
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from physic_core import Reconstruction, export_reconstruction, find_exporter
from physic_core.errors import ConfigError, InputError, OutputError
from physic_export import physic_exporters


def without_floor(result):
    points = np.zeros((0, 3), np.float32)
    return replace(result, scene=replace(result.scene, floor=None, floor_points=points, up=None))


def column_first(value):
    """The same values, with arrays whose first axis is the fastest."""
    if isinstance(value, np.ndarray):
        return np.asfortranarray(value)
    if isinstance(value, tuple):
        return tuple(column_first(one) for one in value)
    if is_dataclass(value):
        values = {one.name: getattr(value, one.name) for one in fields(value) if one.init}
        return replace(value, **{name: column_first(one) for name, one in values.items()})
    return value


@pytest.mark.parametrize("record", physic_exporters(), ids=lambda one: one.name)
def test_the_files_do_not_depend_on_the_order_of_arrays_in_memory(result, file, tmp_path, record):
    if record.missing_packages:
        pytest.skip(f"needs {record.missing_packages}")
    turned = column_first(result)
    assert turned.scene.points.flags.f_contiguous
    body_model = file if record.name == "amass" else None
    exported = [
        one.export(str(tmp_path / folder), record.name, person=0, body_model=body_model).files
        for folder, one in (("rows", result), ("columns", turned))
    ]
    for one, other in zip(*exported, strict=True):
        assert one.name == other.name
        assert one.read_bytes() == other.read_bytes()


def without_body(result, index):
    person = result.people[index]
    lost = replace(
        person,
        vertices=np.full_like(person.vertices, np.nan),
        contact=np.zeros_like(person.contact),
    )
    return replace(
        result, people=tuple(lost if i == index else p for i, p in enumerate(result.people))
    )


def test_the_command_takes_each_value_of_each_option_of_a_format(physic):
    told = re.sub(r"\s+", " ", physic("export", "--help").output)
    for record in physic_exporters():
        for name, values in record.options.items():
            option = f"--{name.replace('_', '-')} "
            assert option in told
            choices = told.partition(option)[2].partition("]")[0].strip("[").split("|")
            assert {*values} <= {False, True} or {*values} <= {*choices}, (record.name, name)


def test_embedded_bodies_are_exported_without_torch(saved_pair, tmp_path):
    names = sorted({each.name for each in physic_exporters()} - {"amass", "exr", "rrd"})
    code = (
        "import sys\n"
        "from dataclasses import replace\n"
        "from pathlib import Path\n"
        "from physic_core import Reconstruction, export_reconstruction\n"
        f"result = Reconstruction.load({str(saved_pair)!r})\n"
        "result.scene.valid[:, :120] = False\n"  # fewer tiles
        "result = replace(result, people=result.people[:1])\n"
        f"for name in {names}:\n"
        f"    export_reconstruction(result, Path({str(tmp_path)!r}, name), name)\n"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(("suffix", "name"), [(".bvh", "bvh"), (".PLY", "ply"), (".usdz", "usd")])
def test_a_suffix_selects_a_format(suffix, name):
    assert find_exporter(None, suffix).record.name == name


@pytest.mark.parametrize(
    ("name", "option"), [("mixamo", "--to bvh --names mixamo"), ("photo", "--to glb --skin photo")]
)
def test_the_value_of_an_option_in_place_of_a_format_is_refused_with_the_option(name, option):
    with pytest.raises(ConfigError, match=f"'{name}' is an option: .*{option}"):
        find_exporter(name)


@pytest.mark.parametrize(
    ("kind", "change", "name", "options", "message"),
    [
        (ConfigError, None, "a.bvh", {"person": 2}, "no person 2"),
        (
            ConfigError,
            lambda result: without_body(result, 0),
            "a.bvh",
            {"person": 0},
            "person 0 has no body",
        ),
        (
            InputError,
            lambda result: without_body(without_body(result, 0), 1),
            "a.bvh",
            {},
            "no person of this result has a body",
        ),
        (InputError, lambda result: replace(result, people=()), "a.bvh", {}, "no person"),
        (ConfigError, None, "a.bvh", {"up": "camera"}, "--up y or z"),
        (InputError, without_floor, "a.xml", {}, "z up needs"),
    ],
)
def test_what_a_format_needs(
    result,
    tmp_path,
    kind,
    change,
    name,
    options,
    message,
):
    with pytest.raises(kind, match=message):
        export_reconstruction(change(result) if change else result, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_person_without_a_body_is_left_out_with_a_note(result, export, tmp_path):
    done = export("a.bvh", of=without_body(result, 0))
    assert done.files == (tmp_path / "a.bvh",)
    assert done.notes[0] == "person 0 has no body and is skipped"


def test_several_people_are_numbered_and_one_is_not(export, tmp_path):
    assert export("a.bvh").files == (tmp_path / "a_0.bvh", tmp_path / "a_1.bvh")
    assert export("b.bvh", person=1).files == (tmp_path / "b.bvh",)
    assert export("new", "bvh", person=0).files == (tmp_path / "new" / "skeleton.bvh",)
    assert export(".", "bvh").files == (tmp_path / "skeleton_0.bvh", tmp_path / "skeleton_1.bvh")


def test_a_file_is_replaced_only_where_that_is_wanted(export, tmp_path):
    (tmp_path / "a.bvh").write_text("mine")
    with pytest.raises(OutputError, match="overwrite=True in Python"):
        export("a.bvh", person=0)
    assert (tmp_path / "a.bvh").read_text() == "mine"
    export("a.bvh", person=0, overwrite=True)
    assert (tmp_path / "a.bvh").read_text().startswith("HIERARCHY")


@pytest.mark.parametrize("kind", ["photo", "link"])
def test_the_photo_and_links_are_never_replaced(result, tmp_path, kind):
    there = tmp_path / "a_1.bvh"  # of the second person
    shown = b"mine" if kind == "photo" else b"another file"
    if kind == "photo":
        there.write_bytes(b"mine")
    else:
        (tmp_path / "mine").write_bytes(b"mine")
        there.symlink_to(tmp_path / "mine")
    photo = f"sha256:{hashlib.sha256(shown).hexdigest()}"
    with pytest.raises(OutputError, match="it is the photo, or no regular file"):
        replace(result, photo=photo).export(tmp_path / "a.bvh", overwrite=True)
    assert there.read_bytes() == b"mine"
    assert not (tmp_path / "a_0.bvh").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no pipes")
def test_pipes_and_folders_are_never_replaced(result, tmp_path):
    os.mkfifo(tmp_path / "a_0.bvh")
    (tmp_path / "a_1.bvh").mkdir()
    with pytest.raises(OutputError, match="no regular file"):
        result.export(tmp_path / "a.bvh", overwrite=True)
    assert stat.S_ISFIFO((tmp_path / "a_0.bvh").stat().st_mode)
    assert (tmp_path / "a_1.bvh").is_dir()


def test_the_command_writes_into_the_result_and_prints_the_files(saved_pair, physic):
    done = physic("export", saved_pair, "--to", "bvh")
    assert done.exit_code == 0, done.output
    names = [
        Path(line.split("  (")[0]).name
        for line in done.output.splitlines()
        if not line.startswith("note:")
    ]
    assert names == ["skeleton_0.bvh", "skeleton_1.bvh"]
    again = physic("export", saved_pair, "--to", "bvh")
    assert (again.exit_code, again.output.startswith("Error: ")) == (2, True)
    assert "--overwrite" in again.output
    for name in names:
        os.remove(saved_pair / name)
    Reconstruction.load(str(saved_pair))
