"""Backends with outputs at the bounds of their interface: results are finite or unknown."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from physic_core import Pipeline, Reconstruction, find_exporters
from physic_mock import backends
from physic_testing.worlds import load_world

CONFIG = {
    "extends": "mock",
    "engine": {"joint": {"optimiser": {"steps": 1}}},
    "run": {"cache": False},
}
MOCKS = {mock.interface: mock for mock in (getattr(backends, name) for name in backends.__all__)}


def filled(**numbers):
    """Return a change that fills fields with one number."""
    return lambda result: replace(
        result,
        **{name: np.full_like(getattr(result, name), number) for name, number in numbers.items()},
    )


def posed(**numbers):
    """Return a change that fills parameters of the bodies with one number."""
    return lambda result: replace(result, parameters=filled(**numbers)(result.parameters))


def behind_the_camera(result):
    transl = result.parameters.transl * np.array([1, 1, -1], np.float32)
    return replace(result, parameters=replace(result.parameters, transl=transl))


def first_pixel(known):
    """Return a mask of the first of the known pixels alone."""
    only = np.zeros_like(known)
    only[np.unravel_index(np.argmax(known), known.shape)] = True
    return only


def with_one(values, value):
    changed = values.copy()
    changed[len(values) // 2, values.shape[1] // 2] = value
    return changed


def holes_in(depth):
    changed = depth.copy()
    changed[::2, ::2] = np.nan
    changed[1::2, 1::2] = np.inf
    return changed


DEVIATIONS = {
    "floor nowhere": ("segmenter", filled(floor=False)),
    "one point known": ("relative_pointmap", lambda r: replace(r, valid=first_pixel(r.valid))),
    "all points on the axis": (
        "relative_pointmap",
        lambda r: replace(r, points=r.points * np.float32([0, 0, 1])),
    ),
    "one point far away": (
        "relative_pointmap",
        lambda r: replace(r, points=with_one(r.points, 1e30)),
    ),
    "all depths equal": ("metric_depth", filled(depth=3.0)),
    "infinite and unknown depths": ("metric_depth", lambda r: replace(r, depth=holes_in(r.depth))),
    "depths without an error": ("metric_depth", lambda r: replace(r, scale_sigma=0.0)),
    "keypoints in one place": ("keypoint_detector", filled(points=50.0)),
    "no confidence": ("keypoint_detector", filled(confidence=0.0)),
    "shape of 100": ("body_estimator", posed(betas=100.0)),
    "bodies 10 km away": ("body_estimator", posed(transl=1e4)),
    "bodies behind the camera": ("body_estimator", behind_the_camera),
    "hands of 1e20 rad": ("hand_estimator", filled(rotvecs=1e20, confidence=1.0)),
    "contact everywhere": ("contact_prior", filled(probability=1.0)),
    "contact of no vertices": (
        "contact_prior",
        lambda r: replace(r, probability=r.probability[:, :0]),
    ),
}
MISSING = ("hands of 1e20 rad", "contact of no vertices")
"""Outputs that are not used."""
WRITTEN = ("shape of 100",)
"""Results of which every file is written."""


@pytest.mark.parametrize("name", DEVIATIONS)
def test_numbers_of_the_result_are_finite_or_unknown(name, tmp_path):
    interface, change = DEVIATIONS[name]
    mock = MOCKS[interface]

    def infer(self, *arguments):
        return change(mock.infer(self, *arguments))

    image = load_world("stand", size=(96, 72)).image
    with Pipeline(
        CONFIG, backends={interface: type("Deviating", (mock,), {"infer": infer})}
    ) as pipeline:
        result = pipeline(image)
    for person in result.people:
        assert np.isfinite(person.vertices).all()
        assert np.isfinite(person.keypoints[person.keypoint_confidence > 0]).all()
        assert not np.isnan(person.distance).any()
        assert ("no valid values" in person.why.lower()) == (name in MISSING)
    assert np.isfinite(result.scene.points[result.scene.valid]).all()
    assert np.isfinite(result.intrinsics.matrix).all()
    assert result.checks
    if name in WRITTEN:
        write_everything(result, tmp_path)


def write_everything(result, folder):
    result.save(str(folder))
    result.report(str(folder / "report.html"))
    json.loads((folder / "reconstruction.json").read_text(), parse_constant=pytest.fail)
    assert len(Reconstruction.load(str(folder)).people) == len(result.people)
    left_out = {"amass"}  # needs a model file of the user's
    if find_spec("rerun") is None:
        left_out.add("rrd")
    for name in {exporter.record.name for exporter in find_exporters()} - left_out:
        result.export(str(folder / name), name)
