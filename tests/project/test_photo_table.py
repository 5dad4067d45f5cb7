"""The table of a folder of photos: one row each, whatever happens to it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
from PIL import Image

from physic_testing.worlds import build_world

pytestmark = pytest.mark.usefixtures("few_steps")

TOOL = Path(__file__).parents[2] / "tools" / "photo_table.py"


@pytest.fixture
def tool():
    spec = importlib.util.spec_from_file_location("photo_table", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_photo_has_its_row(tool, tmp_path, monkeypatch, capsys):
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    Image.fromarray(build_world("stand", 0, (160, 120)).image).save(photos / "b_world.png")
    (photos / "a_empty.jpg").write_bytes(b"")
    (photos / "notes.txt").write_text("not a photo")
    monkeypatch.setenv("PHYSIC__ENGINE__JOINT__OPTIMISER__STEPS", "10")  # after two steps a foot is 7 cm over the floor
    monkeypatch.setattr(sys, "argv", ["photo_table", str(photos), "--config", "mock", "--out", str(out)])
    assert tool.main() == 0
    header, rule, empty, world = capsys.readouterr().out.splitlines()
    assert header.count("|") == rule.count("|") == empty.count("|") == world.count("|")
    reason = f"cannot read the photo {photos / 'a_empty.jpg'}: the file is empty (0 bytes); copy it again"
    assert empty == f"| a_empty.jpg |  |  |  |  |  |  |  | {reason} |"
    cells = [cell.strip() for cell in world.strip("|").split("|")]
    assert cells[:2] == ["b_world.png", "1"]
    assert float(cells[3]) < 5
    assert float(cells[4]) < 3
    assert (out / "b_world.png" / "preview.png").is_file()


def test_a_crash_is_a_row_and_a_status(tool, tmp_path, monkeypatch, capsys):
    Image.new("RGB", (99, 99)).save(tmp_path / "a.png")

    def broken(*_):
        raise KeyError("x | y")

    monkeypatch.setattr(tool, "reconstruct_photo", broken)
    monkeypatch.setattr(sys, "argv", ["photo_table", str(tmp_path)])
    assert tool.main() == 1
    assert capsys.readouterr().out.splitlines()[-1] == "| a.png |  |  |  |  |  |  |  | CRASH: KeyError: 'x / y' |"
