"""The kit over everything that is installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from physic_core.interfaces import INTERFACES
from physic_core.plugins import discover
from physic_core.testing import check_backend
from physic_core.testing.conformance.subject import OptionsFor

CLAIMS = [claim for claim in discover() if not claim.problem]


def pointed(world: Any) -> Mapping[str, Any]:
    """Boxes of the people of a world: GrabCut finds nobody by itself."""
    return {"boxes": world.boxes.tolist()}


# Contracts do not depend on how much a network sees: small inputs, one look and one thread are enough.
OPTIONS: dict[tuple[str, str], OptionsFor] = {
    ("segmenter", "grabcut"): pointed,
    ("segmenter", "embedded"): {"tile_fractions": [], "threads": 1},
    ("relative_pointmap", "embedded"): {"short_side": 154, "threads": 1},
    ("inpainter", "embedded"): {"threads": 1},
    ("keypoint_detector", "embedded"): {"threads": 1},
    ("hand_estimator", "embedded"): {"threads": 1},
}

_UNCHECKED = {"refuses_what_is_no_photo": "takes any array for a photo"}
_VIEWS = {"takes_views": "hands parameters to torch as they come"}
KNOWN: dict[tuple[str, str], dict[str, str]] = {
    (interface, "embedded"): _UNCHECKED | (_VIEWS if interface in ("metric_depth", "contact_prior") else {})
    for interface in INTERFACES
}
"""Backend -> checks that it is known to fail, and why; one that passes fails the test."""


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.record.interface}-{c.record.name}")
def test_an_installed_backend_does_what_its_interface_promises(claim: Any):
    key = (claim.record.interface, claim.record.name)
    report = check_backend(
        f"{claim.origin.distribution}:{claim.record.name}",
        claim.record.interface,
        options=OPTIONS.get(key),
        expected_failures=KNOWN.get(key),
    )
    print(report.summary)
    if report.not_asked and not report.failures:
        pytest.skip(report.not_asked)
    assert report.ok, report.text
