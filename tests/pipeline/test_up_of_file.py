"""A file that states the pitch of its camera is a witness of up in a whole run."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from tests.pipeline.mocks import run

pytestmark = pytest.mark.usefixtures("few_steps")


def by_drone(world, pitch):
    """The photo of a world as the file of a drone."""
    tags = PngImagePlugin.PngInfo()
    xmp = f'<d drone-dji:GimbalPitchDegree="{pitch:+.2f}"/>'
    tags.add_itxt("XML:com.adobe.xmp", xmp)
    file = io.BytesIO()
    Image.fromarray(world.image).save(file, "PNG", pnginfo=tags)
    return file.getvalue()


def off_by(world, off, *settings):
    """Reconstruct with a stated pitch that is off by some degrees; also return the right up."""
    up = world.floor.normal
    pitch = math.degrees(math.asin(up[2])) + off
    return run(by_drone(world, pitch), *settings), up


def test_up_is_that_of_the_file_without_a_floor(world):
    unsure = "relative_pointmap.options.up_sigma=40"
    found, up = off_by(world, 0, "engine.scene.floor=off", unsure)
    assert found.scene.up @ up > np.cos(np.radians(1))
    assert found.scene.up_source == "the gimbal"


def test_a_pitch_that_contradicts_the_photo_is_said(world):
    found, _ = off_by(world, -30, "relative_pointmap.options.up_sigma=1")
    assert any("gimbal contradicts" in warning for warning in found.warnings)
