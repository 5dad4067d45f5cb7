"""Estimate which way is up from the straight edges of a photo, and how surely."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]

# Of 13 rooms with a known vertical 12 have a frame, .7 degrees off (rms) without a known lens. The
# sigmas are rounded up from that, not fitted. Outdoors, frames of trusts up to .74 were wrong:
# there they are one witness of several.
_TRUSTS = (0.3, 0.6, 0.75)  # of frames; sigmas are interpolated between them
_SIGMA_OF_ROOMS_DEG = (5.0, 2.0, 1.2)  # of the vertical of a frame, at these trusts
_SIGMA_OUTDOORS_DEG = (8.0, 6.0, 5.0)  # the same outdoors
_ROOM = -0.2  # open air below which labels are of a room
_MOST_TILT_DEG = 40.0  # of the vertical; beyond, it may be another direction of the frame
_EDGES_SIGMA_DEG = 5.0  # of upright edges without a frame: 4.7 (rms) in eight rooms


class UpInPhoto(NamedTuple):
    """Up direction (3,) unit in the camera frame, its standard deviation in degrees, and what
    tells it.
    """

    up: FloatArray
    sigma: float
    source: str

    @property
    def pitch(self) -> tuple[float, float]:
        """How far the camera looks down and the standard deviation, degrees."""
        return float(np.degrees(np.arcsin(-self.up[2]))), self.sigma


def up_of_edges(
    frame: tuple[FloatArray, float] | None, pitch: tuple[float, float] | None, open_air: float
) -> UpInPhoto | None:
    """Return up by the directions of a room, without these by upright edges; None without both.

    Args:
        frame: directions and their trust, see
            :func:`~physic_embedded.single_view.focal.manhattan_frame`.
        pitch: how far the camera looks down by upright edges and its standard deviation, degrees.
        open_air: -1 to 1, whether the labels of surfaces are of rooms or of outdoors.
    """
    if frame is not None and frame[1] >= _TRUSTS[0]:
        axes, trust = frame
        vertical = axes[np.abs(axes[:, 1]).argmax()]
        if abs(vertical[1]) > np.cos(np.radians(_MOST_TILT_DEG)):
            by_trust = _SIGMA_OF_ROOMS_DEG if open_air < _ROOM else _SIGMA_OUTDOORS_DEG
            sigma = float(np.interp(trust, _TRUSTS, by_trust))
            return UpInPhoto(-vertical * np.sign(vertical[1]), sigma, "edges in three directions")
    if pitch is None:
        return None
    down = np.radians(pitch[0])
    up = np.array([0.0, -np.cos(down), -np.sin(down)])
    return UpInPhoto(up, float(np.hypot(pitch[1], _EDGES_SIGMA_DEG)), "upright edges")
