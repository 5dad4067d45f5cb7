"""Pictures as the camera of a frame saw them: upright, not mirrored, cropped; distortion is left in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import InputError
from physic_evaluate.damage import DamagedFileError, unreadable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physic_evaluate.contract import Frame, Picture

__all__ = ["picture_file", "read_picture"]


def read_picture(picture: Picture) -> NDArray[np.uint8]:
    """Return the pixels (H, W, 3) uint8 RGB.

    Raises:
        DamagedFileError: the file is missing or damaged.
    """
    import numpy as np
    from PIL import Image

    try:
        with Image.open(picture.path) as file:
            pixels = np.array(file.convert("RGB"))
    except FileNotFoundError as error:
        raise DamagedFileError(f"there is no picture {picture.path}") from error
    except OSError as error:
        raise unreadable(picture.path, error, "the picture ") from error
    if picture.mirrored:
        pixels = pixels[:, ::-1]
    if picture.crop is not None:
        x0, y0, x1, y1 = picture.crop
        pixels = pixels[y0:y1, x0:x1]
    return np.ascontiguousarray(pixels)


def picture_file(frame: Frame, folder: Path) -> Path:
    """Return the path of a frame's picture as its camera saw it; it is written to ``folder`` if the file differs.

    Raises:
        InputError: the frame has no picture, the file is damaged, or its size is not the camera's.
    """
    from PIL import Image

    if frame.picture is None:
        raise InputError(f"the frame {frame.id} has no picture: only results of methods can be evaluated on it")
    picture = frame.picture
    try:
        with Image.open(picture.path) as file:
            size = file.size
    except FileNotFoundError as error:
        raise DamagedFileError(f"there is no picture {picture.path}") from error
    except OSError as error:
        raise unreadable(picture.path, error, "the picture ") from error
    if picture.crop is not None:
        size = (picture.crop[2] - picture.crop[0], picture.crop[3] - picture.crop[1])
    if frame.camera is not None and size != (frame.camera.width, frame.camera.height):
        raise InputError(
            f"{picture.path} has {size[0]} x {size[1]} px, but its camera is calibrated for {frame.camera.width} x "
            f"{frame.camera.height} px"
        )
    if not picture.mirrored and picture.crop is None:
        return picture.path
    path = folder / f"{frame.id.replace('/', '_')}.png"
    if not path.exists():
        from physic_core.files.atomic import atomic_write, check_writable

        with atomic_write(check_writable(folder)) as temporary:
            Image.fromarray(read_picture(picture)).save(temporary(path.name), format="PNG")
    return path
