"""Data types of backends, pipeline and engine: frozen dataclasses of NumPy arrays.

One frame everywhere: the OpenCV camera's (x right, y down, z forward), in meters. One pixel
convention: integer coordinates are pixel centers, so the center of an image is ``((width - 1) / 2,
(height - 1) / 2)``. N is people, J keypoints, V vertices, K shape components, H and W image rows
and columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.types.arrays import PER_PERSON, expand_people, select_people
from physic_core.types.bodies import (
    Bodies,
    BodyParameters,
    ContactProbability,
    Hands,
    Mesh,
    RestMesh,
)
from physic_core.types.bounds import (
    Count,
    FrozenGroups,
    NotNegative,
    PointCount,
    Positive,
    PositiveCount,
    PositiveOrInfinite,
    Share,
)
from physic_core.types.camera import CameraTrust, Intrinsics, Lens
from physic_core.types.contacts import (
    NO_PARTNER,
    PARTNER_KINDS,
    BodyContact,
    ContactPartner,
    Support,
    SupportState,
    contacts_text,
    part_words,
    partner_titles,
)
from physic_core.types.depth import AffineAmbiguity, DepthMap, Hints, Plane, Pointmap, SceneScale
from physic_core.types.keypoint_table import KeypointTable
from physic_core.types.known_sizes import KnownLength, KnownSizes
from physic_core.types.observations import (
    CHOICES,
    LEAST_PROBABILITY,
    POSTURES,
    PROBABILITIES,
    TOUCH_PARTS,
    TOUCHED,
    Observations,
)
from physic_core.types.people import (
    CARRIER_NAMES,
    FOUND_TWICE,
    HARDLY_VISIBLE,
    NOT_CHOSEN,
    SURFACE_NAMES,
    Carrier,
    Keypoints,
    People,
    PeoplePrompt,
    SurfaceLabels,
    UnposedPerson,
)
from physic_core.types.person_files import BodiesInFile, FileOfPhoto, MasksInFile
from physic_core.types.records import (
    MARKS,
    CheckResult,
    CheckState,
    ExportedFiles,
    Measures,
    Provenance,
    StageRecord,
    in_words,
    is_usable,
    marks_text,
    summarize_checks,
    usable_text,
)
from physic_core.types.results import (
    Person,
    Reconstruction,
    Scene,
    main_people,
    metres_text,
    pelvis_distance_m,
)
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import (
    MAX_FINGER_KEYPOINTS,
    SEEN_CONFIDENCE,
    SIDES,
    SKELETONS,
    SURE_CONFIDENCE,
    Skeleton,
    is_finger,
    mirrored_order,
    other_side,
    skeleton_named,
)
from physic_core.types.tables import PERSON_COLUMNS, SUMMARY_COLUMNS, marks_of_row, person_rows

if TYPE_CHECKING:
    from physic_core.types.arrays import AnyArray as AnyArray
    from physic_core.types.arrays import BoolArray as BoolArray
    from physic_core.types.arrays import Float32Array as Float32Array
    from physic_core.types.arrays import Float64Array as Float64Array
    from physic_core.types.arrays import FloatArray as FloatArray
    from physic_core.types.arrays import Int64Array as Int64Array
    from physic_core.types.arrays import IntArray as IntArray
    from physic_core.types.arrays import UInt8Array as UInt8Array

__all__ = [
    "CARRIER_NAMES",
    "CHOICES",
    "FOUND_TWICE",
    "HARDLY_VISIBLE",
    "LEAST_PROBABILITY",
    "MARKS",
    "MAX_FINGER_KEYPOINTS",
    "NOT_CHOSEN",
    "NO_PARTNER",
    "PARTNER_KINDS",
    "PERSON_COLUMNS",
    "PER_PERSON",
    "POSTURES",
    "PROBABILITIES",
    "SEEN_CONFIDENCE",
    "SIDES",
    "SKELETONS",
    "SUMMARY_COLUMNS",
    "SURE_CONFIDENCE",
    "SURFACE_NAMES",
    "TOUCHED",
    "TOUCH_PARTS",
    "AffineAmbiguity",
    "Bodies",
    "BodiesInFile",
    "BodyContact",
    "BodyParameters",
    "CameraTrust",
    "Carrier",
    "CheckResult",
    "CheckState",
    "ContactPartner",
    "ContactProbability",
    "Count",
    "DepthMap",
    "ExportedFiles",
    "FileOfPhoto",
    "FrozenGroups",
    "Hands",
    "Hints",
    "Intrinsics",
    "KeypointTable",
    "Keypoints",
    "KnownLength",
    "KnownSizes",
    "Lens",
    "MasksInFile",
    "Measures",
    "Mesh",
    "NotNegative",
    "Observations",
    "People",
    "PeoplePrompt",
    "Person",
    "Plane",
    "PointCount",
    "Pointmap",
    "Positive",
    "PositiveCount",
    "PositiveOrInfinite",
    "Provenance",
    "Reconstruction",
    "RestMesh",
    "Scene",
    "SceneScale",
    "Share",
    "ShortRepr",
    "Skeleton",
    "StageRecord",
    "Support",
    "SupportState",
    "SurfaceLabels",
    "UnposedPerson",
    "contacts_text",
    "expand_people",
    "in_words",
    "is_finger",
    "is_usable",
    "main_people",
    "marks_of_row",
    "marks_text",
    "metres_text",
    "mirrored_order",
    "other_side",
    "part_words",
    "partner_titles",
    "pelvis_distance_m",
    "person_rows",
    "select_people",
    "skeleton_named",
    "summarize_checks",
    "usable_text",
]
