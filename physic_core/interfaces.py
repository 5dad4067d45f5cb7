"""The eight interfaces that a plugin can implement.

Images are (H, W, 3) uint8 RGB numpy arrays, upright. The frame is the OpenCV camera's (x right, y down, z forward),
in metres; integer pixel coordinates are pixel centres. The core checks the image before it calls a backend, which need
not look again. A backend never edits its input, reports other bad input with a :class:`physic_core.errors.PhysicError`,
and returns the same for the same input and options.

Each interface has a version, ``api``. It rises when a backend that was written for it would no longer do; then the
backends of that interface, and of no other, are refused until their records state the new version.

Constructing a backend is cheap and offline. ``load`` reads weights, ``close`` drops them; both may be called twice.

A plugin whose weights are to be fetched lists them in TOML files, and names their folder by the hook ``physic_weights``
(:mod:`physic_core.discovery.hookspecs`). :mod:`physic_core.weights` finds them, and knows which are missing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from pydantic import BaseModel, ConfigDict

if TYPE_CHECKING:
    from physic_core.types import (
        Bodies,
        BoolArray,
        ContactProbability,
        DepthMap,
        Hands,
        Hints,
        Intrinsics,
        Keypoints,
        People,
        Pointmap,
        UInt8Array,
    )

__all__ = [
    "INTERFACES",
    "Backend",
    "BodyEstimator",
    "ContactPrior",
    "HandEstimator",
    "Inpainter",
    "KeypointDetector",
    "MetricDepth",
    "Options",
    "RelativePointmap",
    "Segmenter",
]


class Options(BaseModel):
    """Base of a backend's settings: unknown keys are refused, every field carries a description."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Backend(ABC):
    """What every interface shares.

    Attributes:
        interface: the interface's name in configs.
        api: version of the interface; the record of a backend states the version that it was written for.
        Options: pydantic model of this backend's settings.
        cacheable: whether the output may be cached. Set it to False if the output depends on anything but the input,
            options, files that options name and ``fingerprint()``, or if computing it is faster than reading it.
    """

    interface: ClassVar[str]
    api: ClassVar[int]
    Options: ClassVar[type[Options]] = Options
    cacheable: ClassVar[bool] = True

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    def load(self, device: str = "cpu") -> None:  # noqa: B027 -- a backend without weights has nothing to do
        """Bring weights into memory on ``device`` ("cpu", "cuda", "cuda:1")."""

    def close(self) -> None:  # noqa: B027
        """Let go of everything that ``load`` took."""

    def missing(self) -> tuple[str, ...]:
        """What this backend with its options lacks on this machine, one line each that says how to get it.

        Cheap and offline, the same however often it is asked, and asked before ``load``: a run in which anything is
        missing stops before it begins, and lists what all backends lack.
        """
        return ()

    def fingerprint(self) -> str:
        """What else an answer depends on, such as the revision of weights in a folder; asked before ``load``.

        A short text, cheaply told, the same for the same weights wherever they lie; empty where there is nothing to
        say. Kept answers are given again only while it stays the same. Files that options name are looked at without
        it.
        """
        return ""


class Segmenter(Backend):
    """Finds people and, where it can, the ground that they stand on (paper: GroundingDINO + SAM2)."""

    interface = "segmenter"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array) -> People:
        """Image (H, W, 3) -> people, best score first; N = 0 where nobody is seen."""


class Inpainter(Backend):
    """Takes people out of a photo (paper: OmniEraser)."""

    interface = "inpainter"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) and mask (H, W), True = remove -> image of that size, unchanged where the mask is False."""


class MetricDepth(Backend):
    """Depth in metres (paper: DepthPro)."""

    interface = "metric_depth"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth in metres; ``image`` is the inpainted photo."""


class RelativePointmap(Backend):
    """Detailed geometry without a unit (paper: MoGe).

    Asked once for the inpainted photo (``hints.hole`` says where it is made up) and once for the original.
    """

    interface = "relative_pointmap"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) -> point map; ``hints.intrinsics`` are respected where given."""


class KeypointDetector(Backend):
    """2D joints of known people (paper: ViTPose whole-body)."""

    interface = "keypoint_detector"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> N rows of keypoints."""


class BodyEstimator(Backend):
    """Posed and shaped bodies (paper: CameraHMR)."""

    interface = "body_estimator"
    api = 1

    @abstractmethod
    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """N people -> N bodies in metres in the camera frame; ``hints.floor`` tells which way is up where known.

        Bodies may be of any model: those of another than the configured one are carried over by their ``joints``, and
        closer by their ``mesh``; give at least one of both unless the model is the embedded one.
        """


class HandEstimator(Backend):
    """Finger poses (paper: WiLoR)."""

    interface = "hand_estimator"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """N people -> 15 rotations a hand with a confidence; confidence 0 where there is no hand to see.

        With ``wrists``, how each hand is turned in the camera frame, hands are put onto the arms, as far as they are
        sure.
        """


class ContactPrior(Backend):
    """Which vertices are likely to touch the scene (paper: DECO)."""

    interface = "contact_prior"
    api = 1

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """N people with their bodies -> a probability a vertex.

        On any mesh: where it is not that of the bodies, ``rest`` brings its T-pose, by which the core carries it over.
        ``bodies`` are of the configured model, with ``joints`` where that is a file of the user's.
        """


INTERFACES: dict[str, type[Backend]] = {
    c.interface: c
    for c in (
        Segmenter,
        Inpainter,
        MetricDepth,
        RelativePointmap,
        KeypointDetector,
        BodyEstimator,
        HandEstimator,
        ContactPrior,
    )
}
"""Interface name in configs -> class."""
