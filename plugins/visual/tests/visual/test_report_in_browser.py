"""The page of a result in a real browser, opened from its file."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from physic_core.types import CheckResult, UnposedPerson
from physic_core.types.results import metres_text
from physic_visual.palette import CONTACT_PALETTE, FAINT
from physic_visual.report.page import report_html
from physic_visual.textures.dressed import GUESSED

READY = "document.documentElement.dataset.ready"
ODD = (
    "a\"b'c</script><script>window.broken = 1</script><img src=x onerror='window.broken = 1'> "
    "\u2028 \U0001f3c0.jpg"
)
SWITCHES = ["mesh", "points", "people", "floor"]


@pytest.fixture(scope="module")
def result(make):
    checks = (
        CheckResult(
            "floor", "ok", 0.5, 0.15, "at least", "share", "of the searched pixels lie on the floor"
        ),
        CheckResult("floor_mask", "failed", 0.0, 1.0, "at least", "1: yes", ODD),
        CheckResult("lean", "unknown", None, 12.0, "at most", "degrees", "nobody stands", person=1),
    )
    unposed = (UnposedPerson((5.0, 5.0, 30.0, 60.0), 0.4, "no pose fits the box"),)
    reconstruction = make(320, 240)
    low = reconstruction.scene.floor.normal, reconstruction.scene.floor.offset
    touching = [p.vertices @ low[0] + low[1] < 0.6 for p in reconstruction.people]
    people = tuple(
        replace(
            p,
            contact=contact,
            contact_partner=None,
            contact_probability=None,
            trust_pose=0.914,
            trust_place=0.046,
            why="Leans: 16° (see the side)",
        )
        for p, contact in zip(reconstruction.people, touching, strict=True)
    )
    return replace(reconstruction, people=people, checks=checks, warnings=(ODD,), unposed=unposed)


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(report_html(result, ODD), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def page(chromium, path):
    page = chromium.open(path.as_uri(), 960, 480)
    page.wait(READY)
    yield page
    page.close()


@pytest.fixture(scope="module")
def overview(page):
    """The 3D view as the page opens it."""
    return page.picture("#view")


@pytest.fixture
def opened(chromium):
    """Open a page, until the test ends."""
    pages = []

    def open_page(address, width=960, height=600, **options):
        pages.append(chromium.open(address, width, height, **options))
        pages[-1].wait(READY)
        return pages[-1]

    yield open_page
    for page in pages:
        page.close()


@pytest.fixture
def show(opened, tmp_path):
    """Open the page of a result, until the test ends."""

    def open_page(result, *size, **options):
        path = tmp_path / "report.html"
        path.write_text(report_html(result), encoding="utf-8")
        return opened(path.as_uri(), *size, **options)

    return open_page


def text(page, selector):
    return page.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")


def click(page, selector):
    page.evaluate(f"document.querySelector({json.dumps(selector)}).click()")


def difference(one, other):
    """Share of the pixels that differ."""
    return float((np.abs(one.astype(int) - other.astype(int)).max(-1) > 8).mean())


def test_the_page_opens_from_a_file_without_any_request(page, path):
    assert page.evaluate(READY) == "3d"
    assert page.requests() == [path.as_uri()]
    assert page.errors() == []
    assert page.evaluate("window.broken") is None
    assert text(page, "h1") == ODD.replace("\u2028", " ") or text(page, "h1") == ODD
    assert text(page, "#message") == ""


@pytest.mark.parametrize("name", SWITCHES)
def test_each_switch_shows_and_hides_its_part(page, overview, name):
    click(page, f"[data-show={name}]")
    changed = page.picture("#view")
    click(page, f"[data-show={name}]")
    assert difference(overview, changed) > 0.0003
    assert difference(overview, page.picture("#view")) == 0


def place_on_canvas(page, result, column, row):
    """Return where a pixel of the photo is in the photo's view, px of the page."""
    x, y, width, height = page.box("#canvas")
    camera = result.intrinsics
    tall = max(camera.height / camera.fy, camera.width / camera.fx / (width / height))
    pixels = height / tall
    return x + width / 2 + (column - camera.cx) / camera.fx * pixels, y + height / 2 + (
        row - camera.cy
    ) / camera.fy * pixels


def test_a_click_on_a_person_shows_their_numbers(page, result):
    click(page, "[data-view=camera]")
    page.picture("#view")
    spot = result.people[1].joints[9] @ result.intrinsics.matrix.T
    page.click(*place_on_canvas(page, result, *(spot[:2] / spot[2])))
    card = text(page, "#people")
    click(page, "[data-view=people]")
    assert (
        page.evaluate("document.querySelector('.chips [aria-pressed=true]').innerText")
        == "Person 1"
    )
    assert "pose usable; place doubtful" in card
    assert "Leans: 16° (see the side)" in card
    assert (
        metres_text(float(np.linalg.norm(result.people[1].joints[0])), result.distance_sigmas[1])
        in card
    )
    apart = np.linalg.norm(result.people[0].joints[0] - result.people[1].joints[0])
    assert metres_text(float(apart), result.distance_sigma) in card
    assert "1 not measured" in card
    assert "No body: no pose fits the box" in card


@pytest.mark.parametrize("view", ["camera", "angle", "side", "top"])
def test_each_view_button_shows_another_picture(page, overview, view):
    click(page, f"[data-view={view}]")
    assert difference(overview, page.picture("#view")) > 0.1
    click(page, "[data-view=people]")


LABELLED = """(view => [...document.querySelectorAll(".label.number")].some(label => {
    const r = label.getBoundingClientRect(), x = r.x + r.width / 2, y = r.y + r.height / 2;
    return !label.hidden && x > view.left && x < view.right && y > view.top && y < view.bottom;
}))(document.querySelector("#view").getBoundingClientRect())"""
"""True if the number of a person, which is at the head, is in the view."""


def shows_people(page):
    """Whether a number of a person is in the view, or else a part of a body."""
    page.evaluate(
        "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => r(1))))"
    )
    if page.evaluate(LABELLED):
        return True
    picture = page.picture("#view")
    click(page, "[data-show=people]")
    without = page.picture("#view")
    click(page, "[data-show=people]")
    return difference(picture, without) > 0.0005


def without_floor(result):
    return replace(result, scene=replace(result.scene, floor=None))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "people", "floor"),
    [
        ((160, 120), 2, True),
        ((160, 120), 2, False),
    ],
    ids=["floor", "no floor"],
)
def test_people_stay_in_view_whatever_is_dragged_zoomed_and_pressed(
    make, show, size, people, floor
):
    reconstruction = make(*size, people)
    page = show(reconstruction if floor else without_floor(reconstruction), 420, 420)
    x, y, width, height = page.box("#view canvas")
    rng = np.random.default_rng(0)
    lost = []
    for step in range(200):
        kind = rng.choice(["turn", "move", "zoom", "key", "button"], p=[0.4, 0.2, 0.15, 0.1, 0.15])
        start, end = rng.uniform([0.1, 0.1], [0.9, 0.9], (2, 2)) * [width, height] + [x, y]
        if kind in ("turn", "move"):
            page.drag(tuple(start), tuple(end), "left" if kind == "turn" else "right")
        elif kind == "zoom":
            page.turn_wheel(*start, float(rng.choice([-400, 400])))
        elif kind == "key":
            page.evaluate("document.querySelector('#canvas').focus()")
            page.press(
                str(rng.choice(["+", "-", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"]))
            )
        else:
            click(page, f"[data-view={rng.choice(['people', 'angle', 'side', 'top', 'camera'])}]")
        if not shows_people(page):
            lost.append((step, str(kind)))
    assert lost == []


def test_controls_on_a_phone_are_large_enough_for_a_finger(opened, path):
    page = opened(path.as_uri(), 390, 844)
    sizes = page.evaluate(
        "[...document.querySelectorAll('button, input, select, summary')]"
        ".filter(e => e.offsetParent !== null).map(e => (e.labels?.[0] ?? e)"
        ".getBoundingClientRect()).map(r => Math.min(r.width, r.height))"
    )
    wide = page.evaluate("document.documentElement.scrollWidth")
    assert len(sizes) > 15
    assert min(sizes) >= 24
    assert wide == 390


def test_two_clicks_measure_the_distance_of_their_points(page, result):
    spots = [(30, 200), (250, 120)]  # on the floor beside the hint, on the back wall
    first, second = (result.scene.points[row, column].astype(float) for column, row in spots)
    click(page, "[data-view=camera]")
    page.picture("#view")
    click(page, "#measure")
    for column, row in spots:
        page.click(*place_on_canvas(page, result, column, row))
    apart, upwards = (
        float(number) for number in re.findall(r"([\d.]+) ± [\d.]+ m", text(page, "#hint"))
    )
    assert apart == pytest.approx(np.linalg.norm(first - second), abs=0.04)
    assert upwards == pytest.approx(abs((first - second) @ result.scene.floor.normal), abs=0.03)
    click(page, "#measure")
    click(page, "[data-view=people]")


def test_the_photo_is_that_of_the_result_with_bodies_over_it_and_a_click_selects_a_person(
    page, result
):
    over = page.picture("#photo")
    click(page, "#overlay")
    plain = page.picture("#photo")
    click(page, "#overlay")
    wanted = np.asarray(Image.fromarray(result.image).resize(plain.shape[1::-1]))
    assert np.abs(plain[8:-8, 8:-8].astype(int) - wanted[8:-8, 8:-8].astype(int)).mean() < 6
    assert difference(over, plain) > 0.05
    x, y, width, height = page.box("#photo")
    wrist = result.people[0].joints[9] @ result.intrinsics.matrix.T / result.people[0].joints[9][2]
    rows, columns = result.image.shape[:2]
    page.click(x + (wrist[0] + 0.5) / columns * width, y + (wrist[1] + 0.5) / rows * height)
    assert (
        page.evaluate("document.querySelector('.chips [aria-pressed=true]').innerText")
        == "Person 0"
    )
    page.click(x + 3, y + 3)
    assert page.evaluate("document.querySelector('.chips [aria-pressed=true]')") is None


def test_usable_marks_warnings_checks_and_licences_are_on_the_page(page):
    assert "usable for" in text(page, "#usable")
    assert ODD.split("\u2028")[0].strip() in text(page, "#remarks")
    checks = text(page, "#checks")
    assert "Floor mask: no, must be yes" in checks
    assert page.evaluate("document.querySelector('#checks .check').title") == "floor_mask"
    assert "1 ok" in checks
    licenses = page.evaluate("document.querySelector('#licenses li').textContent")
    assert licenses == "people: Apache-2.0"


def test_the_keyboard_reaches_every_control_and_turns_the_view(page, overview):
    names = page.evaluate(
        "[...document.querySelectorAll('button, input, canvas[tabindex], summary')]"
        ".filter(e => !e.disabled && e.tabIndex < 0).length"
    )
    assert names == 0
    unnamed = (
        "[...document.querySelectorAll('button, input')].filter(e => !(e.labels?.length || "
        "e.innerText)).length"
    )
    assert page.evaluate(unnamed) == 0
    page.evaluate("document.querySelector('[data-show=people]').focus()")
    page.press(" ")
    assert page.evaluate("document.querySelector('[data-show=people]').checked") is False
    page.press(" ")
    page.evaluate("document.querySelector('#canvas').focus()")
    page.press("ArrowLeft")
    assert difference(overview, page.picture("#view")) > 0.05
    click(page, "[data-view=people]")


def test_without_webgl_the_numbers_and_the_photo_are_there(opened, path):
    none = "HTMLCanvasElement.prototype.getContext = (get => function (kind, ...more) {"
    none += " return kind.startsWith('webgl') ? null : get.call(this, kind, ...more); })"
    none += "(HTMLCanvasElement.prototype.getContext)"
    page = opened(path.as_uri(), before=none)
    assert page.evaluate(READY) == "numbers"
    assert text(page, "#message").startswith("This browser shows no 3D")
    assert page.picture("#photo").std() > 15
    click(page, ".chips button")
    assert "To the camera" in text(page, "#people")


@pytest.mark.parametrize("damage", ["cut off", "in the data"])
def test_a_damaged_file_says_so(chromium, path, tmp_path, damage):
    content = path.read_text(encoding="utf-8")
    broken = tmp_path / "broken.html"
    start = content.index('"photo":"data:image/jpeg;base64,') + 40
    kept = (
        content[: len(content) // 2]
        if damage == "cut off"
        else content[:start] + "AAAA" + content[start + 4000 :]
    )
    broken.write_text(kept, encoding="utf-8")
    page = chromium.open(broken.as_uri(), 900, 600)
    if damage == "cut off":
        assert "the file is incomplete" in " ".join(text(page, "#message").split())
    else:
        page.wait(READY)
        assert text(page, "#message").startswith("The data of this page is damaged or incomplete.")
    page.close()


def test_the_legend_names_the_colours_that_the_bodies_show(page, make, show):
    reconstruction = make()
    unsure = [
        replace(p, contact_probability=np.full(len(p.vertices), 0.4, np.float16))
        for p in reconstruction.people
    ]
    other = show(replace(reconstruction, people=tuple(unsure)))
    for one, labels in (
        (page, ["Contact with", "anything"]),
        (other, ["Contact with", "floor", FAINT]),
    ):
        assert text(one, "#legend") == GUESSED
        click(one, "[value=neutral]")
        assert one.evaluate("document.querySelector('#legend').hidden") is True
        click(one, "[value=contact]")
        assert text(one, "#legend").split("\n") == labels
    red, green, blue = CONTACT_PALETTE["floor"]
    dot = "getComputedStyle(document.querySelector('#legend .dot')).backgroundColor"
    assert other.evaluate(dot) == f"rgb({red}, {green}, {blue})"
    click(other, "[data-show=people]")
    assert other.evaluate("document.querySelector('#legend').hidden") is True
    click(page, "[value=photo]")


def test_the_page_opens_on_the_main_people_in_the_photo_s_colours(make, show):
    """As the photo's camera sees them, larger than in the photo."""
    reconstruction = make(320, 240)
    image = reconstruction.image.copy()
    pink = np.array([230, 20, 200])
    for person in reconstruction.people:
        image[person.mask] = pink
    page = show(replace(reconstruction, image=image))
    picture = page.picture("#canvas").astype(int)
    shown = np.abs(picture - pink).max(-1) < 30
    rows, columns = np.nonzero(shown)
    height, width = shown.shape
    assert np.ptp(rows) > 0.55 * height
    assert abs((rows.min() + rows.max()) / 2 - height / 2) < 0.15 * height
    assert abs((columns.min() + columns.max()) / 2 - width / 2) < 0.15 * width
    click(page, "[value=neutral]")
    assert (
        np.abs(page.picture("#canvas").astype(int) - pink).max(-1) < 30
    ).sum() < 0.02 * shown.sum()


def test_in_the_photo_s_view_the_photo_is_behind_the_bodies_until_the_view_turns(page, result):
    click(page, "[data-show=people]")
    click(page, "[data-view=camera]")
    picture = page.picture("#canvas")
    height, width = result.image.shape[:2]
    (left, top), (right, bottom) = (
        np.subtract(place_on_canvas(page, result, *corner), page.box("#canvas")[:2])
        .round()
        .astype(int)
        for corner in ((-0.5, -0.5), (width - 0.5, height - 0.5))
    )
    inside = picture[max(top, 0) : bottom, max(left, 0) : right]
    wanted = np.asarray(Image.fromarray(result.image).resize(inside.shape[1::-1]))
    assert np.abs(inside.astype(int) - wanted).mean() < 4
    page.evaluate("document.querySelector('#canvas').focus()")
    page.press("ArrowLeft")
    assert difference(picture, page.picture("#canvas")) > 0.05
    click(page, "[data-show=people]")
    click(page, "[data-view=people]")
    page.picture("#view")
