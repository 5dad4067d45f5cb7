"""``physic compare``: people, scenes and photos of two folders."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from physic_bench.comparison import changed_lines, compare_results, pair_results, summary_lines
from physic_core import save_reconstruction
from physic_core.body import JOINT_NAMES
from physic_core.configuration.model import load_config
from physic_core.types import BodyContact, ContactPartner

HAND = BodyContact("left_hand", ContactPartner("scene", "table", 3), 0.9, 40)


@pytest.fixture
def result(make):
    """Two people whose place is usable."""
    reconstruction = make()
    return replace(
        reconstruction, people=tuple(replace(one, trust_place=0.9) for one in reconstruction.people)
    )


@pytest.fixture
def other(result):
    """The second person is farther by 0.3 m and touches a table, comes first, and the scene is
    larger by a tenth.
    """
    first, second = result.people
    moved = replace(
        second,
        joints=second.joints + np.float32([0, 0, 0.3]),
        contacts=(*second.contacts, HAND),
        trust_place=0.2,
    )
    scene = replace(result.scene, points=result.scene.points * np.float32(1.1))
    return replace(result, people=(moved, first), scene=scene)


def test_people_are_matched_by_their_masks(result, other):
    comparison = compare_results(result, other)
    assert [person.index for person in comparison.people] == [(0, 1), (1, 0)]
    same, moved = comparison.people
    assert (same.joints.mean_m, same.contacts[0]) == (0, same.contacts[1])
    assert moved.joints.mean_m == pytest.approx(0.3, abs=1e-5)
    assert moved.pose.mean_m == pytest.approx(0, abs=1e-5)
    assert moved.contacts == (("left foot: floor",), ("left foot: floor", "left hand: table"))
    assert [one["place"] for one in moved.marks] == [0.9, 0.2]
    away = [np.linalg.norm(one.people[index].joints[0]) for one, index in ((result, 1), (other, 0))]
    assert moved.distance_m == pytest.approx(away)
    assert comparison.depth_difference == pytest.approx(0.1, rel=1e-3)


def test_the_joint_that_is_farthest_apart_is_named(result):
    joints = result.people[0].joints.copy()
    joints[JOINT_NAMES.index("left_wrist")] += np.float32([0, 0.22, 0])
    other = replace(result, people=(replace(result.people[0], joints=joints), *result.people[1:]))
    pose = compare_results(result, other).people[0].pose
    assert (pose.worst, pose.worst_m, pose.mean_m) == (
        "left_wrist",
        pytest.approx(0.22),
        pytest.approx(0.01),
    )


def test_backends_and_settings_that_differ_are_listed(result):
    def with_config(*overrides):
        return replace(result, config=load_config(preset="mock", overrides=overrides).as_dict())

    before = with_config()
    assert compare_results(before, with_config("run.threads=7")).changed == ()
    swapped = with_config(
        "inpainter.backend=telea", "inpainter.options.threads=1", "photo.max_side=960"
    )
    assert compare_results(before, swapped).changed == (
        "inpainter: mock -> telea",
        "photo.max_side: 1280 -> 960",
    )
    option = compare_results(before, with_config("metric_depth.options.seed=4"))
    assert option.changed == ("metric_depth.options.seed: default -> 4",)
    assert changed_lines([option, compare_results(before, before)]) == [
        f"{option.changed[0]} (1 of 2 photos)"
    ]


def test_results_of_different_photos_are_compared_and_the_first_line_says_so(
    result,
):
    a, b = (replace(result, photo=f"sha256:{name}", photo_name=name) for name in ("a.jpg", "b.jpg"))
    (line,) = compare_results(a, b).changed
    assert "a.jpg and b.jpg differ" in line
    pixels = replace(a, photo="pixels-sha256:a")
    assert compare_results(a, a).changed == compare_results(a, pixels).changed == ()


def test_a_person_of_one_result_alone_is_listed(result):
    fewer = replace(result, people=result.people[1:])
    assert [person.index for person in compare_results(result, fewer).people] == [(0, None), (1, 0)]
    assert [person.index for person in compare_results(fewer, result).people] == [(0, 1), (None, 0)]


@pytest.mark.parametrize(("trust", "words"), [(0.69, "2 the same"), (0.6, "1 worse, 1 the same")])
def test_a_mark_has_changed_only_beyond_the_noise_of_the_probability(result, trust, words):
    first, *rest = result.people
    a, b = (replace(result, people=(replace(first, trust_place=p), *rest)) for p in (0.74, trust))
    assert f"marks of people in B: {words}" in summary_lines([compare_results(a, b)], ((), ()))


def test_change_of_given_bodies_is_told(result):
    first, *rest = result.people
    joints = first.joints - np.array([0, 0, 0.1], np.float32)
    b = replace(result, people=(replace(first, given_joints=joints, body_source="a"), *rest))
    (line,) = [t for t in summary_lines([compare_results(result, b)], ((), ())) if "given" in t]
    assert "1 people in B" in line
    assert "place 100 mm, of pose 0 mm" in line


def test_photos_of_folders_are_paired_by_their_digests(result, tmp_path):
    for place, photo in {"a/1": "x", "a/2": "y", "b/one": "y", "b/two": "z"}.items():
        save_reconstruction(replace(result, photo=f"sha256:{photo}"), tmp_path / place, "numbers")
    both, only = pair_results(tmp_path / "a", tmp_path / "b")
    assert both == [(tmp_path / "a/2", tmp_path / "b/one")]
    assert only == ([tmp_path / "a/1"], [tmp_path / "b/two"])


@pytest.fixture
def saved(result, other, tmp_path):
    """The folders of both results; the second one has a page."""
    for name, one in {"a": result, "b": other}.items():
        save_reconstruction(replace(one, photo_name="beach.jpg"), tmp_path / name, "numbers")
    (tmp_path / "b/report.html").touch()
    return [str(tmp_path / name) for name in "ab"]


def test_the_command_prints_a_table_or_json(saved, physic):
    done = physic("compare", *saved)
    assert done.exit_code == 0, done.output
    row = next(line for line in done.output.splitlines() if "only B: left hand: table" in line)
    assert re.search(
        r"person 1 of A, 0 of B +place usable +place doubtful +3.84 m +4.14 m +300 mm \(", row
    )
    assert "beach.jpg" in done.output
    data = json.loads(physic("compare", *saved, "--json").output)
    assert data["photos"][0]["people"][1]["joints"]["mean_m"] == pytest.approx(0.3, abs=1e-4)


def test_the_page_has_the_pictures_and_the_table_and_links_to_the_pages(
    saved, tmp_path, chromium, physic
):
    path = tmp_path / "page.html"
    done = physic("compare", *saved, "--html", str(path))
    assert done.output.endswith(f"wrote {path}\n")
    page = chromium.open(path.as_uri(), 390, 800)
    words = page.evaluate("document.body.innerText")
    assert all(
        text in words
        for text in ("beach.jpg", "A and B have the same", "300 mm", "left hand: table")
    )
    assert page.evaluate("[...document.images].map(one => one.naturalWidth > 300)") == [True, True]
    links = page.evaluate("[...document.querySelectorAll('article a')].map(one => one.href)")
    assert links == [(tmp_path / "b/report.html").as_uri()]
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()


def test_a_damaged_result_leaves_the_others(result, tmp_path, physic):
    for place in ("a/1", "a/2", "b/1", "b/2"):
        save_reconstruction(
            replace(result, photo=f"sha256:{place[-1]}"), tmp_path / place, "numbers"
        )
    (tmp_path / "b/1/reconstruction.npz").write_bytes(b"broken")
    done = physic("compare", str(tmp_path / "a"), str(tmp_path / "b"))
    assert done.exit_code == 3
    assert "reconstruction.npz" in done.output
    assert "people in both: 2" in done.output


def test_a_file_of_the_user_is_not_replaced_by_the_page(result, tmp_path, physic):
    save_reconstruction(result, tmp_path / "a", "numbers")
    page = tmp_path / "page.html"
    page.write_text("mine")
    done = physic("compare", str(tmp_path / "a"), str(tmp_path / "a"), "--html", str(page))
    assert done.exit_code != 0
    assert page.read_text() == "mine"
