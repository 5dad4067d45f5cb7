"""Export a reconstruction: the request that an exporter gets and the frame that it writes in, the
call of the exporter, and its files.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.discovery.hooks import ExporterRecord
from physic_core.discovery.plugins import FoundRecord, find_exporter, import_and_call
from physic_core.errors import ConfigError, InputError, OutputError, PluginError
from physic_core.files.atomic import (
    MARK,
    atomic_write,
    check_regular,
    check_writable,
    open_regular,
    unreadable,
)
from physic_core.geometry.world_frame import world_from_camera
from physic_core.types.records import Exported, ExportedFiles

if TYPE_CHECKING:
    from physic_core.types import Float64Array, Person, Plane, Reconstruction

_Z_UP_FROM_Y_UP = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class ExportFrame:
    """Frame of an exported file, in metres.

    Attributes:
        up: "y", "z" or "camera".
        from_camera: (4, 4) rigid transform from the camera frame (x right, y down, z forward).
        axes: description of the axes and the origin.
        notes: sentences for the user.
    """

    up: str
    from_camera: Float64Array
    axes: str
    notes: tuple[str, ...] = ()

    @property
    def up_vector(self) -> Float64Array:
        """Unit vector (3,) that points up in this frame; of a camera frame, the camera's up."""
        return np.array(
            {"y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0], "camera": [0.0, -1.0, 0.0]}[self.up]
        )


@dataclass(frozen=True)
class ExportRequest:
    """One export.

    Attributes:
        result: the reconstruction.
        person: indices of the people to write; each has a finite body.
        frame: of the file.
        stem: file name without suffix.
        suffix: of the file, with its dot.
        scene: whether to write the scene too.
        body_file: SMPL-X file of the user, or None.
        options: name -> value of the ``options`` of the record; their defaults where the user gave
            none.
    """

    result: Reconstruction
    person: tuple[int, ...]
    frame: ExportFrame
    stem: str
    suffix: str
    scene: bool = True
    body_file: Path | None = None
    options: Mapping[str, str | bool] = field(default_factory=dict)

    def chosen(self) -> list[tuple[int, Person]]:
        """Return index and person of the people to write."""
        return [(index, self.result.people[index]) for index in self.person]

    def file_of(self, person: int) -> str:
        """Return the name of the file of one person: the stem, with the person's number if there
        are several.
        """
        return (
            f"{self.stem}{self.suffix}"
            if len(self.person) == 1
            else f"{self.stem}_{person}{self.suffix}"
        )


def export_frame(level: Plane | None, up: str) -> ExportFrame:
    """Return the frame with an up axis.

    "y" and "z" have the origin on the floor below the camera, and the camera looks along -z or +y.
    "camera" is the frame of the result. Without a floor, the origin is the camera. If nothing
    tells up, y is the camera's up axis.

    Args:
        level: the floor, or the level plane through the camera; None if nothing tells up.
        up: "y", "z" or "camera".

    Raises:
        InputError: z up if nothing tells up.
    """
    if up == "camera":
        return ExportFrame(up, np.eye(4), "x right, y down, z forward, origin at the camera")
    matrix = world_from_camera(level)
    origin = "origin on the floor below the camera"
    notes: tuple[str, ...] = ()
    if level is None or not level.offset:
        origin = "origin at the camera"
        axis = "the camera's up axis" if level is None else "up"
        notes = (f"the result has no floor: {up} is {axis}, and the origin is the camera",)
    if up == "z":
        if level is None:
            raise InputError(
                "z up needs the direction of gravity, and this result has neither a floor nor "
                "edges that tell it: use a format with --up y (y is then the camera's up axis) or "
                "--up camera"
            )
        axes = f"x right, y forward, z up, {origin}"
        return ExportFrame(up, _Z_UP_FROM_Y_UP @ matrix, axes, notes)
    of_camera = " (of the camera)" if level is None else ""
    return ExportFrame(up, matrix, f"x right, y up{of_camera}, z backward, {origin}", notes)


def camera_pose(frame: ExportFrame) -> Float64Array:
    """Return the pose (4, 4) of a camera that looks along its -z with y up, as in glTF, USD and
    MuJoCo.
    """
    return frame.from_camera @ np.diag([1.0, -1.0, -1.0, 1.0])


def export_reconstruction(
    result: Reconstruction,
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    person: int | Sequence[int] | None = None,
    up: str | None = None,
    scene: bool = True,
    body_model: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    write: Callable[[Path, Mapping[str, bytes]], None] | None = None,
    **options: str | bool,
) -> Exported:
    """Write a reconstruction to a file of another program's format.

    Args:
        result: the reconstruction.
        path: of the file, or a folder, which then needs ``format`` and is created if missing. With
            several people, formats of one person per file add "_0", "_1", ... to the name.
        format: name of the format ("glb", "amass", ...); None for that of the suffix.
        person: index or indices into ``result.people``; None for all people with a body.
        up: "y", "z" or "camera"; None for the convention of the format.
        scene: whether to write the scene too, where the format has one.
        body_model: SMPL-X file of the user, which some exports need.
        overwrite: whether to replace files; never the photo, or a link.
        write: writes the files of a folder, by name; None to only write them.
        options: of the format, such as ``names="mixamo"``; docs/exports.md lists them.

    Raises:
        ConfigError: the format, a person or an option is not there, or a library is missing.
        InputError: the result does not have what the format needs.
        OutputError: a file exists already and may not be replaced, or cannot be written.
        BodyModelError: the body model file cannot be used.
        PluginError: the exporter of a plugin cannot be imported, fails, or returns no files.
    """
    exporter, folder, stem, suffix = _export_target(Path(path), format)
    kind = exporter.record
    people, notes = _people(result, person, kind)
    if up is not None and up not in kind.ups:
        raise ConfigError(f"{kind.name} is written with --up {' or '.join(kind.ups)}, not '{up}'")
    frame = export_frame(result.scene.level, up or kind.ups[0])
    file = None if body_model is None else Path(os.path.expanduser(body_model))
    if file is not None:
        try:
            check_regular(file)
        except OSError as error:
            raise InputError(f"cannot read the body model {file}: {unreadable(error)}") from error
    request = ExportRequest(
        result, people, frame, stem, suffix, scene, file, _options(kind, options)
    )
    names = (
        {request.file_of(person) for person in people} if kind.per_person else {f"{stem}{suffix}"}
    )
    # before an exporter that takes long is called
    _check_names(folder, names, overwrite, result.photo)
    made = import_and_call(exporter, "exporter", request)
    if not isinstance(made, ExportedFiles):
        raise PluginError(
            f"{exporter.title('exporter')} should return physic_core.ExportedFiles, got "
            f"{type(made).__name__}"
        )
    _check_names(folder, made.files, overwrite, result.photo)
    # the file that names the others comes last
    ordered = sorted(made.files, key=lambda name: name == f"{stem}{suffix}")
    (write or _write_export_files)(folder, {name: _marked(made.files[name]) for name in ordered})
    paths = tuple(folder / name for name in made.files)
    return Exported(paths, (*notes, *frame.notes, *made.notes))


def _export_target(
    path: Path, format: str | None
) -> tuple[FoundRecord[ExporterRecord], Path, str, str]:
    """Return the exporter, and folder, stem and suffix of the files.

    Raises:
        ConfigError: the format is unknown, the path has another suffix, or a package is missing.
    """
    is_folder = path.is_dir() or (format is not None and not path.suffix)
    exporter = find_exporter(format, "" if is_folder else path.suffix)
    kind = exporter.record
    if is_folder:
        return exporter, path, kind.stem or kind.name, kind.suffixes[0]
    if path.suffix.lower() not in kind.suffixes:
        raise ConfigError(
            f"{path} does not end in {' or '.join(kind.suffixes)}, as a file of the format "
            f"{kind.name} must: name another file"
        )
    return exporter, path.parent, path.stem, path.suffix.lower()


def _people(
    result: Reconstruction, person: int | Sequence[int] | None, kind: ExporterRecord
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the indices of the people to write, and notes about those skipped.

    Raises:
        ConfigError: a person does not exist or has no body.
        InputError: the format needs a body, and the result has none.
    """
    count = len(result.people)
    bodiless = {i for i, one in enumerate(result.people) if not one.has_body}
    chosen = range(count) if person is None else person
    wanted = [chosen] if isinstance(chosen, int) else list(dict.fromkeys(chosen))
    for index in wanted:
        if not 0 <= index < count:
            many = f"people are numbered 0 to {count - 1}: choose one of them"
            advice = ("no person was found in the photo", "choose 0, the only one", many)[
                min(count, 2)
            ]
            raise ConfigError(f"there is no person {index}: {advice}")
        if person is not None and index in bodiless:
            raise ConfigError(
                f"person {index} has no body, only a box and keypoints: the body estimator "
                "returned no finite values for them; choose another person"
            )
    with_bodies = tuple(index for index in wanted if index not in bodiless)
    if kind.bodies == "required" and not with_bodies:
        why = "no person of this result has a body" if count else "no person was found in the photo"
        raise InputError(f"cannot export to {kind.name}, which needs a body: {why}")
    left = sorted(bodiless.intersection(wanted))
    return with_bodies, tuple(f"person {index} has no body and is skipped" for index in left)


def _options(kind: ExporterRecord, given: Mapping[str, str | bool]) -> dict[str, str | bool]:
    """Return the options of a format, with defaults.

    Raises:
        ConfigError: the format has no such option, or not this value.
    """
    for name, value in given.items():
        if name not in kind.options:
            there = f"its options are {', '.join(kind.options)}" if kind.options else "it has none"
            raise ConfigError(f"the format {kind.name} has no option '{name}': {there}")
        if value not in kind.options[name]:
            allowed = ", ".join(map(str, kind.options[name]))
            raise ConfigError(
                f"the option '{name}' of the format {kind.name} is one of {allowed}, not '{value}'"
            )
    return {name: values[0] for name, values in kind.options.items()} | dict(given)


def _write_export_files(folder: Path, files: Mapping[str, bytes]) -> None:
    with atomic_write(check_writable(folder)) as temporary:
        for name, content in files.items():
            temporary(name).write_bytes(content)


def _marked(content: bytes) -> bytes:
    """Return a file, with the mark in a comment if it is PNG or JPEG: no batch takes it for a
    photo.
    """
    mark = MARK.encode("ascii")
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        chunk = b"tEXtComment\0" + mark
        chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return content[:33] + chunk + content[33:]
    if re.match(rb"\xff\xd8\xff[\xe0-\xef]", content):  # after the segment that comes first
        end = 4 + int.from_bytes(content[4:6], "big")
        comment = b"\xff\xfe" + struct.pack(">H", len(mark) + 2) + mark
        return content[:end] + comment + content[end:]
    return content


def _check_names(folder: Path, names: Iterable[str], overwrite: bool, photo: str) -> None:
    """Refuse names of existing files: all without ``overwrite``, else the photo, and links, pipes,
    devices and folders.
    """
    existing = [folder / name for name in names if os.path.lexists(folder / name)]
    if existing and not overwrite:
        raise OutputError(
            f"{', '.join(map(str, existing))} exists already: name another file (-o), or replace "
            "it with --overwrite (overwrite=True in Python)"
        )
    for path in existing:
        if not stat.S_ISREG(path.lstat().st_mode) or _sha256(path) in photo.split():
            raise OutputError(
                f"cannot replace {path}: it is the photo, or no regular file; name another file "
                f"(-o)"
            )


def _sha256(path: Path) -> str:
    """Return the digest of a file as ``Reconstruction.photo`` has it; "" if it cannot be read."""
    with suppress(OSError), open_regular(path) as file:
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
    return ""
