"""The kit over everything that is installed."""

from __future__ import annotations

from typing import Any

import pytest

from physic_core.discovery.plugins import discover
from physic_testing import check_backend
from physic_testing.conformance.backend_under_test import OptionsFor
from physic_testing.conformance.cases import SIZE

CLAIMS = [claim for claim in discover() if not claim.problem]

# Contracts do not depend on how much a network sees: small inputs, one look and one thread are enough.
OPTIONS: dict[tuple[str, str], OptionsFor] = {
    ("segmenter", "embedded"): {"tile_fractions": [], "threads": 1},
    ("relative_pointmap", "embedded"): {"short_side": 154, "threads": 1},
    ("inpainter", "embedded"): {"threads": 1},
    ("keypoint_detector", "embedded"): {"threads": 1},
    ("hand_estimator", "embedded"): {"threads": 1},
}

# The checks of these interfaces hold on small photos too; the others need people of some size.
SIZES = dict.fromkeys(("inpainter", "relative_pointmap", "body_estimator"), (160, 120))


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.record.interface}-{c.record.name}")
def test_an_installed_backend_does_what_its_interface_promises(claim: Any):
    key = (claim.record.interface, claim.record.name)
    report = check_backend(
        f"{claim.origin.distribution}:{claim.record.name}",
        claim.record.interface,
        options=OPTIONS.get(key),
        size=SIZES.get(claim.record.interface, SIZE),
    )
    print(report.summary)
    if report.not_run_reason and not report.failures:
        pytest.skip(report.not_run_reason)
    assert report.ok, report.text
