"""Convert a reconstruction, except its arrays, to and from ``reconstruction.json``."""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files.regular import read_regular
from physic_core.files.strict_json import parse_json, to_json
from physic_core.geometry.upright import gltf_from_camera
from physic_core.io.arrays import PERSON_ARRAYS, SHARED_ARRAYS, ArraySpec
from physic_core.io.records import to_record
from physic_core.io.result_folder import DOCUMENT_FILE, MAX_DOCUMENT_BYTES, SCHEMA
from physic_core.io.schema_file import schema_fault
from physic_core.types import Skeleton

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import Person, Reconstruction

SCHEMA_VERSION = 5
"""Version of documents that are written and read."""

_NUMBERS = re.compile(r"\[\n\s*((?:[-+.\deE]+,\n\s*)*[-+.\deE]+)\n\s*\]")


def to_document(
    reconstruction: Reconstruction,
    files: Sequence[str],
    digests: Mapping[str, str] | None = None,
    specs: tuple[Sequence[ArraySpec], Sequence[ArraySpec]] = (SHARED_ARRAYS, PERSON_ARRAYS),
) -> dict[str, Any]:
    """Convert a reconstruction to a JSON-ready dictionary.

    Args:
        files: names of the other files in the folder.
        digests: file name -> digest, for the files that are already written.
        specs: of the arrays that exist once, and of those of each person.
    """
    shared, of_person = specs
    scene, floor = reconstruction.scene, reconstruction.scene.floor
    document = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
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
            "distance_sigma": reconstruction.distance_sigma,
            "valid_share": float(np.mean(scene.valid)),
        },
        "stages": to_record(reconstruction.stages),
        "diagnostics": reconstruction.diagnostics,
        "config": reconstruction.config,
        "files": list(files),
        "digests": dict(digests or {}),
        "arrays": {
            "shared": [_spec(spec.name, spec.dtype, spec.shape, spec.meaning) for spec in shared],
            "of_person_i": [
                _spec(f"person_{{i}}_{spec.name}", spec.dtype, spec.shape, spec.meaning) for spec in of_person
            ],
        },
    }
    ready: dict[str, Any] = to_json(document)
    return ready


def encode_document(document: Mapping[str, Any]) -> bytes:
    """Encode a dictionary as UTF-8 JSON without NaN, with each row of numbers on one line."""
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    # JSON strings contain no raw newline, so only lists match.
    text = _NUMBERS.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text)
    # A file name that is not UTF-8 has lone surrogates; backslashreplace writes them as JSON escapes.
    return (text + "\n").encode("utf-8", "backslashreplace")


def read_document(folder: Path) -> dict[str, Any]:
    """Read ``reconstruction.json`` of a folder and verify version and entries; NaN and infinities stay strings.

    Raises:
        InputError: it is missing, damaged, not a reconstruction, or of another schema version.
    """
    path = folder / DOCUMENT_FILE
    try:
        document = parse_json(read_regular(path, MAX_DOCUMENT_BYTES))
    except OSError as error:
        raise unreadable(path, error) from error
    except ValueError as error:
        raise InputError(f"cannot read {path}: it is not JSON ({error}); run the reconstruction again") from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            f"cannot read {path}: it does not describe a reconstruction; name the folder of a finished run"
        )
    if document.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"cannot read {path}: its schema version is {reprlib.repr(document.get('schema_version'))}, and this "
            f"PhySIC reads {SCHEMA_VERSION}; load it with the PhySIC that wrote it, or run the reconstruction again"
        )
    if fault := schema_fault(document):
        raise InputError(f"cannot read {path}: {fault}; run the reconstruction again")
    return document


def unreadable(path: Path, error: OSError) -> InputError:
    """Return the error for an unreadable file of a result."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return InputError(f"cannot read {path}: there is no such file; name the folder of a finished run")
    return InputError(f"cannot read {path}: {error.strerror}; check who may read it")


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
        "world_contact": person.world_contact,
        "age": person.age,
        "stature": person.stature,
        "vertices": len(person.vertices),
    }


def _spec(name: str, dtype: str, shape: Sequence[str | int], meaning: str) -> dict[str, Any]:
    return {"name": name, "dtype": dtype, "shape": " x ".join(map(str, shape)) or "one", "meaning": meaning}
