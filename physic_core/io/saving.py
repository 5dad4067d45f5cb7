"""Write a reconstruction to a folder: the files named by one word, such as "full" or "numbers+preview"."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
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
    earlier_files,
)
from physic_core.io.saved_files import Saving

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

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
    earlier: Collection[str] = (),
) -> tuple[Path, ...]:
    """Write the files of a result to a folder.

    Either all of JSON, arrays and pictures are written, or none; if the process is killed, the folder may have no
    result. Numbers have the dtypes of :mod:`physic_core.io.arrays`. An earlier result of the same photo is replaced,
    that of another photo with ``overwrite`` only. Files of it that were edited are kept: ``preview.png`` as
    ``preview.edited.png``. The photo, and files that no run wrote, are never replaced.

    Args:
        reconstruction: what to save.
        folder: created if missing.
        save: which files, such as "numbers+preview"; see :mod:`physic_core.io.saved_files`.
        title: of the report, such as the name of the photo; by default the name of the folder.
        overwrite: whether to replace another photo's result.
        beside: name and content of further files, which are files of the result too; none at level "summary".
        photos: digests of all photos of one moment, whose earlier results are replaced; "" for that of the result.
        earlier: names of files that an earlier run wrote, which are edited ones if no document lists them.

    Returns:
        Paths of the written files.

    Raises:
        ConfigError: ``save`` is not valid.
        OutputError: the folder cannot be written, or user data would be lost.
        PackageMissingError: a report is requested, and no installed plugin writes it.
        Exception: a picture cannot be made; the numbers are then written without pictures.
    """
    saving, folder = Saving.parse(save), Path(folder)
    written: tuple[Path, ...] = ()
    if saving.level != "summary":
        replaced = _Replaced(photos or reconstruction.photo, overwrite, earlier)
        written = _save_result(reconstruction, folder, saving, beside or {}, replaced)
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
    replaced: _Replaced,
) -> tuple[Path, ...]:
    """Write JSON, arrays, pictures and the files beside them."""
    stored = _stored_arrays(reconstruction, saving)
    names = [DOCUMENT_FILE, stored.file]
    if saving.glb != "none":
        names.append("combined.glb")
    if saving.glb == "all":
        names += ["scene.glb", *(f"person_{index}.glb" for index in range(len(reconstruction.people)))]
    names += [*([PREVIEW_FILE] if saving.preview else []), *beside]
    replaced.check(folder, names)
    folder = check_writable(folder)
    # All contents are made before the folder is locked.
    contents, failure = _contents(reconstruction, saving, stored)
    contents = {name: contents[name] for name in names if name in contents} | dict(beside)
    written = _write(reconstruction, folder, stored, contents, replaced)
    if failure is not None:
        raise failure
    return written


@dataclass(frozen=True)
class _Replaced:
    """Which earlier results are replaced; see :func:`save_reconstruction`."""

    photos: str
    overwrite: bool
    earlier: Collection[str]

    def check(self, folder: Path, names: Sequence[str]) -> None:
        check_overwrite(folder, self.photos, overwrite=self.overwrite, names=names, earlier=self.earlier)


def _stored_arrays(reconstruction: Reconstruction, saving: Saving) -> _StoredArrays:
    """Return the arrays of a level, and how they are stored."""
    arrays = to_arrays(reconstruction)
    if saving.is_exact:
        return _StoredArrays(ARRAYS_FILE, arrays, array_specs(arrays, compact=False), "f")
    arrays = compact_arrays(arrays)
    if saving.level != "people":
        return _StoredArrays(ARRAYS_FILE, arrays, array_specs(arrays, compact=True))
    arrays = {name: array for name, array in arrays.items() if is_kept_without_scene(name)}
    shared, of_person = array_specs(arrays, compact=True)
    return _StoredArrays(PEOPLE_FILE, arrays, (tuple(spec for spec in shared if spec.name in arrays), of_person))


@dataclass(frozen=True)
class _StoredArrays:
    """Arrays, their file, their specifications, and the kinds of dtype that are not compressed."""

    file: str
    arrays: Mapping[str, NDArray[Any]]
    specs: tuple[Sequence[ArraySpec], Sequence[ArraySpec]]
    uncompressed: str = ""

    def content(self) -> bytes:
        """Return the content of their file."""
        stream = BytesIO()
        write_arrays(stream, self.arrays, stored=self.uncompressed)
        return stream.getvalue()


def _write(
    reconstruction: Reconstruction,
    folder: Path,
    stored: _StoredArrays,
    contents: Mapping[str, bytes],
    replaced: _Replaced,
) -> tuple[Path, ...]:
    """Write the document and the contents of all other files, all or none; delete unchanged files of an earlier result.

    Args:
        reconstruction: of the document.
        folder: exists.
        stored: arrays that the document describes.
        contents: by file name; the arrays are first.
        replaced: whose results.
    """
    names = [DOCUMENT_FILE, *contents]
    with atomic_write(folder, index=DOCUMENT_FILE) as temporary:
        replaced.check(folder, names)
        unchanged, edited = earlier_files(folder, replaced.earlier)
        for name in unchanged.difference(names):
            temporary.remove(name)
        for name in edited:
            temporary.keep(name)
        document_file, digests = temporary(DOCUMENT_FILE), dict[str, str]()
        for name, content in contents.items():
            temporary(name).write_bytes(content)
            digests[name] = digest_of(content)
        document = to_document(reconstruction, names, digests, stored.specs)
        document_file.write_bytes(encode_document(document))
    return tuple(folder / name for name in names)


def _contents(
    reconstruction: Reconstruction, saving: Saving, stored: _StoredArrays
) -> tuple[dict[str, bytes], Exception | None]:
    """Return the contents of the arrays' file, the GLB files and the preview, and the error if a picture fails."""
    from threadpoolctl import threadpool_limits

    pictures = dict[str, bytes]()
    # A second thread draws the preview, which takes as long as all else. Matrices of three columns: further threads of
    # BLAS would take as much processor time again, waiting.
    with threadpool_limits(limits=1, user_api="blas"), ThreadPoolExecutor(1, "preview") as second:
        preview = second.submit(_preview, reconstruction) if saving.preview else None
        arrays = {stored.file: stored.content()}
        try:
            if saving.glb != "none":
                from physic_core.visual.glb import glb_files

                pictures |= glb_files(reconstruction, parts=saving.glb == "all")
            if preview is not None:
                pictures[PREVIEW_FILE] = preview.result()
        except Exception as error:
            return arrays, error
    return arrays | pictures, None


def _preview(reconstruction: Reconstruction) -> bytes:
    from physic_core.visual.preview import preview_png

    return preview_png(reconstruction)
