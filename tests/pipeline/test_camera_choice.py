"""Whose camera a scene is put into: the one that is known, else the mean of the estimated ones,
else a guess.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import KnownSizes, Photo, engine_preset
from physic_core.body import load_body
from physic_core.configuration.model import load_config
from physic_core.configuration.resolve import resolve
from physic_core.engine.settings import with_overrides
from physic_core.pipeline.estimate import run_backends
from physic_core.pipeline.optimise import run_engine
from physic_core.pipeline.photo_run import PhotoRun
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.prepare.photo import PreparedPhoto
from physic_core.types import CameraTrust, Intrinsics
from physic_testing.worlds import load_world

SIZE = (160, 120)
QUICK = with_overrides(
    engine_preset("default"), {"joint": {"optimiser": {"steps": 1}, "frozen": ("scale",)}}
)
SEES_150, SEES_200 = (Intrinsics.from_focal(f, *SIZE, source="a network") for f in (150.0, 200.0))


@pytest.fixture(scope="module")
def evidence():
    world = load_world("stand", SIZE)
    plan = resolve(load_config(preset="mock"))
    given = PreparedPhoto(Photo(world.image), None, KnownSizes())
    return run_backends(PhotoRun(given, plan, StageCaller("cpu", 8)))


def with_cameras(evidence, pointmap, metric):
    photo = replace(
        evidence.photo,
        camera=pointmap or evidence.photo.camera,
        scene_map=replace(evidence.photo.scene_map, intrinsics=pointmap),
    )
    seen = replace(
        evidence,
        photo=photo,
        depth=replace(evidence.depth, intrinsics=metric),
    )
    return run_engine(seen, QUICK, load_body("embedded"), StageCaller("cpu", 8))


def known(camera):
    return replace(camera, source="a phone", trust=CameraTrust.KNOWN)


def guessed(camera):
    return replace(camera, source="1.2 sides", trust=CameraTrust.GUESSED)


@pytest.mark.parametrize(
    ("pointmap", "metric", "focal", "source"),
    [
        (SEES_150, SEES_200, 30000**0.5, "point map and metric depth"),
        (SEES_150, None, 150.0, "a network"),
        (SEES_150, guessed(SEES_200), 150.0, "a network"),
        (guessed(SEES_150), SEES_200, 200.0, "a network"),
        (SEES_150, known(SEES_200), 200.0, "a phone"),
        (known(SEES_150), SEES_200, 150.0, "a phone"),
    ],
)
def test_known_cameras_precede_estimated_and_guessed_ones(
    evidence, pointmap, metric, focal, source
):
    camera = with_cameras(evidence, pointmap, metric).intrinsics
    assert (camera.fx, camera.fy) == pytest.approx((focal, focal))
    assert camera.source == source


def test_depths_follow_the_focal_length_unless_they_were_measured(evidence):
    own = evidence.photo.scene_map.intrinsics
    longer = Intrinsics.from_focal(1.3 * own.fx, *SIZE, source="a network")
    agreed = with_cameras(evidence, own, replace(own, source="a network")).scene

    def ratio(metric):
        scene = with_cameras(evidence, own, metric).scene
        both = agreed.valid & scene.valid
        return float(np.median(scene.points[both][:, 2] / agreed.points[both][:, 2]))

    assert ratio(longer) == pytest.approx(1.3**-0.5, rel=2e-3)
    assert ratio(known(longer)) == pytest.approx(1.0, rel=0.05)
