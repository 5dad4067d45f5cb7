"""Errors of estimators against a known truth: an error that is put in comes out as that number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.truth.estimator_errors import estimator_records, world_truth
from benchmarks.truth.estimator_statistics import STATISTICS, statistics_of, text_of
from physic_core import load_config
from physic_core.body import load_body
from physic_core.configuration.resolve import resolve
from physic_core.discovery.plugins import discover
from physic_core.interfaces import INTERFACES
from physic_core.pipeline.estimate import run_backends
from physic_core.pipeline.stage_runner import StageRunner
from physic_core.types import CameraTrust
from physic_testing.worlds import build_world


@pytest.fixture(scope="module")
def model():
    return load_body("embedded")


@pytest.fixture(scope="module")
def world():
    return build_world("stand", 0)


@pytest.fixture(scope="module")
def estimates(world, model):
    settings = [f"{name}.options.noise=0" for name in INTERFACES]
    settings.append("engine.preset=paper")  # others scale the depth by the people as well
    plan = resolve(load_config(preset="mock", overrides=settings), discover())
    camera = replace(world.intrinsics, trust=CameraTrust.KNOWN)
    return run_backends(world.image, camera, plan, lambda: model, StageRunner(plan.device, len(plan.backends)))


@pytest.fixture
def truth(world, model):
    return world_truth(world, model)


def test_true_estimates_have_no_errors(estimates, truth, model):
    records = estimator_records(estimates, truth, model)
    (person,), (body,), (depth,) = records["people"], records["bodies"], records["depth"]
    assert person["found"]
    assert body["pa_mpjpe_mm"] < 0.01
    assert body["bones_log"] == pytest.approx(0, abs=1e-5)
    assert body["depth_log"] == pytest.approx(0, abs=1e-5)
    assert max(abs(body[f"turn_{axis}"]) for axis in ("right", "down", "away")) < 0.01
    assert max(segment["angle_deg"] for segment in records["segments"]) < 0.1
    assert not any(segment["flipped"] for segment in records["segments"])
    assert max(max(body[name]) for name in ("spine", "hip", "knee", "shoulder", "elbow")) < 0.1
    assert depth["floor_scale_log"] == pytest.approx(0, abs=1e-3)
    assert depth["bend"] == pytest.approx(0, abs=0.01)
    assert depth["floor_angle_deg"] < 0.1
    assert depth["camera_height_log"] == pytest.approx(0, abs=2e-3)
    # A detector puts shoulders and hips elsewhere than bodies have them.
    assert max(r["error"] for r in records["keypoints"] if r["joint"] in ("elbow", "wrist", "knee")) < 0.02


def test_a_scale_and_an_offset_of_inverse_depth_are_measured(estimates, truth, model):
    depth = estimates.depth.depth
    larger = replace(estimates, depth=replace(estimates.depth, depth=1.1 * depth))
    assert estimator_records(larger, truth, model)["depth"][0]["floor_scale_log"] == pytest.approx(
        np.log(1.1), abs=1e-3
    )
    offset = 0.3 / float(np.nanmedian(depth))
    with np.errstate(divide="ignore"):
        bent = np.where(1 / depth > offset, 1 / (1 / depth - offset), np.nan).astype(np.float32)
    found = estimator_records(replace(estimates, depth=replace(estimates.depth, depth=bent)), truth, model)["depth"][0]
    assert found["bend"] < -0.2
    assert found["floor_angle_deg"] > 3


def test_a_nearer_body_and_swapped_keypoints_are_measured(estimates, truth, model):
    parameters = estimates.bodies.parameters
    pelvis = truth.joints[:, [6, 7]].mean(1)
    nearer = replace(parameters, transl=(parameters.transl - 0.1 * pelvis).astype(np.float32))
    moved = replace(estimates, bodies=replace(estimates.bodies, parameters=nearer))
    (body,) = estimator_records(moved, truth, model)["bodies"]
    assert body["depth_log"] == pytest.approx(np.log(0.9), abs=1e-3)
    assert body["pa_mpjpe_mm"] < 0.01
    names = list(estimates.keypoints.joint_set.names)
    order = list(range(len(names)))
    for joint in ("knee", "ankle"):
        left, right = names.index(f"left_{joint}"), names.index(f"right_{joint}")
        order[left], order[right] = right, left
    swapped = replace(estimates.keypoints, points=estimates.keypoints.points[:, order])
    apart = np.linalg.norm(truth.points[0, 8] - truth.points[0, 9]) / (truth.boxes[0, 2:] - truth.boxes[0, :2]).max()
    first = estimator_records(replace(estimates, keypoints=swapped), truth, model)["keypoints"][0]
    assert first["swap_legs"] is (True if apart > 0.06 else None)
    assert not first["swap_arms"]


def test_statistics_have_intervals_over_photos():
    records = {
        "bodies": [{"set": "a", "group": f"{k}", "photo": f"{k}", "pa_mpjpe_mm": float(10 * k)} for k in range(1, 10)]
    }
    figures = statistics_of(records)
    assert set(figures) == set(STATISTICS)
    mean = figures["bodies: PA-MPJPE mm, mean"]
    assert (mean.value, mean.count) == (50, 9)
    assert 30 < mean.low < 50 < mean.high < 70
    assert np.isnan(figures["keypoints, hidden: median error"].value)
    assert "| bodies: PA-MPJPE mm, mean | 50 |" in text_of(figures)
