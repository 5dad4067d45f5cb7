"""The kit over everything that is installed."""

from __future__ import annotations

import pytest

from physic_core import list_backends
from physic_testing import check_backend
from physic_testing.conformance.cases import SIZE

pytestmark = pytest.mark.slow

# Contracts do not depend on how much a network sees: small inputs, one look and one thread are
# enough.
OPTIONS = {
    ("segmenter", "embedded"): {"tile_fractions": [], "threads": 1},
    ("relative_pointmap", "embedded"): {"short_side": 154, "threads": 1},
    ("inpainter", "embedded"): {"threads": 1},
    ("keypoint_detector", "embedded"): {"threads": 1},
    ("hand_estimator", "embedded"): {"threads": 1},
    ("person_observer", "embedded"): {"short_side": 154, "threads": 1},
}

SMALL = (160, 120)
ON_SMALL_PHOTOS = ("inpainter", "relative_pointmap", "body_estimator")
"""Interfaces whose checks hold on small photos of any network; the others need people of some size,
or the truth.
"""


@pytest.mark.parametrize(
    "offer", list_backends(), ids=lambda offer: f"{offer.interface}-{offer.name}"
)
def test_an_installed_backend_does_what_its_interface_promises(offer):
    report = check_backend(
        f"{offer.distribution}:{offer.name}",
        offer.interface,
        options=OPTIONS.get((offer.interface, offer.name)),
        size=SMALL
        if offer.interface in ON_SMALL_PHOTOS or offer.distribution == "metricbody-testing"
        else SIZE,
    )
    print(report.summary)
    if report.not_run_reason and not report.failures:
        pytest.skip(report.not_run_reason)
    assert report.ok, report.text
