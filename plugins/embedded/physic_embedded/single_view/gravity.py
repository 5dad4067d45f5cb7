"""Estimate which way is up from the straight edges of a photo or from the tokens of an encoder, and
how surely.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from physic_core.files import read_arrays

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.types import FloatArray
    from physic_embedded.networks.patch_tokens import PatchTokens


NUMBERS = Path(__file__).with_suffix(".npz")
"""Fitted numbers: "angles" (2, 9 C + 1), of pitch and roll in degrees: weights of the tokens of
:func:`mean_tokens_3x3`, and a constant.
"""

PICTURE_SIDE_PX = 252
"""Short side of the picture for these tokens: of panoramas 1024 px round, which the numbers are
fitted to, a crop has 100 to 220 px.
"""

PICTURE_PATCHES = 3600
"""Cap on the patches of 14 px, which only a long panorama reaches."""

# Of 13 rooms with a known vertical 12 have a frame, .7 degrees off (rms) without a known lens. The
# sigmas are rounded up from that, not fitted. Outdoors, frames of trusts up to .74 were wrong:
# there they are one witness of several.
_TRUSTS = (0.3, 0.6, 0.75)  # of frames; sigmas are interpolated between them
_SIGMA_OF_ROOMS_DEG = (5.0, 2.0, 1.2)  # of the vertical of a frame, at these trusts
_SIGMA_OUTDOORS_DEG = (8.0, 6.0, 5.0)  # the same outdoors
_ROOM = -0.2  # open air below which labels are of a room
_MOST_OFF_DEG = 40.0  # vertical from the look; beyond, it may be another direction of the frame
_WRONG = 0.1  # share of frames that are far off: 3 of 18 of panoramas, none of 12 of rooms
_WRONG_RANGE_DEG = 60.0  # of their angles to the look
# Of the look of a picture, in each direction: 108 labelled photos are 8.3 degrees off (rms of the
# angle), a camera's axis 14.4. The share of the tilt that it states is fitted to 42 views of half
# of 25 panoramas: 46 of the others have 1.07 stated errors, 1.70 without it.
_SIGMA_OF_LOOK_DEG = 7.0
_SIGMA_BY_TILT = 0.5


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


def up_from_edges(
    frame: tuple[FloatArray, float] | None, open_air: float, look: UpInPhoto
) -> UpInPhoto | None:
    """Return up by the directions of a room, that which is nearest to the look of the picture; None
    without a trusted one.

    Its error contains that of the others and that of a wrong frame, by how far the look is from
    them.

    Args:
        frame: directions and their trust, see
            :func:`~physic_embedded.single_view.focal.manhattan_frame`.
        open_air: -1 to 1, whether the labels of surfaces are of rooms or of outdoors.
        look: of :func:`up_from_tokens`.
    """
    if frame is None or frame[1] < _TRUSTS[0]:
        return None
    axes, trust = frame
    along = axes @ look.up
    angle_deg = np.degrees(np.arccos(np.clip(np.abs(along), 0, 1)))
    best = angle_deg.argmin()
    if angle_deg[best] >= _MOST_OFF_DEG:
        return None
    by_trust = _SIGMA_OF_ROOMS_DEG if open_air < _ROOM else _SIGMA_OUTDOORS_DEG
    sigma = float(np.interp(trust, _TRUSTS, by_trust))
    square = sigma**2 + look.sigma**2
    likely = (1 - _WRONG) * angle_deg / square * np.exp(-0.5 * angle_deg**2 / square)
    wrong = _WRONG / _WRONG_RANGE_DEG
    contrary = 90.0**2 * (likely.sum() - likely[best]) + wrong * angle_deg[best] ** 2
    sigma = np.hypot(sigma, np.sqrt(contrary / (likely.sum() + wrong)))
    return UpInPhoto(axes[best] * np.sign(along[best]), float(sigma), "edges in three directions")


def up_from_tokens(tokens: PatchTokens, numbers: Mapping[str, FloatArray]) -> UpInPhoto:
    """Return up by the tokens of a picture and the arrays of :data:`NUMBERS`.

    The answer is drawn to a level camera, as that of every regression. It says nothing of the lens.
    """
    weights = numbers["angles"]
    pitch, roll = np.radians(weights[:, :-1] @ mean_tokens_3x3(tokens) + weights[:, -1])
    up = [np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll), -np.sin(pitch)]
    tilt = np.degrees(np.arccos(np.clip(-up[1], -1, 1)))
    sigma = float(np.hypot(_SIGMA_OF_LOOK_DEG, _SIGMA_BY_TILT * tilt))
    return UpInPhoto(np.array(up), sigma, "look of the picture")


def mean_tokens_3x3(tokens: PatchTokens) -> FloatArray:
    """Return the mean tokens (9 C,) of three by three parts of a picture, row by row."""
    shown = tokens.photo_grid
    for axis in (0, 1):
        # sixths, of which two make a part: of few patches, thirds would differ more
        edges = np.linspace(0, shown.shape[axis], 7).round().astype(int)
        sixths = [part.mean(axis, dtype=np.float64) for part in np.split(shown, edges[1:-1], axis)]
        shown = np.stack(sixths, axis)
    return np.asarray(shown.reshape(3, 2, 3, 2, -1).mean((1, 3)).ravel())


@cache
def fitted_numbers() -> Mapping[str, FloatArray]:
    """Return the arrays of :data:`NUMBERS`."""
    with NUMBERS.open("rb") as stream:
        return read_arrays(stream)
