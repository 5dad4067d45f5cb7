"""Interface CameraSolver: cameras of several photos of one moment, and who is who in them."""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from physic_core.interfaces.backend import Backend, BaseRequest
from physic_core.interfaces.checks import check_array, check_camera, check_limit, check_notes, check_sigma, within
from physic_core.interfaces.limits import METRES
from physic_core.types import SolvedCameras

if TYPE_CHECKING:
    from physic_core.types import MomentView, UInt8Array

_ORTHONORMAL = 1e-3  # largest deviation of R R^T from the identity
_KNOWN_POSE_M = 1e-3  # largest deviation of a known translation


@dataclass(frozen=True)
class CameraSolverRequest(BaseRequest[SolvedCameras]):
    """Input of a CameraSolver: V photos of one moment, two at least, with what each shows alone."""

    photos: tuple[MomentView, ...]

    @property
    def images(self) -> tuple[UInt8Array, ...]:
        """The images of all photos."""
        return tuple(photo.image for photo in self.photos)


class CameraSolver(Backend):
    """Solves the cameras of several photos of one moment, and finds who is who (paper: none; HSfM).

    Optional: a single photo neither constructs nor calls it. Bodies, keypoints and intrinsics of each photo are those
    of the other backends; a solver need not look at the pixels.
    """

    interface = "camera_solver"
    api = 1
    Request = CameraSolverRequest
    Result = SolvedCameras
    sees = "moment"

    @abstractmethod
    def infer(self, photos: tuple[MomentView, ...]) -> SolvedCameras:
        """Solve the cameras of V photos in one metric frame, that of the reference camera.

        The photos are of one moment because the user says so: doubts belong into sigmas and notes. A photo that cannot
        be joined is listed in ``skipped``. Raise InputError if no two photos share a person.

        Photos with a known ``pose`` keep the motion between them, and their intrinsics. Two of them give the scale;
        otherwise known ``statures`` do, and without these the bodies.

        Example: photo 0 sees a pelvis at (0, 0, 4). Camera 1 stands 4 m to the right of it, at (4, 0, 4), and looks
        left: its x axis points along z of the reference, its z axis along -x. Then ``rotation[1]`` is
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], ``translation[1]`` is (-4, 0, 4), and photo 1 sees the pelvis at (0, 0, 4),
        too. If this person is row 0 of photo 0 and row 2 of photo 1, ``people`` is [[0, 2]].
        """

    @classmethod
    def check(cls, result: SolvedCameras, request: CameraSolverRequest) -> Iterator[str]:
        """Check poses, cameras and sigmas of the photos in the solution, and the rows and points of P people."""
        views = len(request.photos)
        # A photo without people has no skeleton of its own.
        joints = next((photo.keypoints.points.shape[1] for photo in request.photos if len(photo.people)), 0)
        people = len(result.people) if getattr(result.people, "ndim", 0) else 0
        wrong = [
            *check_array("rotation", result.rotation, (views, 3, 3), "float"),
            *check_array("translation", result.translation, (views, 3), "float"),
            *check_array("rotation_sigma", result.rotation_sigma, (views,), "float"),
            *check_array("position_sigma", result.position_sigma, (views,), "float"),
            *check_array("points", result.points, (people, joints, 3), "float"),
            *_check_rows("people", result.people, request.photos),
            *(() if result.moved is None else _check_rows("moved", result.moved, request.photos)),
        ]
        if len(result.intrinsics) != views:
            wrong.append(f"intrinsics must be those of the {views} photos, got {len(result.intrinsics)}")
        if not 0 <= result.reference < views:
            wrong.append(f"reference must be the index of a photo, 0 to {views - 1}, got {result.reference!r}")
        yield from wrong
        yield from check_notes(result.notes)
        if result.scale_sigma is not None:
            yield from check_sigma("scale_sigma", result.scale_sigma)
        if not wrong:
            yield from _check_values(result, request)


def _check_rows(name: str, rows: Any, photos: tuple[MomentView, ...]) -> Iterator[str]:
    """Check the rows (P, V) of people in photos."""
    count = len(rows) if getattr(rows, "ndim", 0) else 0
    dtype = str(getattr(rows, "dtype", "int64"))
    wrong = list(check_array(name, rows, (count, len(photos)), dtype if dtype.startswith("int") else "int64"))
    yield from wrong
    if wrong:
        return
    for v, photo in enumerate(photos):
        used = rows[:, v][rows[:, v] >= 0]
        if (rows[:, v] < -1).any() or (used >= len(photo.people)).any():
            found = rows[:, v].tolist()
            yield f"{name} must be rows of the {len(photo.people)} people of photo {v}, or -1, got {found}"
        elif len(set(used.tolist())) < len(used):
            yield f"{name} must not have one row of photo {v} for two people, got {rows[:, v].tolist()}"
    if count and ((rows >= 0).sum(1) < 2).any():
        yield f"{name} must show everybody in at least 2 photos"


def _check_values(result: SolvedCameras, request: CameraSolverRequest) -> Iterator[str]:
    """Check the numbers of a result whose shapes are right."""
    import numpy as np

    skipped = {one.index for one in result.skipped}
    kept = [v for v in range(len(request.photos)) if v not in skipped]
    if result.reference in skipped or len(kept) < 2:
        yield f"two photos and the reference must be in the solution, skipped are {sorted(skipped)}"
        return
    if not len(result.people):
        yield "people must have at least one person: raise InputError if no two photos share anybody"
    if sorted(skipped) and (result.people[:, sorted(skipped)] >= 0).any():
        yield f"people must be -1 in the skipped photos {sorted(skipped)}"
    yield from check_limit("translation", result.translation[kept], METRES, "m")
    if not (within(result.points, METRES) | np.isnan(result.points)).all():
        yield f"points must lie within +-{METRES:g} m, or be NaN where unknown"
    for v in kept:
        rotation = result.rotation[v]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not (off < _ORTHONORMAL and np.linalg.det(rotation) > 0):
            yield f"rotation of photo {v} must be a rotation matrix, its R R^T is {off:.2g} off the identity"
        image = request.photos[v].image
        camera = result.intrinsics[v]
        if camera is None:
            yield f"intrinsics of photo {v} must not be None"
        yield from (f"photo {v}: {text}" for text in check_camera(camera, *image.shape[:2]))
        for name in ("rotation_sigma", "position_sigma"):
            sigma = float(getattr(result, name)[v])
            if not 0 <= sigma <= METRES:
                yield f"{name} of photo {v} must be a number from 0 to {METRES:g}, got {sigma!r}"
    yield from _check_known_poses(result, request, kept)
    own = result.rotation[result.reference], result.translation[result.reference]
    if max(np.abs(own[0] - np.eye(3)).max(), np.abs(own[1]).max()) > _ORTHONORMAL:
        yield "the pose of the reference camera must be the identity: the frame is its own"


def _check_known_poses(result: SolvedCameras, request: CameraSolverRequest, kept: list[int]) -> Iterator[str]:
    """Check that photos of known pose have the motion between them that is known."""
    import numpy as np

    known = {v: pose for v in kept if (pose := request.photos[v].pose) is not None}
    for a, b in itertools.pairwise(known):
        given = np.linalg.inv(known[b]) @ known[a]
        rotation = result.rotation[b] @ result.rotation[a].T
        translation = result.translation[b] - rotation @ result.translation[a]
        turned, away = np.abs(rotation - given[:3, :3]).max(), np.abs(translation - given[:3, 3]).max()
        if not (turned < _ORTHONORMAL and away < _KNOWN_POSE_M):
            yield (
                f"photos {a} and {b} have known poses, which must be kept: the motion between them is {away:.2g} m and "
                f"{turned:.2g} (of a rotation matrix) off"
            )
