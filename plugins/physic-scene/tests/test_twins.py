"""A picture that is given twice is recognised."""

from __future__ import annotations

import numpy as np

from physic_scene.photos import thumbnails_match


def test_a_brighter_copy_is_the_same_photo():
    picture = np.random.default_rng(2).uniform(-60, 60, (32, 32))
    assert thumbnails_match(picture, 1.2 * picture)
    assert not thumbnails_match(picture, picture[::-1])
