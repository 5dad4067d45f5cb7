"""Settings of stage 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.engine.bounds import Degrees, NotNegative, PositiveOrInfinite, Share

__all__ = ["PlacementSettings"]


@dataclass(frozen=True)
class PlacementSettings:
    """Stage 2: human points in the scene, and the translation of each body (paper Sec. 3.2, Eq. 2-4).

    Attributes:
        method: "robust" minimises means of robust errors by Gauss-Newton steps. "paper" minimises the sums of squares
            of Eq. 2-4 by Adam and L-BFGS, and no body ends farther off its keypoints than it was estimated.
            "released" is the code of the paper: its reprojection loss, visibility and camera-facing angle.
        reprojection_weight: lambda_j2d of Eq. 3.
        chamfer_weight: lambda_d of Eq. 3; 0 stops after Eq. 2.
        min_confidence: keypoints below are ignored.
        seen_confidence: a joint whose keypoint has this confidence and lies on the person's mask is observed, whatever
            the body estimator reports; 1 uses the report alone.
        swapped_sides_deg: the left and right keypoints of a person's arms, or legs, are exchanged where the directions
            from left to right differ by more than this from those of the placed body; 180 exchanges none.
        robust_px_share: scale of the robust reprojection error, as a share of the person's size in the picture; "inf"
            is plain least squares.
        robust_m: scale of the robust Chamfer distance, metres, wider where most points are farther off; "inf" is plain
            least squares.
        depth_offset_sigma: prior of log(depth offset) of a person whose feet stand on a known floor; 0 fixes the human
            points to the scene.
        floor_weight: of the distance of the lower foot to the floor, if the feet stand on a known floor; 0 is off.
        stand_reach_m: if the lower foot of a person, fixed to the scene, is more than this above the floor, the person
            is assumed to be on furniture and not on the floor; 0 disables the test.
    """

    method: Literal["robust", "paper", "released"] = "robust"
    reprojection_weight: NotNegative = 1000.0
    chamfer_weight: NotNegative = 0.6
    min_confidence: Share = 0.3
    seen_confidence: Share = 0.7
    swapped_sides_deg: Degrees = 125.0
    robust_px_share: PositiveOrInfinite = 0.05
    robust_m: PositiveOrInfinite = 0.15
    depth_offset_sigma: NotNegative = 0.2
    floor_weight: NotNegative = 1.0
    stand_reach_m: NotNegative = 0.45

    @property
    def robust(self) -> bool:
        """Whether this is the default method, and not one of the paper's."""
        return self.method == "robust"
