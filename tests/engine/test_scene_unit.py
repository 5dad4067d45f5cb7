"""Distances to the scene in the scene's own unit: shrinking people and scene together gains
nothing.
"""

from __future__ import annotations

import pytest

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted

# Contact that is never let go of, so that it is always worth something to be nearer.
STUBBORN = adjusted(
    engine_preset("default").joint,
    depth__weight=0.0,
    contact__weight=20.0,
    contact__outlier_sigmas=30.0,
)


@pytest.fixture(scope="module")
def torn(make_stage):
    """One who stands between two walls that the hands are said to touch, and cannot."""
    walls = [((-0.6, 0.0, 2.0), (-0.36, 1.3, 4.5)), ((0.36, 0.0, 2.0), (0.6, 1.3, 4.5))]
    return make_stage([({}, (0.0, 0.0, 3.2))], walls).state


def test_a_torn_surface_changes_neither_scale_nor_distance(torn):
    """With distances in metres the scene shrank by more than 0.8 %, and the person came nearer with
    it.
    """
    result = optimize(torn, STUBBORN)
    moved = float((result.transl[0, 2] / torn.transl[0, 2]).log())
    assert result.unapplied_scene_scale == pytest.approx(1.0, abs=0.007)
    assert abs(moved) < 0.01
