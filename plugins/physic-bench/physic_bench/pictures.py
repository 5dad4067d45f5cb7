"""Pictures as the camera of a frame saw them: upright, not mirrored, cropped; distortion is left in."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from physic_bench.damage import DamagedFrameError, damaged_file_error
from physic_core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image as OpenedImage

    from physic_bench.contract import Frame, Picture


@contextmanager
def open_picture(path: Path) -> Iterator[OpenedImage]:
    """Open a picture of a data set; decoding it takes bounded memory, as of a photo.

    Raises:
        DamagedFrameError: the file is missing, damaged or too large; also if the block decodes it and it is damaged.
    """
    from physic_core.files.image_file import ImageSource, open_image, wrap_decoding_errors

    source = ImageSource(str(path), path=path, what="picture")
    try:
        with path.open("rb"):
            pass
        with open_image(source) as (image, _), wrap_decoding_errors(source):
            yield image
    except FileNotFoundError as error:
        raise DamagedFrameError(f"there is no picture {path}") from error
    except OSError as error:
        raise damaged_file_error(path, error, "the picture ") from error
    except DamagedFrameError:
        raise
    except InputError as error:
        raise DamagedFrameError(str(error)) from error


def read_picture(picture: Picture) -> NDArray[np.uint8]:
    """Return the pixels (H, W, 3) uint8 RGB.

    Raises:
        DamagedFrameError: the file is missing or damaged.
    """
    import numpy as np

    with open_picture(picture.path) as file:
        pixels = np.array(file.convert("RGB"))
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
    if frame.picture is None:
        raise InputError(f"the frame {frame.id} has no picture: only results of methods can be evaluated on it")
    picture = frame.picture
    with open_picture(picture.path) as file:
        size = file.size
    if picture.crop is not None:
        size = (picture.crop[2] - picture.crop[0], picture.crop[3] - picture.crop[1])
    if size != (frame.camera.width, frame.camera.height):
        raise InputError(
            f"{picture.path} has {size[0]} x {size[1]} px, but its camera is calibrated for {frame.camera.width} x "
            f"{frame.camera.height} px"
        )
    if not picture.mirrored and picture.crop is None:
        return picture.path
    path = folder / f"{frame.id.replace('/', '_')}.png"
    if not path.exists():
        from PIL import Image

        from physic_core.files.atomic import atomic_write, check_writable

        with atomic_write(check_writable(folder)) as temporary:
            Image.fromarray(read_picture(picture)).save(temporary(path.name), format="PNG")
    return path
