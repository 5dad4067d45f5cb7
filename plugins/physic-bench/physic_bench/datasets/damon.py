"""DAMON: contact of vertices, annotated on photos of HOT, HICO-DET and V-COCO."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.contract import Frame, Picture, TruePerson, Truth
from physic_bench.damage import DamagedFrameError, as_numbers, damaged_file_error
from physic_bench.datasets.base import DataSet, DataSource, Description, FrameSet, option
from physic_bench.pickled import read_object_rows
from physic_bench.touched_classes import CLASSES, class_of_object
from physic_core.files.npz import read_arrays
from physic_core.files.regular import open_regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles
    from physic_bench.carry import Carrier
    from physic_bench.evaluation import Evaluation

    Bools = NDArray[np.bool_]

LABELS = {"smpl": ("contact_label", 6890), "smplx": ("contact_label_smplx", 10475)}
OBJECTS = {"smpl": "contact_label_objectwise", "smplx": "contact_label_smplx_objectwise"}
"""Arrays of a dictionary per photo: object -> ids of the vertices that touch it."""
PATHS = ("Release_Datasets/damon/{name}", "damon/{name}", "{name}")

TREE = """\
ROOT/
  Release_Datasets/damon/hot_dca_test.npz     imgname, contact_label (n, 6890), contact_label_smplx (n, 10475);
                                              optional: contact_label_objectwise, contact_label_smplx_objectwise
  <imgname> ...                               pictures, at the paths that imgname gives, or below ROOT by their name"""


@dataclass(frozen=True)
class DamonOptions:
    """Options of the command.

    Attributes:
        labels: file of the annotation.
        mesh: "smpl" or "smplx", whose labels are the truth.
        every: step through the photos.
    """

    labels: str = option("hot_dca_test.npz", "File with the annotation.", metavar="NAME")
    mesh: str = option("smpl", "Mesh of the labels: smpl (as published) or smplx.", metavar="NAME")
    every: int = option(1, "Every N-th photo.", metavar="N")


class Damon(DataSet):
    """Reads the labels; there is no camera and no 3D truth."""

    name: ClassVar[str] = "damon"
    summary: ClassVar[str] = "DAMON"
    Options: ClassVar[type[Any]] = DamonOptions

    def describe(self) -> Description:
        """Return what DAMON needs."""
        return Description(
            "DAMON: annotated contact of vertices on photos from the internet.",
            (
                DataSource(
                    "hot_dca_test.npz", "the site of DECO, deco.is.tue.mpg.de, with an account", "DAMON dataset licence"
                ),
                DataSource(
                    "the photos that it names",
                    "the sites of HOT (hot.is.tue.mpg.de), HICO-DET and V-COCO",
                    "their own terms",
                ),
                DataSource(
                    "SMPL model file (--smpl), to carry contact of other bodies to its 6890 vertices",
                    "the site of SMPL, smpl.is.tue.mpg.de, with an account",
                    "SMPL licence: non-commercial research",
                ),
            ),
            TREE,
            (
                "As in the challenge, the threshold is .5, and scores are means over photos: without predicted contact "
                "P = 1 and R = F1 = 0; without true contact P = 0, R = 1, F1 = 0.",
                "The one annotated person is the method's best.",
                "Objects of contact_label_objectwise are compared by class: supporting (floor, ground, stairs, wall), "
                "seat (chair, couch, bench, toilet), bed, table, cabinet (refrigerator, oven, sink), vehicle, "
                "vegetation, person; all others are object. Objects of one class in a photo count together.",
                "Geodesic distances are measured on the edges of the mesh's T-pose, not by the published matrix.",
                "results-NAME.zip, with results.pkl, is the submission file of the challenge.",
            ),
        )

    def check(self, root: Path, options: DamonOptions, *, pictures: bool = True) -> list[str]:
        """Return the missing files."""
        if options.every < 1:
            return [f"--every is at least 1 (got {options.every})"]
        if options.mesh not in LABELS:
            return [f"--mesh is smpl or smplx (got '{options.mesh}')"]
        file = _labels_file(root, options)
        if file is None:
            return [f"{root / PATHS[0].format(name=options.labels)}: annotation"]
        names = _names(file)[:: options.every]
        if not pictures:
            return []
        lost = [name for name in names if _picture(root, name) is None]
        shown = [f"{root / name}: picture" for name in lost[:20]]
        return shown + ([f"and {len(lost) - 20} more pictures"] if len(lost) > 20 else [])

    def frames(self, root: Path, options: DamonOptions, bodies: BodyFiles) -> FrameSet:
        """Return the photos."""
        file = _labels_file(root, options)
        assert file is not None
        names = _names(file)
        key, count = LABELS[options.mesh]
        contact = as_numbers(_array(file, key), f"{file}: '{key}'")
        if contact.shape != (len(names), count):
            raise DamagedFrameError(f"{file}: '{key}' must be ({len(names)}, {count}), got {contact.shape}")
        objects = _objects(file, OBJECTS[options.mesh], len(names), count)
        known: Bools = np.asarray(np.isfinite(contact).all(axis=1))
        frames, left_out = [], {}
        for row in range(0, len(names), options.every):
            name, picture = names[row], _picture(root, names[row])
            identifier = Path(name).with_suffix("").as_posix().lstrip("/")
            if not known[row]:
                left_out[identifier] = f"{file}: '{key}' of {name} has values that are not finite"
                continue
            load = partial(_truth, contact[row] >= 0.5, options.mesh, None if objects is None else objects[row])
            labels = {"image": name}
            frames.append(Frame(identifier, identifier, load, None, Picture(picture) if picture else None, labels))
        if len({frame.id for frame in frames}) < len(frames):
            raise DamagedFrameError(f"{file} names a photo twice")
        return FrameSet(tuple(frames), (), left_out)

    def write_more(self, evaluation: Evaluation, out: Path, carrier: Carrier) -> list[Path]:
        """Write the submission file of each method."""
        return [
            path for method in evaluation.methods if (path := write_submission(evaluation, method.name, out, carrier))
        ]


def write_submission(evaluation: Evaluation, method: str, out: Path, carrier: Carrier) -> Path | None:
    """Write results.pkl in a zip archive: {image: {"gen_contact_vids": 6890 zeros and ones}}.

    The pickle holds plain lists, so that any reader can open it. None if contact cannot be carried to SMPL.
    """
    import io
    import pickle

    from physic_core.files.atomic import atomic_write
    from physic_core.files.own import MARK

    chosen = next(m for m in evaluation.methods if m.name == method)
    document: dict[str, dict[str, list[int]]] = {}
    for frame in evaluation.frames:
        contact = np.zeros(LABELS["smpl"][1], bool)
        prediction = chosen.result_or_none(frame)
        if prediction is not None and prediction.people and prediction.people[0].contact is not None:
            person = prediction.people[0]
            carried = carrier.contact(np.asarray(person.contact), person.contact_topology or person.topology, "smpl")
            if carried is None:
                return None
            contact = carried
        document[Path(frame.labels["image"]).name] = {"gen_contact_vids": contact.astype(int).tolist()}
    stream = io.BytesIO()
    pickle.dump(document, stream, protocol=2)
    path = out / f"results-{method.replace('/', '_')}.zip"
    with atomic_write(out) as temporary, zipfile.ZipFile(temporary(path.name), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("results.pkl", stream.getvalue())
        archive.comment = MARK.encode()
    return path


def _truth(contact: Bools, mesh: str, objects: dict[str, list[int]] | None) -> Truth:
    if objects is None:
        return Truth((TruePerson(contact=contact, topology=mesh),))
    touched = {name: np.zeros(len(contact), bool) for name in CLASSES}
    for name, vertices in objects.items():
        touched[class_of_object(name)][vertices] = True
    return Truth((TruePerson(contact=contact, topology=mesh, contact_classes=touched),))


def _objects(file: Path, key: str, photos: int, count: int) -> list[dict[str, list[int]]] | None:
    """Return the vertices of each object in each photo; None if the file has no such labels.

    Raises:
        DamagedFrameError: the labels are not a dictionary of vertex ids per photo.
    """
    try:
        rows = read_object_rows(file, key)
    except KeyError:
        return None
    if len(rows) != photos:
        raise DamagedFrameError(f"{file}: '{key}' must have {photos} entries, got {len(rows)}")
    return [_vertices_by_object(row, f"{file}: '{key}'", count) for row in rows]


def _vertices_by_object(row: Any, where: str, count: int) -> dict[str, list[int]]:
    if not isinstance(row, dict) or not all(isinstance(name, str) for name in row):
        raise DamagedFrameError(f"{where} must be a dictionary from object to vertex ids for each photo")
    found = {}
    for name, ids in row.items():
        vertices = np.asarray(ids)
        whole = vertices.dtype.kind in "iu" and vertices.ndim == 1
        if vertices.size and not (whole and vertices.min() >= 0 and vertices.max() < count):
            raise DamagedFrameError(f"{where} must hold vertex ids from 0 to {count - 1} for '{name}'")
        found[name] = vertices.astype(np.int64).tolist()
    return found


def _labels_file(root: Path, options: DamonOptions) -> Path | None:
    return next(
        (root / p.format(name=options.labels) for p in PATHS if (root / p.format(name=options.labels)).is_file()), None
    )


def _picture(root: Path, name: str) -> Path | None:
    relative = name.lstrip("/")
    places = [root / relative, root / Path(relative).name, *(root / Path(*Path(relative).parts[k:]) for k in (1, 2))]
    return next((place for place in places if place.is_file()), None)


def _names(file: Path) -> list[str]:
    names = _array(file, "imgname")
    if names.ndim != 1 or names.dtype.kind not in "US":
        raise DamagedFrameError(f"{file}: 'imgname' must be a list of texts, got {names.shape} of {names.dtype}")
    return [name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name) for name in names.tolist()]


def _array(file: Path, name: str) -> Any:
    """Return one array: the others of the published file are Python objects, which are not read.

    Raises:
        DamagedFrameError: it is missing, damaged or a Python object.
    """
    try:
        with open_regular(file) as stream:
            return read_arrays(stream, [name])[name]
    except KeyError as error:
        raise DamagedFrameError(f"{file} has no '{name}'") from error
    except ValueError as error:
        if "Python objects" not in str(error):
            raise DamagedFrameError(f"{file} cannot be read: {error}") from error
    except Exception as error:  # of zipfile and its compressors, which have many
        raise damaged_file_error(file, error) from error
    return _texts_of_pickled_array(file, name)


def _texts_of_pickled_array(file: Path, name: str) -> Any:
    raise DamagedFrameError(
        f"{file}: '{name}' is an array of Python objects, which can run code and is not read; save it anew: "
        f"np.savez(NEW, **{{key: np.array(list(old[key])) for key in {json.dumps(['imgname', 'contact_label'])}}})"
    )


DATA_SET = Damon()
