"""Folders of results that others made: no command changes a file outside of the folder."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress

import pytest

from physic_core.errors import InputError, OutputError
from physic_core.files.atomic import atomic_write
from physic_core.io.report_file import add_report
from physic_core.io.result_folder import add_result_files, digest_of
from physic_core.io.results import (
    save_reconstruction,
)
from tests.rooms import tiny_result


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


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    made = tmp_path_factory.mktemp("saved")
    save_reconstruction(tiny_result(), made, "numbers")
    return made


@pytest.fixture
def folder(saved, tmp_path):
    return shutil.copytree(saved, tmp_path / "result")


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


def export(folder, name):
    with atomic_write(folder) as write:
        write(name).write_bytes(b"theirs")


def list_it(folder, name):
    add_result_files(folder, {name: b"theirs"})


def add_page(folder, name):
    add_report(folder)


@pytest.mark.parametrize("content", [b"theirs", b"mine"])
@pytest.mark.parametrize("act", [save, export, list_it, add_page])
def test_a_name_that_leads_out_of_the_folder_is_no_file_of_a_result(
    act, content, name, folder, tmp_path
):
    document = json.loads((folder / "reconstruction.json").read_bytes())
    document["files"][name] = digest_of(content)
    (folder / "reconstruction.json").write_text(json.dumps(document))
    links = {path: os.readlink(path) for path in folder.iterdir() if path.is_symlink()}
    with suppress(InputError, OutputError):
        act(folder, name)
    assert tree(tmp_path / "home") == {"notes.txt": b"mine"}
    assert {path: os.readlink(path) for path in links} == links
