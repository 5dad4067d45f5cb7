"""The mock's keypoints in the larger joint sets pass the kit too."""

from __future__ import annotations

import pytest

from physic_testing.conformance import check_backend


@pytest.mark.parametrize("skeleton", ["coco_wholebody133", "halpe26"])
def test_the_kit_passes_in(skeleton: str) -> None:
    report = check_backend("mock", "keypoint_detector", options={"skeleton": skeleton})
    report.raise_if_failed()
    print(report.summary, report.accuracy)
    assert report.accuracy["share of person"] < 0.03
