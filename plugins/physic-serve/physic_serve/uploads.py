"""Read the photo of a request: a form of a browser, or the bytes of a file."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fastapi import HTTPException
from fastapi.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException as StarletteHTTPException

if TYPE_CHECKING:
    from starlette.requests import Request

SETTINGS = {
    "focal_px": ("Focal length in px of the photo file", 1e6),
    "stature": ("Standing height of every person, metres", 2.7),
    "age": ("Age of every person, years", 120.0),
    "camera_height": ("Height of the camera over the floor, metres", 1000.0),
}
"""Settings of ``[photo]`` that a client can give: meaning and largest value."""

_LONGEST_NAME = 100  # characters of a photo's name that pages show
KINDS = "JPEG, PNG, WebP, TIFF, AVIF or HEIC"
_STARTS = (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


async def read_upload(request: Request, path: Path) -> tuple[str, dict[str, float]]:
    """Write the photo of a request to a file; return its name, and the settings from the form or from the query.

    Raises:
        HTTPException: 400 without a photo, 413 for more bytes than allowed, 415 for a file of another kind, 422 for a
            setting that is not a number in its range.
        OSError: the file cannot be written.
    """
    given: dict[str, Any] = dict(request.query_params)
    name = ""
    with path.open("wb") as photo:
        if request.headers.get("content-type", "").startswith("multipart/form-data"):
            try:
                async with request.form(max_files=1, max_fields=8, max_part_size=10_000) as form:
                    given |= {key: value for key, value in form.items() if isinstance(value, str)}
                    file = form.get("photo")
                    if isinstance(file, UploadFile):
                        name = file.filename or ""
                        await run_in_threadpool(shutil.copyfileobj, file.file, photo)
            except StarletteHTTPException as error:
                if error.status_code == 413:
                    raise
                raise HTTPException(400, f"the form cannot be read: {error.detail}") from error
        else:
            async for chunk in request.stream():
                await run_in_threadpool(photo.write, chunk)
    with path.open("rb") as photo:
        start = photo.read(16)
    if not start:
        raise HTTPException(400, "there is no photo: send its bytes as the body, or as the form's field 'photo'")
    if not _is_photo(start):
        raise HTTPException(415, f"the file is not a photo: send {KINDS}")
    settings = {key: _number(key, given[key]) for key in SETTINGS if given.get(key)}
    return "".join(c for c in re.split(r"[/\\]", name)[-1] if c.isprintable())[:_LONGEST_NAME], settings


def _is_photo(start: bytes) -> bool:
    """Whether the first 16 bytes are those of a format that :func:`physic_core.io.photo.read_photo` can read."""
    container = start[4:8] == b"ftyp" and start[8:12] in {b"avif", b"avis", b"heic", b"heix", b"mif1", b"msf1", b"heim"}
    webp = start[:4] == b"RIFF" and start[8:12] == b"WEBP"
    return container or webp or start.startswith(_STARTS)


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= SETTINGS[name][1]:
        raise HTTPException(422, f"{name} must be a number over 0 and at most {SETTINGS[name][1]:g}, got '{text[:40]}'")
    return value
