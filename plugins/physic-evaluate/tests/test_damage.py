"""Readers of results and of data sets on damaged content: an error that names the file, and never another exception."""

from __future__ import annotations

import json
import pickle
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.errors import InputError
from physic_evaluate.damage import DamagedFileError
from physic_evaluate.datasets.damon import DATA_SET as DAMON
from physic_evaluate.datasets.damon import DamonOptions
from physic_evaluate.datasets.emdb import DATA_SET as EMDB
from physic_evaluate.datasets.emdb import EmdbOptions
from physic_evaluate.datasets.rich import DATA_SET as RICH
from physic_evaluate.datasets.rich import RichOptions
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.readers import open_reader
from physic_evaluate.readers.base import ResultReader
from physic_evaluate.validation import checked_truth

from .miniatures import Files, K, figures, python2_pickle, run, write_plain
from .test_damon_and_emdb import damon, emdb
from .test_readers import POSE, STANDING, WRITERS, frame_of
from .test_rich import SEQUENCE
from .test_rich import root as rich

__all__ = ["damon", "emdb", "rich"]

Change = Callable[[Any], Any]
CHANGES: dict[str, Change] = {
    "missing": lambda value: KeyError,
    "NaN": lambda value: np.full(np.shape(value), np.nan),
    "text": lambda value: "a text",
    "one less": lambda value: np.ravel(value)[:-1],
    "empty": lambda value: np.zeros(0),
}


def leaves(values: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Keys of all entries of nested dictionaries, and of these."""
    for key, value in values.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))


def changed(values: Any, path: tuple[Any, ...], change: Change) -> Any:
    """A copy of nested dictionaries in which one entry is changed."""
    copy = dict(values)
    key, *rest = path
    new = changed(values[key], tuple(rest), change) if rest else change(values[key])
    if new is KeyError:
        del copy[key]
    else:
        copy[key] = new
    return copy


def write_parameters(folder: Path, files: Files, frame: Any) -> None:
    arrays = {name: np.array(value, np.float64)[None] for name, value in (STANDING | POSE).items()}
    write_plain(folder, frame.id, **arrays, K=K, contact=np.zeros((1, 10475)), boxes=np.zeros((1, 4)))


def write_sam(folder: Path, files: Files, frame: Any) -> None:
    rng = np.random.default_rng(1)
    arrays = {"pred_vertices": rng.uniform(-0.8, 0.8, (18439, 3)), "pred_keypoints_3d": rng.uniform(-1, 1, (70, 3))}
    write_plain(folder, frame.id, **arrays, pred_cam_t=np.array([0, 0, 4.0]), focal_length=480.0)


@pytest.mark.parametrize("name", [*WRITERS, "plain", "sam-3d-body"])
def test_a_reader_of_changed_content_gives_a_result_or_names_the_file(name: str, files: Files, tmp_path: Path):
    frame = frame_of()
    more = {"plain": write_parameters, "sam-3d-body": write_sam}
    (WRITERS | more)[name](tmp_path, files, frame)
    reader = open_reader(name, tmp_path, files.bodies)
    for file in sorted((*tmp_path.rglob("*.npz"), *tmp_path.rglob("*.pkl"))):
        content = file.read_bytes()
        values = dict(np.load(file)) if file.suffix == ".npz" else pickled_arrays(file)
        for path in leaves(values):
            for kind, change in CHANGES.items():
                new = changed(values, path, change)
                if file.suffix == ".npz":
                    np.savez(file, **new)
                else:
                    file.write_bytes(pickle.dumps(new))
                require_result_or_reason(reader, frame, file, f"{path} {kind}")
        for size in (0, 10, len(content) // 2, len(content) - 3):
            file.write_bytes(content[:size])
            with pytest.raises(DamagedFileError, match=file.name):
                reader.result(frame)
        file.write_bytes(content)


def require_result_or_reason(reader: ResultReader, frame: Any, file: Path, what: str) -> None:
    try:
        found = reader.result(frame)
    except InputError as error:
        found, reason = None, str(error)
    else:
        assert found is not None, what
        reason = str(file)
    assert str(file) in reason, what
    if found is None:
        return
    for person in found.people:
        assert person.vertices is None or np.isfinite(person.vertices).all(), what


def truths(data_set: Any, root: Path, options: Any, files: Files) -> dict[str, str]:
    """Frame or sequence -> why it is not evaluated."""
    found = data_set.frames(root, options, files.bodies)
    reasons = dict(found.left_out)
    for frame in found.frames:
        try:
            truth = checked_truth(frame)
        except DamagedFileError as error:
            reasons[frame.id] = str(error)
        else:
            assert all(np.isfinite(p.vertices).all() for p in truth.people if p.vertices is not None)
    return reasons


def test_emdb_of_changed_content_gives_truth_or_names_the_file(emdb: Path, files: Files, tmp_path: Path):
    source = next(emdb.glob("P2/*/*_data.pkl"))
    file = tmp_path / "P2" / "19 indoor" / "P2_19_data.pkl"
    values = pickled_arrays(source)
    harmless = {("name",), ("emdb2",)}
    for path in leaves(values):
        for kind, change in CHANGES.items():
            python2_pickle(file, changed(values, path, change))
            reasons = truths(EMDB, tmp_path, EmdbOptions(every=40), files)
            optional = path in {("kp2d",), ("gender",), ("good_frames_mask",)} and kind == "missing"
            assert optional or path in harmless or all(str(file) in reason for reason in reasons.values()), path
            assert reasons or optional or path in {*harmless, ("smpl", "betas")}, (path, kind)
    for what, change in {
        "from the camera: lengths": lambda v: v["smpl"].update(trans=1000 * v["smpl"]["trans"]),
        "from the sequence's own 2D joints": lambda v: v["camera"].update(
            extrinsics=v["camera"]["extrinsics"].swapaxes(1, 2)
        ),
    }.items():
        values = pickled_arrays(source)
        change(values)
        python2_pickle(file, values)
        (reason,) = truths(EMDB, tmp_path, EmdbOptions(every=40), files).values()
        assert what in reason or "is no rotation" in reason or "project" in reason


@pytest.fixture
def rich_copy(rich: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage, in a folder with a blank."""
    return Path(shutil.copytree(rich, tmp_path / "the set"))


def test_rich_of_changed_parameters_gives_truth_or_names_the_file(rich_copy: Path, files: Files):
    file = next(rich_copy.glob("bodies/test/*/*/009.pkl"))
    values = pickled_arrays(file)
    for path in leaves(values):
        for kind, change in CHANGES.items():
            python2_pickle(file, changed(values, path, change))
            reasons = truths(RICH, rich_copy, RichOptions(), files)
            # Twelve hand components less one are eleven.
            harmless = kind == "missing" or (path == ("left_hand_pose",) and kind == "one less")
            assert harmless or len(reasons) == 2, (path, kind)
            assert all(str(file) in reason for reason in reasons.values()), (path, kind)
    python2_pickle(file, changed(values, ("transl",), lambda transl: 1000 * np.asarray(transl)))
    reasons = truths(RICH, rich_copy, RichOptions(), files)
    assert len(reasons) == 2
    assert all("m from the camera: lengths must be metres" in reason for reason in reasons.values())


CALIBRATION = "scan_calibration/LectureHall_lunge/calibration/003.xml"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("</opencv_storage>", "", "{file} is not valid XML: it is damaged or cut off"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>wide", "{file}: Intrinsics holds no numbers"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>nan", "{file}: Intrinsics has values that are not finite"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>-400.0", "{file}: Intrinsics has no positive focal lengths and"),
        ("320.0", "20.0", "the picture {root}/images/test/"),
        ("<CameraMatrix><data>", "<CameraMatrix><data>5 ", "{file}: CameraMatrix must have 3 x 4 numbers, got 13"),
        ("<CameraMatrix><data>0.", "<CameraMatrix><data>-0.", "{file}: the rotation of CameraMatrix is no rotation"),
        ("2.000000000", "2000.0", "{file}: the camera is 2000 m away: it must be metres"),
        ("-0.01 0.02 0 0 0", "-0.01", "{file}: Distortion must have 2 numbers or more, got 1"),
    ],
)
def test_a_damaged_calibration_of_rich_costs_its_camera(rich_copy: Path, files: Files, old: str, new: str, reason: str):
    file = rich_copy / CALIBRATION
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    (file.parent / "notes of the makers.xml").write_text("")
    found = RICH.frames(rich_copy, RichOptions(), files.bodies)
    assert [frame.id for frame in found.frames] == [f"{SEQUENCE}/00042/0"]
    assert found.left_out[f"{SEQUENCE}/00042/3"].startswith(reason.format(file=file, root=rich_copy))


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        (
            "resource/gender.json",
            b"[]",
            "{file} must be an object of subjects, each of them one of neutral, male, f",
        ),
        (
            "resource/gender.json",
            b'{"9": "m"}',
            "{file} must be an object of subjects, each of them one of neutral, male, f",
        ),
        ("resource/gender.json", b'{"9": "male"}', "{file} has no subject 021"),
        ("resource/gender.json", b'{"9": "mal', "{file} is not valid JSON ("),
        (f"human_scene_contact/test/{SEQUENCE}/00042/009.pkl", b"", "{file} is not a complete pickle ("),
        (f"bodies/test/{SEQUENCE}/00042/009.pkl", b"cmine\nBody\n.", "{file} holds mine.Body, which is refused"),
        (f"bodies/test/{SEQUENCE}/00042/009.pkl", pickle.dumps([1]), "{file} holds a list, not the arrays of a body"),
        ("scan_calibration/LectureHall_lunge/scan_camcoord.ply", b"ply\n", "{file} cannot be read as a mesh: it is"),
    ],
)
def test_a_damaged_file_of_rich_is_the_reason_of_its_frames(
    rich_copy: Path, files: Files, name: str, content: bytes, reason: str
):
    file = rich_copy / name
    file.write_bytes(content)
    reasons = truths(RICH, rich_copy, RichOptions(), files)
    assert len(reasons) == 2
    assert all(text.startswith(reason.format(file=file)) for text in reasons.values())


def test_rich_without_any_usable_frame_is_refused_before_pictures_are_reconstructed(
    rich_copy: Path, files: Files, tmp_path: Path
):
    (rich_copy / "resource" / "gender.json").write_text("{}")
    done = run("rich", str(rich_copy), "-o", str(tmp_path / "out"), "--preset", "mock", *files.arguments())
    assert done.exit_code == 3
    assert (
        f"no frame of {rich_copy} can be evaluated: {rich_copy}/resource/gender.json has no subject 009" in done.output
    )
    assert not (tmp_path / "out" / "reconstructions").exists()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda a: a.update(contact_label=a["contact_label"][:2]), "'contact_label' must be (3, 6890), got (2, 6890)"),
        (lambda a: a.update(contact_label=a["contact_label"].T), "'contact_label' must be (3, 6890), got (6890, 3)"),
        (lambda a: a.update(contact_label=np.full((3, 6890), "x")), "'contact_label' holds no numbers"),
        (lambda a: a.update(imgname=np.arange(3)), "'imgname' must be a list of texts, got (3,) of int64"),
        (lambda a: a.update(imgname=np.array(["a.jpg"] * 3)), "names a photo twice"),
        (lambda a: a.pop("contact_label"), "has no 'contact_label'"),
        (lambda a: a.update(imgname=np.array([{}] * 3, object)), "'imgname' is an array of Python objects"),
    ],
)
def test_damaged_labels_of_damon_are_refused(
    damon: tuple[Path, np.ndarray], change: Callable[[dict[str, Any]], Any], reason: str
):
    file = damon[0] / "Release_Datasets" / "damon" / "hot_dca_test.npz"
    arrays = {"imgname": np.load(file)["imgname"], "contact_label": np.load(file)["contact_label"]}
    change(arrays)
    np.savez(file, **arrays)
    with pytest.raises(DamagedFileError) as error:
        DAMON.frames(damon[0], DamonOptions(), Files(None).bodies)  # type: ignore[arg-type]
    assert str(error.value).startswith(str(file))
    assert reason in str(error.value)


def test_unknown_labels_of_damon_cost_their_photo(damon: tuple[Path, np.ndarray]):
    file = damon[0] / "Release_Datasets" / "damon" / "hot_dca_test.npz"
    names, labels = np.load(file)["imgname"], np.load(file)["contact_label"]
    labels[1, 5] = np.nan
    np.savez(file, imgname=names, contact_label=labels)
    found = DAMON.frames(damon[0], DamonOptions(), Files(None).bodies)  # type: ignore[arg-type]
    assert len(found.frames) == 2
    assert list(found.left_out.values()) == [f"{file}: 'contact_label' of {names[1]} has values that are not finite"]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Two photos with one measured person each, and results."""
    from physic_evaluate.joints import LIMB_JOINTS

    rng, folder = np.random.default_rng(0), tmp_path / "mine"
    folder.mkdir()
    true = rng.uniform([-0.4, -0.9, 2.9], [0.4, 0.9, 3.1], (12, 3))
    joints = dict(zip(LIMB_JOINTS, true.tolist(), strict=True))
    record = {"width": 640, "height": 480, "K": K.tolist(), "joints": joints}
    for i in range(2):
        (folder / f"p{i}.png").write_bytes(b"")
        write_plain(tmp_path / "theirs", f"p{i}", joints=true[None], joint_names=np.array(LIMB_JOINTS))
    (folder / "truth.json").write_text(json.dumps([{"image": f"p{i}.png", **record} for i in range(2)]))
    return folder


def test_an_error_of_the_program_ends_with_code_1_after_the_table(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from physic_evaluate.readers.plain import Plain

    read = Plain.read

    def broken(self: Plain, path: Path, frame: Any) -> Any:
        return {}["spine"] if frame.id == "p1" else read(self, path, frame)

    monkeypatch.setattr(Plain, "read", broken)
    monkeypatch.setenv("PHYSIC_DEBUG", "1")
    arguments = ("calibrated", str(photos), "-o", str(tmp_path / "out"), "--results")
    done = run(*arguments, f"theirs=plain:{tmp_path / 'theirs'}")
    assert done.exit_code == 1
    assert "Error: 1 score failed by an error of this program, not of a file" in done.output
    assert "p1 (theirs): KeyError: 'spine' (" in done.output
    assert "Traceback" in done.output
    assert "theirs: 1 of 2 frames without a result: p1 (unexpected error: KeyError: 'spine'" in done.output
    assert figures(tmp_path / "out", "theirs")["found"] == 0.5
    monkeypatch.setattr(Plain, "read", read)
    done = run(*arguments, f"theirs=plain:{tmp_path / 'theirs'}")
    assert done.exit_code == 0
    assert "1 of 2 scores unchanged" in done.output
    assert figures(tmp_path / "out", "theirs")["found"] == 1
