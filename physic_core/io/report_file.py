"""Write the page of a result: to a file, or to the folder of the result."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import InputError
from physic_core.files.atomic import check_own, write_own
from physic_core.io.result_folder import add_result_files, check_added, is_result
from physic_core.io.results import load_reconstruction
from physic_core.pictures import PAGE_MARK, REPORT_FILE, report_html

if TYPE_CHECKING:
    from physic_core.types import Reconstruction


def save_report(
    reconstruction: Reconstruction, path: str | os.PathLike[str], title: str = ""
) -> Path:
    """Write the page of a reconstruction to a file; an earlier page of PhySIC is replaced.

    Args:
        reconstruction: what to show.
        path: of the file; missing folders are created.
        title: of the page, such as the name of the photo.

    Raises:
        OutputError: the file cannot be written, or is not a page of PhySIC.
        PackageMissingError: no installed plugin makes pictures.
    """
    check_own(Path(path), mark=PAGE_MARK)  # before a page that takes long is made
    return write_own(Path(path), report_html(reconstruction, title).encode(), PAGE_MARK)


def add_report(folder: str | os.PathLike[str], title: str = "") -> Path:
    """Write ``report.html`` to the folder of a result, and list it there, so that later runs
    replace it.

    If the result cannot be read, the page says why, and the error is raised.

    Args:
        folder: of a finished run.
        title: of the page; by default the name of the photo, or of the folder if that is not known.

    Raises:
        InputError: there is no result in the folder, or its files are damaged.
        OutputError: the page cannot be written, or a ``report.html`` there is not a page of PhySIC,
            or was edited.
        PackageMissingError: no installed plugin makes pictures.
    """
    folder = Path(folder)
    if not is_result(folder):
        raise InputError(
            f"no result in {folder}: name the folder of a finished run, or a folder of such folders"
        )
    check_own(folder / REPORT_FILE, mark=PAGE_MARK)
    check_added(folder, REPORT_FILE)
    name = folder.resolve().name
    try:
        result = load_reconstruction(folder)
    except InputError as error:
        add_result_files(folder, {REPORT_FILE: report_html(error, title or name).encode()})
        raise
    page = report_html(result, title or result.photo_name or name)
    add_result_files(folder, {REPORT_FILE: page.encode()})
    return folder / REPORT_FILE
