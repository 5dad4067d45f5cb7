"""The contact sheet of a batch in a real browser: totals, filters, order and links."""

from __future__ import annotations

import json

import pytest

from physic_batch.contact_sheet import contact_sheet
from physic_core.judge import CHECKS

USABLE = (("pose", "place"), (), ("place",), ("pose", "place"), None)
"""Usable marks of the person of each photo; None for a photo that failed."""


def card(number, usable):
    done = {"state": "done", "error": "", "message": "", "people": 1, "checks": []}
    done["usable"] = {mark: int(mark in (usable or ())) for mark in ("pose", "place")}
    return {
        "name": f"id-{number}",
        "title": f"photo {number}.jpg",
        "link": f"photos/3f/{number}%20#/report.html",
        "thumbnail": "R0lGODlhAQABAAAAACwAAAAAAQABAAA=",
        **(
            done
            if usable is not None
            else done
            | {"state": "failed", "error": "InputError", "message": "damaged", "people": None}
        ),
    }


@pytest.fixture(scope="module")
def page(chromium, tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "contact-sheet.html"
    cards = [card(number, usable) for number, usable in enumerate(USABLE)]
    cards[1]["checks"] = ["limb_keypoints"]
    cards[2] |= {"people": 0, "usable": {"pose": 0, "place": 0}}
    path.write_text("".join(contact_sheet(cards, 3)), encoding="utf-8")
    page = chromium.open(path.as_uri(), 960, 480)
    page.wait("document.getElementById('count').textContent")
    yield page
    page.close()


def select(page, field, value):
    element = f"document.getElementById({json.dumps(field)})"
    page.evaluate(
        f"{element}.value = {json.dumps(value)}; {element}.dispatchEvent(new Event('input')); 1"
    )


def titles(page):
    shown = "[...document.querySelectorAll('article')].filter(a => !a.hidden)"
    found = page.evaluate(
        f"{shown}.map(a => a.querySelector('.line span').textContent.slice(6, 7))"
    )
    return found


def text(page, selector):
    found = page.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")
    return found


def test_a_photo_without_people_says_so(page):
    # The browser renders the cards that are in view alone.
    card = page.evaluate("document.querySelector('article:nth-child(3)').textContent")
    assert "no person was found" in card


def test_totals_and_notes_stand_above_the_photos(page):
    assert text(page, "#totals").split("\n") == [
        "3 people",
        "2 pose usable",
        "2 place usable",
        "1 failed",
    ]
    assert text(page, "#count") == "5 photos"
    assert "3 more photos are in the summary table only." in text(page, "header")
    failed = f"Failed: {CHECKS['limb_keypoints'].label}"
    assert failed in page.evaluate("document.querySelector('main').textContent")


def test_the_order_is_that_of_usable_marks_or_name(page):
    for order, expected in (
        ("worst", "42103"),
        ("best", "03124"),
        ("name", "01234"),
        ("", "01234"),
    ):
        select(page, "order", order)
        assert titles(page) == list(expected)


def test_filters_show_matching_photos_or_a_note(page):
    select(page, "usable", "place")
    assert (titles(page), text(page, "#count")) == (["0", "3"], "2 of 5 photos")
    select(page, "check", "+")
    assert (titles(page), text(page, "#none"), text(page, "#count")) == (
        [],
        "No photo matches.",
        "0 of 5 photos",
    )
    select(page, "check", "")
    select(page, "usable", "")
    assert page.evaluate("document.getElementById('none').hidden")


def test_thumbnail_and_title_link_to_the_page_of_the_result(page):
    links = page.evaluate(
        "[...document.querySelectorAll('article a')].slice(0, 2).map(a => a.getAttribute('href'))"
    )
    assert links == ["photos/3f/0%2520%23/report.html"] * 2
    assert page.evaluate("document.querySelector('article a img') !== null")
