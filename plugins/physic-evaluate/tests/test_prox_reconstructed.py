"""``physic evaluate prox --preset``: pictures of a synthetic world, mirrored as in PROX, through the batch."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from physic_core import load_reconstruction
from physic_core.batch.photos import photo_folder
from physic_core.body import load_body
from physic_testing.worlds import World, build_world

from .miniatures import Files, figures, moved_by, other_body, rigid, run

RECORDING = "vicon_03301_01"
NAMES = tuple(f"s001_frame_{i:05d}__00.00.0{i}.023" for i in range(2))
IDS = tuple(f"{RECORDING}/{name}" for name in NAMES)


@pytest.fixture(scope="module")
def world() -> World:
    return build_world("stand", 0, (320, 240))


@pytest.fixture(scope="module")
def root(world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of one world: a mesh with 10475 vertices in Vicon's frame, and the mirror image of the photo."""
    folder = tmp_path_factory.mktemp("world") / "quantitative"
    to_scene = rigid(world.camera.rotation.T, world.camera.position)
    np.testing.assert_allclose(world.camera.to_room(world.joints[0]), moved_by(to_scene, world.joints[0]), atol=1e-5)
    i = world.intrinsics
    K = np.array([[i.fx, 0, i.cx], [0, i.fy, i.cy], [0, 0, 1]])
    from_vicon = rigid(np.eye(3)[[1, 2, 0]], [2.0, 0.5, 0.03])
    for part in ("calibration", "cam2world", "scenes"):
        (folder / part).mkdir(parents=True)
    write_json(folder / "calibration" / "Color.json", {"camera_mtx": K.tolist(), "k": [[0.0] * 5]})
    write_json(folder / "cam2world" / "vicon.json", to_scene.tolist())
    write_json(folder / "vicon2scene.json", from_vicon.tolist())
    trimesh.Trimesh(*world.room.mesh()[:2], process=False).export(folder / "scenes" / "vicon.ply")
    body = other_body().make(load_body("embedded"), 10475)
    vertices = moved_by(np.linalg.inv(from_vicon) @ to_scene, body.from_embedded @ world.vertices[0])
    points = np.zeros((25, 3))
    pixels = world.joints[0, :22] @ K.T
    points[:22, :2], points[:22, 2] = pixels[:, :2] / pixels[:, 2:], 0.9
    for name in NAMES:
        mesh = folder / "fittings" / "mosh" / RECORDING / "meshes" / name / "000.ply"
        mesh.parent.mkdir(parents=True)
        trimesh.Trimesh(vertices, body.faces, process=False).export(mesh)
        write_json(
            folder / "keypoints" / RECORDING / f"{name}_keypoints.json",
            {"people": [{"pose_keypoints_2d": points.ravel().tolist()}]},
        )
        picture = folder / "recordings" / RECORDING / "Color" / f"{name}.jpg"
        picture.parent.mkdir(parents=True, exist_ok=True)
        # Mocks know their photos without loss alone: PNG under PROX's name.
        Image.fromarray(world.image[:, ::-1]).save(picture, format="PNG")
    return folder


def write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def command(root: Path, out: Path, files: Files) -> list[str]:
    noise = [f"{name}.options.noise=0" for name in ("metric_depth", "body_estimator")]
    sets = [part for name in noise for part in ("--set", name)]
    return ["prox", str(root), "-o", str(out), "--preset", "mock", *sets, *files.arguments(), "--no-geodesic"]


def rows_of(out: Path) -> dict[str, dict[str, Any]]:
    """The journal's rows without what differs between photos and runs: all frames show one world."""
    lines = (json.loads(line) for line in (out / "reconstructions" / "journal.jsonl").read_text().splitlines())
    different = ("id", "folder", "seconds", "finished", "peak_mb", "modified", "path", "checksum")
    return {row["id"]: {k: v for k, v in row.items() if k not in different and "seconds" not in k} for row in lines}


def test_a_killed_run_goes_on_and_gives_the_same_rows(root: Path, world: World, files: Files, tmp_path: Path):
    out = tmp_path / "out"
    journal = out / "reconstructions" / "journal.jsonl"
    process = subprocess.Popen(
        [sys.executable, "-c", "from physic_core.cli import main; main()", "evaluate", *command(root, out, files)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    while process.poll() is None and not (journal.is_file() and journal.read_bytes().count(b"\n")):
        time.sleep(0.05)
    assert process.poll() is None, process.stderr.read().decode()  # type: ignore[union-attr]
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    first = json.loads(journal.read_text().splitlines()[0])["id"]
    result = out / "reconstructions" / photo_folder(first) / "reconstruction.json"
    before, lines = result.stat().st_mtime_ns, journal.read_bytes().count(b"\n")
    assert lines < len(NAMES)
    assert not (out / "table.txt").exists()

    done = run(*command(root, out, files))
    assert done.exit_code == 0, done.output
    assert f"2 pictures: {2 - lines} to reconstruct, {lines} done before" in done.output
    assert result.stat().st_mtime_ns == before
    rows = rows_of(out)
    assert sorted(rows) == sorted(IDS)
    # The name of the photo stands in the document, and rows state the run that made them.
    same = [{key: value for key, value in rows[i].items() if key not in ("files", "run")} for i in IDS]
    assert same[0] == same[1]

    found = figures(out, "physic mock")
    assert found["found"] == 1
    # The mirror image would be refused by the mocks; what they got is the photo of the world.
    with Image.open(out / "reconstructions" / "pictures" / f"{IDS[0].replace('/', '_')}.png") as picture:
        assert np.array_equal(np.asarray(picture), world.image)
    own = load_reconstruction(str(out / "reconstructions" / photo_folder(IDS[0]))).people[0]
    apart = 1000 * np.linalg.norm(own.vertices - world.vertices[0], axis=1).mean()
    assert found["me_pve"] == pytest.approx(apart, abs=1)
