"""Convert a reconstruction, except its arrays, to and from ``reconstruction.json``."""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files.document_checksum import EDITED, ChecksumState, checksum_state, with_checksum
from physic_core.files.strict_json import parse_json, to_json
from physic_core.geometry.upright import gltf_from_camera
from physic_core.io.arrays import PERSON_ARRAYS, SHARED_ARRAYS, ArraySpec
from physic_core.io.records import to_record
from physic_core.io.result_folder import SCHEMA
from physic_core.io.schema_file import schema_fault
from physic_core.types import Skeleton

if TYPE_CHECKING:
    from physic_core.types import CameraView, Person, Reconstruction

__all__ = [
    "READABLE_VERSIONS",
    "SCHEMA",
    "SCHEMA_VERSION",
    "decode_document",
    "encode_document",
    "parse_skeleton",
    "to_document",
]

SCHEMA_VERSION = 4
"""Of the newest documents. Version 4 has ``cameras``, and is written for several photos alone; the result of one photo
is version 3. Version 3 has a checksum of the document. Version 2 gives each check a state and a direction; version 1
has ``ok`` instead."""

READABLE_VERSIONS = (1, 2, 3, 4)

_NUMBERS = re.compile(r"\[\n\s*((?:[-+.\deE]+,\n\s*)*[-+.\deE]+)\n\s*\]")


def to_document(
    reconstruction: Reconstruction,
    files: Sequence[str],
    arrays_checksum: str,
    digests: Mapping[str, str] | None = None,
    specs: tuple[Sequence[ArraySpec], Sequence[ArraySpec]] = (SHARED_ARRAYS, PERSON_ARRAYS),
) -> dict[str, Any]:
    """Convert a reconstruction to a JSON-ready dictionary.

    Args:
        files: names of the other files in the folder.
        arrays_checksum: checksum of ``reconstruction.npz``.
        digests: file name -> digest, for the files that are already written.
        specs: of the arrays that exist once, and of those of each person.
    """
    shared, of_person = specs
    scene, floor = reconstruction.scene, reconstruction.scene.floor
    document = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION if reconstruction.cameras else SCHEMA_VERSION - 1,
        "units": {"length": "metres", "angle": "radians", "time": "seconds", "image": "pixels"},
        "frame": {
            "axes": "OpenCV camera: x right, y down, z forward; origin at the camera",
            "pixels": "integer coordinates are pixel centres; (0, 0) is the centre of the top left pixel",
            "gltf": "the GLB files have y up: their points are gltf_from_camera times the camera frame's",
            "gltf_from_camera": gltf_from_camera(floor).tolist(),
        },
        "photo": reconstruction.photo,
        "image": {"width": reconstruction.image.shape[1], "height": reconstruction.image.shape[0]},
        "intrinsics": to_record(reconstruction.intrinsics),
        "grade": reconstruction.grade,
        "lens": to_record(reconstruction.lens),
        **_cameras(reconstruction.cameras),
        "checks": to_record(reconstruction.checks),
        "warnings": reconstruction.warnings,
        "notes": reconstruction.notes,
        "people": [_person(index, person) for index, person in enumerate(reconstruction.people)],
        "contact_partners": to_record(reconstruction.contact_partners),
        "unposed": to_record(reconstruction.unposed),
        "body_model": reconstruction.body_model,
        **_skeleton(reconstruction.skeleton),
        "scene": {
            "floor": None if floor is None else {"normal": np.asarray(floor.normal), "offset": floor.offset},
            "scale": scene.scale,
            "scale_sigma": scene.scale_sigma,
            "valid_share": float(np.mean(scene.valid)),
        },
        "stages": to_record(reconstruction.stages),
        "diagnostics": reconstruction.diagnostics,
        "config": reconstruction.config,
        "files": list(files),
        "digests": dict(digests or {}),
        "arrays": {
            "checksum": arrays_checksum,
            "shared": [_spec(spec.name, spec.dtype, spec.shape, spec.meaning) for spec in shared],
            "of_person_i": [
                _spec(f"person_{{i}}_{spec.name}", spec.dtype, spec.shape, spec.meaning) for spec in of_person
            ],
        },
    }
    ready: dict[str, Any] = to_json(document)
    return ready


def encode_document(document: Mapping[str, Any]) -> bytes:
    """Encode a dictionary and its checksum as UTF-8 JSON without NaN, with each row of numbers on one line."""
    text = json.dumps(with_checksum(document), indent=2, ensure_ascii=False, allow_nan=False)
    # JSON strings contain no raw newline, so only lists match.
    text = _NUMBERS.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text)
    # A file name that is not UTF-8 has lone surrogates; backslashreplace writes them as JSON escapes.
    return (text + "\n").encode("utf-8", "backslashreplace")


def decode_document(content: bytes, name: str) -> dict[str, Any]:
    """Decode and validate ``reconstruction.json``: checksum, and kind of every entry; NaN and infinities stay strings.

    Args:
        content: bytes of the file.
        name: of the file, for error messages.

    Raises:
        InputError: the file is damaged or was edited, is not a reconstruction, or has another schema version.
    """
    try:
        document = parse_json(content)
    except ValueError as error:
        raise InputError(f"cannot read {name}: it is not JSON ({error}); run the reconstruction again") from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            f"cannot read {name}: it does not describe a reconstruction; name the folder of a finished run"
        )
    version = document.get("schema_version")
    if type(version) is not int or version not in READABLE_VERSIONS:
        raise InputError(
            f"cannot read {name}: its schema version is {reprlib.repr(version)}, and this PhySIC reads "
            f"{', '.join(map(str, READABLE_VERSIONS[:-1]))} and {READABLE_VERSIONS[-1]}; "
            "load it with the PhySIC that wrote it, or run the reconstruction again"
        )
    state = checksum_state(document)
    if state is ChecksumState.WRONG or (version >= 3 and state is ChecksumState.MISSING):
        raise InputError(
            f"cannot read {name}: it does not fit its checksum, so it is damaged or was edited; run the reconstruction "
            f'again; if you edited it, set its entry "checksum" to "{EDITED}", and it is read without this check'
        )
    if fault := schema_fault(document):
        raise InputError(f"cannot read {name}: {fault}; run the reconstruction again")
    return document


def parse_skeleton(document: Mapping[str, Any]) -> Skeleton | str:
    """Parse ``skeleton`` of a document, and ``skeleton_points`` if it is not a standard skeleton."""
    points = document.get("skeleton_points")
    if points is None:
        return str(document["skeleton"])
    return Skeleton(document["skeleton"], tuple(points["names"]), points["on_body"], points["weights"])


def _skeleton(skeleton: Skeleton | str) -> dict[str, Any]:
    if isinstance(skeleton, str):
        return {"skeleton": skeleton}
    points = {"names": skeleton.names, "on_body": skeleton.on_body, "weights": skeleton.weights}
    return {"skeleton": skeleton.name, "skeleton_points": points}


def _cameras(cameras: Sequence[CameraView]) -> dict[str, Any]:
    """Return ``cameras`` of several photos; of the reference, all but the name is elsewhere in the document."""
    others = [
        {
            "photo": camera.photo,
            "intrinsics": to_record(camera.intrinsics),
            "rotation": camera.rotation,
            "translation": camera.translation,
            "rotation_sigma": camera.rotation_sigma,
            "position_sigma": camera.position_sigma,
            "people": [{"index": index, "score": one.score} for index, one in camera.people.items()],
        }
        for camera in cameras[1:]
    ]
    return {"cameras": [{"photo": cameras[0].photo}, *others]} if cameras else {}


def _person(index: int, person: Person) -> dict[str, Any]:
    return {
        "index": index,
        "box": np.asarray(person.box),
        "score": person.score,
        "grade": person.grade,
        "failed_checks": person.failed_checks,
        "unknown_checks": person.unknown_checks,
        "pelvis": np.asarray(person.joints)[0] if len(person.joints) else None,
        "contact_vertices": int(np.sum(person.contact)),
        "contacts": None if person.contact_partner is None else to_record(person.contacts),
        "support": to_record(person.support),
        "age": to_record(person.age),
        "vertices": len(person.vertices),
    }


def _spec(name: str, dtype: str, shape: Sequence[str | int], meaning: str) -> dict[str, Any]:
    return {"name": name, "dtype": dtype, "shape": " x ".join(map(str, shape)) or "one", "meaning": meaning}
