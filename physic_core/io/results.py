"""Write a reconstruction to a folder and read it back."""

from __future__ import annotations

import os
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError
from physic_core.files.atomic import atomic_write, check_writable
from physic_core.files.npz import read_arrays, write_arrays
from physic_core.files.strict_json import from_json
from physic_core.io.arrays import (
    PARAMETER_NAMES,
    PERSON_ARRAYS,
    SHARED_ARRAYS,
    npz_checksum,
    to_arrays,
)
from physic_core.io.check_records import parse_checks, parse_grade
from physic_core.io.compact import COMPACT_PERSON_ARRAYS, COMPACT_SHARED_ARRAYS, compact_arrays, expand_arrays
from physic_core.io.document import (
    decode_document,
    encode_document,
    parse_skeleton,
    parse_stages,
    parse_trust,
    parse_unposed,
    to_document,
)
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    PREVIEW_FILE,
    check_overwrite,
    file_digest,
    unchanged_result_files,
)
from physic_core.types import BodyParameters, CheckState, Intrinsics, Lens, Person, Plane, Reconstruction, Scene

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from physic_core.types import CheckResult

__all__ = [
    "ARRAYS_FILE",
    "DOCUMENT_FILE",
    "PREVIEW_FILE",
    "check_writable",
    "load_reconstruction",
    "save_reconstruction",
]


_COMPACT_NAMES = {"scene_points": ("scene_depth",), "scene_colors": ("scene_colors_change",)}


def save_reconstruction(
    reconstruction: Reconstruction,
    folder: str | os.PathLike[str],
    *,
    preview: bool = True,
    glb: bool = True,
    compact: bool = False,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write ``reconstruction.json``, ``reconstruction.npz``, the GLB files and ``preview.png`` to a folder.

    Files are written to temporary names and then renamed. Numbers have the dtypes of :mod:`physic_core.io.arrays`. An
    earlier result of the same photo is replaced. The result of another photo and changed files are replaced only with
    ``overwrite``. The photo, and files that no run wrote, are never replaced.

    Args:
        reconstruction: what to save.
        folder: created if missing.
        preview: whether to write ``preview.png``.
        glb: whether to write the GLB files.
        compact: whether to write the arrays in their smaller form; see :mod:`physic_core.io.compact`.
        overwrite: whether to replace another photo's result, or changed files of a result.

    Returns:
        Paths of the written files.

    Raises:
        OutputError: the folder cannot be written, or data of the user would be lost.
    """
    from physic_core.visual.glb import glb_files

    names = [DOCUMENT_FILE, ARRAYS_FILE]
    if glb:
        people = (f"person_{index}.glb" for index in range(len(reconstruction.people)))
        names += ["scene.glb", "combined.glb", *people]
    names += [PREVIEW_FILE] if preview else []
    arrays, specs = to_arrays(reconstruction), (SHARED_ARRAYS, PERSON_ARRAYS)
    if compact:
        arrays, specs = compact_arrays(arrays), (COMPACT_SHARED_ARRAYS, COMPACT_PERSON_ARRAYS)

    def document() -> bytes:
        return encode_document(to_document(reconstruction, names, arrays_checksum, digests, specs))

    check_overwrite(folder, reconstruction.photo, overwrite=overwrite, names=names)
    folder = check_writable(folder)
    earlier = unchanged_result_files(folder)
    stale = [folder / name for name in earlier.difference(names)]
    # Digests of the earlier images, which stay until the new ones are written.
    digests = {name: file_digest(folder / name) for name in earlier.intersection(names) if name != DOCUMENT_FILE}
    with atomic_write(folder) as temporary:
        # The document first: if the process ends between the two, the folder is still recognised as a result.
        document_file, arrays_file = temporary(DOCUMENT_FILE), temporary(ARRAYS_FILE)
        write_arrays(arrays_file, arrays, stored="" if compact else "f")
        arrays_checksum = npz_checksum(arrays_file)
        digests[ARRAYS_FILE] = file_digest(arrays_file)
        document_file.write_bytes(document())
        for path in stale:
            with suppress(OSError):
                path.unlink()
    # The numbers are safe by now, whatever becomes of the pictures.
    with atomic_write(folder) as temporary:

        def write(name: str, content: bytes) -> None:
            temporary(name).write_bytes(content)
            digests[name] = file_digest(temporary(name))

        document_file = temporary(DOCUMENT_FILE)
        for name, content in glb_files(reconstruction) if glb else ():
            write(name, content)
        if preview:
            from physic_core.visual.preview import preview_png

            write(PREVIEW_FILE, preview_png(reconstruction))
        document_file.write_bytes(document())
    return tuple(folder / name for name in names)


def load_reconstruction(folder: str | os.PathLike[str]) -> Reconstruction:
    """Read a reconstruction that :func:`save_reconstruction` wrote.

    Raises:
        InputError: a file is missing, damaged, from another run, or of another schema version.
    """
    folder = Path(folder)
    document = decode_document(_content(folder / DOCUMENT_FILE), str(folder / DOCUMENT_FILE))
    arrays = _arrays(folder / ARRAYS_FILE, document)
    try:
        return _assemble(document, arrays)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"cannot read {folder / DOCUMENT_FILE}: an entry is missing or of another kind ({error}); "
            "run the reconstruction again"
        ) from error


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"cannot read {path}: there is no such file; name the folder of a finished run") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check who may read it") from error


def _arrays(path: Path, document: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    people = len(document.get("people", ()))
    wanted = [spec.name for spec in SHARED_ARRAYS]
    wanted += [f"person_{index}_{spec.name}" for index in range(people) for spec in PERSON_ARRAYS]
    try:
        found = npz_checksum(path)
        with path.open("rb") as stream:
            names = zipfile.ZipFile(stream).namelist()
            present = {name.removesuffix(".npy") for name in names}
            wanted = [next((n for n in (name, *_COMPACT_NAMES.get(name, ())) if n in present), name) for name in wanted]
            if missing := [name for name in wanted if name not in present]:
                raise InputError(f"cannot read {path}: it lacks {', '.join(missing)}; run the reconstruction again")
            arrays = expand_arrays(read_arrays(stream, wanted))
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"cannot read {path}: there is no such file; name the folder of a finished run") from None
    except Exception as error:  # zipfile, zlib and numpy raise a dozen classes for flipped and missing bytes
        raise InputError(f"cannot read {path}: it is damaged ({error}); run the reconstruction again") from error
    if found != document.get("arrays", {}).get("checksum"):
        raise InputError(
            f"cannot read {path}: it is not of the same run as {DOCUMENT_FILE} beside it; run the reconstruction again"
        )
    return arrays


def _assemble(document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Reconstruction:
    camera, scene = document["intrinsics"], document["scene"]
    floor = scene["floor"]
    # The first results were written without checks.
    checks = parse_checks(document.get("checks", ()), document["schema_version"])
    return Reconstruction(
        image=arrays["image"],
        intrinsics=_camera(camera),
        scene=Scene(
            points=arrays["scene_points"],
            normals=arrays["scene_normals"],
            colors=arrays["scene_colors"],
            valid=arrays["scene_valid"],
            floor=None if floor is None else Plane(arrays["floor_normal"][0], from_json(floor["offset"])),
            floor_points=arrays["floor_points"],
            scale=from_json(scene["scale"]),
            scale_sigma=from_json(scene["scale_sigma"]),
        ),
        people=tuple(_person(record, index, arrays, checks) for index, record in enumerate(document["people"])),
        faces=arrays["faces"],
        body_model=document["body_model"],
        skeleton=parse_skeleton(document),
        stages=parse_stages(document["stages"]),
        diagnostics=from_json(document["diagnostics"]),
        warnings=tuple(document["warnings"]),
        notes=tuple(document["notes"]),
        config=from_json(document["config"]),
        checks=checks,
        grade=parse_grade(document),
        photo=document.get("photo", ""),
        unposed=parse_unposed(document.get("unposed", ())),
        lens=_lens(document.get("lens")),
    )


def _camera(camera: Mapping[str, Any]) -> Intrinsics:
    return Intrinsics(
        fx=from_json(camera["fx"]),
        fy=from_json(camera["fy"]),
        cx=from_json(camera["cx"]),
        cy=from_json(camera["cy"]),
        width=camera["width"],
        height=camera["height"],
        source=camera["source"],
        trust=parse_trust(camera),
        focal_sigma=camera.get("focal_sigma"),
    )


def _lens(lens: Mapping[str, Any] | None) -> Lens | None:
    if lens is None:
        return None
    k1, k2, p1, p2, k3 = (float(v) for v in from_json(lens["distortion"]))
    return Lens(_camera(lens["intrinsics"]), (k1, k2, p1, p2, k3))


def _person(
    record: Mapping[str, Any], index: int, arrays: Mapping[str, NDArray[Any]], checks: Sequence[CheckResult]
) -> Person:
    def of(name: str) -> NDArray[Any]:
        return arrays[f"person_{index}_{name}"]

    # Documents of version 1 do not list them.
    unknown = [check.name for check in checks if check.person == index and check.state is CheckState.UNKNOWN]
    return Person(
        box=of("box"),
        score=from_json(record["score"]),
        mask=of("mask"),
        keypoints=of("keypoints"),
        keypoint_confidence=of("keypoint_confidence"),
        parameters=BodyParameters(**{name: of(name) for name in PARAMETER_NAMES}),
        vertices=of("vertices"),
        joints=of("joints"),
        contact=of("contact"),
        distance=of("distance"),
        failed_checks=tuple(record["failed_checks"]),
        unknown_checks=tuple(record.get("unknown_checks", unknown)),
        grade=parse_grade(record),
    )
