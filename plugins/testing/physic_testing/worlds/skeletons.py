"""Skeletons of the keypoints that each world stores."""

from __future__ import annotations

from physic_core.types import SIDES, Skeleton
from physic_core.types import SKELETONS as STANDARD

__all__ = ["BLAZEPOSE", "SKELETONS"]

_SHARES = (
    *(("hip", "same knee", 0.06), ("hip", "other hip", 0.08), ("ankle", "same knee", 0.10)),
    *(("shoulder", "other shoulder", 0.055), ("shoulder", "same hip", -0.055)),
    *(
        ("heel", "same ankle", 0.16),
        ("foot_tip", "same heel", 0.085),
        ("foot_tip", "same ankle", 0.26),
    ),
    *(("ear_surface", "nose", 0.14), ("eye_surface", "nose", 0.05)),
    *(
        ("pinky1", "same wrist", 0.23),
        ("index1", "same wrist", 0.21),
        ("thumb2", "same wrist", 0.12),
    ),
)
"""Calibration of BlazePose: body point, point towards which the network shifts it, and share of the
way.

It is part of the definition of the worlds: a new calibration of a detector does not change it.
"""


def _on_body() -> dict[str, dict[str, float]]:
    places: dict[str, dict[str, float]] = {}
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        for point, towards, share in _SHARES:
            end = towards.replace("same ", f"{side}_").replace("other ", f"{other}_")
            places.setdefault(f"{side}_{point}", {})[end] = share
    return places


BLAZEPOSE = Skeleton(
    "blazepose33",
    STANDARD["blazepose33"].names,
    on_body=_on_body(),
    weights={f"{side}_hip": 0.5 for side in SIDES},
)
"""BlazePose's 33 keypoints, at the shifted positions that the network predicts."""

SKELETONS: dict[str, Skeleton] = {
    skeleton.name: skeleton for skeleton in (STANDARD["coco17"], STANDARD["coco23"], BLAZEPOSE)
}
"""Skeleton name -> skeleton, for ``World.keypoints`` and ``World.visible``."""
