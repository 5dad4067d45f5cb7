"""A small result with two people, a floor, a lens, checks and stages."""

from __future__ import annotations

from dataclasses import replace

from physic_core.types import CheckResult, Lens, Reconstruction, UnposedPerson
from tests.conftest import make_reconstruction


def tiny_result(seed: int = 0) -> Reconstruction:
    """Return a result of 16 x 12 px; another seed gives a larger picture and other numbers."""
    made = make_reconstruction(16 + seed, 12)
    return replace(
        made,
        diagnostics={"joint": {"seed": seed}},
        checks=(
            CheckResult("floor", "ok", 0.4, 0.15, "at least", "share", "of the pixels"),
            CheckResult("lean", "unknown", None, 12.0, "at most", "deg", "no floor", 0),
        ),
        photo="pixels-sha256:0",
        lens=Lens(made.intrinsics, (0.1, -0.01, 0.0, 0.0, 0.0)),
        unposed=(UnposedPerson((1.0, 1.0, 3.0, 4.0), 0.5, "no pose fits the box"),),
    )
