"""The nine interfaces that a plugin can implement: arguments, result type and validation of each.

Images are (H, W, 3) uint8 RGB numpy arrays: already rotated as the EXIF data of the file says, and
undistorted if the lens is known. The pipeline maps results back to the pixels of the file; a
backend does neither. The frame is the OpenCV camera's (x right, y down, z forward), in meters;
integer pixel coordinates are pixel centers: the first pixel is (0, 0), and the center of an image 4
px wide is x = 1.5. The core checks the image before it calls a backend. A backend never edits its
input, reports other bad input with a :class:`physic_core.errors.PhysicError`, and returns the same
result for the same input and options.

Each interface has a version, ``api``. It rises when backends written for the previous version no
longer work; then the backends of that interface, and of no other, are refused until their
``written_for`` states the new version.

Constructing a backend is cheap and offline. ``load`` reads weights, ``close`` drops them; both may
be called twice.

A plugin whose weights are to be fetched lists them in TOML files, and names their folder by an
entry point in the group ``physic.weights``. :mod:`physic_core.weights` finds them, and knows which
are missing.
"""

from __future__ import annotations

from physic_core.interfaces.backend import (
    Backend,
    GpuMemory,
    Options,
    Packages,
    Repository,
    Request,
    Requirement,
    UserFile,
    call,
    contract_violations,
)
from physic_core.interfaces.bodies import (
    BodyEstimator,
    BodyEstimatorRequest,
    ContactPrior,
    ContactPriorRequest,
    HandEstimator,
    HandEstimatorRequest,
)
from physic_core.interfaces.checks import tensor_advice
from physic_core.interfaces.maps import (
    Inpainter,
    InpainterRequest,
    MetricDepth,
    MetricDepthRequest,
    RelativePointmap,
    RelativePointmapRequest,
)
from physic_core.interfaces.people import (
    KeypointDetector,
    KeypointDetectorRequest,
    PersonObserver,
    PersonObserverRequest,
    Segmenter,
    SegmenterRequest,
)
from physic_core.types.bounds import Share

__all__ = [
    "INTERFACES",
    "Backend",
    "BodyEstimator",
    "BodyEstimatorRequest",
    "ContactPrior",
    "ContactPriorRequest",
    "GpuMemory",
    "HandEstimator",
    "HandEstimatorRequest",
    "Inpainter",
    "InpainterRequest",
    "KeypointDetector",
    "KeypointDetectorRequest",
    "MetricDepth",
    "MetricDepthRequest",
    "Options",
    "Packages",
    "PersonObserver",
    "PersonObserverRequest",
    "RelativePointmap",
    "RelativePointmapRequest",
    "Repository",
    "Request",
    "Requirement",
    "Segmenter",
    "SegmenterRequest",
    "Share",
    "UserFile",
    "call",
    "contract_violations",
    "tensor_advice",
]

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
        PersonObserver,
        ContactPrior,
    )
}
"""Interface classes by their names in configs."""
