"""physic view: what is found, drawn, measured, followed and said; once in a real browser."""

from __future__ import annotations

import shutil
import time
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest
import viser
from click.testing import CliRunner
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from physic_core import save_reconstruction
from physic_core.cli import main
from physic_core.errors import BackendError, InputError
from physic_core.types.metres_text import metres_text
from physic_core.visual.palette import CONTACT_PALETTE
from physic_viewer import command, own_page
from physic_viewer.drawing import SKINS
from physic_viewer.shapes import build_shapes, nearest_on_ray
from physic_viewer.sources import ResultSource
from physic_viewer.text import escape
from physic_viewer.viewer import Viewer


@pytest.fixture(scope="module")
def result(rooms):
    return rooms.make_reconstruction()


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "a_b-physic"
    save_reconstruction(result, folder, "exact")
    return folder


@pytest.fixture
def viewer_of():
    running = []

    def start(*folders: Path, names: tuple[str, ...] = ()) -> Viewer:
        running.append(Viewer([ResultSource(folder) for folder in folders], port=8500, names=names))
        return running[-1]

    yield start
    for viewer in running:
        viewer.stop()


def test_the_cameras_of_several_photos_are_drawn(viewer_of, tmp_path, rooms):
    several = rooms.make_several_photos()
    save_reconstruction(several, tmp_path, "exact")
    viewer = viewer_of(tmp_path)
    scene, upright = viewer.server.scene, viewer.slots[0].drawn.shapes.upright
    for name, camera in zip(("frustum", "frustum_1", "frustum_2"), several.cameras, strict=True):
        place = (upright @ [*camera.centre, 1])[:3]
        np.testing.assert_allclose(scene.get_handle_by_name(f"/0/camera/{name}").position, place, atol=1e-6)


def ray_to(viewer: Viewer, slot: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A ray from the photo's camera to a point in the camera frame of the result in a slot."""
    drawn = viewer.slots[slot].drawn
    upright = drawn.shapes.upright
    origin = upright[:3, 3] + np.array(drawn.offset)
    return origin, upright[:3, :3] @ point


def test_a_source_finds_one_result_or_all_below(saved, tmp_path):
    (one,) = ResultSource(saved).find()
    assert (one.name, one.folder) == ("a_b-physic", saved)
    shutil.copytree(saved, tmp_path / "photos" / "2")
    shutil.copytree(saved, tmp_path / "photos" / "10")
    (tmp_path / "empty").mkdir()
    assert [found.name for found in ResultSource(tmp_path).find()] == ["photos/10", "photos/2"]
    before = ResultSource(tmp_path / "photos" / "2").find()
    (tmp_path / "photos" / "2" / "reconstruction.npz").write_bytes(b"new")
    assert ResultSource(tmp_path / "photos" / "2").find() != before


def test_a_folder_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"^no folder .*nowhere: name the folder of a finished run, or a folder of "):
        ResultSource(tmp_path / "nowhere")


def test_shapes_are_upright_and_their_contact_lies_on_the_skin(result):
    shapes = build_shapes(result)
    assert [body.index for body in shapes.bodies] == [0, 1]
    for body in shapes.bodies:
        assert body.vertices[:, 1].min() == pytest.approx(0.0, abs=0.02)
        assert body.vertices[:, 1].max() == pytest.approx(1.7, abs=0.05)
        assert body.contact_vertices[:, 1].max() < 0.03
        assert body.contact_faces.max() == len(body.contact_vertices) - 1
    assert (shapes.low <= shapes.bodies[0].vertices.min(0)).all()


def test_a_ray_finds_the_first_point_near_it():
    points = np.array([[0.0, 0.0, 5.0], [0.0, 0.01, 3.0], [1.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert nearest_on_ray(points, np.zeros(3), np.array([0.0, 0.0, 2.0])) == 1
    assert nearest_on_ray(points[2:], np.zeros(3), np.array([0.0, 0.0, 1.0])) is None
    assert nearest_on_ray(np.zeros((0, 3)), np.zeros(3), np.array([0.0, 0.0, 1.0])) is None


def test_two_results_stand_side_by_side_or_in_one_place(saved, viewer_of):
    viewer = viewer_of(saved, saved)
    assert viewer.server.get_host() == "127.0.0.1"
    first, second = (slot.drawn for slot in viewer.slots)
    offset = np.array(second.offset) - np.array(first.offset)
    width = first.shapes.high[0] - first.shapes.low[0]
    np.testing.assert_allclose(offset, [width + 0.6, 0, 0], atol=1e-9)
    viewer.arrange.value = "in one place"
    viewer._place()
    np.testing.assert_allclose(second.offset, first.offset)
    assert "bad" in viewer.slots[0].message
    assert "no checks were run" in viewer.slots[0].message


def test_the_first_view_shows_all_people_and_the_camera(saved, result, viewer_of):
    viewer = viewer_of(saved)
    camera, shapes = viewer.server.initial_camera, viewer.slots[0].drawn.shapes
    position, target = np.array(camera.position), np.array(camera.look_at)
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    points = np.concatenate([*(body.vertices for body in shapes.bodies), shapes.upright[None, :3, 3]])
    points += viewer.slots[0].drawn.offset
    depth = (points - position) @ ahead
    assert depth.min() > 0
    assert np.abs((points - position) @ np.cross(right, ahead) / depth).max() < np.tan(camera.fov / 2)
    assert np.abs((points - position) @ right / depth).max() < 1.2 * np.tan(camera.fov / 2)


def test_contact_has_the_colour_of_what_is_touched(result):
    for body in build_shapes(result).bodies:
        np.testing.assert_array_equal(np.unique(body.contact_colors, axis=0), [CONTACT_PALETTE["floor"]])
        assert len(body.contact_colors) == len(body.contact_vertices)


def test_people_wear_the_photo_s_colours_neutral_ones_or_contact(saved, viewer_of):
    viewer = viewer_of(saved)
    scene, drawn = viewer.server.scene, viewer.slots[0].drawn

    def worn() -> set[str]:
        return {skin for skin in SKINS if scene.get_handle_by_name(f"/0/people/{skin}").visible}

    assert worn() == {"photo"}
    assert "what the photo does not show" in viewer.legend.content
    assert scene.get_handle_by_name("/0/people/photo/person_1") is not None
    for skin, shown, legend in (("neutral", {"neutral"}, ""), ("contact", {"neutral", "contact"}, "Contact with")):
        viewer.skin.value = skin
        viewer._show()
        assert worn() == shown
        assert (legend in viewer.legend.content) if legend else viewer.legend.content == ""
    assert drawn.is_shown("people")


def test_a_click_selects_a_person_and_two_clicks_measure(saved, result, viewer_of):
    viewer = viewer_of(saved)
    joints = result.people[1].joints
    viewer.click(*ray_to(viewer, 0, joints[9]))
    assert viewer.text.content.startswith("**Person 1**: doubtful")
    assert metres_text(float(np.linalg.norm(joints[0])), result.distance_sigma) in viewer.text.content
    spots = [result.scene.points[100, 30].astype(float), result.scene.points[60, 125].astype(float)]
    viewer.measuring.value = True
    viewer._start_measuring()
    for spot in spots:
        viewer.click(*ray_to(viewer, 0, spot))
    apart = np.linalg.norm(spots[0] - spots[1])
    assert float(viewer.text.content[2:].split(" m")[0]) == pytest.approx(apart, abs=0.03)
    viewer.click((0.0, 50.0, 0.0), (0.0, 1.0, 0.0))  # the sky: nothing happens
    assert "apart" in viewer.text.content


def test_results_are_followed_while_they_are_written(saved, tmp_path, viewer_of):
    viewer = viewer_of(tmp_path)
    (slot,) = viewer.slots
    assert slot.drawn is None
    assert slot.message == "waiting for a result"
    shutil.copytree(saved, tmp_path / "one")
    viewer.refresh()
    assert slot.names == ["one"]
    assert slot.drawn is not None
    # A result that is half written says so, and is drawn when it is complete.
    (tmp_path / "two").mkdir()
    shutil.copy(saved / "reconstruction.json", tmp_path / "two")
    viewer.refresh()
    assert slot.drawn is None
    assert slot.message.startswith("**cannot be shown**: cannot read ")
    time.sleep(0.02)
    shutil.copyfile(saved / "reconstruction.npz", tmp_path / "two" / "reconstruction.npz")
    viewer.refresh()
    assert slot.drawn is not None
    slot.choose("one")
    shutil.copytree(saved, tmp_path / "three", copy_function=shutil.copyfile)
    viewer.refresh()
    assert slot.names == ["one", "three", "two"]
    assert slot._choice.value == "one"


def answer(viewer: Viewer, host: str, origin: str | None = None) -> tuple[int, str]:
    """Status and text of a GET with these headers."""
    headers = {"Host": host} | ({} if origin is None else {"Origin": origin})
    with closing(HTTPConnection("127.0.0.1", viewer.server.get_port(), timeout=60)) as connection:
        connection.request("GET", "/", headers=headers)
        response = connection.getresponse()
        return response.status, response.read().decode()


def test_the_websocket_of_another_site_gets_no_result(saved, viewer_of):
    viewer = viewer_of(saved)
    address = viewer.address.replace("http", "ws")
    client = Subprotocol(f"viser-v{viser.__version__}")
    with connect(address, origin=viewer.address, subprotocols=[client], max_size=None) as own:
        assert len(own.recv()) > 100
    with pytest.raises(InvalidStatus) as refused, connect(address, origin="http://evil.example"):
        pass
    assert refused.value.response.status_code == 403
    assert refused.value.response.body == b"this request came from a page of another site\n"


def test_only_the_names_and_addresses_of_this_machine_are_answered(saved, viewer_of):
    viewer = viewer_of(saved, names=("Studio",))
    assert [answer(viewer, host)[0] for host in ("127.0.0.1", "[::1]:80", "localhost:1", "studio")] == [200] * 4
    words = "this server is not called 'evil.example': the option --allow-host adds a name\n"
    assert answer(viewer, "evil.example:80") == (421, words)
    assert answer(viewer, "127.0.0.1", "http://evil.example")[0] == 403


def test_a_viser_that_does_not_refuse_other_sites_shows_nothing(saved, monkeypatch):
    monkeypatch.setattr(own_page, "refuse_foreign", lambda *_: None)
    with pytest.raises(BackendError, match=r"did not refuse a page of another site \(101 Switching Protocols\)"):
        Viewer([ResultSource(saved)], port=8500)


def test_text_of_others_is_not_markup():
    assert escape("a_b <img> [x](y) *z*") == r"a\_b \<img\> \[x\]\(y\) \*z\*"


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_command_prints_the_address_and_ends_at_ctrl_c(saved, monkeypatch, host):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(command.sys, "platform", "linux")
    monkeypatch.setattr(command.webbrowser, "open", lambda _: pytest.fail("there is no display"))

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "sleep", interrupt)
    done = CliRunner().invoke(main, ["view", str(saved), "--host", host, "--port", "8600"])
    assert done.exit_code == 0, done.output
    first, *more = done.output.splitlines()
    assert first.startswith("showing a_b-physic at http://127.0.0.1:86")
    assert first.endswith("  (Ctrl-C ends it)")
    assert more[:1] == (
        [""]
        if host == "127.0.0.1"
        else ["warning: whoever reaches 0.0.0.0 can see these photos; --host 127.0.0.1 is this machine only"]
    )


def pixels_of(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - color).max(-1) <= 3).sum())


def test_it_is_drawn_in_a_browser_without_any_request(chromium, saved, viewer_of):
    viewer = viewer_of(saved)
    page = chromium.open(viewer.address, 900, 500)
    page.wait("document.querySelectorAll('canvas').length > 0")
    # The scene has its own colours, whatever the light: the squares of the floor, and the top of the box.
    colors = ((205, 180, 150), (150, 120, 90), (215, 120, 95))
    deadline = time.monotonic() + 60
    while (least := min(pixels_of(page.picture("canvas"), color) for color in colors)) <= 200:
        assert time.monotonic() < deadline, f"{least} pixels of a colour"
        time.sleep(0.5)
    assert [url for url in page.requests() if not url.startswith((viewer.address, "ws://127.0.0.1"))] == []
    page.close()
