"""``physic evaluate calibrated --config``: pictures go through the batch, and a killed call is
continued.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_bench.joints import LIMB_JOINTS
from physic_core import load_reconstruction
from physic_core.batch.photos import photo_folder
from physic_core.body.joints import JOINT_INDEX
from physic_testing.worlds import load_world

from .miniatures import figures, run


@pytest.mark.slow
def test_a_killed_call_reconstructs_what_is_missing_alone(tmp_path, monkeypatch):
    world = load_world("stand", (160, 120))
    out = tmp_path / "out"
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    rows = [JOINT_INDEX[name] for name in LIMB_JOINTS]
    joints = dict(zip(LIMB_JOINTS, world.joints[0, rows].tolist(), strict=True))
    for name in ("a", "b"):
        Image.fromarray(world.image).save(f"mine/{name}.png")
    camera = {"width": 160, "height": 120, "K": world.intrinsics.matrix.tolist()}
    Path("mine/truth.json").write_text(
        json.dumps([{"image": f"{n}.png", "joints": joints, **camera} for n in "ab"])
    )
    Path("quick.toml").write_text('extends = "mock"\n')
    arguments = (
        "calibrated",
        "mine",
        "-o",
        "out",
        "--config",
        "quick.toml",
        "--set",
        "engine.joint.optimiser.steps=2",
    )
    assert "--preset cannot be combined with --config" in run(*arguments, "--preset", "mock").output
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    assert "2 pictures: 2 to reconstruct, 0 done before" in done.output
    first = figures(out, "physic quick")
    folders = [out / "reconstructions" / photo_folder(name) for name in ("a", "b")]
    found = load_reconstruction(str(folders[0])).people[0].joints[rows]
    apart_mm = 1000 * np.linalg.norm(found - world.joints[0, rows], axis=1).mean()
    assert first["me_mpjpe"] == pytest.approx(apart_mm, abs=0.1)

    # A call that is killed in the second picture leaves the row of the first, and no tables.
    journal = out / "reconstructions" / "journal.jsonl"
    kept = [line for line in journal.read_text().splitlines() if json.loads(line)["id"] == "a"]
    journal.write_text("\n".join(kept) + "\n")
    shutil.rmtree(folders[1])
    before = (folders[0] / "reconstruction.json").stat().st_mtime_ns
    again = run(*arguments)
    assert "2 pictures: 1 to reconstruct, 1 done before" in again.output
    assert (folders[0] / "reconstruction.json").stat().st_mtime_ns == before
    assert figures(out, "physic quick") == first
