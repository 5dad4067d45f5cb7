"""The published results as a reference."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_bench import release_engine
from physic_bench.readers.base import archive_arrays

from .miniatures import Files, K, figures, run
from .test_readers import frame_of, true_body, write_release


def test_the_published_start_is_as_far_from_the_published_end_as_it_was_put(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_release(tmp_path / "release", files, frame_of())

    def optimise(file: Path, bodies: Any) -> dict[str, Any]:
        problem = release_engine.release_problem(archive_arrays(file), file, bodies)
        problem.check()
        np.testing.assert_allclose(problem.transl0[0], [0.1, 0.35, 3.8])
        assert problem.contact_probability.sum() == 7
        vertices, joints = (part[None] + [0, 0.02, 0] for part in true_body(files))
        return {"vertices": vertices, "joints": joints, "contact": np.zeros((1, 10475), bool), "K": K}

    monkeypatch.setattr(release_engine, "optimise_release", optimise)
    arguments = ("--from-release", str(tmp_path / "release"), "--no-geodesic", *files.arguments())
    done = run("physic-release", str(tmp_path / "release"), "-o", str(tmp_path / "out"), *arguments)
    assert done.exit_code == 0, done.output
    found = figures(tmp_path / "out", "release init")
    assert (found["me_mpjpe"], found["me_pve"], found["ca_mpjpe"]) == pytest.approx((300, 300, 0), abs=0.05)
    assert figures(tmp_path / "out", "engine from init")["me_pve"] == pytest.approx(20, abs=0.05)
    assert "the reference is the published end, a result: no measured truth" in (tmp_path / "out/table.txt").read_text()


RUN = """
import os, signal, sys
import numpy as np
from physic_bench import release_engine

def optimise(file, bodies):
    if file.stem == sys.argv[1]:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"vertices": np.load(sys.argv[2]), "contact": np.zeros((1, 10475), bool), "K": np.load(file)["K"]}

release_engine.optimise_release = optimise
from physic_core.cli import main
main(["evaluate", *sys.argv[3:]])
"""


def test_a_killed_run_of_the_release_goes_on_to_the_same_rows(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    names = [f"room_{i}/s001_frame_{i:05d}__00.00.00.400" for i in range(3)]
    for name in names:
        write_release(tmp_path / "release", files, frame_of(name))
    (tmp_path / "release" / "release_data" / "prox" / f"{names[1]}.npz").write_bytes(b"PK")

    vertices = true_body(files)[0][None] + [0, 0.02, 0]
    np.save(tmp_path / "vertices.npy", vertices)

    def optimise(file: Path, bodies: Any) -> dict[str, Any]:
        return {"vertices": vertices, "contact": np.zeros((1, 10475), bool), "K": np.load(file)["K"]}

    def command(out: str) -> list[str]:
        release = str(tmp_path / "release")
        more = ["--from-release", release, "--no-geodesic", "--smplx", str(files.bodies.smplx)]
        return ["physic-release", release, "-o", str(tmp_path / out), *more]

    monkeypatch.setattr(release_engine, "optimise_release", optimise)
    given = [names[2].rpartition("/")[2], str(tmp_path / "vertices.npy"), *command("out")]
    killed = subprocess.run([sys.executable, "-c", RUN, *given], capture_output=True)
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    assert [path.name for path in (tmp_path / "out" / "engine").glob("*.npz")] == [f"{names[0].replace('/', '__')}.npz"]
    for out in ("out", "at once"):
        done = run(*command(out))
        assert done.exit_code == 0, done.output
    both = [json.loads((tmp_path / out / "results.json").read_text()) for out in ("out", "at once")]
    assert both[0]["records"] == both[1]["records"]
    assert both[0]["left_out"] == both[1]["left_out"]
    rows = [(record["frame"], record["method"]) for record in both[0]["records"]]
    assert rows == [(name, method) for name in (names[0], names[2]) for method in ("release init", "engine from init")]
    assert both[0]["left_out"][names[1]].endswith("is damaged or truncated, copy it again")


def test_the_engine_moves_soles_in_contact_towards_the_points_of_the_release(files: Files, tmp_path: Path):
    write_release(tmp_path, files, frame_of())
    (file,) = tmp_path.rglob("*.npz")
    arrays, vertices = dict(np.load(file)), true_body(files)[0]
    floor = vertices[:, 1].max() - 0.03
    grid = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 50), np.linspace(2.8, 4.4, 50)), -1).reshape(-1, 2)
    arrays["scene_points"] = np.column_stack([grid[:, 0], np.full(len(grid), floor), grid[:, 1]])
    arrays["scene_normals"] = np.tile([0.0, -1, 0], (len(grid), 1))
    arrays["init_cam_trans"] = arrays["final_cam_trans"]
    soles = vertices[:, 1] > floor
    arrays["contact_deco"] = soles.astype(np.float32)
    np.savez(file, **arrays)
    found = release_engine.optimise_release(file, files.bodies)
    assert found["failures"].tolist() == [""]
    after = float(found["scene_points"][:, 1].mean())  # the scene has a scale of its own
    before = np.abs(vertices[soles, 1] - floor).mean()
    assert np.abs(found["vertices"][0, soles, 1] - after).mean() < before
