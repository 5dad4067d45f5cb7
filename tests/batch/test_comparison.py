"""``physic compare``: people, scenes and photos of two folders."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from physic_core import Reconstruction, save_reconstruction
from physic_core.batch.comparison import compare_results, pair_results
from physic_core.cli import main
from physic_core.errors import InputError
from physic_core.types import BodyContact, ContactPartner, Grade

HAND = BodyContact("left_hand", ContactPartner("scene", "table", 3), 0.9, 40)


@pytest.fixture
def result(make: Callable[..., Reconstruction]) -> Reconstruction:
    return make()


@pytest.fixture
def other(result: Reconstruction) -> Reconstruction:
    """The second person is farther by 0.3 m and touches a table, comes first, and the scene is larger by a tenth."""
    first, second = result.people
    moved = replace(
        second, joints=second.joints + np.float32([0, 0, 0.3]), contacts=(*second.contacts, HAND), grade=Grade.BAD
    )
    scene = replace(result.scene, points=result.scene.points * np.float32(1.1))
    return replace(result, people=(moved, first), scene=scene)


def test_people_are_matched_by_their_masks(result: Reconstruction, other: Reconstruction):
    found = compare_results("a", result, other)
    assert [person.index for person in found.people] == [(0, 1), (1, 0)]
    same, moved = found.people
    assert (same.joints_m, same.pose_m, same.contact_of_one) == (0, 0, ((), ()))
    assert moved.joints_m == pytest.approx(0.3, abs=1e-5)
    assert moved.pose_m == pytest.approx(0, abs=1e-5)
    assert moved.contact_of_one == ((), ("left_hand: scene",))
    assert moved.grade[1] == "bad"
    away = [np.linalg.norm(one.people[index].joints[0]) for one, index in ((result, 1), (other, 0))]
    assert moved.distance_m == pytest.approx(away)
    assert found.depth_ratio == pytest.approx(1.1, rel=1e-4)
    assert found.depth_difference == pytest.approx(0.1, rel=1e-3)


def test_a_person_of_one_result_alone_is_listed(result: Reconstruction):
    fewer = replace(result, people=result.people[1:])
    assert [person.index for person in compare_results("a", result, fewer).people] == [(0, None), (1, 0)]
    assert [person.index for person in compare_results("a", fewer, result).people] == [(0, 1), (None, 0)]


def test_a_person_without_a_body_has_no_joints_to_compare(result: Reconstruction):
    first = result.people[0]
    lost = replace(first, joints=np.full_like(first.joints, np.nan))
    person = compare_results("a", result, replace(result, people=(lost, *result.people[1:]))).people[0]
    assert (person.joints_m, person.pose_m, person.distance_m[1]) == (None, None, None)


def test_pictures_of_different_sizes_are_refused(result: Reconstruction):
    narrow = replace(result, intrinsics=replace(result.intrinsics, width=7))
    with pytest.raises(InputError, match="7 x"):
        compare_results("a", result, narrow)


def test_photos_of_folders_are_paired_by_their_digests(result: Reconstruction, tmp_path: Path):
    for place, photo in {"a/1": "x", "a/2": "y", "b/one": "y", "b/two": "z"}.items():
        save_reconstruction(replace(result, photo=f"sha256:{photo}"), tmp_path / place, "numbers")
    paired = pair_results(tmp_path / "a", tmp_path / "b")
    assert paired.both == ((tmp_path / "a/2", tmp_path / "b/one"),)
    assert paired.only == ((tmp_path / "a/1",), (tmp_path / "b/two",))


def test_the_command_prints_a_table_or_json_and_writes_a_page(
    result: Reconstruction, other: Reconstruction, tmp_path: Path
):
    for name, one in {"a": result, "b": other}.items():
        save_reconstruction(one, tmp_path / name, "numbers")
    folders = [str(tmp_path / name) for name in "ab"]
    page = tmp_path / "page.html"
    done = CliRunner().invoke(main, ["compare", *folders, "--html", str(page)])
    assert done.exit_code == 0, done.output
    row = next(line for line in done.output.splitlines() if "left hand: scene" in line)
    assert "300 mm" in row
    assert "-> bad" in row
    assert page.read_text().count("data:image/jpeg;base64,") == 2
    data = json.loads(CliRunner().invoke(main, ["compare", *folders, "--json"]).output)
    assert data["photos"][0]["people"][1]["joints_m"] == pytest.approx(0.3, abs=1e-4)
    assert data["only_a"] == data["only_b"] == []


def test_a_damaged_result_leaves_the_others(result: Reconstruction, tmp_path: Path):
    for place in ("a/1", "a/2", "b/1", "b/2"):
        save_reconstruction(replace(result, photo=f"sha256:{place[-1]}"), tmp_path / place, "numbers")
    (tmp_path / "b/1/reconstruction.npz").write_bytes(b"broken")
    done = CliRunner().invoke(main, ["compare", str(tmp_path / "a"), str(tmp_path / "b")])
    assert done.exit_code == 3
    assert "reconstruction.npz" in done.output
    assert "2 people in both" in done.output


def test_a_file_of_the_user_is_not_replaced_by_the_page(result: Reconstruction, tmp_path: Path):
    save_reconstruction(result, tmp_path / "a", "numbers")
    page = tmp_path / "page.html"
    page.write_text("mine")
    done = CliRunner().invoke(main, ["compare", str(tmp_path / "a"), str(tmp_path / "a"), "--html", str(page)])
    assert done.exit_code != 0
    assert page.read_text() == "mine"
