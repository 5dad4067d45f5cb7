"""Two to eight photos of one moment as one reconstruction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import torch

from physic_core import Pipeline
from physic_core.body import load_body
from physic_core.errors import InputError, NoPersonError
from physic_scene.background import BackgroundSettings
from physic_scene.bundle import BundleSettings
from physic_scene.cameras import FitLimits, solve_cameras
from physic_scene.energy import KeypointSettings
from physic_scene.matching import MatchingSettings
from physic_scene.observations import observe
from physic_scene.people import people_of_scene
from physic_scene.reference import ReferenceInput, solve_reference
from physic_scene.result import assemble
from physic_scene.selection import Photo, select_photos

if TYPE_CHECKING:
    import os
    from collections.abc import Callable
    from typing import Self

    from physic_core import Config, KnownSizes
    from physic_core.types import Intrinsics, Reconstruction
    from physic_scene.types import SceneResult

    PhotoSource = Any
    Progress = Callable[[str, int, int], None]

__all__ = ["Scene", "SceneSettings", "reconstruct_scene"]

FEWEST, MOST = 2, 8
"""Numbers of photos."""


@dataclass(frozen=True)
class SceneSettings:
    """Settings of all steps."""

    matching: MatchingSettings = field(default_factory=MatchingSettings)
    background: BackgroundSettings = field(default_factory=BackgroundSettings)
    bundle: BundleSettings = field(default_factory=BundleSettings)
    fit: FitLimits = field(default_factory=FitLimits)
    keypoints: KeypointSettings = field(default_factory=KeypointSettings)


class Scene:
    """Reconstructs moments from several photos; backends stay loaded between moments.

    Args:
        config: as of :class:`physic_core.Pipeline`: a Config, the name of a preset, the path of a TOML file, or its
            tables. ``engine.preset`` must be "default".
        settings: of matching and cameras.

    Raises:
        PhysicError: as of :class:`physic_core.Pipeline`.
    """

    def __init__(
        self,
        config: Config | Mapping[str, Any] | str | os.PathLike[str] | None = None,
        settings: SceneSettings | None = None,
    ) -> None:
        self._pipeline = Pipeline(config)
        self._settings = settings or SceneSettings()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all backends."""
        self._pipeline.close()

    def __call__(
        self,
        photos: Sequence[PhotoSource],
        *,
        intrinsics: Sequence[Intrinsics | None] | None = None,
        known: KnownSizes | None = None,
        progress: Progress | None = None,
    ) -> SceneResult:
        """Reconstruct one moment.

        Args:
            photos: two to eight photos of the moment, each as for :class:`physic_core.Pipeline`. People may hold still
                between photos.
            intrinsics: camera of each upright photo, px, or None where unknown; None if no camera is known.
            known: sizes that are known in the first photo; its statures give the scale of the scene.
            progress: called when each stage begins.

        Returns:
            Everything in metres in the frame of the reference camera: that of the first photo that shows most people.

        Raises:
            InputError: there are too few or too many photos, or fewer than two show the same people.
            PhysicError: a photo cannot be reconstructed alone; see :class:`physic_core.Pipeline`.
        """
        _check_number(len(photos), intrinsics)
        results = []
        for i, photo in enumerate(photos):
            camera, sizes = None if intrinsics is None else intrinsics[i], known if i == 0 else None
            results.append(self.alone(photo, intrinsics=camera, known=sizes, progress=progress))
        names = [_name(photo, i) for i, photo in enumerate(photos)]
        return self.join(results, names, statures=() if known is None else known.stature, progress=progress)

    def alone(
        self,
        photo: PhotoSource,
        *,
        intrinsics: Intrinsics | None = None,
        known: KnownSizes | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction | None:
        """Reconstruct one photo alone, for :meth:`join`; arguments are those of :class:`physic_core.Pipeline`.

        Returns:
            The result, or None if nobody is in the photo and the config requires people.

        Raises:
            PhysicError: the photo cannot be reconstructed.
        """
        try:
            return self._pipeline(photo, intrinsics=intrinsics, known=known, progress=progress)
        except NoPersonError:
            return None

    def join(
        self,
        results: Sequence[Reconstruction | None],
        names: Sequence[str] | None = None,
        *,
        statures: Sequence[float] = (),
        progress: Progress | None = None,
    ) -> SceneResult:
        """Reconstruct one moment from the results of its photos alone, which this configuration has made.

        Args:
            results: reconstruction of each photo, or None for a photo without people.
            names: of the photos.
            statures: known standing heights, metres: one for all people, or one per person of the first photo from
                left to right, 0 where unknown.
            progress: called when each stage begins.

        Raises:
            InputError: there are too few or too many photos, or fewer than two show the same people.
            PhysicError: the reference photo cannot be reconstructed.
        """
        _check_number(len(results), None)
        step = progress or (lambda name, done, total: None)
        names = list(names) if names is not None else [f"photo {i + 1}" for i in range(len(results))]
        model = load_body(self._pipeline.config.body_model.source).to(dtype=torch.float64)
        step("matching people", 0, 3)
        photos = [
            Photo(i, name, result, observe(result, model))
            for i, (name, result) in enumerate(zip(names, results, strict=True))
            if result is not None
        ]
        chosen = select_photos(photos, names, self._settings.matching, self._settings.background)
        step("cameras", 1, 3)
        solved = solve_cameras(chosen, statures, model, self._settings)
        step("one solution", 2, 3)
        people = people_of_scene(solved, model)
        given = ReferenceInput.of(solved, people, model)
        reconstruction = solve_reference(given, self._pipeline.config, self._settings.keypoints)
        return assemble(solved, people, reconstruction)


def reconstruct_scene(
    photos: Sequence[PhotoSource],
    config: Config | Mapping[str, Any] | str | os.PathLike[str] | None = None,
    *,
    intrinsics: Sequence[Intrinsics | None] | None = None,
    known: KnownSizes | None = None,
    progress: Progress | None = None,
) -> SceneResult:
    """Reconstruct one moment from two to eight photos; for several moments, :class:`Scene` loads backends once.

    Arguments, result and errors are those of :class:`Scene` and its call.
    """
    with Scene(config) as scene:
        return scene(photos, intrinsics=intrinsics, known=known, progress=progress)


def _check_number(count: int, intrinsics: Sequence[object] | None) -> None:
    if not FEWEST <= count <= MOST:
        raise InputError(
            f"a scene needs {FEWEST} to {MOST} photos of one moment, got {count}: choose the clearest ones"
        )
    if intrinsics is not None and len(intrinsics) != count:
        raise InputError(f"give intrinsics for each of the {count} photos, None where unknown, got {len(intrinsics)}")


def _name(photo: object, index: int) -> str:
    """Return the file name of a photo, or its number."""
    from pathlib import Path

    return Path(photo).name if isinstance(photo, str | Path) else f"photo {index + 1}"
