"""What decides how far a camera is trusted: its ``trust``, and never the text of its ``source``."""

from __future__ import annotations

from dataclasses import replace

import pytest

from physic_core.types import CameraTrust, Intrinsics


@pytest.mark.parametrize("trust", CameraTrust)
def test_trust_is_stated_by_the_enum_or_its_value_and_kept_when_resized(trust):
    camera = Intrinsics(500.0, 500.0, 319.5, 239.5, 640, 480, "a text", trust)
    assert camera == Intrinsics(500.0, 500.0, 319.5, 239.5, 640, 480, "a text", trust.value)
    assert camera.resized(320, 240).trust is trust
    assert (camera.known, camera.guessed) == (trust == "known", trust == "guessed")


def test_any_other_trust_is_refused():
    with pytest.raises(ValueError, match="'sure' is not a valid CameraTrust"):
        replace(Intrinsics.from_focal(500.0, 640, 480), trust="sure")


@pytest.mark.parametrize("focal", [0.0, -500.0, float("nan"), float("inf")])
def test_a_focal_length_is_positive_and_finite(focal):
    with pytest.raises(ValueError, match="focal length"):
        Intrinsics.from_focal(focal, 640, 480)
    with pytest.raises(ValueError, match="focal length"):
        Intrinsics(500.0, focal, 319.5, 239.5, 640, 480)
