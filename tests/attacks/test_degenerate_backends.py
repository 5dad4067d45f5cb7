"""Numbers of backends at and beyond every bound: refused by the interface, or a complete result."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from degenerate import CONFIG, DEVIATIONS, Deviation, deviating_backends, record
from physic_core import Pipeline, Reconstruction, find_exporters
from physic_core.interfaces import INTERFACES
from physic_testing import violations
from physic_testing.worlds import build_world

REFUSED = [deviation for deviation in DEVIATIONS if deviation.refused]
USED = [deviation for deviation in DEVIATIONS if not deviation.refused]
EXTREME = (  # every file is written of them
    "keypoint_detector-all_in_one_place",
    "body_estimator-betas_of_100",
)


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return build_world("stand", size=(96, 72)).image


@pytest.fixture(scope="module")
def recorded(image: np.ndarray) -> dict[str, list[Any]]:
    return record(image)


def run(deviation: Deviation, image: np.ndarray, recorded: dict[str, list[Any]]) -> Reconstruction:
    with Pipeline(CONFIG, backends=deviating_backends(deviation, recorded)) as pipeline:
        return pipeline(image)


@pytest.mark.parametrize("deviation", REFUSED, ids=str)
def test_the_check_of_the_interface_refuses(
    deviation: Deviation, image: np.ndarray, recorded: dict[str, list[Any]]
) -> None:
    height, width = image.shape[:2]
    result = deviation.change(recorded[deviation.interface][0])
    found = violations(
        INTERFACES[deviation.interface], result, height=height, width=width, people=1
    )
    assert any(deviation.refused in sentence for sentence in found)


@pytest.mark.parametrize("deviation", USED, ids=str)
def test_used_results_give_finite_or_unknown_numbers(
    deviation: Deviation, image: np.ndarray, recorded: dict[str, list[Any]], tmp_path: Path
) -> None:
    result = run(deviation, image, recorded)
    for person in result.people:
        assert np.isfinite(person.vertices).all()
        assert np.isfinite(person.keypoints[person.keypoint_confidence > 0]).all()
        assert not np.isnan(person.distance).any()
        assert ("missing_outputs" in person.failed_checks) == deviation.missing
    assert np.isfinite(result.scene.points[result.scene.valid]).all()
    assert np.isfinite(result.intrinsics.matrix).all()
    assert result.grade is not None
    if str(deviation) in EXTREME:
        assert result.grade != "good"
        write_everything(result, tmp_path)


def write_everything(result: Reconstruction, folder: Path) -> None:
    result.save(str(folder))
    result.report(str(folder / "report.html"))
    json.loads((folder / "reconstruction.json").read_text(), parse_constant=pytest.fail)
    assert len(Reconstruction.load(str(folder)).people) == len(result.people)
    left_out = {"amass"}  # needs a model file of the user's
    if find_spec("rerun") is None:
        left_out.add("rrd")
    for name in {exporter.record.name for exporter in find_exporters()} - left_out:
        result.export(str(folder / name), name)
