"""A reconstruction as one flat dictionary of numbers, as a row of a table."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from physic_core.types.camera import CameraTrust
from physic_core.types.contacts import PARTNER_KINDS

if TYPE_CHECKING:
    from physic_core.types.records import CheckResult
    from physic_core.types.results import Reconstruction

__all__ = ["SUMMARY_NUMBERS", "summarize"]

SUMMARY_NUMBERS = (
    "people",
    "bodies",
    "width_px",
    "height_px",
    "focal_px",
    "focal_known",
    "floor_found",
    "scene_valid_share",
    "scene_scale",
    "scale_sigma",
    "nearest_person_m",
    "farthest_person_m",
    "contact_vertices",
    "contact_parts",
    *(f"contact_{kind}" for kind in PARTNER_KINDS),
    "failed_checks",
    "unknown_checks",
    "warnings",
    "seconds",
    "load_seconds",
)
"""Keys of every summary; that of a result also has ``check_NAME`` for each self-check."""


def summarize(result: Reconstruction) -> dict[str, float | int | None]:
    """Return the numbers of :meth:`physic_core.types.Reconstruction.summary`."""
    import numpy as np

    camera, scene, checks = result.intrinsics, result.scene, result.checks
    # Results of older versions have no partners.
    known = all(person.contact_partner is not None for person in result.people)
    kinds = [contact.partner.kind for person in result.people for contact in person.contacts]
    distances = [float(p.joints[0, 2]) for p in result.people if len(p.joints) and np.isfinite(p.joints[0]).all()]
    numbers: dict[str, float | int | None] = {
        "people": len(result.people),
        "bodies": len(distances),
        "width_px": camera.width,
        "height_px": camera.height,
        "focal_px": camera.fy,
        "focal_known": int(camera.trust is CameraTrust.KNOWN),
        "floor_found": int(scene.floor is not None),
        "scene_valid_share": float(np.mean(scene.valid)),
        "scene_scale": scene.scale,
        "scale_sigma": scene.scale_sigma,
        "nearest_person_m": min(distances, default=None),
        "farthest_person_m": max(distances, default=None),
        "contact_vertices": sum(int(np.sum(person.contact)) for person in result.people),
        "contact_parts": len(kinds) if known else None,
        **{f"contact_{kind}": kinds.count(kind) if known else None for kind in PARTNER_KINDS},
        "failed_checks": sum(check.failed for check in checks),
        "unknown_checks": sum(not (check.ok or check.failed) for check in checks),
        "warnings": len(result.warnings),
        "seconds": sum(stage.seconds for stage in result.stages),
        "load_seconds": sum(stage.load_seconds for stage in result.stages),
    }
    by_name: dict[str, list[CheckResult]] = defaultdict(list)
    for check in checks:
        by_name[check.name].append(check)
    return numbers | {f"check_{name}": _worst(group) for name, group in by_name.items()}


def _worst(checks: list[CheckResult]) -> float | None:
    """Return the worst value of one check of several people; None if nothing was measured."""
    values = [check.value for check in checks if check.value is not None]
    worst = max if checks[0].direction == "at most" else min
    return worst(values, default=None)
