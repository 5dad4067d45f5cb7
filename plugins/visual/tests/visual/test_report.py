"""The page of a result: one file, without an address, whose data are the result's."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial import cKDTree

from physic_core.body import PART_NAMES, embedded_arrays
from physic_core.geometry import vertex_areas
from physic_core.pictures import PAGE_MARK
from physic_core.types import (
    BodyContact,
    CheckResult,
    ContactPartner,
    UnposedPerson,
    part_words,
)
from physic_visual.report.page import failure_html, report_html
from physic_visual.report.surfaces import pack_scene
from physic_visual.scene_mesh import mesh_scene, scene_reach

PAGE = files("physic_visual.report") / "page"
ODD = "a\"b'c</script><script>alert(1)</script><!-- ]]> @DATA@ \u2028 \U0001f3c0 \udce9.jpg"


def data_of(page):
    return json.loads(
        re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.S)[1]
    )


def scripts_of(page):
    return re.findall(r"<script(?: type=\"module\")?>(.*?)</script>", page, re.S)


def unpacked(text, dtype="u1"):
    return np.frombuffer(base64.b64decode(text), dtype)


def points_of(packed):
    levels = unpacked(packed["data"], "<u2").reshape(-1, 3)
    assert len(levels) == packed["count"]
    return np.array(packed["origin"]) + np.array(packed["step"]) * levels


def flags_of(text, count):
    return np.unpackbits(unpacked(text), count=count, bitorder="little").astype(bool)


def shown(result, people=None):
    """The data of the page of a result, or of one with other people."""
    return data_of(report_html(result if people is None else replace(result, people=people)))


@pytest.mark.parametrize(
    "size", [(160, 120), (440, 330)], ids=["every pixel", "every second pixel"]
)
def test_the_scene_has_the_points_of_its_pixels_and_the_triangles_of_its_mesh(make, size):
    result = make(*size)
    packed = pack_scene(result)
    stride = packed["stride"]
    rows = packed["rows"]
    columns = packed["columns"]
    assert stride == (1 if size == (160, 120) else 2)
    valid = flags_of(packed["valid"], rows * columns).reshape(rows, columns)
    wanted = result.scene.points[::stride, ::stride][valid]
    assert np.abs(points_of(packed["points"]) - wanted).max() < 1e-3
    kept = flags_of(packed["triangles"], 2 * rows * columns)
    mesh = mesh_scene(result.scene, scene_reach(result), 130_000)
    assert kept.sum() == len(mesh.faces) > 10_000
    # The corners of each triangle, found as the page finds them, are those of the mesh.
    cells = np.flatnonzero(kept) // 2
    offsets = np.where(
        (np.flatnonzero(kept) % 2)[:, None], [1, columns, columns + 1], [0, columns, 1]
    )
    of_mesh = (mesh.pixels[:, 1] // stride * columns + mesh.pixels[:, 0] // stride)[mesh.faces]
    corners = np.unique(cells[:, None] + offsets, axis=0)
    np.testing.assert_array_equal(corners, np.unique(of_mesh, axis=0))


def test_the_page_tells_assumed_contacts_from_others(result):
    foot = BodyContact("left_foot", ContactPartner("floor", "floor"), 0.8, 9, assumed=True)
    hand = replace(foot, part="left_hand", assumed=False)
    person = replace(result.people[0], contacts=(foot, hand))
    contacts = shown(result, (person,))["people"][0]["contacts"]
    assumed = {one["part"]: one["assumed"] for one in contacts}
    assert assumed == {"left foot": True, "left hand": False}


def test_stature_and_distances_are_those_of_the_bodies(result):
    person, other = shown(result)["people"]
    first, second = (one.vertices.astype(np.float64) for one in result.people)
    floor = result.scene.floor
    pelvis, beside = (one.joints[0].astype(np.float64) for one in result.people)
    assert person["stature"] == result.people[0].stature
    assert person["camera"] == pytest.approx(np.linalg.norm(pelvis), abs=1e-6)
    assert person["lowest"] == pytest.approx((first @ floor.normal + floor.offset).min(), abs=1e-6)
    (record,) = person["others"]
    apart = np.linalg.norm(pelvis - beside)
    assert (record["person"], record["pelvis"]) == (1, pytest.approx(apart, abs=1e-6))
    gap = cKDTree(first).query(second)[0].min()
    assert record["gap"] == other["others"][0]["gap"] == pytest.approx(gap, abs=1e-6)


@pytest.mark.parametrize("people", [0, 1, 2])
def test_a_page_has_no_address_and_is_small(make, people):
    page = report_html(make(people=people), "photo.jpg")
    assert "<title>photo.jpg – PhySIC</title>" in page
    assert PAGE_MARK in page
    assert not re.search(r"https?:|src=|href=|@import|url\(", page.split("<script>")[0])
    assert not re.search("https?:", page)
    assert len(page) < 1.5e6
    assert len(data_of(page)["people"]) == people


def test_a_person_without_a_body_is_on_the_page(reconstruction):
    first, person = reconstruction.people
    lost = replace(person, vertices=person.vertices * np.nan, joints=person.joints * np.nan)
    unposed = (UnposedPerson((1.0, 2.0, 3.0, 4.0), 0.5, "no pose fits the box"),)
    data = shown(replace(reconstruction, unposed=unposed), (first, lost))
    assert data["bodies"]["people"][1] is None
    assert (data["people"][1]["posed"], data["people"][1]["others"]) == (False, [])
    assert data["people"][0]["others"] == []
    assert data["unposed"][0]["reason"] == "no pose fits the box"


def test_a_scene_without_floor_and_without_a_valid_pixel_gives_a_page(reconstruction):
    scene = reconstruction.scene
    empty = replace(scene, floor=None, valid=np.zeros_like(scene.valid))
    data = shown(replace(reconstruction, scene=empty, checks=(), stages=()), ())
    assert data["floor"] is False
    assert data["scene"]["points"]["count"] == 0


def test_text_of_others_is_never_markup(reconstruction):
    check = CheckResult("floor", "unknown", None, 0.15, "at least", "share", ODD)
    result = replace(reconstruction, warnings=(ODD,), notes=(ODD,), checks=(check,))
    page = report_html(result, ODD)
    page.encode("utf-8")
    data = data_of(page)
    assert data["warnings"] == data["notes"] == [ODD]
    assert "alert(1)</script>" not in page
    assert page.count("<script") == page.count("</script") == 3
    title = html.escape(ODD).replace("\udce9", "\\udce9")
    assert f"<h1>{title}</h1>" in page


def test_only_the_scripts_of_the_page_may_run(reconstruction):
    page = report_html(reconstruction)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    digests = [
        base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts_of(page)
    ]
    assert len(digests) == 2
    assert all(f"'sha256-{digest}'" in policy for digest in digests)
    assert "unsafe-inline" not in policy.partition("style-src")[0]


def test_a_page_of_failure_says_what_is_wrong():
    page = failure_html(ODD, f"cannot read {ODD}: it is damaged")
    page.encode("utf-8")
    assert html.escape("cannot read a\"b'c</script>") in page
    assert "<script" not in page
    assert "script-src 'none'" in page
    assert "https:" not in page


def test_the_bundle_of_three_js_is_the_one_that_was_built_and_has_its_licence():
    content = (PAGE / "vendor" / "three.js").read_bytes()
    stated = (PAGE / "vendor" / "three.sha256").read_text().split()
    assert stated == [hashlib.sha256(content).hexdigest(), "three.js"]
    head = content[:1400].decode()
    assert "The MIT License" in head
    assert "three.js authors" in head
    assert b"http:" not in content
    assert b"https:" not in content


def test_contact_is_counted_by_body_part(result):
    person = result.people[0]
    contact = shown(result)["people"][0]["contact"]
    parts = embedded_arrays().part_of_vertex
    touching = np.unique(parts[person.contact])
    area = 1e4 * vertex_areas(person.vertices, result.faces)
    whole = {part_words(PART_NAMES[part]): area[parts == part].sum() for part in touching}
    touched = sum(row["cm2"] for row in contact)
    assert touched == pytest.approx(area[person.contact].sum(), abs=0.5 * len(touching))
    for row in contact:
        assert row["share"] == pytest.approx(row["cm2"] / whole[row["part"]])
        assert sum(one["share"] for one in row["colors"]) == pytest.approx(row["share"])
