"""Read contact that InteractVLM (Dwivedi et al. 2025) predicted earlier, from files matched by their photo.

InteractVLM needs a large GPU and its own environment, so it runs separately: its ``run_demo.py`` writes
``<photo>_hcontact_vertices.npz`` with probabilities on SMPL(+H) and on SMPL-X. Photos are matched by their pixels,
because a backend does not get file names.
"""

from __future__ import annotations

import hashlib
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError, InputError, WeightsMissingError
from physic_core.files.image_file import ImageSource, decode, open_image, wrap_decoding_errors
from physic_core.files.npz import read_arrays
from physic_core.files.regular import open_regular, read_regular
from physic_core.files.strict_json import parse_json
from physic_core.interfaces import ContactPrior, Options
from physic_core.types import ContactProbability
from physic_human.user_smpl import load_rest_mesh

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray, People, RestMesh, UInt8Array

_SUFFIX = "_hcontact_vertices"
_TOPOLOGIES = {6890: "smpl", 10475: "smplx"}
_PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".bmp")
_THUMB = 48
"""Side of the thumbnails by which photos are matched, px."""
_MOST_GREY = 6.0
"""Mean difference of two thumbnails of one photo, grey levels; sizes and JPEG leave 1 to 3, another photo 30 and up."""
_MOST_ASPECT = 0.03
_MAX_BYTES = 256 << 20
"""Largest content of a result file, bytes; that of 100 people has 4 MB."""


class InteractVlmOptions(Options):
    """Settings of :class:`InteractVlmResults`."""

    results: str = Field(
        default="",
        description="one result file, or a folder with result files and their photos, as run_demo.py leaves it",
    )
    smpl_file: str = Field(
        default="", description="your SMPL_NEUTRAL.npz or .pkl, by whose T-pose labels are carried to your body model"
    )
    threshold: float = Field(
        default=0.3, gt=0, lt=1, description="value from which InteractVLM means contact; becomes a probability of 0.5"
    )
    when_absent: Literal["fail", "nothing"] = Field(
        default="fail", description="what a photo without a result gives: an error, or no contact for anybody"
    )


@dataclass(frozen=True)
class _ResultFile:
    """Result file of InteractVLM with the thumbnail of its photo.

    Attributes:
        path: of it.
        thumb: of the photo that it is about, None where one file was named.
        aspect: width over height of that photo.
    """

    path: Path
    thumb: FloatArray | None
    aspect: float


class InteractVlmResults(ContactPrior):
    """Contact prior that reads InteractVLM's result files.

    The results of several files of one photo are merged by their maximum. A file is about one person, or has one row
    for each. In the first case, the result is assigned to the largest person in the photo.
    """

    Options: ClassVar[type[Options]] = InteractVlmOptions
    options: InteractVlmOptions

    def __init__(self, options: InteractVlmOptions | None = None) -> None:
        super().__init__(options)
        self._results: tuple[_ResultFile, ...] | None = None
        self._rest: RestMesh | None = None

    def missing(self) -> tuple[str, ...]:
        """Describe missing results."""
        given = self.options.results
        place = Path(os.path.expanduser(given))
        if not given:
            return (f"results of InteractVLM are not given: {_ADVICE}",)
        if not place.exists():
            return (f"there is no {place}: {_ADVICE}",)
        if place.is_dir() and not _result_files(place):
            return (f"{place} holds no *{_SUFFIX}.npz: {_ADVICE}",)
        return ()

    def fingerprint(self) -> str:
        """Return a checksum of the files' contents."""
        if not self.options.results:
            return ""
        place = Path(os.path.expanduser(self.options.results))
        files = _result_files(place) if place.is_dir() else [place] if place.is_file() else []
        whole = hashlib.sha256()
        for path in files:
            whole.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
        return whole.hexdigest() if files else ""

    def load(self, device: str = "cpu") -> None:
        """Index the result files.

        Raises:
            WeightsMissingError: there are none.
            BodyModelError: the SMPL file cannot be used.
        """
        if self._results is not None:
            return
        lacking = self.missing()
        if lacking:
            raise WeightsMissingError(lacking[0])
        place = Path(os.path.expanduser(self.options.results))
        self._rest = load_rest_mesh(self.options.smpl_file)
        self._results = (
            (_ResultFile(place, None, 0.0),)
            if place.is_file()
            else tuple(_index_result(path) for path in _result_files(place))
        )

    def close(self) -> None:
        """Release the list of result files and the T-pose mesh."""
        self._results, self._rest = None, None

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return the contact probability (N, V) of N people on SMPL, or on SMPL-X for SMPL-X bodies.

        Raises:
            BackendError: it is not loaded, the photo has no result, or a file holds something else.
        """
        if self._results is None:
            raise BackendError("InteractVLM's results are not loaded: call load() before infer()")
        found = [result for result in self._results if _same_photo(result, image)]
        wanted = "smplx" if bodies.body_model == "smplx" else "smpl"
        if not found:
            if self.options.when_absent == "fail":
                raise BackendError(
                    f"none of {len(self._results)} results in {self.options.results} belongs to this photo of "
                    f"{image.shape[1]} x {image.shape[0]} px: run InteractVLM on it, keep the photo beside its result, "
                    "or set when_absent = 'nothing'"
                )
            return self._answer(np.zeros((len(people), _size_of(wanted)), np.float32), wanted)
        estimates = [_read(result.path, wanted) for result in found]
        topology = wanted if all(name == wanted for name, _ in estimates) else "smpl"
        values = [_read(result.path, topology)[1] for result in found]
        rows = np.zeros((len(people), _size_of(topology)), np.float32)
        for one in values:
            rows = np.maximum(rows, _rows_of(one, people))
        return self._answer(rows, topology)

    def _answer(self, values: FloatArray, topology: str) -> ContactProbability:
        """Map values to probabilities so that the threshold becomes 0.5."""
        t = self.options.threshold
        values = np.clip(values, 0, 1)
        probability = np.where(values < t, 0.5 * values / t, 0.5 + 0.5 * (values - t) / (1 - t))
        return ContactProbability(probability.astype(np.float32), topology, self._rest if topology == "smpl" else None)


_ADVICE = (
    "run run_demo.py of https://github.com/saidwivedi/InteractVLM (--contact_type hcontact) on your photos, and set "
    "results to the folder"
)


def _size_of(topology: str) -> int:
    """Return the number of vertices of a topology."""
    return next(size for size, name in _TOPOLOGIES.items() if name == topology)


def _result_files(folder: Path) -> list[Path]:
    """Return the result files in a folder and below it."""
    return sorted(
        path for path in folder.rglob(f"*{_SUFFIX}.*") if path.suffix in (".npz", ".npy", ".json") and path.is_file()
    )


def _index_result(path: Path) -> _ResultFile:
    """Return a result file with the thumbnail of its photo, which is beside it or one folder up."""
    stem = path.name.split(_SUFFIX)[0]
    for folder in (path.parent, path.parent.parent):
        for suffix in _PICTURES:
            picture = folder / f"{stem}{suffix}"
            if picture.is_file():
                image = _upright(picture)
                return _ResultFile(path, _thumbnail(image), image.shape[1] / image.shape[0])
    raise BackendError(f"the photo of {path} is not there: keep {stem}.jpg or .png beside it or one folder up")


def _upright(path: Path) -> UInt8Array:
    """Read a photo (H, W, 3) RGB with its EXIF rotation applied."""
    from PIL import ImageOps

    source = ImageSource(str(path), path=path)
    try:
        with open_image(source) as (image, _):
            decode(image, source)
            with wrap_decoding_errors(source):
                return np.array(ImageOps.exif_transpose(image).convert("RGB"))
    except InputError as error:
        raise BackendError(f"{error}; keep the photo that InteractVLM saw beside its result") from error


def _thumbnail(image: UInt8Array) -> FloatArray:
    """Resize an image to a thumbnail."""
    import cv2

    return np.asarray(
        cv2.resize(np.ascontiguousarray(image), (_THUMB, _THUMB), interpolation=cv2.INTER_AREA), np.float32
    )


def _same_photo(result: _ResultFile, image: UInt8Array) -> bool:
    """Return whether a result belongs to an image."""
    if result.thumb is None:
        return True
    aspect = image.shape[1] / image.shape[0]
    if abs(np.log(aspect / result.aspect)) > _MOST_ASPECT:
        return False
    return float(np.abs(_thumbnail(image) - result.thumb).mean()) < _MOST_GREY


def _read(path: Path, wanted: str) -> tuple[str, FloatArray]:
    """Return topology and values (M, V) of a file, in the wanted topology if the file has several."""
    try:
        arrays = _arrays(path)
    except Exception as error:  # of zipfile, zlib and NumPy, which share no base class
        raise BackendError(f"{path} cannot be read, run InteractVLM on its photo again: {error}") from error
    known = {_TOPOLOGIES[a.shape[-1]]: a for a in arrays if a.ndim and a.shape[-1] in _TOPOLOGIES}
    if not known:
        shapes = ", ".join(str(a.shape) for a in arrays) or "nothing"
        raise BackendError(f"{path} holds {shapes}, where contact is (6890,) on SMPL or (10475,) on SMPL-X")
    name = wanted if wanted in known else next(iter(known))
    values = np.asarray(known[name], np.float32)
    if not np.isfinite(values).all():
        raise BackendError(f"{path} holds values that are not finite: run InteractVLM on its photo again")
    return name, values.reshape(-1, values.shape[-1])


def _arrays(path: Path) -> list[Any]:
    """Return the arrays of a file."""
    if path.suffix == ".npz":
        with open_regular(path) as stream:
            return list(read_arrays(stream, limit=_MAX_BYTES).values())
    content = read_regular(path, _MAX_BYTES)
    if path.suffix == ".npy":
        return [np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)]
    content = parse_json(content)
    values = content.get("vertices", content.get("contact", content)) if isinstance(content, dict) else content
    listed = np.asarray(values)
    if listed.ndim == 1 and listed.dtype.kind in "iu" and len(listed) not in _TOPOLOGIES:
        marked = np.zeros(_size_of("smpl"), np.float32)  # numbers of the vertices that touch
        marked[listed] = 1
        return [marked]
    return [listed]


def _rows_of(values: FloatArray, people: People) -> FloatArray:
    """Return values (N, V) of N people; a single row goes to the largest person."""
    if len(values) == len(people):
        return values
    rows = np.zeros((len(people), values.shape[1]), np.float32)
    if len(people):
        sides = people.boxes[:, 2:] - people.boxes[:, :2]
        rows[int(np.argmax(sides.prod(axis=1)))] = values.max(axis=0)
    return rows
