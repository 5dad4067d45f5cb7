"""Folders of results that others made: readers write nothing, and no command changes a file outside
of the folder.
"""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress
from dataclasses import replace

import pytest

from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import atomic_write
from physic_core.io.report_file import add_report
from physic_core.io.result_folder import digest_of, record_exports
from physic_core.io.results import (
    load_people,
    load_reconstruction,
    read_image,
    read_record,
    save_reconstruction,
)
from tests.rooms import tiny_result

READERS = (load_reconstruction, load_people, read_image, read_record, add_report)
COMMANDS = (["show"], ["report"], ["report", "-o", "page.html"], ["export", "--to", "glb"])


def tree(folder):
    """Return path -> content, or target of a link, of everything below a folder."""
    return {
        path.relative_to(folder).as_posix(): os.readlink(path)
        if path.is_symlink()
        else path.read_bytes()
        if path.is_file()
        else None
        for path in folder.rglob("*")
    }


def tear(folder):
    """Give the files of a result the names that a killed process leaves."""
    for path in [path for path in folder.iterdir() if not path.is_symlink()]:
        kind = "document" if path.suffix == ".json" else "part"
        path.rename(folder / f".{path.name}.01234567.physic-{kind}")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    made = tmp_path_factory.mktemp("saved")
    save_reconstruction(tiny_result(), made, "numbers")
    return made


@pytest.fixture
def folder(saved, tmp_path):
    return shutil.copytree(saved, tmp_path / "result")


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_reader_of_an_unfinished_result_writes_nothing_and_names_the_cure(read, folder):
    tear(folder)
    before = tree(folder)
    with pytest.raises(InputError, match="the result is unfinished"):
        read(folder)
    assert tree(folder) == before


@pytest.mark.parametrize("command", [*COMMANDS, ["compare", "result"]], ids=" ".join)
def test_a_command_for_an_unfinished_result_writes_nothing(
    command, folder, physic, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    tear(folder)
    before = tree(tmp_path)
    done = physic(command[0], "result", *command[1:])
    assert "unfinished" in done.output
    assert done.exit_code == 3
    assert tree(tmp_path) == before


def test_a_file_that_a_killed_process_has_not_completed_is_not_put_in_place(folder):
    tear(folder)
    (part,) = folder.glob(".reconstruction.npz.*")
    part.write_bytes(part.read_bytes()[:-1])
    with pytest.raises(OutputError, match="another photo"):
        save_reconstruction(replace(tiny_result(), photo="sha256:1"), folder, "numbers")
    assert part.exists()
    assert not (folder / "reconstruction.npz").exists()


LEADING_OUT = {
    "folder": ("extra/notes.txt", "extra", "home"),
    "file": ("notes.txt", "notes.txt", "home/notes.txt"),
    "parent": ("extra/home/notes.txt", "extra", ""),
    "up": ("../home/notes.txt", None, None),
    "up and down": ("extra/../../home/notes.txt", None, None),
    "absolute": ("{}/home/notes.txt", None, None),
}


@pytest.fixture(params=LEADING_OUT)
def name(request, folder, tmp_path):
    """The name of the user's home/notes.txt, by which a result may list it."""
    name, link, target = LEADING_OUT[request.param]
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "notes.txt").write_bytes(b"mine")
    if link:
        (folder / link).symlink_to(tmp_path / target)
    return name.format(tmp_path)


def save(folder, name):
    save_reconstruction(tiny_result(1), folder, "numbers", overwrite=True)


def save_after_a_batch(folder, name):
    save_reconstruction(tiny_result(1), folder, "numbers", overwrite=True, earlier=[name])


def export(folder, name):
    with atomic_write(folder) as write:
        write(name).write_bytes(b"theirs")


def list_it(folder, name):
    record_exports(folder, [folder / name])


def add_page(folder, name):
    add_report(folder)


@pytest.mark.parametrize(
    ("is_torn", "content"), [(True, b"theirs"), (False, b"theirs"), (False, b"mine")]
)
@pytest.mark.parametrize("act", [save, save_after_a_batch, export, list_it, add_page])
def test_a_name_that_leads_out_of_the_folder_is_no_file_of_a_result(
    act, is_torn, content, name, folder, tmp_path
):
    document = json.loads((folder / "reconstruction.json").read_bytes())
    document["files"][name] = digest_of(content)
    (folder / "reconstruction.json").write_text(json.dumps(document))
    if is_torn:
        tear(folder)
        part = f".{name.replace('/', '.')}.01234567.physic-part"
        (folder / part).write_bytes(b"theirs")
    links = {path: os.readlink(path) for path in folder.iterdir() if path.is_symlink()}
    with suppress(InputError, OutputError):
        act(folder, name)
    assert tree(tmp_path / "home") == {"notes.txt": b"mine"}
    assert {path: os.readlink(path) for path in links} == links
    if act is save:
        assert name not in read_record(folder).files
