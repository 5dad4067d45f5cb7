"""A result names all that made it: ``physic run --config OUT/reconstruction.json`` makes it
again.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from physic_core.cli import main
from physic_testing.worlds import load_world

pytestmark = pytest.mark.kernels


def run(*arguments):
    done = CliRunner().invoke(
        main, ["run", "photo.png", "--no-cache", "--save", "numbers", *arguments]
    )
    assert done.exit_code == 0, done.output
    folder = arguments[arguments.index("-o") + 1]
    document = json.loads((Path(folder) / "reconstruction.json").read_text())
    return document


def test_a_run_is_repeated_from_its_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(load_world("stand", (160, 120)).image).save("photo.png")
    Path("base.toml").write_text(
        'extends = "mock"\n[metric_depth.options]\nnoise = 0.5\n[engine.contact]\nthreshold = 0.4\n'
    )
    Path("my.toml").write_text(
        'extends = "base.toml"\n[inpainter]\nbackend = "telea"\noptions = {radius_px = 3.0}\n'
    )
    monkeypatch.setenv("PHYSIC__PHOTO__MASK_GROWTH", "0.02")
    given = (
        "--set",
        "hand_estimator.backend=none",
        "--set",
        "engine.joint.optimiser.steps=4",
        "--intrinsics",
        "200,205,80,60",
    )
    first = run("--config", "my.toml", *given, "-o", "first")
    assert first["config"]["photo"]["mask_growth"] == 0.02

    monkeypatch.delenv("PHYSIC__PHOTO__MASK_GROWTH")
    for file in ("my.toml", "base.toml"):
        Path(file).unlink()
    second = run("--config", "first/reconstruction.json", "-o", "second")
    assert second["config"] == first["config"]
    assert second["intrinsics"] == first["intrinsics"]
    asked = [[s["provenance"] for s in document["stages"]] for document in (first, second)]
    assert asked[0] == asked[1]
    with (
        np.load("first/reconstruction.npz") as one,
        np.load("second/reconstruction.npz") as other,
    ):
        assert one.files == other.files
        for name in set(one.files) - {"run"}:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
