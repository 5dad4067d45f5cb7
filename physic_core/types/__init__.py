"""Data types of backends, pipeline and engine: frozen dataclasses of NumPy arrays.

One frame everywhere: the OpenCV camera's (x right, y down, z forward), in metres. One pixel
convention: integer coordinates are pixel centres, so the centre of an image is ``((width - 1) / 2,
(height - 1) / 2)``. N is people, J keypoints, V vertices, K shape components, H and W image rows
and columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.types.bodies import (
    Bodies,
    BodyParameters,
    ContactProbability,
    Hands,
    Mesh,
    RestMesh,
)
from physic_core.types.camera import CameraTrust, Intrinsics, Lens
from physic_core.types.contacts import (
    NO_PARTNER,
    PARTNER_KINDS,
    BodyContact,
    ContactPartner,
    Support,
    SupportState,
)
from physic_core.types.depth import AffineAmbiguity, DepthMap, Hints, Plane, Pointmap, SceneScale
from physic_core.types.keypoint_table import KeypointTable
from physic_core.types.known_sizes import KnownLength, KnownSizes
from physic_core.types.observations import POSTURES, TOUCH_PARTS, Observations
from physic_core.types.people import (
    CARRIER_NAMES,
    SURFACE_NAMES,
    Carrier,
    Keypoints,
    People,
    PeoplePrompt,
    SurfaceLabels,
    UnposedPerson,
)
from physic_core.types.records import (
    CheckResult,
    CheckState,
    Grade,
    Measures,
    Provenance,
    StageRecord,
    grade_text,
    summarize_checks,
)
from physic_core.types.results import Person, Reconstruction, Scene
from physic_core.types.skeletons import SKELETONS, Skeleton, skeleton_named

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray as BoolArray
    from physic_core.types.arrays import FloatArray as FloatArray
    from physic_core.types.arrays import IntArray as IntArray
    from physic_core.types.arrays import UInt8Array as UInt8Array

__all__ = [
    "CARRIER_NAMES",
    "NO_PARTNER",
    "PARTNER_KINDS",
    "POSTURES",
    "SKELETONS",
    "SURFACE_NAMES",
    "TOUCH_PARTS",
    "AffineAmbiguity",
    "Bodies",
    "BodyContact",
    "BodyParameters",
    "CameraTrust",
    "Carrier",
    "CheckResult",
    "CheckState",
    "ContactPartner",
    "ContactProbability",
    "DepthMap",
    "Grade",
    "Hands",
    "Hints",
    "Intrinsics",
    "KeypointTable",
    "Keypoints",
    "KnownLength",
    "KnownSizes",
    "Lens",
    "Measures",
    "Mesh",
    "Observations",
    "People",
    "PeoplePrompt",
    "Person",
    "Plane",
    "Pointmap",
    "Provenance",
    "Reconstruction",
    "RestMesh",
    "Scene",
    "SceneScale",
    "Skeleton",
    "StageRecord",
    "Support",
    "SupportState",
    "SurfaceLabels",
    "UnposedPerson",
    "grade_text",
    "skeleton_named",
    "summarize_checks",
]
