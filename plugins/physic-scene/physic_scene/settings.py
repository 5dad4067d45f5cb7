"""Settings of the cameras of several photos."""

from __future__ import annotations

from dataclasses import dataclass, field

from physic_core.types.bounds import Positive, Share
from physic_scene.bundle import BundleSettings
from physic_scene.energy import KeypointSettings
from physic_scene.matching import MatchingSettings


@dataclass(frozen=True)
class FitLimits:
    """Limits of what fits one moment.

    Attributes:
        keypoint: largest median distance of a person's solved keypoints from those of a photo, as a share of the
            stature in px: the bound of ``view_keypoints``. Of 30 pairs of photos of a rig, right matches have up to
            0.032.
    """

    keypoint: Positive = 0.06


@dataclass(frozen=True)
class VerdictSettings:
    """Settings of what counts as a contradiction.

    Attributes:
        inside: least share of a person's keypoints in the frame of a photo that ought to show the person.
        nobody: distance from the nearest person of the photo, as a share of the stature in px, where it shows nobody.
    """

    inside: Share = 0.9
    nobody: Positive = 0.4


@dataclass(frozen=True)
class MomentSettings:
    """Settings of all steps."""

    matching: MatchingSettings = field(default_factory=MatchingSettings)
    bundle: BundleSettings = field(default_factory=BundleSettings)
    fit: FitLimits = field(default_factory=FitLimits)
    keypoints: KeypointSettings = field(default_factory=KeypointSettings)
    verdict: VerdictSettings = field(default_factory=VerdictSettings)
