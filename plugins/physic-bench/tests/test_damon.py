"""``physic evaluate damon`` on a miniature."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_bench.touched_classes import class_of_partner
from physic_core.types import ContactPartner

from .miniatures import figures, run, write_plain


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
