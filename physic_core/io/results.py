"""Write a reconstruction to a folder and read it back."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_core.files.npz import MAX_ARRAY_BYTES, read_arrays, read_headers
from physic_core.files.regular import open_regular
from physic_core.files.strict_json import from_json
from physic_core.io.arrays import (
    PERSON_ARRAYS,
    SHARED_ARRAYS,
    check_arrays,
    number_of_people,
)
from physic_core.io.compact import (
    array_specs,
    expand_arrays,
    expand_people,
    is_compact,
    is_kept_without_scene,
)
from physic_core.io.document import parse_skeleton, read_document, unreadable
from physic_core.io.records import from_record, from_records
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    PEOPLE_FILE,
    file_digest,
)
from physic_core.types import (
    NO_PARTNER,
    BodyContact,
    BodyParameters,
    CheckResult,
    ContactPartner,
    Grade,
    Intrinsics,
    Lens,
    Person,
    Plane,
    Reconstruction,
    Scene,
    StageRecord,
    Support,
    UnposedPerson,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from io import BufferedReader

    from numpy.typing import NDArray

    from physic_core.files.npz import ArrayHeader
    from physic_core.io.arrays import ArraySpec

_SMALL = 256 << 20
_MAX_RATIO = 50
"""Arrays may have 256 MB plus 50 times the size of their file: photos and depth compress by less than 10."""


def load_reconstruction(folder: str | os.PathLike[str]) -> Reconstruction:
    """Read a reconstruction that :func:`save_reconstruction` wrote, and verify digests, dtypes and shapes.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    folder = Path(folder)
    document = read_document(folder)
    arrays = _arrays(folder, document)
    try:
        return _assemble(document, arrays)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise _incomplete(folder, error) from error


def load_people(folder: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Read the arrays of a result saved with ``--save people``, and verify digests, dtypes and shapes.

    Returns:
        The arrays by name, as in :mod:`physic_core.io.arrays`, such as ``person_0_vertices`` (V, 3), metres, in the
        frame of the OpenCV camera.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    folder = Path(folder)
    return _arrays(folder, read_document(folder), file=PEOPLE_FILE)


def read_image(folder: Path) -> NDArray[np.uint8]:
    """Read the image (H, W, 3) uint8 of a result alone; its arrays are verified as by :func:`load_reconstruction`.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    image: NDArray[np.uint8] = _arrays(folder, read_document(folder), only=("image",))["image"]
    return image


def _incomplete(folder: Path, error: Exception) -> InputError:
    return InputError(
        f"cannot read {folder / DOCUMENT_FILE}: an entry is missing or of the wrong type ({_brief(error)}); "
        "run the reconstruction again"
    )


def _brief(error: Exception) -> str:
    """Return the message of a library error, which may quote the file."""
    text = str(error)
    text = text if len(text) <= 300 else f"{text[:300]} ..."
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _arrays(
    folder: Path, document: Mapping[str, Any], only: Sequence[str] | None = None, file: str = ARRAYS_FILE
) -> dict[str, NDArray[Any]]:
    """Read and verify the arrays of a result, or only some of the shared ones."""
    path = folder / file
    listed = document["files"]
    if file not in listed and (other := {ARRAYS_FILE: PEOPLE_FILE, PEOPLE_FILE: ARRAYS_FILE}[file]) in listed:
        reader = "load_people" if other == PEOPLE_FILE else "load_reconstruction"
        raise InputError(f"cannot read {path}: this result was saved as {other}; physic_core.{reader} reads it")
    try:
        with open_regular(path) as stream:
            return _verified_arrays(stream, path, document, only)
    except OSError as error:
        raise unreadable(path, error) from error


def _verified_arrays(
    stream: BufferedReader, path: Path, document: Mapping[str, Any], only: Sequence[str] | None
) -> dict[str, NDArray[Any]]:
    if file_digest(stream) != document["digests"].get(path.name):
        raise InputError(
            f"cannot read {path}: its SHA-256 differs from that in {DOCUMENT_FILE} beside it, so it is damaged, or "
            f"from another run; run the reconstruction again"
        )
    try:
        headers = read_headers(stream)
        wanted = _wanted(path, headers, document)
        limit = min(MAX_ARRAY_BYTES, _SMALL + _MAX_RATIO * os.fstat(stream.fileno()).st_size)
        arrays = read_arrays(stream, wanted if only is None else only, limit=limit)
        if only is None:
            _check_values(arrays, document)
            arrays = expand_people(arrays) if path.name == PEOPLE_FILE else expand_arrays(arrays)
    except InputError:
        raise
    except (KeyError, TypeError) as error:
        raise _incomplete(path.parent, error) from error
    except Exception as error:  # zipfile, zlib and numpy raise a dozen classes for flipped and missing bytes
        raise InputError(
            f"cannot read {path}: it is damaged ({_brief(error)}); run the reconstruction again"
        ) from error
    return arrays


def _wanted(path: Path, headers: Mapping[str, ArrayHeader], document: Mapping[str, Any]) -> list[str]:
    """Return the names of the arrays to read, after checks of all dtypes and shapes.

    Raises:
        InputError: an array is missing.
        ValueError: an array has the wrong dtype or shape, or the people differ.
        KeyError, TypeError: an entry of the document is missing, or of the wrong type.
    """
    people, image = len(document["people"]), document["image"]
    sizes = {"H": image["height"], "W": image["width"], "P": 0 if document["scene"]["floor"] is None else 1}
    is_of_people_alone = path.name == PEOPLE_FILE
    compact = is_of_people_alone or is_compact(headers)
    shared, of_person = array_specs(headers, compact=compact)
    if is_of_people_alone:
        shared = tuple(spec for spec in shared if is_kept_without_scene(spec.name))
    required = [spec.name for spec in shared]
    required += [f"person_{i}_{spec.name}" for i in range(people) for spec in of_person if not spec.optional]
    if missing := [name for name in required if name not in headers]:
        raise InputError(
            f"cannot read {path}: it has no {', '.join(missing[:20])}{', ...' * (len(missing) > 20)}; "
            "run the reconstruction again"
        )
    if (found := number_of_people(headers)) > people:
        raise ValueError(f"it has arrays for {found} people, but {DOCUMENT_FILE} lists {people}")
    check_arrays(headers, sizes, people, (shared, of_person))
    optional = [f"person_{i}_{spec.name}" for i in range(people) for spec in of_person if spec.optional]
    return [*required, *(name for name in optional if name in headers)]


def _check_values(arrays: Mapping[str, NDArray[Any]], document: Mapping[str, Any]) -> None:
    """Raise ValueError if arrays contradict each other or the document."""
    for name in ("body_model", "skeleton"):
        if str(arrays[name]) != document[name]:
            raise ValueError(f"{name} is {str(arrays[name])[:60]!r}, but {DOCUMENT_FILE} has {document[name][:60]!r}")
    partners = len(document["contact_partners"])
    for index in range(len(document["people"])):
        ids = arrays.get(f"person_{index}_contact_partner")
        if ids is not None and ids.size and (ids.min() < NO_PARTNER or ids.max() >= partners):
            raise ValueError(
                f"person_{index}_contact_partner has {ids.min()} to {ids.max()}, but there are {partners} partners"
            )
    faces = arrays["faces"]
    if document["people"] and faces.size:
        vertices = len(arrays["person_0_vertices"])
        if faces.min() < 0 or faces.max() >= vertices:
            raise ValueError(f"faces has vertices {faces.min()} to {faces.max()}, but a person has {vertices}")


def _assemble(document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Reconstruction:
    scene = document["scene"]
    floor = scene["floor"]
    own, of_scene = _values(SHARED_ARRAYS, arrays), _values(SHARED_ARRAYS, arrays, "scene.")
    return Reconstruction(
        **own,
        intrinsics=from_record(Intrinsics, document["intrinsics"]),
        scene=Scene(
            **of_scene,
            floor=None if floor is None else Plane(arrays["floor_normal"][0], from_json(floor["offset"])),
            scale=from_json(scene["scale"]),
            scale_sigma=from_json(scene["scale_sigma"]),
        ),
        people=tuple(_person(record, index, arrays) for index, record in enumerate(document["people"])),
        body_model=document["body_model"],
        skeleton=parse_skeleton(document),
        stages=from_records(StageRecord, document["stages"]),
        diagnostics=from_json(document["diagnostics"]),
        warnings=tuple(document["warnings"]),
        notes=tuple(document["notes"]),
        config=from_json(document["config"]),
        checks=from_records(CheckResult, document["checks"]),
        grade=None if document["grade"] is None else Grade(document["grade"]),
        photo=document["photo"],
        unposed=from_records(UnposedPerson, document["unposed"]),
        lens=None if document["lens"] is None else from_record(Lens, document["lens"]),
        contact_partners=from_records(ContactPartner, document["contact_partners"]),
    )


def _person(record: Mapping[str, Any], index: int, arrays: Mapping[str, NDArray[Any]]) -> Person:
    prefix = f"person_{index}_"
    return Person(
        **_values(PERSON_ARRAYS, arrays, prefix=prefix),
        score=from_json(record["score"]),
        parameters=BodyParameters(**_values(PERSON_ARRAYS, arrays, "parameters.", prefix)),
        failed_checks=tuple(record["failed_checks"]),
        unknown_checks=tuple(record["unknown_checks"]),
        grade=None if record["grade"] is None else Grade(record["grade"]),
        contacts=from_records(BodyContact, record["contacts"]),
        support=None if record["support"] is None else from_record(Support, record["support"]),
        age=record["age"],
        world_contact=record.get("world_contact"),
        stature=from_json(record.get("stature")),
    )


def _values(
    specs: Sequence[ArraySpec], arrays: Mapping[str, NDArray[Any]], owner: str = "", prefix: str = ""
) -> dict[str, Any]:
    """Return the arrays by the attributes of one object, such as those that start with "scene."."""
    of_owner = {spec.attribute.removeprefix(owner): prefix + spec.name for spec in specs if _owner(spec) == owner}
    return {attribute: arrays.get(name) for attribute, name in of_owner.items()}


def _owner(spec: ArraySpec) -> str | None:
    """Return the attribute up to its last dot; None for an array that is converted."""
    return "".join(spec.attribute.rpartition(".")[:2]) if spec.attribute else None
