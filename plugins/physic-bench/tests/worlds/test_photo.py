"""What ``physic bench photo`` measures: its parts and its errors; never how long anything took."""

from __future__ import annotations

import json

import numpy as np
from click.testing import CliRunner
from PIL import Image

from physic_core.cli import main


def test_the_parts_of_a_photo_without_people_add_up(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "photo.png")
    done = CliRunner().invoke(main, ["bench", "photo", str(tmp_path / "photo.png"), "--repeats", "1", "--json"])
    assert done.exit_code == 0, done.output
    cost = json.loads(done.stdout)
    assert list(cost["parts"])[:3] == ["start", "reading", "people"]
    assert "saving" in cost["parts"]
    assert abs(sum(cost["parts"].values()) - cost["total"]) < 0.2
    assert cost["networks"]["depth_anything_v2_vits"] < cost["total"]
    assert 0 < cost["imports"] < cost["total"]
    assert cost["yardstick"] > 0
