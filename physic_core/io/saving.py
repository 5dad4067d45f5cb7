"""Write a reconstruction to a folder: the files that one word names, such as "full" or "numbers+preview"."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.files.atomic import atomic_write, check_writable
from physic_core.files.npz import write_arrays
from physic_core.io.arrays import to_arrays
from physic_core.io.compact import array_specs, compact_arrays, is_kept_without_scene
from physic_core.io.document import encode_document, to_document
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    PEOPLE_FILE,
    PREVIEW_FILE,
    REPORT_FILE,
    check_overwrite,
    digest_of,
    file_digest,
    unchanged_result_files,
)
from physic_core.io.saved_files import Saving

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from physic_core.io.arrays import ArraySpec
    from physic_core.types import Reconstruction


def save_reconstruction(
    reconstruction: Reconstruction,
    folder: str | os.PathLike[str],
    save: str | Saving = "full",
    *,
    title: str = "",
    overwrite: bool = False,
    beside: Mapping[str, bytes] | None = None,
    photos: str = "",
) -> tuple[Path, ...]:
    """Write the files of a result to a folder.

    JSON, arrays and pictures are all written, or none; if the process is killed, the folder may have no result. Numbers
    have the dtypes of :mod:`physic_core.io.arrays`. An earlier result of the same photo is replaced. The result of
    another photo and changed files are replaced only with ``overwrite``. The photo, and files that no run wrote, are
    never replaced.

    Args:
        reconstruction: what to save.
        folder: created if missing.
        save: which files, such as "numbers+preview"; :mod:`physic_core.io.saved_files` has the words.
        title: of the report, such as the name of the photo; by default the name of the folder.
        overwrite: whether to replace another photo's result, or changed files of a result.
        beside: name and content of further files, which are files of the result too; none at level "summary".
        photos: digests of all photos of one moment, whose earlier results are replaced; "" for that of the result.

    Returns:
        Paths of the written files.

    Raises:
        ConfigError: ``save`` is not valid.
        OutputError: the folder cannot be written, or data of the user would be lost.
        PackageMissingError: a report is to be written, and no installed plugin makes it.
        Exception: a picture cannot be made; the numbers are then written without pictures.
    """
    saving, folder = Saving.parse(save), Path(folder)
    written: tuple[Path, ...] = ()
    if saving.level != "summary":
        written = _save_result(reconstruction, folder, saving, beside or {}, photos or reconstruction.photo, overwrite)
    elif saving.preview:
        from physic_core.files.own import write_own
        from physic_core.visual.preview import preview_png

        written = (write_own(folder / PREVIEW_FILE, preview_png(reconstruction)),)
    if saving.report:
        from physic_core.io.report_file import add_report, save_report

        if saving.level == "summary":
            save_report(reconstruction, folder / REPORT_FILE, title)
        else:
            add_report(folder, reconstruction, title)
        written = (*written, folder / REPORT_FILE)
    return written


def _save_result(
    reconstruction: Reconstruction,
    folder: Path,
    saving: Saving,
    beside: Mapping[str, bytes],
    photos: str,
    overwrite: bool,
) -> tuple[Path, ...]:
    """Write JSON, arrays, pictures and the files beside them."""
    stored = _stored_arrays(reconstruction, saving)
    names = [DOCUMENT_FILE, stored.file]
    if saving.glb != "none":
        names.append("combined.glb")
    if saving.glb == "all":
        names += ["scene.glb", *(f"person_{index}.glb" for index in range(len(reconstruction.people)))]
    names += [*([PREVIEW_FILE] if saving.preview else []), *beside]
    check_overwrite(folder, photos, overwrite=overwrite, names=names)
    folder = check_writable(folder)
    # Pictures are made before the folder is locked.
    pictures, failure = _pictures(reconstruction, saving)
    further = {name: pictures[name] for name in names if name in pictures} | dict(beside)
    written = _write(reconstruction, folder, stored, further, photos, overwrite=overwrite)
    if failure is not None:
        raise failure
    return written


def _stored_arrays(reconstruction: Reconstruction, saving: Saving) -> _StoredArrays:
    """Return the arrays of a level, and how they are stored."""
    arrays, views = to_arrays(reconstruction), [camera.people for camera in reconstruction.cameras]
    if saving.is_exact:
        return _StoredArrays(ARRAYS_FILE, arrays, array_specs(arrays, compact=False, views=views), "f")
    arrays = compact_arrays(arrays)
    if saving.level != "people":
        return _StoredArrays(ARRAYS_FILE, arrays, array_specs(arrays, compact=True, views=views))
    arrays = {name: array for name, array in arrays.items() if is_kept_without_scene(name)}
    shared, of_person = array_specs(arrays, compact=True, views=views)
    return _StoredArrays(PEOPLE_FILE, arrays, (tuple(spec for spec in shared if spec.name in arrays), of_person))


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


def _pictures(reconstruction: Reconstruction, saving: Saving) -> tuple[dict[str, bytes], Exception | None]:
    """Return GLB files and preview by name, and the error if they cannot be made."""
    if saving.glb == "none" and not saving.preview:
        return {}, None
    from threadpoolctl import threadpool_limits

    try:
        # Matrices of three columns: other threads of BLAS would take as much processor time again, waiting.
        with threadpool_limits(limits=1, user_api="blas"):
            made = dict[str, bytes]()
            if saving.glb != "none":
                from physic_core.visual.glb import glb_files

                made |= glb_files(reconstruction, parts=saving.glb == "all")
            if saving.preview:
                from physic_core.visual.preview import preview_png

                made[PREVIEW_FILE] = preview_png(reconstruction)
    except Exception as error:
        return {}, error
    return made, None
