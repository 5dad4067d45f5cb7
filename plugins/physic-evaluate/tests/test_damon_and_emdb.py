"""``physic evaluate damon`` and ``physic evaluate emdb`` on miniatures."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_core.types import ContactPartner
from physic_evaluate.datasets.emdb import DATA_SET as EMDB
from physic_evaluate.datasets.emdb import EmdbOptions
from physic_evaluate.touched_classes import class_of_partner

from .miniatures import SIZE, Files, K, figures, moved_by, python2_pickle, rigid, rotation, run, write_plain


@pytest.fixture
def damon(tmp_path: Path) -> tuple[Path, np.ndarray]:
    """Three photos: 100, 60 and no contact vertices."""
    root, labels = tmp_path / "set", np.zeros((3, 6890))
    labels[0, :100] = labels[1, :60] = 1
    folder = root / "Release_Datasets" / "damon"
    folder.mkdir(parents=True)
    names = np.array([f"datasets/HOT-Annotated/images/hake_{i}.jpg" for i in range(3)])
    objects = np.array([{"chair": [1, 2]}, {}, {}], object)
    np.savez(folder / "hot_dca_test.npz", imgname=names, contact_label=labels, contact_label_objectwise=objects)
    (root / "HOT-Annotated" / "images").mkdir(parents=True)
    for i in range(3):
        Image.new("RGB", (40, 30)).save(root / "HOT-Annotated" / "images" / f"hake_{i}.jpg")
    return root, labels.astype(bool)


def test_damon_scores_as_the_challenge_and_writes_its_file(damon: tuple[Path, np.ndarray], tmp_path: Path):
    root, labels = damon
    predicted = labels.copy()
    predicted[0, 100:150] = True  # P = 2/3, R = 1
    predicted[1] = False  # nothing predicted: P = 1, R = 0, F1 = 0
    predicted[2, :10] = True  # nothing true: P = 0, R = 1, F1 = 0
    for i in range(3):
        write_plain(tmp_path / "theirs", f"hake_{i}", contact=predicted[i][None])
    done = run("damon", str(root), "-o", str(tmp_path / "out"), "--results", f"theirs=plain:{tmp_path / 'theirs'}")
    assert done.exit_code == 0, done.output
    found = figures(tmp_path / "out", "theirs")
    assert found["precision@annotated"] == pytest.approx((2 / 3 + 1 + 0) / 3)
    assert found["recall@annotated"] == pytest.approx(2 / 3)
    assert found["f1_mean@annotated"] == pytest.approx(0.8 / 3)
    assert found["f1_pooled@annotated"] == pytest.approx(2 * 100 / (2 * 100 + 60 + 60))
    with zipfile.ZipFile(tmp_path / "out" / "results-theirs.zip") as archive:
        sent = pickle.loads(archive.read("results.pkl"))
    assert list(sent) == ["hake_0.jpg", "hake_1.jpg", "hake_2.jpg"]
    assert np.array(sent["hake_0.jpg"]["gen_contact_vids"]).tolist() == predicted[0].astype(int).tolist()


def test_objects_are_scored_by_class(damon: tuple[Path, np.ndarray], tmp_path: Path):
    """The first photo has vertices 1 and 2 on a chair; the others have no object."""
    contact = np.zeros((3, 6890), bool)
    names = np.full((3, 6890), "", "<U10")
    contact[0, 1:4], names[0, 1], names[0, 2:4] = True, "seat", "object"  # one of two is right, one false alarm
    contact[1, 7], names[1, 7] = True, "supporting"
    for i in range(3):
        write_plain(tmp_path / "theirs", f"hake_{i}", contact=contact[i][None], contact_class=names[i][None])
    arguments = ("--results", f"theirs=plain:{tmp_path / 'theirs'}")
    done = run("damon", str(damon[0]), "-o", str(tmp_path / "out"), *arguments)
    assert done.exit_code == 0, done.output
    found = figures(tmp_path / "out", "theirs")
    assert found["touched_right"] == 1 / 2
    assert found["touched_f1@seat"] == pytest.approx(2 / 3)
    assert found["touched_f1@object"] == found["touched_f1@supporting"] == 0
    assert "touched_f1@bed" not in found


@pytest.mark.parametrize(
    ("partner", "name"),
    [
        (ContactPartner("floor", "rug"), "supporting"),
        (ContactPartner("scene", "seat", id=0), "seat"),
        (ContactPartner("scene", "wall", id=0), "supporting"),
        (ContactPartner("scene", "", id=0), ""),
        (ContactPartner("hidden", "seat"), "seat"),
        (ContactPartner("person", person=1, part="head"), "person"),
        (ContactPartner("self", part="head"), ""),
    ],
)
def test_the_class_of_a_partner(partner: ContactPartner, name: str):
    assert class_of_partner(partner) == name


@pytest.fixture(scope="module")
def emdb(files: Files, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One sequence of 40 frames, z up in the world, camera turning; frame 30 is not good."""
    root = tmp_path_factory.mktemp("emdb")
    folder = root / "P2" / "19_indoor_walk_off_mvs"
    rng = np.random.default_rng(0)
    extrinsics = np.stack([rigid(rotation("y", i - 20.0) @ rotation("x", 90), [0, 0.9, 4.0]) for i in range(40)])
    poses = 0.1 * rng.standard_normal((40, 69))
    smpl = {"poses_root": np.tile([np.pi / 2, 0, 0], (40, 1)), "poses_body": poses, "betas": np.zeros(10)}
    smpl["trans"] = np.stack([[0.01 * i, 0, 1.0] for i in range(40)])
    values = {"gender": "neutral", "name": "P2_19", "emdb1": True, "emdb2": False, "n_frames": 40, "smpl": smpl}
    values["good_frames_mask"] = np.arange(40) != 30
    values["camera"] = {"intrinsics": K, "extrinsics": extrinsics, "width": SIZE[0], "height": SIZE[1]}
    joints = []
    for i in range(40):
        own = {"global_orient": smpl["poses_root"][i], "body_pose": poses[i], "transl": smpl["trans"][i]}
        inside = moved_by(extrinsics[i], files.bodies.smpl_body(own).joints)
        joints.append((inside / inside[:, 2:]) @ K[:2].T)
    values["kp2d"] = np.stack(joints)
    python2_pickle(folder / "P2_19_indoor_walk_off_mvs_data.pkl", values)
    (folder / "images").mkdir()
    for i in range(0, 40, 10):
        Image.new("RGB", SIZE).save(folder / "images" / f"{i:05d}.jpg")
    return root


def test_emdb_in_the_camera_of_each_frame(emdb: Path, files: Files, tmp_path: Path):
    found = EMDB.frames(emdb, EmdbOptions(every=10), files.bodies)
    assert [frame.id.rpartition("/")[2] for frame in found.frames] == ["00000", "00010", "00020", "00031"]
    for frame in found.frames:
        person = frame.truth().people[0]
        arrays = {"vertices": person.vertices[None], "joints": person.joints[None] + [0.03, 0, 0.04]}  # type: ignore[index]
        write_plain(tmp_path / "theirs", frame.id, **arrays)
    arguments = ("--results", f"theirs=plain:{tmp_path / 'theirs'}", "--every", "10", *files.arguments())
    done = run("emdb", str(emdb), "-o", str(tmp_path / "out"), *arguments)
    assert done.exit_code == 0, done.output
    values = figures(tmp_path / "out", "theirs")
    assert (values["me_mpjpe"], values["rt_error"], values["me_pve"]) == pytest.approx((50, 50, 0), abs=1e-3)
    assert EMDB.frames(emdb, EmdbOptions(part="2"), files.bodies).frames == ()


def test_emdb_with_inverted_extrinsics_is_refused(emdb: Path, files: Files, tmp_path: Path):
    from physic_evaluate.pickled import pickled_arrays

    file = next(emdb.glob("P2/*/*_data.pkl"))
    values = pickled_arrays(file)
    values["camera"]["extrinsics"] = np.linalg.inv(values["camera"]["extrinsics"])
    python2_pickle(tmp_path / "P2" / "19" / "P2_19_data.pkl", values)
    left_out = EMDB.frames(tmp_path, EmdbOptions(), files.bodies).left_out
    assert "from the sequence's own 2D joints" in left_out["P2/19"]


def test_a_pickle_that_names_code_is_refused(tmp_path: Path, files: Files):
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            import os

            return os.system, ("touch /tmp/never",)

    file = tmp_path / "P0" / "0" / "P0_0_data.pkl"
    file.parent.mkdir(parents=True)
    file.write_bytes(pickle.dumps({"emdb1": True, "camera": Evil()}))
    left_out = EMDB.frames(tmp_path, EmdbOptions(), files.bodies).left_out
    assert left_out["P0/0"].startswith(f"{file} holds posix.system, which is refused")
    whole = pickle.dumps({"emdb1": np.ones(1000)}, protocol=2)
    file.write_bytes(whole[:500])
    assert "is not a complete pickle" in EMDB.frames(tmp_path, EmdbOptions(), files.bodies).left_out["P0/0"]
