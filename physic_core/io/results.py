"""Write a reconstruction to a folder and read it back."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from physic_core.errors import InputError
from physic_core.files.atomic import atomic_write, check_writable
from physic_core.files.npz import MAX_ARRAY_BYTES, read_arrays, read_headers, write_arrays
from physic_core.files.regular import open_regular, read_regular
from physic_core.files.strict_json import from_json
from physic_core.io.arrays import (
    CAMERA_ARRAYS,
    DETECTION_ARRAYS,
    PERSON_ARRAYS,
    SHARED_ARRAYS,
    check_arrays,
    number_of_people,
    to_arrays,
)
from physic_core.io.compact import (
    array_specs,
    compact_arrays,
    expand_arrays,
    expand_people,
    is_compact,
    is_kept_without_scene,
)
from physic_core.io.document import (
    decode_document,
    encode_document,
    parse_skeleton,
    to_document,
)
from physic_core.io.records import from_record, from_record_or_none, from_records, parse_grade
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    MAX_DOCUMENT_BYTES,
    PEOPLE_FILE,
    PREVIEW_FILE,
    check_overwrite,
    digest_of,
    file_digest,
    unchanged_result_files,
)
from physic_core.types import (
    NO_PARTNER,
    BodyContact,
    BodyParameters,
    CameraView,
    CheckResult,
    ContactPartner,
    Detection,
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
"""Arrays may have 256 MB, and 50 times the size of their file beyond: photos and depth compress by less than 10."""


def save_reconstruction(
    reconstruction: Reconstruction,
    folder: str | os.PathLike[str],
    *,
    preview: bool = True,
    glb: bool | Literal["combined"] = True,
    compact: bool = False,
    overwrite: bool = False,
    beside: Mapping[str, bytes] | None = None,
    photos: str = "",
) -> tuple[Path, ...]:
    """Write ``reconstruction.json``, ``reconstruction.npz``, the GLB files and ``preview.png`` to a folder.

    All files are written, or none; if the process is killed, the folder may have no result. Numbers have the dtypes of
    :mod:`physic_core.io.arrays`. An earlier result of the same photo is replaced. The result of another photo and
    changed files are replaced only with ``overwrite``. The photo, and files that no run wrote, are never replaced.

    Args:
        reconstruction: what to save.
        folder: created if missing.
        preview: whether to write ``preview.png``.
        glb: whether to write the GLB files; "combined" for ``combined.glb`` alone, which has everything.
        compact: whether to write the arrays in their smaller form; see :mod:`physic_core.io.compact`.
        overwrite: whether to replace another photo's result, or changed files of a result.
        beside: name and content of further files, which are files of the result too.
        photos: digests of all photos of one moment, whose earlier results are replaced; "" for that of the result.

    Returns:
        Paths of the written files.

    Raises:
        OutputError: the folder cannot be written, or data of the user would be lost.
        Exception: a picture cannot be made; the numbers are then written without pictures.
    """
    names = [DOCUMENT_FILE, ARRAYS_FILE]
    if glb:
        names.append("combined.glb")
    if glb is True:
        names += ["scene.glb", *(f"person_{index}.glb" for index in range(len(reconstruction.people)))]
    names += [*([PREVIEW_FILE] if preview else []), *(beside or ())]
    photos = photos or reconstruction.photo
    check_overwrite(folder, photos, overwrite=overwrite, names=names)
    folder = check_writable(folder)
    arrays = to_arrays(reconstruction)
    if compact:
        arrays = compact_arrays(arrays)
    # Pictures are made before the folder is locked.
    pictures, failure = _pictures(reconstruction, preview=preview, glb=glb)
    specs = array_specs(arrays, compact=compact, views=[camera.people for camera in reconstruction.cameras])
    stored = _StoredArrays(ARRAYS_FILE, arrays, specs, "" if compact else "f")
    further = {name: pictures[name] for name in names if name in pictures} | dict(beside or {})
    written = _write(reconstruction, folder, stored, further, photos, overwrite=overwrite)
    if failure is not None:
        raise failure
    return written


def save_people(
    reconstruction: Reconstruction,
    folder: str | os.PathLike[str],
    *,
    preview: bool = False,
    overwrite: bool = False,
    beside: Mapping[str, bytes] | None = None,
) -> tuple[Path, ...]:
    """Write ``reconstruction.json`` and the people's arrays in their smaller form, which :func:`load_people` reads.

    Arguments, return value and errors are those of :func:`save_reconstruction`.
    """
    pictures = dict[str, bytes]()
    if preview:
        from physic_core.visual.preview import preview_png

        pictures[PREVIEW_FILE] = preview_png(reconstruction)
    arrays = {n: a for n, a in compact_arrays(to_arrays(reconstruction)).items() if is_kept_without_scene(n)}
    views = [camera.people for camera in reconstruction.cameras]
    shared, of_person = array_specs(arrays, compact=True, views=views)
    specs = tuple(spec for spec in shared if spec.name in arrays), of_person
    stored = _StoredArrays(PEOPLE_FILE, arrays, specs)
    further = pictures | dict(beside or {})
    return _write(reconstruction, check_writable(folder), stored, further, reconstruction.photo, overwrite=overwrite)


@dataclass(frozen=True)
class _StoredArrays:
    """Arrays, their file, their specifications, and the kinds of dtype that are not compressed."""

    file: str
    arrays: Mapping[str, NDArray[Any]]
    specs: tuple[Sequence[ArraySpec], Sequence[ArraySpec]]
    uncompressed: str = ""


def _write(
    reconstruction: Reconstruction,
    folder: Path,
    stored: _StoredArrays,
    further: Mapping[str, bytes],
    photos: str,
    *,
    overwrite: bool,
) -> tuple[Path, ...]:
    """Write document, arrays and further files, all or none; delete unchanged files of an earlier result."""
    names = [DOCUMENT_FILE, stored.file, *further]
    with atomic_write(folder, index=DOCUMENT_FILE) as temporary:
        check_overwrite(folder, photos, overwrite=overwrite, names=names)
        for name in unchanged_result_files(folder).difference(names):
            temporary.remove(name)
        document_file, arrays_file = temporary(DOCUMENT_FILE), temporary(stored.file)
        write_arrays(arrays_file, stored.arrays, stored=stored.uncompressed)
        digests = {stored.file: file_digest(arrays_file)}
        for name, content in further.items():
            temporary(name).write_bytes(content)
            digests[name] = digest_of(content)
        document = to_document(reconstruction, names, digests, stored.specs)
        document_file.write_bytes(encode_document(document))
    return tuple(folder / name for name in names)


def add_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files (name -> content) to the folder of a result, and list them in its document, if that can be read.

    Raises:
        OutputError: a file cannot be written.
    """
    with atomic_write(check_writable(folder), index=DOCUMENT_FILE) as temporary:
        # Read while the folder is locked: another process may just have saved another result.
        with suppress(InputError):
            document = read_document(folder)
            document["files"] = [*(name for name in document["files"] if name not in files), *files]
            document["digests"] = document["digests"] | {name: digest_of(files[name]) for name in files}
            temporary(DOCUMENT_FILE).write_bytes(encode_document(document))
        for name, content in files.items():
            temporary(name).write_bytes(content)


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
    """Read the arrays of a result that ``physic batch --save people`` wrote, and verify digests, dtypes and shapes.

    Returns:
        The arrays by name, as in :mod:`physic_core.io.arrays`, such as ``person_0_vertices`` (V, 3), metres, in the
        frame of the OpenCV camera.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    folder = Path(folder)
    return _arrays(folder, read_document(folder), file=PEOPLE_FILE)


def read_document(folder: Path) -> dict[str, Any]:
    """Read ``reconstruction.json`` of a folder and verify it; NaN and infinities stay strings.

    Raises:
        InputError: it is missing, damaged, or of another schema version.
    """
    path = folder / DOCUMENT_FILE
    try:
        content = read_regular(path, MAX_DOCUMENT_BYTES)
    except OSError as error:
        raise _unreadable(path, error) from error
    return decode_document(content, str(path))


def read_image(folder: Path) -> NDArray[np.uint8]:
    """Read the image (H, W, 3) uint8 of a result alone; its arrays are verified as by :func:`load_reconstruction`.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    image: NDArray[np.uint8] = _arrays(folder, read_document(folder), only=("image",))["image"]
    return image


def _pictures(
    reconstruction: Reconstruction, *, preview: bool, glb: bool | str
) -> tuple[dict[str, bytes], Exception | None]:
    """Return GLB files and preview by name, and the error if they cannot be made."""
    if not (glb or preview):
        return {}, None
    from threadpoolctl import threadpool_limits

    try:
        # Matrices of three columns: other threads of BLAS would take as much processor time again, waiting.
        with threadpool_limits(limits=1, user_api="blas"):
            made = dict[str, bytes]()
            if glb:
                from physic_core.visual.glb import glb_files

                made |= glb_files(reconstruction, parts=glb is True)
            if preview:
                from physic_core.visual.preview import preview_png

                made[PREVIEW_FILE] = preview_png(reconstruction)
    except Exception as error:
        return {}, error
    return made, None


def _incomplete(folder: Path, error: Exception) -> InputError:
    return InputError(
        f"cannot read {folder / DOCUMENT_FILE}: an entry is missing or of another kind ({_brief(error)}); "
        "run the reconstruction again"
    )


def _brief(error: Exception) -> str:
    """Return the message of an error of a library, which can quote the file."""
    text = str(error)
    text = text if len(text) <= 300 else f"{text[:300]} ..."
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _unreadable(path: Path, error: OSError) -> InputError:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return InputError(f"cannot read {path}: there is no such file; name the folder of a finished run")
    return InputError(f"cannot read {path}: {error.strerror}; check who may read it")


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
        raise _unreadable(path, error) from error


def _verified_arrays(
    stream: BufferedReader, path: Path, document: Mapping[str, Any], only: Sequence[str] | None
) -> dict[str, NDArray[Any]]:
    if file_digest(stream) != document["digests"].get(path.name):
        raise InputError(
            f"cannot read {path}: its SHA-256 is not the one in {DOCUMENT_FILE} beside it, so it is damaged, or of "
            "another run; run the reconstruction again"
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
        ValueError: an array has another dtype or shape, or there are other people.
        KeyError, TypeError: an entry of the document is missing, or of another kind.
    """
    people, image = len(document["people"]), document["image"]
    sizes = {"H": image["height"], "W": image["width"], "P": 0 if document["scene"]["floor"] is None else 1}
    is_of_people_alone = path.name == PEOPLE_FILE
    views = [[one["index"] for one in camera.get("people", ())] for camera in document.get("cameras", ())]
    if strangers := {index for view in views for index in view} - set(range(people)):
        raise ValueError(f"{DOCUMENT_FILE} lists person {min(strangers)} in a photo, and has {people} people")
    for number, camera in enumerate(document.get("cameras", ())[1:], start=1):
        sizes |= {f"H{number}": camera["intrinsics"]["height"], f"W{number}": camera["intrinsics"]["width"]}
    compact = is_of_people_alone or is_compact(headers)
    shared, of_person = array_specs(headers, compact=compact, views=views)
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
        raise ValueError(f"it has arrays of {found} people, and {DOCUMENT_FILE} lists {people}")
    check_arrays(headers, sizes, people, (shared, of_person))
    optional = [f"person_{i}_{spec.name}" for i in range(people) for spec in of_person if spec.optional]
    return [*required, *(name for name in optional if name in headers)]


def _check_values(arrays: Mapping[str, NDArray[Any]], document: Mapping[str, Any]) -> None:
    """Raise ValueError if arrays contradict each other or the document."""
    for name in ("body_model", "skeleton"):
        if str(arrays[name]) != document[name]:
            raise ValueError(f"{name} is {str(arrays[name])[:60]!r}, and {DOCUMENT_FILE} has {document[name][:60]!r}")
    partners = len(document["contact_partners"])
    for index in range(len(document["people"])):
        ids = arrays.get(f"person_{index}_contact_partner")
        if ids is not None and ids.size and (ids.min() < NO_PARTNER or ids.max() >= partners):
            raise ValueError(f"person_{index}_contact_partner has {ids.min()} to {ids.max()}, of {partners} partners")
    faces = arrays["faces"]
    if document["people"] and faces.size:
        vertices = len(arrays["person_0_vertices"])
        if faces.min() < 0 or faces.max() >= vertices:
            raise ValueError(f"faces has vertices {faces.min()} to {faces.max()}, and a person has {vertices}")


def _assemble(document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Reconstruction:
    scene = document["scene"]
    floor = scene["floor"]
    own, of_scene = _values(SHARED_ARRAYS, arrays), _values(SHARED_ARRAYS, arrays, "scene.")
    result = Reconstruction(
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
        grade=parse_grade(document),
        photo=document["photo"],
        unposed=from_records(UnposedPerson, document["unposed"]),
        lens=from_record_or_none(Lens, document["lens"]),
        contact_partners=from_records(ContactPartner, document["contact_partners"]),
    )
    cameras = document.get("cameras", ())
    others = [_camera(record, f"camera_{c}_", arrays) for c, record in enumerate(cameras) if c]
    first = [CameraView.of_reference(result, record["photo"]) for record in cameras[:1]]
    return replace(result, cameras=(*first, *others)) if first else result


def _camera(record: Mapping[str, Any], prefix: str, arrays: Mapping[str, NDArray[Any]]) -> CameraView:
    """Return a photo but the reference."""
    rotation, translation = (np.array(from_json(record[name]), np.float64) for name in ("rotation", "translation"))
    return CameraView(
        **_values(CAMERA_ARRAYS, arrays, prefix=prefix),
        photo=record["photo"],
        intrinsics=from_record(Intrinsics, record["intrinsics"]),
        rotation=rotation,
        translation=translation,
        rotation_sigma=from_json(record["rotation_sigma"]),
        position_sigma=from_json(record["position_sigma"]),
        people={
            one["index"]: Detection(
                **_values(DETECTION_ARRAYS, arrays, prefix=f"{prefix}person_{one['index']}_"),
                score=from_json(one["score"]),
            )
            for one in record["people"]
        },
    )


def _person(record: Mapping[str, Any], index: int, arrays: Mapping[str, NDArray[Any]]) -> Person:
    prefix = f"person_{index}_"
    return Person(
        **_values(PERSON_ARRAYS, arrays, prefix=prefix),
        score=from_json(record["score"]),
        parameters=BodyParameters(**_values(PERSON_ARRAYS, arrays, "parameters.", prefix)),
        failed_checks=tuple(record["failed_checks"]),
        unknown_checks=tuple(record["unknown_checks"]),
        grade=parse_grade(record),
        contacts=from_records(BodyContact, record["contacts"]),
        support=from_record_or_none(Support, record["support"]),
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
    """Return the start of the attribute up to its last point; None for an array that is converted."""
    return "".join(spec.attribute.rpartition(".")[:2]) if spec.attribute else None
