"""Files of data sets and of results: whatever is wrong with one becomes an error that names it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.types import Picture, Surface
from physic_core.errors import InputError, PhysicError
from physic_core.files import check_regular, parse_json, path_to_write, read_text

if TYPE_CHECKING:
    from PIL.Image import Image

    from physic_bench.types import Frame
    from physic_core.types import Float64Array, UInt8Array


_MAX_JSON_BYTES = 1 << 28


class DamagedFrameError(InputError):
    """Raised if a file is missing, damaged, or has another content than its format states.

    It costs one frame.
    """


@contextmanager
def naming_file_in_errors(path: Path) -> Iterator[None]:
    """Turn every error of the block into one that names the file; a pipe, which would be waited
    for, is one before the block.

    Raises:
        DamagedFrameError: the block failed, or it is no regular file.
    """
    try:
        check_regular(path)
        yield
    except PhysicError as error:
        if isinstance(error, DamagedFrameError) and str(path) not in str(error):
            raise DamagedFrameError(f"{path}: {error}") from error
        raise
    except Exception as error:  # libraries that read files have many
        raise DamagedFrameError(
            f"{path} cannot be read: {type(error).__name__}: {error}"
        ) from error


def checked_numbers(values: Any, shape: tuple[int, ...], what: str) -> Float64Array:
    """Return finite float64 numbers of a shape; -1 is any length.

    Raises:
        DamagedFrameError: there are others.
    """
    numbers = np.asarray(values)
    if numbers.dtype.kind not in "biuf" or not np.isfinite(numbers).all():
        raise DamagedFrameError(f"'{what}' must be finite numbers")
    try:
        return numbers.astype(np.float64).reshape(shape)
    except ValueError as error:
        raise DamagedFrameError(
            f"'{what}' must have the shape {shape}, got {numbers.shape}"
        ) from error


def checked_rotation(values: Any, what: str) -> Float64Array:
    """Return a rotation (3, 3).

    Raises:
        DamagedFrameError: it is scaled or a mirror image.
    """
    matrix = checked_numbers(values, (3, 3), what)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-2 or np.linalg.det(matrix) < 0:
        raise DamagedFrameError(f"'{what}' is not a rotation: it is scaled or a mirror image")
    return matrix


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises:
        DamagedFrameError: it cannot be read.
    """
    with naming_file_in_errors(path):
        return parse_json(read_text(path, _MAX_JSON_BYTES))


def read_npz(path: Path) -> dict[str, Any]:
    """Return all arrays of an .npz file, without unpickling.

    Raises:
        DamagedFrameError: it cannot be read.
    """
    from physic_core.files import open_regular, read_arrays

    with naming_file_in_errors(path), open_regular(path) as stream:
        return dict(read_arrays(stream))


def read_pickled(path: Path) -> dict[str, Any]:
    """Return the numbers and arrays of a pickle, Python 2's too; anything that could run code is
    refused by its name.

    Raises:
        DamagedFrameError: it cannot be read.
    """
    from physic_core.body import PickledObject, as_array, read_pickle

    with naming_file_in_errors(path):
        content = read_pickle(path)
        return {
            name: as_array(value) if isinstance(value, PickledObject) else value
            for name, value in content.items()
        }


def read_mesh(path: Path) -> Any:
    """Return a mesh of trimesh with the vertices in the order of the file.

    Raises:
        DamagedFrameError: it cannot be read, or has no vertices.
    """
    import trimesh

    with naming_file_in_errors(path):
        mesh = trimesh.load(path, process=False, maintain_order=True)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        checked_numbers(mesh.vertices, (-1, 3), "vertices")
    return mesh


@lru_cache(maxsize=3)
def read_surface(path: Path) -> Surface:
    """Return the mesh of a scan, which is kept for the next frames.

    Raises:
        DamagedFrameError: it cannot be read, or has no vertices.
    """
    mesh = read_mesh(path)
    return Surface(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces))


@contextmanager
def open_picture(path: Path) -> Iterator[Image]:
    """Open a picture; decoding it takes bounded memory, as of a photo.

    Raises:
        DamagedFrameError: it cannot be read.
    """
    from physic_core.files import ImageSource, open_image, wrap_decoding_errors

    source = ImageSource(str(path), path=path, role="picture")
    try:
        with (
            naming_file_in_errors(path),
            open_image(source) as (image, _),
            wrap_decoding_errors(source),
        ):
            yield image
    except InputError as error:
        raise DamagedFrameError(str(error)) from error


def picture_file(frame: Frame, folder: Path) -> Path:
    """Return the path of a frame's picture as its camera saw it; it is written to ``folder`` if the
    file differs.

    Raises:
        InputError: the frame has no picture, the file is damaged, or its size is not the camera's.
        OutputError: as of :func:`write_picture`.
    """
    if frame.picture is None:
        raise InputError(
            f"the frame {frame.id} has no picture: only results of methods can be evaluated on it"
        )
    picture = frame.picture
    camera = frame.camera
    pixels = _rgb_pixels(picture)
    if pixels.shape[:2] != (camera.height, camera.width):
        raise InputError(
            f"{picture.path} has {pixels.shape[1]} x {pixels.shape[0]} px, but its camera is "
            f"calibrated for {camera.width} x {camera.height} px"
        )
    if not picture.mirrored:
        return picture.path
    path = path_to_write(folder, f"{frame.id}.png")
    write_picture(path, pixels)
    return path


def write_picture(path: Path, pixels: UInt8Array) -> None:
    """Write a picture (H, W, 3) RGB as PNG; one that shows the same stays as it is.

    Raises:
        OutputError: something else is there, or the folder cannot be written.
    """
    from PIL import Image

    from physic_core.files import atomic_write, check_writable, foreign_file

    if os.path.lexists(path):
        try:
            is_same = np.array_equal(_rgb_pixels(Picture(path)), pixels)
        except DamagedFrameError as error:
            raise foreign_file(path) from error
        if not is_same:
            raise foreign_file(path)
        return
    with atomic_write(check_writable(path.parent)) as temporary:
        Image.fromarray(pixels).save(temporary(path.name), format="PNG")


def _rgb_pixels(picture: Picture) -> UInt8Array:
    """Return the pixels (H, W, 3) RGB, upright."""
    with open_picture(picture.path) as file:
        pixels = np.array(file.convert("RGB"))
    if picture.mirrored:
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels)


def missing_files(root: Path, names: Sequence[tuple[str, str]]) -> list[str]:
    """Return a sentence for each path (relative, what it is) or pattern that nothing exists for."""
    return [f"{root / name}: {what}" for name, what in names if next(root.glob(name), None) is None]
