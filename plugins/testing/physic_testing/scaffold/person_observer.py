"""Observations independent of the photo: half of all feet touch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from pydantic import Field

from physic_core.interfaces import Options, PersonObserver
from physic_core.types import Observations

if TYPE_CHECKING:
    from physic_core.types import Intrinsics, Keypoints, People, UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    share: float = Field(
        0.5, gt=0, lt=1, description="share of the feet that touch in the data of the fit"
    )


class Template(PersonObserver):
    """Returns for all feet the share that touches, which is no evidence, and nothing else."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    def infer(
        self, image: UInt8Array, people: People, keypoints: Keypoints, intrinsics: Intrinsics
    ) -> Observations:
        """N people with keypoints -> probabilities (N, ...); NaN for what is not said."""
        unknown = Observations.unknown(len(people))
        touch, share = unknown.touch.copy(), unknown.touch_share.copy()
        touch[:, :2] = share[:2] = (self.options.share, 0, 0, 0, 1 - self.options.share)
        return replace(unknown, touch=touch, touch_share=share)
