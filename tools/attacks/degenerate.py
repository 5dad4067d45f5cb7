"""Backends that return numbers at and beyond every bound: each is a mock backend with one
deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import Pipeline
from physic_core.interfaces import INTERFACES
from physic_core.types import Intrinsics, People
from physic_mock import backends

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

CONFIG = {
    "extends": "mock",
    "engine": {"joint": {"optimiser": {"steps": 1}}},
    "run": {"cache": False},
}
_PER_PERSON = ("keypoint_detector", "body_estimator", "hand_estimator", "contact_prior")

Change = Callable[[Any], Any]


@dataclass(frozen=True)
class Deviation:
    """One deviation of one backend.

    Attributes:
        interface: of the backend.
        name: what deviates.
        change: returns the deviating result for a valid one.
        refused: part of the message of the interface's check; "" if the run uses the result.
        missing: whether the run goes on without the numbers of this backend, and says so of each
            person.
    """

    interface: str
    name: str
    change: Change
    refused: str = ""
    missing: bool = False

    def __str__(self) -> str:
        return f"{self.interface}-{self.name}".replace(" ", "_")


def mock_of(interface: str) -> type:
    """Return the mock backend of an interface."""
    return next(
        kind
        for kind in vars(backends).values()
        if isinstance(kind, type)
        and issubclass(kind, INTERFACES[interface])
        and kind.__name__[:4] == "Mock"
    )


def record(image: UInt8Array) -> dict[str, list[Any]]:
    """Return the results of all mock backends for a photo, in the order of the calls, by
    interface.
    """
    results: dict[str, list[Any]] = {name: [] for name in INTERFACES}

    def recording(interface: str) -> type:
        mock = mock_of(interface)

        def infer(self: Any, *arguments: Any) -> Any:
            results[interface].append(mock.infer(self, *arguments))
            return results[interface][-1]

        return type("Recording", (mock,), {"infer": infer})

    with Pipeline(CONFIG, backends={name: recording(name) for name in INTERFACES}) as pipeline:
        pipeline(image)
    return results


def deviating_backends(deviation: Deviation, recorded: Mapping[str, list[Any]]) -> dict[str, type]:
    """Return backends that return the recorded results for any input; one of them deviates."""

    def replaying(interface: str) -> type:
        mock = mock_of(interface)
        calls = recorded[interface]

        def infer(self: Any, image: Any, *arguments: Any) -> Any:
            hints = arguments[0] if interface == "relative_pointmap" else None
            result = calls[-1 if hints is not None and hints.scene is not None else 0]
            if interface in _PER_PERSON:
                result = _of_people(result, len(arguments[0]))
            return deviation.change(result) if interface == deviation.interface else result

        return type("Replaying", (mock,), {"infer": infer})

    return {name: replaying(name) for name in INTERFACES}


def _of_people(result: Any, count: int) -> Any:
    """Return the result of the first person for each of ``count`` people."""
    rows = np.zeros(count, int)

    def chosen(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value[rows]
        return (
            replace(value, **{k: chosen(v) for k, v in vars(value).items()})
            if is_dataclass(value)
            else value
        )

    return chosen(result)


def _set(**values: Any) -> Change:
    """Set fields to arrays that are filled with one number, or to the results of functions."""

    def change(result: Any) -> Any:
        changed = {}
        for name, value in values.items():
            now = getattr(result, name)
            changed[name] = value(now) if callable(value) else np.full_like(now, value)
        return replace(result, **changed)

    return change


def _parameters(**values: Any) -> Change:
    return lambda result: replace(result, parameters=_set(**values)(result.parameters))


def _first(value: float) -> Callable[[Any], Any]:
    """Set the first number of each row."""

    def change(array: Any) -> Any:
        changed = array.copy()
        changed.reshape(len(changed), -1)[:, 0] = value
        return changed

    return change


def _camera(**values: float) -> Change:
    return lambda result: replace(result, intrinsics=replace(_some_camera(result), **values))


def _some_camera(result: Any) -> Intrinsics:
    height, width = (result.depth if hasattr(result, "depth") else result.valid).shape
    return result.intrinsics or Intrinsics.from_focal(width, width, height)


def _people(count: int, pixel: Callable[[int, int, int], tuple[int, int]]) -> Change:
    """``count`` people of one pixel each."""

    def change(result: People) -> People:
        height, width = result.masks.shape[1:]
        masks = np.zeros((count, height, width), bool)
        boxes = np.zeros((count, 4), np.float32)
        for i in range(count):
            x, y = pixel(i, width, height)
            masks[i, y, x], boxes[i] = True, (x, y, x + 1, y + 1)
        scores = np.linspace(1, 0.5, count, dtype=np.float32)
        return People(masks, boxes, scores, result.floor)

    return change


def _full_mask(result: People) -> People:
    masks = np.zeros_like(result.masks)
    masks[0] = True
    height, width = masks.shape[1:]
    box = np.array([[0, 0, width, height]], result.boxes.dtype)
    return replace(result, masks=masks[:1], boxes=box, scores=result.scores[:1], keypoints=None)


def _boxes(*box: float) -> Change:
    return _set(boxes=lambda b: np.tile(np.array(box, b.dtype), (len(b), 1)))


class _Subclass(np.ndarray):
    pass


_INF = np.inf
_S = "segmenter"
_I = "inpainter"
_M = "metric_depth"
_R = "relative_pointmap"
_K = "keypoint_detector"
_B = "body_estimator"
_H = "hand_estimator"
_C = "contact_prior"

DEVIATIONS: tuple[Deviation, ...] = (
    # ---- segmenter
    Deviation(_S, "all-True mask", _full_mask),
    Deviation(_S, "8 people of 1 pixel", _people(8, lambda i, w, h: (i % w, i // w))),
    Deviation(
        _S, "boxes far outside", _boxes(1e9, 1e9, 2e9, 2e9), "boxes must be x0 y0 x1 y1 inside"
    ),
    Deviation(_S, "denormal boxes", _boxes(0, 0, 1e-40, 1e-40)),
    Deviation(_S, "infinite boxes", _set(boxes=_INF), "boxes must be finite"),
    Deviation(_S, "infinite scores", _set(scores=_INF), "scores must lie in [0, 1]"),
    Deviation(_S, "floor everywhere", _set(floor=True)),
    Deviation(_S, "floor nowhere", _set(floor=False)),
    # ---- inpainter
    Deviation(_I, "another size", lambda image: image[:-1], "image must be"),
    Deviation(_I, "text", lambda image: "image", "image must be a numpy array"),
    Deviation(
        _I, "read-only and strided", lambda image: np.broadcast_to(image[:1, :1], image.shape)
    ),
    # ---- relative point map
    Deviation(_R, "all points equal", _set(points=1.0)),
    Deviation(_R, "denormal points", _set(points=1e-42), "the median of z must lie between"),
    Deviation(_R, "points of 1e-3", lambda r: replace(r, points=r.points * np.float32(1e-3))),
    Deviation(_R, "one pixel valid", lambda r: replace(r, valid=_only(r.valid, 1))),
    Deviation(_R, "infinite points", _set(points=_INF), "points must be finite"),
    Deviation(
        _R, "all x and y zero", lambda r: replace(r, points=r.points * np.float32([0, 0, 1]))
    ),
    Deviation(_R, "one point at 1e30", lambda r: replace(r, points=_one(r.points, 1e30))),
    Deviation(_R, "float16", lambda r: replace(r, points=r.points.astype(np.float16))),
    Deviation(
        _R, "focal length of 1e-9 px", _camera(fx=1e-9, fy=1e-9), "fx and fy must lie between"
    ),
    Deviation(_R, "principal point at 1e9 px", _camera(cx=1e9), "cx and cy must lie within"),
    # ---- metric depth
    Deviation(_M, "all equal", _set(depth=3.0)),
    Deviation(_M, "1e30 m", _set(depth=1e30), "the median of depth must lie between"),
    Deviation(_M, "scale of 0", _set(depth=0.0), "depth must be > 0 m"),
    Deviation(
        _M,
        "one pixel known",
        lambda r: replace(r, depth=np.where(_only(r.depth > 0, 1), r.depth, np.nan)),
    ),
    Deviation(_M, "one pixel at 1e30", lambda r: replace(r, depth=_one(r.depth, 1e30))),
    Deviation(_M, "infinities and NaN", lambda r: replace(r, depth=_checkered(r.depth))),
    Deviation(
        _M, "scale_sigma of 1e30", lambda r: replace(r, scale_sigma=1e30), "scale_sigma must be"
    ),
    Deviation(_M, "scale_sigma of 0", lambda r: replace(r, scale_sigma=0.0)),
    Deviation(
        _M,
        "masked array",
        lambda r: replace(r, depth=np.ma.masked_less(r.depth, 3.0)),
        "got MaskedArray",
    ),
    Deviation(
        _M,
        "subclass of ndarray",
        lambda r: replace(r, depth=r.depth.view(_Subclass)),
        "got _Subclass",
    ),
    Deviation(
        _M,
        "array of objects",
        lambda r: replace(r, depth=r.depth.astype(object)),
        "depth must be float",
    ),
    Deviation(_M, "big-endian", lambda r: replace(r, depth=r.depth.astype(">f4"))),
    Deviation(_M, "long notes", lambda r: replace(r, notes=("x" * 1_000_000,))),
    # ---- keypoints
    Deviation(_K, "one at 1e9 px", _set(points=_first(1e9)), "points must lie within"),
    Deviation(_K, "all in one place", _set(points=100.0)),
    Deviation(_K, "infinite", _set(points=_INF), "points must be finite"),
    Deviation(_K, "confidence of 0", _set(confidence=0.0)),
    Deviation(_K, "negative confidence", _set(confidence=-1.0), "confidence must lie in [0, 1]"),
    Deviation(
        _K,
        "world at 1e9 m",
        lambda r: replace(r, world=np.full((*r.points.shape[:2], 3), 1e9)),
        "world must",
    ),
    Deviation(
        _K,
        "one person too many",
        lambda r: replace(r, points=np.repeat(r.points, 2, 0)),
        "points must be",
    ),
    # ---- bodies
    Deviation(_B, "betas of 1e20", _parameters(betas=1e20), "betas must lie within"),
    Deviation(_B, "infinite transl", _parameters(transl=_INF), "transl must be finite"),
    Deviation(_B, "betas of 100", _parameters(betas=100.0)),
    Deviation(_B, "transl of 1e4", _parameters(transl=_first(1e4))),
    Deviation(_B, "behind the camera", _parameters(transl=lambda t: t * [1, 1, -1])),
    Deviation(_B, "transl of 0", _parameters(transl=0.0)),
    Deviation(_B, "rotations of 1e6 rad", _parameters(body_pose=1e6), "body_pose must lie within"),
    Deviation(
        _B,
        "joints at 1e9 m",
        lambda r: replace(r, joints=np.full((len(r.parameters), 55, 3), 1e9)),
        "joints",
    ),
    # ---- hands
    Deviation(_H, "1e20 rad", _set(rotvecs=1e20, confidence=1.0), missing=True),
    # ---- contact
    Deviation(_C, "probability of 2", _set(probability=2.0), missing=True),
    Deviation(_C, "probability of 1", _set(probability=1.0)),
    Deviation(
        _C, "no vertices", lambda r: replace(r, probability=r.probability[:, :0]), missing=True
    ),
)


def _only(valid: Any, count: int) -> Any:
    kept = np.zeros_like(valid)
    rows, columns = np.nonzero(valid)
    chosen = np.linspace(0, len(rows) - 1, count).astype(int)
    kept[rows[chosen], columns[chosen]] = True
    return kept


def _one(values: Any, value: float) -> Any:
    changed = values.copy()
    changed[len(values) // 2, values.shape[1] // 2] = value
    return changed


def _checkered(depth: Any) -> Any:
    changed = depth.copy()
    changed[::2, ::2], changed[1::2, 1::2] = np.nan, np.inf
    return changed
