"""The photos of a batch, from files, folders and tables."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pydantic import ValidationError

from physic_core.cache import file_stamp
from physic_core.configuration.model import PhotoSettings
from physic_core.configuration.problems import problems_from_pydantic
from physic_core.errors import ConfigError, InputError
from physic_core.files import (
    IMAGE_SUFFIXES,
    has_mark,
    path_problem,
    printable,
    quoted,
    read_csv,
    read_text,
    shorten,
    unreadable,
)
from physic_core.io.result_folder import is_result

_PHOTO_SUFFIXES = frozenset(suffix for suffixes in IMAGE_SUFFIXES.values() for suffix in suffixes)
_MAX_KINDS = 8
_FILES = ("depth", "pointmap", "bodies", "masks")
_COLUMNS = ("path", "camera", "stature", "age", "ignore", *_FILES, "id")
_OTHER_TABLES = (
    *(".tsv", ".txt", ".lst", ".json", ".jsonl", ".parquet", ".xlsx", ".xls", ".ods", ".numbers"),
    *(".tar", ".zip", ".gz", ".7z"),
)
_MAX_TABLE = 1 << 30  # bytes
_MAX_NAME = 100  # characters of a folder's name; file systems allow 255 bytes


@dataclass(frozen=True, slots=True)
class PhotoItem:
    """One photo of a batch.

    Attributes:
        id: unique in the batch, and equal in every run of it.
        path: absolute.
        settings: of the table ``[photo]``, only for this photo.
        stamp: :func:`physic_core.cache.digests.file_stamp` of the file at some time before it is
            read, by :meth:`stamped`; "" if it is unknown, or there is no file.
    """

    id: str
    path: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    stamp: str = field(default="", compare=False)

    @classmethod
    def at(cls, path: str | os.PathLike[str], **fields: Any) -> PhotoItem:
        """Return the photo at a path; its id is by default the name of the file and a hash of the
        path.
        """
        absolute = os.fspath(path) if "://" in os.fspath(path) else os.path.abspath(path)
        name = f"{Path(absolute).stem}-{hashlib.sha256(os.fsencode(absolute)).hexdigest()[:16]}"
        return cls(**{"id": name, "path": absolute, **fields})

    def stamped(self) -> PhotoItem:
        """Return a copy with the stamp that the file has now."""
        try:
            stamp = file_stamp(os.stat(self.path))
        except OSError:
            stamp = ""
        return replace(self, stamp=stamp)


@dataclass(frozen=True)
class PhotoList:
    """The photos of a batch.

    Attributes:
        photos: in the order of the inputs.
        left_out: number of the files in folders that are not photos, by kind: their suffix, or why.
    """

    photos: list[PhotoItem]
    left_out: Mapping[str, int]

    def left_out_in_words(self) -> str:
        """Return what was left out: "3 .jxl, 1 .livp, 2 in folders of results"."""
        ordered = sorted(self.left_out.items(), key=lambda one: (-one[1], one[0]))
        parts = [f"{count:,} {kind}" for kind, count in ordered]
        if more := len(parts[_MAX_KINDS:]):
            parts[_MAX_KINDS:] = [f"files of {more} more kinds"]
        return ", ".join(parts) or "nothing"


def list_photos(inputs: Iterable[str]) -> PhotoList:
    """List the photos of files, folders (recursively) and CSV tables, without duplicates.

    A table has a column "path", relative to the table's folder, and may have "camera" (focal length
    in px, or "fx,fy,cx,cy"), "stature" (m), "age" (years), "ignore" (px x,y on each person to leave
    out), "depth", "pointmap", "bodies" and "masks" (files), and "id". Photos of folders are sorted
    by path. Of these, files in folders of results, thumbnails of batches, pictures of exports,
    files that are hidden or have a suffix that no photo has, and hidden folders are left out.

    Raises:
        InputError: an input does not exist, a folder cannot be read, a table is invalid, two photos
            have one id, or there are no photos.
    """
    left_out = Counter[str]()
    photos: dict[str, PhotoItem] = {}
    for item in (item for text in inputs for item in _items_of(text)):
        if isinstance(item, str):
            left_out[item] += 1
            continue
        previous = photos.setdefault(item.id, item)
        if previous != item:
            where = (
                _show(previous.path)
                if previous.path == item.path
                else f"{_show(previous.path)} and {_show(item.path)}"
            )
            raise InputError(
                f"two photos have the id {quoted(item.id)}, {where}: give each an id of its own, "
                f"or remove one"
            )
    listed = PhotoList(list(photos.values()), left_out)
    if not photos:
        raise InputError(
            f"no photos in {_show(', '.join(inputs))} (left out: {listed.left_out_in_words()}): "
            "name photos, folders or CSV tables; pictures of results are not photos"
        )
    return listed


def photo_folder(item_id: str) -> str:
    """Return the folder of a photo's results in the output folder: "photos/3f/NAME", with 2 digits
    of the id's hash.
    """
    digest = hashlib.sha256(os.fsencode(item_id)).hexdigest()
    name = quote(item_id, safe=" +,=@()[]", errors="surrogateescape")
    if len(name) > _MAX_NAME or name.startswith(".") or not name:
        name = f"{name[: _MAX_NAME - 17].lstrip('.')}-{digest[:16]}"
    return f"photos/{digest[:2]}/{name}"


@dataclass(frozen=True)
class Shard:
    """One of ``count`` parts of a batch; each id belongs to exactly one of them.

    Attributes:
        number: from 1 to ``count``.
        count: number of parts.
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Parse "3/16", the third of sixteen shards.

        Raises:
            ConfigError: it is not a shard.
        """
        match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
        number, count = (int(part) for part in match.groups()) if match else (0, 0)
        if not 1 <= number <= count:
            raise ConfigError(
                f"a shard is written 3/16, with a first number from 1 to the second (got "
                f"{quoted(text)})"
            )
        return cls(number, count)

    def __contains__(self, item_id: str) -> bool:
        """Return whether the photo with an id belongs to this shard."""
        return (
            int(hashlib.sha256(os.fsencode(item_id)).hexdigest()[-12:], 16) % self.count
            == self.number - 1
        )


def _items_of(source: str) -> Iterator[PhotoItem | str]:
    """Yield the photos of a folder, of a table, or a photo, and the kind of each file of a folder
    that is not a photo.

    Raises:
        ConfigError: it is an address.
        InputError: the file does not exist, or it is a table that is not a regular file, or not
            CSV.
    """
    # Unlike methods of Path, functions of os.path return False for a name that no file can have.
    if os.path.isdir(source):
        paths = sorted(_files_below(source))
        yield from (kind or PhotoItem.at(path) for path, kind in paths)
    elif not os.path.exists(source):
        if problem := path_problem(source):
            raise ConfigError(f"no photos at {_show(source)}: {problem}")
        raise InputError(f"no photos at {_show(source)}: name files, folders, or a CSV table")
    elif source.lower().endswith(".csv"):
        yield from _table_items(Path(source))
    elif source.lower().endswith(_OTHER_TABLES):
        raise InputError(
            f"cannot read {_show(source)}: a table or list of photos is CSV with the column path; "
            "an archive must be unpacked, and its folder named"
        )
    else:
        yield PhotoItem.at(source)


def _files_below(top: str) -> Iterator[tuple[str, str]]:
    """Yield the files of a folder and its sub-folders, each with why it is no photo; "" if it is
    one.
    """
    for folder, folders, names in os.walk(top, onerror=_raise_error):
        folders[:] = (name for name in folders if not name.startswith("."))
        of_result = is_result(folder)
        for name in names:
            path = os.path.join(folder, name)
            yield path, _why_no_photo(path, of_result=of_result)


def _why_no_photo(path: str, *, of_result: bool) -> str:
    name = os.path.basename(path)
    suffix = os.path.splitext(name)[1].lower()
    if name.startswith("."):
        return "hidden"
    if of_result:
        return "in folders of results"
    if suffix not in _PHOTO_SUFFIXES:
        return printable(shorten(suffix, 20)) or "without a suffix"
    with suppress(OSError):  # a photo that cannot be read fails alone
        if has_mark(path):
            return "thumbnails and exports"
    return ""


def _raise_error(error: OSError) -> None:
    raise InputError(
        f"cannot read the folder {_show(str(error.filename))}: {error.strerror}; "
        "allow it, or name the other folders or files"
    ) from error


def _table_items(table: Path) -> Iterator[PhotoItem]:
    number = 0
    row: dict[str, Any] = {}
    try:
        for row in read_csv(read_text(table, _MAX_TABLE), _COLUMNS[:1], _COLUMNS[1:]):
            number += 1
            item = photo_of_row(row, table.parent)
            PhotoSettings.model_validate(item.settings)
            yield item
    except OSError as error:
        raise InputError(f"cannot read {table}: {unreadable(error)}") from error
    except ValidationError as error:
        problems_of_row = problems_from_pydantic(error, PhotoSettings)
        problems = "; ".join(f"{one.path}: {one.message}" for one in problems_of_row)
        raise InputError(f"{table}, row {number}: {problems}{_hint(row)}") from error
    except ValueError as error:
        at = f", row {number}" if number else ""
        raise InputError(f"{table}{at}: {error}{_hint(row)}") from error


def photo_of_row(row: Mapping[str, Any], folder: str | os.PathLike[str] = "") -> PhotoItem:
    """Return the photo of a row with "path", and where given other columns of a table.

    A relative path is one of ``folder``; a URI, such as "s3://bucket/photo.jpg", is kept.

    Raises:
        ValueError: a value is missing or invalid.
    """
    path = row.get("path")
    if not path:
        raise ValueError("the column 'path' is missing or empty")
    if not isinstance(path, str) or "\0" in path:
        raise ValueError(f"a path is text without null characters (got {quoted(path)})")
    if "://" not in path:
        path = os.path.join(folder, path)
    item = PhotoItem.at(path, settings=_settings(row, folder))
    return replace(item, id=_text(row.get("id")) or item.id)


def _hint(row: Mapping[str, Any]) -> str:
    """Return what to write instead of a number with a decimal comma; "" if there is none."""
    decimal = next((t for t in map(_text, row.values()) if re.fullmatch(r"[0-9]+,[0-9]+", t)), "")
    return f"; write a number with a point, as {decimal.replace(',', '.')}" if decimal else ""


def _show(text: str) -> str:
    return printable(shorten(text, 300))


def _text(value: Any) -> str:
    """Return a value of a table as text; "" for a missing one, which pandas writes as NaN."""
    return "" if value is None or value != value else str(value).strip()


def _settings(row: Mapping[str, Any], folder: str | os.PathLike[str]) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    camera = _text(row.get("camera"))
    if camera:
        numbers = _numbers(camera)
        if len(numbers) not in (1, 4):
            raise ValueError(
                f"a camera is a focal length in px, or fx,fy,cx,cy (got {quoted(camera)})"
            )
        settings |= {"focal_px": numbers[0]} if len(numbers) == 1 else {"intrinsics": numbers}
    for name, unit in (("stature", "m"), ("age", "years")):
        if text := _text(row.get(name)):
            settings[name] = _numbers(text)
            if not settings[name]:
                raise ValueError(
                    f"{name}s are numbers in {unit}, from left to right (got {quoted(text)})"
                )
    if text := _text(row.get("ignore")):
        numbers = _numbers(text)
        if not numbers or len(numbers) % 2:
            raise ValueError(f"ignored people are pixels x,y (got {quoted(text)})")
        settings["ignore"] = list(zip(numbers[::2], numbers[1::2], strict=True))
    files = {name: text for name in _FILES if (text := _text(row.get(name)))}
    return settings | {
        name: os.path.abspath(os.path.join(folder, text)) for name, text in files.items()
    }


def _numbers(text: str) -> list[float]:
    """Return the numbers of a list such as "1.7, 1.8"; none if a part is not a finite number."""
    try:
        numbers = [float(part) for part in re.split(r"[,\s]+", text.strip("[]() "))]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
