"""``benchmarks.speed`` and ``benchmarks.photo``: what they measure, and never how long anything took."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.photo import run
from benchmarks.speed import joint_problem
from physic_core.body import load_body

ROOT = Path(__file__).parents[2]


def test_everybody_is_in_the_picture_and_starts_beside_the_truth():
    width, height = 160, 120
    problem = joint_problem(load_body("embedded"), 8, (width, height), 0)
    problem.check()
    assert len(problem) == 8
    assert (problem.masks.flatten(1).sum(1) > 20).all()
    assert (problem.masks.sum(0) <= 1).all()
    x, y = problem.keypoints.unbind(-1)
    assert ((x > -10) & (x < width + 10) & (y > -20) & (y < height + 20)).all()


def test_the_parts_of_a_photo_without_people_add_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "photo.png")
    monkeypatch.chdir(ROOT)
    given = argparse.Namespace(photo=tmp_path / "photo.png", preset="embedded", no_report=True)
    cost = run(given, str(tmp_path / "cache"))
    assert list(cost["parts"])[:3] == ["start", "reading", "people"]
    assert "saving" in cost["parts"]
    assert abs(sum(cost["parts"].values()) - cost["total"]) < 0.2
    assert cost["networks"]["depth_anything_v2_vits"] < cost["total"]
    assert cost["yardstick"] > 0
