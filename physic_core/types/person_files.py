"""What a file of another program states of the bodies and the masks of people in one photo."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.types.arrays import shape
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class FileOfPhoto:
    """A file of bodies or masks, and the photo that it should be of.

    Attributes:
        path: of the file or folder.
        photo: name of the photo's file, which selects one of several pictures.
        size: width and height of the upright photo file, px.
        frame: which picture of a film, from 0; None if the user does not say.
    """

    path: Path
    photo: str
    size: tuple[int, int]
    frame: int | None = None


@dataclass(frozen=True)
class BodiesInFile(ShortRepr):
    """N bodies as a file states them: meters, in the frame of its camera (x right, y down, z
    forward).

    Bodies have ``rotations``, ``vertices`` or ``joints``; with several, the first one counts.

    Attributes:
        tool: what wrote them, for messages.
        model: "smpl", "smplh", "smplx" or "mhr".
        rotations: (N, J, 3) vectors, radians, of J joints in SMPL-X's order; others are at rest.
        betas: (N, K), for ``rotations``.
        expression: (N, E), for ``rotations``.
        transl: (N, 3), added to posed bodies and to vertices and joints; None for bodies without a
            place, unless they are placed by their vertices.
        vertices: (N, V, 3).
        joints: (N, 55, 3) as of :class:`Bodies`, NaN where unknown.
        camera: (N, 4) fx, fy, cx, cy, px of the photo file; None for the photo's own.
        mean_hands: whether hands at zero are the mean pose of the model's file, and not flat.
        is_placed: whether the file says where the bodies are in the picture.
        sigma_m: root mean square error of their joints relative to the pelvis, by the tool's
            authors.
        distance_sigma: standard deviation of the logarithm of distance; None if the file's
            distances follow from a guessed camera.
        notes: what was left out or assumed.
    """

    tool: str
    model: str
    rotations: FloatArray | None = field(default=None, metadata=shape("N", "J", 3))
    betas: FloatArray | None = field(default=None, metadata=shape("N", "K"))
    expression: FloatArray | None = field(default=None, metadata=shape("N", "E"))
    transl: FloatArray | None = field(default=None, metadata=shape("N", 3))
    vertices: FloatArray | None = field(default=None, metadata=shape("N", "V", 3))
    joints: FloatArray | None = field(default=None, metadata=shape("N", 55, 3))
    camera: FloatArray | None = field(default=None, metadata=shape("N", 4))
    mean_hands: bool = False
    is_placed: bool = True
    sigma_m: float = 0.06
    distance_sigma: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class MasksInFile(ShortRepr):
    """N masks as a file states them.

    Attributes:
        masks: (N, H, W) bool, of the whole picture; they may overlap.
        are_people: whether each is a person; otherwise those that cover a detected person count.
        notes: what was left out.
    """

    masks: BoolArray = field(metadata=shape("N", "H", "W"))
    are_people: bool = True
    notes: tuple[str, ...] = ()
