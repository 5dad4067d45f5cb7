"""``physic cache``: what it lists and removes."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.quick


@pytest.fixture
def folder(root):
    return root / "results"


def fill(folder):
    folder.mkdir(parents=True)
    for name, size in (("metric_depth-embedded-00", 400_000), ("inpainter-telea-01", 1_000_000)):
        (folder / f"{name}.result.npz").write_bytes(bytes(size))
    (folder / ".x.result.npz.0b.physic-part").write_text("incomplete")
    (folder / "mine.npz").write_text("not theirs")


def test_a_cache_is_cleared_alone_or_with_all_others(folder, physic):
    fill(folder)
    hashes = folder.parent / "hashes"
    hashes.mkdir()
    (hashes / "a.sha256").write_text("a")
    assert physic("cache", "clear", "hashes").output == f"removed 1 files, 0.0 MB from {hashes}\n"
    assert len(list(folder.iterdir())) == 4
    assert physic("cache", "clear").output.startswith(f"removed 2 files, 1.4 MB from {folder}\n")
    assert [path.name for path in folder.iterdir()] == ["mine.npz"]
    assert f"removed 0 files, 0.0 MB from {folder}\n" in physic("cache", "clear").output
    done = physic("cache", "clear", "graph")
    assert (done.exit_code, "graphs" in done.output) == (2, True)


def test_the_other_caches_are_listed_and_removed_too(folder, physic):
    others = {
        "maps": "a.map.npz",
        "graphs": "a.graph.onnx",
        "hashes": "a.sha256",
        "kit": "a.passed",
    }
    for name, file in others.items():
        (folder.parent / name).mkdir(parents=True)
        (folder.parent / name / file).write_bytes(bytes(3_000_000))
        (folder.parent / name / "mine.onnx").write_text("not theirs")
    printed = [
        f"{folder}: 0 files, 0.0 MB",
        *(f"{folder.parent / name}: 1 files, 3.0 MB" for name in others),
    ]
    assert physic("cache", "info").output.splitlines()[:-1] == printed
    assert len(physic("cache", "clear").output.splitlines()) == 5
    assert {file.name for name in others for file in (folder.parent / name).iterdir()} == {
        "mine.onnx"
    }


@pytest.mark.parametrize("command", ["info", "clear", "fill"])
def test_a_cache_that_is_switched_off_is_an_error(command, monkeypatch, physic):
    monkeypatch.setenv("PHYSIC_CACHE", "off")
    done = physic("cache", command)
    assert (done.exit_code, "PHYSIC_CACHE" in done.output) == (2, True)
