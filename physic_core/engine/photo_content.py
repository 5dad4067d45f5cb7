"""What one photo shows before its bodies are estimated. OpenCV camera frame, pixels, any unit.

Numbers of people stay arrays, and pixels become tensors, once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.up import Up, slope_sigma, stored_up
from physic_core.geometry.tensors import tensor
from physic_core.types.arrays import PER_PERSON
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import (
        AffineAmbiguity,
        Intrinsics,
        Keypoints,
        Observations,
        People,
        Pointmap,
    )
    from physic_core.types.known_sizes import KnownPeople


FEWEST_PIXELS = 10
"""Fewest pixels of a region whose depth, labels or ground count."""


@dataclass(frozen=True)
class PixelPoints(ShortRepr):
    """A point map as tensors on the CPU.

    Attributes:
        points: (H, W, 3).
        valid: (H, W) bool.
        unknown: transformation from these points to metric ones.
    """

    points: Tensor
    valid: Tensor
    unknown: AffineAmbiguity

    @classmethod
    def of(cls, pointmap: Pointmap) -> PixelPoints:
        """Return the points of a point map of a backend."""
        return cls(tensor(pointmap.points), tensor(pointmap.valid), pointmap.unknown)

    @property
    def depth(self) -> Tensor:
        """Depth (H, W) along z; NaN where it is not valid."""
        return torch.where(self.valid, self.points[..., 2], torch.nan)


@dataclass(frozen=True)
class PhotoContent(ShortRepr):
    """What one photo shows of N people and their scene.

    Attributes:
        people: masks, scores and labels of surfaces.
        keypoints: of the people.
        observations: what the people do; NaN if no backend was configured, or if it failed.
        known: what the user knows of the people.
        camera: of the photo.
        hole: (H, W) bool, inpainted pixels: those of the people and what they hold.
        scene_map: relative point map of the photo without its people.
        photo_map: relative point map of the photo with its people.
        aligned_map: the same in the unit of the scene, to which it is aligned outside the people.
    """

    people: People = field(metadata=PER_PERSON)
    keypoints: Keypoints = field(metadata=PER_PERSON)
    observations: Observations = field(metadata=PER_PERSON)
    known: KnownPeople = field(metadata=PER_PERSON)
    camera: Intrinsics
    hole: Tensor
    scene_map: Pointmap
    photo_map: Pointmap
    aligned_map: Pointmap

    @cached_property
    def masks(self) -> Tensor:
        """Visible pixels (N, H, W) bool of each person."""
        return tensor(self.people.masks)

    @cached_property
    def scene_points(self) -> PixelPoints:
        """Points of the photo without its people."""
        return PixelPoints.of(self.scene_map)

    @cached_property
    def photo_points(self) -> PixelPoints:
        """Points of the photo with its people."""
        return PixelPoints.of(self.photo_map)

    @cached_property
    def aligned_points(self) -> PixelPoints:
        """The same in the unit of the scene."""
        return PixelPoints.of(self.aligned_map)

    @cached_property
    def up_without_floor(self) -> Up | None:
        """Up by other evidence than the floor; None without any."""
        return stored_up(self.scene_map)

    @property
    def slope_sigma_deg(self) -> float:
        """Standard deviation of the floor's normal from up, degrees."""
        return slope_sigma(self.people.surfaces)

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the labels of surfaces; "unknown" alone without labels."""
        surfaces = self.people.surfaces
        return ("unknown",) if surfaces is None else surfaces.names

    @cached_property
    def labels(self) -> Tensor:
        """Labels (H, W) int64 of surfaces, indices into their names."""
        surfaces = self.people.surfaces
        if surfaces is None:
            return torch.zeros(self.hole.shape, dtype=torch.int64)
        return tensor(surfaces.labels).long()

    def labelled(self, *names: str) -> Tensor:
        """Return the pixels (H, W) bool with one of some labels; none without labels."""
        return torch.tensor([name in names for name in self.label_names])[self.labels]
