"""Cameras from matched pixels of the background, by LightGlue (Lindenberger et al. 2023) with DISK (Tyszkiewicz 2020).

Pixels of people do not take part. The essential matrices of pairs of photos are chained, people found by where their
keypoints' rays meet give the scale, and a bundle adjustment takes both. Accuracy with the published weights was not
measured.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import cv2
import numpy as np
import torch
from pydantic import Field

from physic_cameras.disk_lightglue import DiskLightGlue
from physic_cameras.pairs import PairSettings, chained, known_link, link
from physic_cameras.people import shown_people
from physic_cameras.solution import Evidence, PhotoWithStart, SolverOptions, focal_sigmas, skipped_photo, solved
from physic_core import weights
from physic_core.adapters.devices import check_device
from physic_core.body import load_body
from physic_core.errors import BackendError, InputError
from physic_core.interfaces import CameraSolver, Options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from physic_cameras.bundle import CalibratedRig, Matches
    from physic_cameras.disk_lightglue import Features, Matcher
    from physic_cameras.people import ShownPeople
    from physic_core.types import FloatArray, MomentView, SolvedCameras

MANIFEST = Path(__file__).parent / "weights"
"""Folder with the manifests of this plugin's weights."""


class LightGlueOptions(SolverOptions):
    """Settings of :class:`LightGlueCameras`."""

    weights: str = Field(
        default="disk-lightglue",
        description="a name of `physic weights list`, or a folder with depth-save.pth and disk_lightglue.pth",
    )
    longest_px: int = Field(default=1024, ge=64, le=8192, description="photos are reduced to this longer side")
    features: int = Field(default=2048, ge=50, le=20_000, description="most features of a photo")
    margin: int = Field(default=5, ge=0, le=1000, description="px round each person that do not count as background")
    pairs: PairSettings = Field(PairSettings(), description="essential matrices of pairs of photos")


class LightGlueCameras(CameraSolver):
    """Matches the background of the photos, and solves cameras from it."""

    Options: ClassVar[type[Options]] = LightGlueOptions
    options: LightGlueOptions
    cacheable: ClassVar[bool] = False  # its input is as large as the photos

    _matcher: Matcher | None = None

    def missing(self) -> tuple[str, ...]:
        """Describe the missing weights, and how to get them."""
        return weights.missing(MANIFEST, self.options.weights)

    def fingerprint(self) -> str:
        """Return the identity of the weights, independent of their path."""
        return weights.fingerprint(MANIFEST, self.options.weights)

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there.
            BackendError: a file is not that of its network.
        """
        check_device(device)
        if self._matcher is None:
            folder = weights.locate(MANIFEST, self.options.weights)
            self._matcher = DiskLightGlue(
                folder, device, longest_px=self.options.longest_px, features=self.options.features
            )

    def close(self) -> None:
        """Release the networks."""
        self._matcher = None

    def infer(self, photos: tuple[MomentView, ...]) -> SolvedCameras:
        """Solve the cameras of V photos in one metric frame.

        Raises:
            BackendError: ``load`` was not called.
            InputError: no two photos share background and people.
        """
        if self._matcher is None:
            raise BackendError("LightGlueCameras is not loaded: call load() before infer()")
        model = load_body("embedded").to(dtype=torch.float64)
        people = [shown_people(view, model) for view in photos]
        features = [_background(self._matcher.features(view.image), view, self.options.margin) for view in photos]
        pixels = {}
        for a, b in itertools.combinations(range(len(photos)), 2):
            if photos[a].pose is None or photos[b].pose is None:
                found = self._matcher.match(features[a], features[b])
                pixels[a, b] = np.stack([features[a].pixels[found[:, 0]], features[b].pixels[found[:, 1]]], axis=1)
        order, cameras, matches = self._best(photos, people, pixels)
        counts = {f"{photos[a].name}, {photos[b].name}": len(found) for (a, b), found in pixels.items()}
        skipped = [
            skipped_photo(v, view, "other background", "its background and people are not those of the other photos")
            if len(people[v])
            else skipped_photo(v, view, "no people", "no person in it has a body")
            for v, view in enumerate(photos)
            if v not in order
        ]
        used = [PhotoWithStart(v, photos[v], people[v]) for v in order]
        return solved(photos, used, Evidence(cameras, matches), skipped, self.options, {"matched_pixels": counts})

    def _best(
        self, photos: Sequence[MomentView], people: Sequence[ShownPeople], pixels: Mapping[tuple[int, int], FloatArray]
    ) -> tuple[list[int], CalibratedRig, Matches]:
        """Return the photos of the best tree, their cameras, and their matches.

        Essential matrices need focal lengths: those of the photos, and all shorter or longer by their standard
        deviations. The best solution has most photos, and most matches that fit it.

        Raises:
            InputError: no two photos share background and people.
        """
        found = []
        for log_focal in np.array([[0.0], [-1.0], [1.0]]) * focal_sigmas(photos):
            links = {}
            for a, b in itertools.combinations(range(len(photos)), 2):
                pair, focal = ((photos[a], photos[b]), (people[a], people[b])), log_focal[[a, b]]
                if (a, b) not in pixels:
                    links[a, b] = known_link(*pair[0])
                elif one := link(pixels[a, b], *pair, focal, self.options.pairs, self.options.people):
                    links[a, b] = one
            if links:
                found.append(chained(links, photos, log_focal, self.options.bundle))
        if not found:
            raise InputError(
                f"no two of the photos {', '.join(view.name for view in photos)} show the same background and the same "
                "people: give photos whose backgrounds overlap, or the solver 'people', which needs no background"
            )
        bound = self.options.bundle.outlier
        return max(found, key=lambda one: (len(one[0]), int((np.abs(one[2].errors(one[1])) < bound).sum())))


def _background(features: Features, view: MomentView, margin: int) -> Features:
    """Return the features that lie on no person."""
    people = view.people.masks.any(axis=0).astype(np.uint8)
    near = cv2.dilate(people, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8))
    columns, rows = features.pixels.round().astype(int).T
    height, width = near.shape
    return features.where(near[rows.clip(0, height - 1), columns.clip(0, width - 1)] == 0)
