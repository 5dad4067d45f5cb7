"""Mocks in place of networks, with a fault of the wrapper; they know the changed photos of the kit,
too.
"""

from __future__ import annotations

import inspect
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from physic_mock import backends as mocks
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.cases import PAIRED, SIZE, Case, build_case
from physic_testing.conformance.changes import CHANGES, Change, change_of, changed_case
from physic_testing.conformance.contact_prior import mirrored_vertices
from physic_testing.conformance.depths import rays_of
from physic_testing.conformance.field_comparison import named_values
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.requests import build_request
from physic_testing.conformance.run import CheckRun

NO_NOISE: dict[str, dict[str, Any]] = {
    "MockMetricDepth": {"noise": 0, "stated_sigma": 0.1},
    "MockRelativePointmap": {"noise": 0, "unknown": "scale"},
}
"""Mock -> its options; all others have {"noise": 0}."""


@cache
def changed_photos(interface: str) -> dict[int, tuple[Case, Change]]:
    """Checksum of each changed photo, with people and without -> the photo and its change."""
    found = {}
    for case in (build_case(name, SIZE) for name in PAIRED.get(interface, PAIRED[""])):
        for change in (change_of(case, name) for name in CHANGES):
            other = changed_case(case, change)
            found |= {
                zlib.crc32(picture.tobytes()): (case, change)
                for picture in (other.photo, other.empty)
            }
    return found


def as_changed(answer: Any, case: Case, change: Change) -> Any:
    """The answer of an equivariant network for the changed photo."""
    kind = type(answer).__name__
    if kind == "ndarray":
        return change.of_picture(answer)
    if kind == "DepthMap":
        depth = answer.depth * (rays_of(case.intrinsics) @ change.axes[2])
        return replace(answer, depth=change.of_picture(depth), intrinsics=change.camera)
    if kind == "Hands" and change.mirrors:
        return replace(
            answer,
            rotvecs=answer.rotvecs[:, ::-1] * [1, -1, -1],
            confidence=answer.confidence[:, ::-1],
        )
    if kind == "ContactProbability" and change.mirrors:
        return replace(answer, probability=answer.probability[:, mirrored_vertices()])
    place = {
        "People": "people",
        "Keypoints": "keypoints",
        "Bodies": "bodies",
        "Pointmap": "scene",
    }.get(kind)
    if place is None:
        return answer
    changed = getattr(changed_case(replace(case, **{place: answer}), change), place)
    return (
        replace(changed, floor=change.of_picture(answer.floor))
        if getattr(answer, "floor", None) is not None
        else changed
    )


def with_own_errors(answer: Any, rng: np.random.Generator) -> Any:
    """What a network returns otherwise for a changed photo: about what the embedded ones do."""
    kind = type(answer).__name__
    if kind in ("DepthMap", "Pointmap"):
        shape = (answer.depth if kind == "DepthMap" else answer.points).shape[:2]
        waves = (
            1
            + 0.02
            * np.sin(rng.uniform(0, 6, 2)[0] + np.linspace(0, rng.uniform(3, 9), shape[1]))[
                None, :, None
            ]
        )
        if kind == "DepthMap":
            return replace(answer, depth=(answer.depth * waves[..., 0]).astype(np.float32))
        return replace(answer, points=(answer.points * waves).astype(np.float32))
    if kind == "Keypoints":
        return replace(answer, points=answer.points + rng.normal(0, 0.5, answer.points.shape))
    if kind == "Bodies":
        p = answer.parameters
        turned = {
            name: (Rotation.from_rotvec(np.radians(3) * rng.normal(size=(getattr(p, name).size // 3, 3)))  # noqa: E501
                   * Rotation.from_rotvec(getattr(p, name).reshape(-1, 3))).as_rotvec().reshape(getattr(p, name).shape)  # noqa: E501
            for name in ("global_orient", "body_pose")
        }  # fmt: skip
        transl = p.transl * (1 + 0.02 * rng.normal(size=(len(p), 1)))
        return replace(answer, parameters=replace(p, transl=transl.astype(np.float32), **turned))
    if kind == "Hands":
        return replace(
            answer, rotvecs=answer.rotvecs + np.radians(3) * rng.normal(size=answer.rotvecs.shape)
        )
    return answer


_ANSWERS: dict[tuple[Any, ...], Any] = {}
_OF_PHOTOS: dict[str, dict[Any, Any]] = {}  # of the last mock


def answer_of(kind: type[Any], own: Any, arguments: tuple[Any, ...]) -> Any:
    """The mock's answer, each of which is computed once."""
    parts = [
        v.tobytes() if isinstance(v, np.ndarray) else repr(v).encode()
        for _, v in named_values(arguments)
    ]
    key = (kind, own.options.model_dump_json(), zlib.crc32(b"".join(parts)))
    if key not in _ANSWERS:
        _ANSWERS[key] = kind.infer(own, *arguments)
    return _ANSWERS[key]


@lru_cache(maxsize=32)
def of_changed_photo(kind: type[Any], own: str, photo: int, seed: int) -> Any:
    """The answer of an equivariant mock with errors of its own, for a changed photo."""
    case, how = changed_photos(kind.interface)[photo]
    mock = kind(kind.Options.model_validate_json(own))
    request = build_request(kind.interface, case)
    answer = as_changed(answer_of(kind, mock, request.limited_to(mock.reads)), case, how)
    return with_own_errors(answer, np.random.default_rng(zlib.crc32(how.name.encode()) + seed))


def run_checks(
    mock: str, change: Callable[..., Any] | None = None, *, noise: float = 0, seed: int = 0
) -> CheckRun:
    """All checks of a mock whose result is changed by ``change(result, *arguments)``."""
    kind = getattr(mocks, mock)

    def infer(self: Any, *arguments: Any) -> Any:
        if noise and (photo := zlib.crc32(arguments[0].tobytes())) in changed_photos(
            kind.interface
        ):
            answer = of_changed_photo(kind, self.options.model_dump_json(), photo, seed)
        else:
            answer = answer_of(kind, self, arguments)
        return answer if change is None else change(answer, *arguments)

    infer.__signature__ = inspect.signature(kind.infer)  # type: ignore[attr-defined]
    options = {"noise": noise, "noise_seed": seed} if noise else NO_NOISE.get(mock, {"noise": 0})
    if mock not in _OF_PHOTOS:
        _OF_PHOTOS.clear()
    shared = _OF_PHOTOS.setdefault(mock, {})
    return start_checks(
        find_backend(type(mock, (kind,), {"infer": infer}), None, options=options, of_photos=shared)
    )
