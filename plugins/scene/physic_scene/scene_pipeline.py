"""Two to eight photos of one moment as one reconstruction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch

from physic_core import Pipeline
from physic_core.body import load_body
from physic_core.errors import ConfigError, InputError, NoPersonError
from physic_core.types import KnownSizes
from physic_scene.calibration import KnownCamera
from physic_scene.energy import require_default_engine
from physic_scene.people import people_of_scene
from physic_scene.photos import ScenePhoto, choose_photos, skipped_photo
from physic_scene.reference import ReferenceInput, solve_reference
from physic_scene.result import assemble
from physic_scene.solution import solve_scene

if TYPE_CHECKING:
    import os
    from collections.abc import Callable
    from typing import Self

    from physic_core import Config
    from physic_core.types import FloatArray, Reconstruction
    from physic_scene.types import SceneResult

    PhotoSource = Any
    Progress = Callable[[str, int, int], None]

FEWEST = 2
MOST = 8
"""Numbers of photos."""


class ScenePipeline:
    """Reconstructs moments from several photos; backends stay loaded between moments.

    Args:
        config: as of :class:`physic_core.Pipeline`: a Config, the name of a preset, the path of a
            TOML file, or its tables. ``engine.preset`` must be "default".

    Raises:
        ConfigError: ``engine.preset`` is not "default".
        PhysicError: as of :class:`physic_core.Pipeline`.
    """

    def __init__(
        self, config: Config | Mapping[str, Any] | str | os.PathLike[str] | None = None
    ) -> None:
        self._pipeline = Pipeline(config)
        require_default_engine(self._pipeline.config.engine.settings())

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
        cameras: Sequence[KnownCamera | None] | None = None,
        known: KnownSizes | None = None,
        settings: Sequence[Mapping[str, Any]] | None = None,
        progress: Progress | None = None,
    ) -> SceneResult:
        """Reconstruct one moment.

        Args:
            photos: two to eight photos of the moment, each as for :class:`physic_core.Pipeline`.
                People may hold still between photos.
            cameras: calibrated camera of each photo, or None where unknown; None if no camera is
                known. Poses of two or more stay as they are, and give the scale.
                :func:`physic_scene.read_calibration` reads files.
            known: sizes that are known in the first photo; its statures give the scale of the
                scene. One age or stature is that of all people of all photos; several statures are
                those of the people of the first photo from left to right. For people of several
                ages, use :meth:`reconstruct_photo` with those of each photo, and
                :meth:`join_photos`.
            settings: of each photo, other values in the table ``[photo]`` of the config, such as
                files of ``bodies`` and ``masks``.
            progress: called when each stage begins.

        Returns:
            Everything in metres in the frame of the reference camera: that of the photo that shows
                most people. It is
            one of known pose if there are any.

        Raises:
            ConfigError: there are too few or too many photos, or several ages are given.
            InputError: fewer than two photos show the same people, or known poses are not in
                metres.
            PhysicError: a single photo cannot be reconstructed; see :class:`physic_core.Pipeline`.
        """
        _check_number(len(photos), cameras=cameras, settings=settings)
        known = known or KnownSizes()
        names = _unique_names([_photo_name(photo, i) for i, photo in enumerate(photos)])
        if len(known.age) > 1:
            raise ConfigError(
                "one age is that of all people of a moment: for several, give those of each photo "
                "to ScenePipeline.reconstruct_photo, and its results to join_photos"
            )
        stature = known.stature if len(known.stature) == 1 else ()
        others = KnownSizes(stature=stature, age=known.age)
        calibrated = [None] * len(photos) if cameras is None else list(cameras)
        photo_settings = [{}] * len(photos) if settings is None else settings
        results = [
            self.reconstruct_photo(
                photo,
                camera=camera,
                known=(others if i else known) or None,
                settings=photo_settings[i],
                progress=progress,
            )
            for i, (photo, camera) in enumerate(zip(photos, calibrated, strict=True))
        ]
        poses = [None if camera is None else camera.pose for camera in calibrated]
        return self.join_photos(
            results, names, statures=known.stature, poses=poses, progress=progress
        )

    def reconstruct_photo(
        self,
        photo: PhotoSource,
        *,
        camera: KnownCamera | None = None,
        known: KnownSizes | None = None,
        settings: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction | None:
        """Reconstruct a single photo, for :meth:`join_photos`; other arguments are those of
        :class:`physic_core.Pipeline`.

        Args:
            photo: as of :meth:`__call__`.
            camera: of the upright photo file; its pose is not used.
            known: sizes.
            settings: other values in the table ``[photo]``, as of :meth:`__call__`.
            progress: called when each stage begins.

        Returns:
            The result, or None if the config requires people and the photo shows none.

        Raises:
            PhysicError: the photo cannot be reconstructed.
        """
        camera_intrinsics = None if camera is None else camera.lens.intrinsics
        values = dict(settings or {})
        if camera is not None and camera_intrinsics is not None and any(camera.lens.distortion):
            values["intrinsics"] = [
                camera_intrinsics.fx,
                camera_intrinsics.fy,
                camera_intrinsics.cx,
                camera_intrinsics.cy,
            ]
            values["distortion"] = list(camera.lens.distortion)
        try:
            return self._pipeline(
                photo, intrinsics=camera_intrinsics, known=known, settings=values, progress=progress
            )
        except NoPersonError:
            return None

    def join_photos(
        self,
        results: Sequence[Reconstruction | None],
        names: Sequence[str] | None = None,
        *,
        statures: Sequence[float] = (),
        poses: Sequence[FloatArray | None] | None = None,
        progress: Progress | None = None,
    ) -> SceneResult:
        """Reconstruct one moment from the results of its single photos, which this configuration
        has made.

        Args:
            results: reconstruction of each photo, or None for a photo without people.
            names: of the photos.
            statures: known standing heights, metres: one for all people, or one per person of the
                first photo from left to right, 0 where unknown.
            poses: (4, 4) of each camera to a calibrated rig, metres, or None where unknown; None if
                none is known. The results have the intrinsics of the same calibration.
            progress: called when each stage begins.

        Raises:
            InputError: there are too few or too many photos, fewer than two show the same people,
                or known poses are not in metres.
            PhysicError: the reference photo cannot be reconstructed.
        """
        _check_number(len(results), poses=poses)
        progress = progress or (lambda name, done, total: None)
        names = _unique_names(
            names if names is not None else [f"photo {i + 1}" for i in range(len(results))]
        )
        poses = poses or [None] * len(results)
        progress("cameras", 1, 3)
        model = load_body(self._pipeline.config.body_model.source).to(dtype=torch.float64)
        several = len(statures) > 1
        photos = [
            ScenePhoto.of(
                i, names[i], result, model, statures if i == 0 or not several else (), poses[i]
            )
            for i, result in enumerate(results)
            if result is not None
        ]
        empty = [
            skipped_photo(i, name, "no people", "no person was found in it")
            for i, name in enumerate(names)
            if results[i] is None
        ]
        solved = solve_scene(choose_photos(photos, empty), model)
        if several and solved.photos[0].index:
            why = next(one.message for one in solved.left_out if one.index == 0)
            raise InputError(
                f"the statures are those of people of the first photo, but {why}; put another "
                f"photo first"
            )
        progress("one solution", 2, 3)
        people = people_of_scene(solved, model)
        reconstruction = solve_reference(
            ReferenceInput.of(solved, people, model), self._pipeline.config
        )
        return assemble(solved, people, reconstruction)


def _check_number(count: int, **of_photos: Sequence[object] | None) -> None:
    if not FEWEST <= count <= MOST:
        cure = (
            "choose the clearest ones"
            if count > MOST
            else "add others; `physic run` takes one photo"
        )
        raise ConfigError(
            f"a scene needs {FEWEST} to {MOST} photos of one moment, got {count}: {cure}"
        )
    for name, values in of_photos.items():
        if values is not None and len(values) != count:
            raise ConfigError(
                f"give {name} for each of the {count} photos, None where unknown, got {len(values)}"
            )


def _unique_names(names: Sequence[str]) -> list[str]:
    """Return the names of photos, such as files of two folders, with the numbers of those of the
    same name.
    """
    return [
        f"{name} (photo {i + 1})" if names.count(name) > 1 else name for i, name in enumerate(names)
    ]


def _photo_name(photo: object, index: int) -> str:
    """Return the file name of a photo, or its number."""
    from pathlib import Path

    return Path(photo).name if isinstance(photo, str | Path) else f"photo {index + 1}"
