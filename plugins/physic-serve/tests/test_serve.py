"""``physic serve`` as a user starts it: a process of its own, real sockets on the loopback, and a browser."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import httpx2
import pytest
from click.testing import CliRunner
from PIL import Image

from physic_core import Reconstruction
from physic_core.cli import main
from physic_serve.command import is_loopback
from physic_testing import build_world

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photo") / "walk.png"
    Image.fromarray(build_world("walk").image).save(path)
    return path


@contextmanager
def started(folder: Path, end: signal.Signals = signal.SIGTERM) -> Iterator[str]:
    """Yield the address of a server with mock estimators, which the signal ends; its folder is then as before."""
    before = sorted(folder.rglob("*"))
    command = [sys.executable, "-P", "-m", "physic_core", "serve", "--preset", "mock", "--port", "0"]
    options = ["--max-mb", "5", "--queue", "30", "--allow-host", "photos.example", "--folder", str(folder)]
    with subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
    ) as process:
        line = process.stdout.readline()
        found = re.fullmatch(r"(http://127\.0\.0\.1:\d+)/  \(Ctrl-C ends it\)\n", line)
        assert found, line + process.communicate()[1]
        yield found[1]
        process.send_signal(end)
        _, log = process.communicate(timeout=60)
    assert "Traceback" not in log
    assert sorted(folder.rglob("*")) == before


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with started(tmp_path_factory.mktemp("served")) as found:
        yield found


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_a_closed_terminal_leaves_no_photo_and_the_files_of_the_user(photo: Path, tmp_path: Path):
    (tmp_path / "physic-serve-docker" / "jobs").mkdir(parents=True)
    (tmp_path / "physic-serve-docker" / "docker-compose.yml").write_text("mine")
    with started(tmp_path, signal.SIGHUP) as address:
        for _ in range(3):
            assert httpx2.post(f"{address}/reconstructions", content=photo.read_bytes()).status_code == 202
        assert len(list(tmp_path.rglob("photo"))) > 1


@pytest.mark.parametrize(("host", "status"), [("Photos.Example:80", 200), ("photos.example.evil.example", 421)])
def test_another_name_of_the_server_is_given_with_an_option(address: str, host: str, status: int):
    assert httpx2.get(f"{address}/health", headers={"host": host}).status_code == status


def finish(client: httpx2.Client, name: str) -> dict[str, Any]:
    """Follow the events until the end, and return the state."""
    with client.stream("GET", f"/reconstructions/{name}/events") as events:
        *_, last = (line for line in events.iter_lines() if line.startswith("event: "))
        assert last in ("event: done", "event: failed")
    found: dict[str, Any] = client.get(f"/reconstructions/{name}").json()
    return found


USD_FILES = (
    *("stage.usdc", "stage_scene.jpg"),
    *("stage_person_0.jpg", "stage_person_0_filled.png", "stage_person_0_contact.png"),
)


def test_a_program_gets_the_files_of_a_result(address: str, photo: Path, tmp_path: Path):
    with httpx2.Client(base_url=address, timeout=300) as client:
        posted = client.post("/reconstructions", content=photo.read_bytes(), headers={"content-type": "image/png"})
        done = finish(client, posted.json()["id"])
        assert (done["state"], done["summary"]["people"]) == ("done", 1)
        assert set(done["files"]) == {
            *("combined.glb", "person_0.glb", "preview.png", "reconstruction.json", "reconstruction.npz"),
            *("report.html", "scene.glb", "skinned.glb", "skeleton.bvh", "mujoco.xml", "mujoco_scene.png"),
            *(USD_FILES if find_spec("pxr") else ()),
        }
        for name, place in done["files"].items():
            (tmp_path / name).write_bytes(client.get(place).content)
    assert len(Reconstruction.load(str(tmp_path)).people) == 1
    assert "/tmp" not in json.dumps(done)


def test_a_person_uploads_a_photo_in_the_browser(address: str, photo: Path, chromium: Any):
    page = chromium.open(f"{address}/", 420, 900)
    root = page.call("DOM.getDocument")["root"]["nodeId"]
    field = page.call("DOM.querySelector", nodeId=root, selector="input[type=file]")["nodeId"]
    page.call("DOM.setFileInputFiles", nodeId=field, files=[str(photo)])
    page.wait("document.querySelector('.drop img').naturalWidth > 0")
    assert page.evaluate("document.querySelector('.drop span').textContent").startswith("walk.png, ")
    page.evaluate("document.querySelector('button').click()")
    # On a loaded machine, the page of the job may be shown when it has ended.
    page.wait("document.querySelectorAll('#stages li').length > 3 || !!document.querySelector('iframe')")
    first = page.evaluate("document.querySelector('#stages li')?.textContent")
    assert first in ("people", None)
    page.wait("!!document.querySelector('iframe')")
    assert page.evaluate("document.querySelector('h1').textContent") == "walk.png"
    assert page.evaluate("document.querySelector('#state').textContent").startswith("Done. Grade: good")
    page.wait("document.querySelector('iframe').contentDocument?.documentElement?.dataset.ready")
    picture = page.picture("iframe")
    assert picture.std() > 10
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.errors() == []
    assert {re.match(r"\w+://[^/]+", place)[0] for place in page.requests()} == {address}  # type: ignore[index]
    names = page.evaluate("[...document.querySelectorAll('a[download]')].map(a => a.textContent)")
    assert {"combined.glb", "skinned.glb", "skeleton.bvh"} <= set(names)
    job = page.evaluate("location.href")
    start = chromium.open(f"{address}/", 420, 900)
    start.wait("!!document.querySelector('.results a')")
    assert start.evaluate("[...document.querySelectorAll('.results a')].map(a => [a.textContent, a.href])") == [
        ["walk.png", job]
    ]
    start.close()
    page.evaluate("document.querySelector('button.quiet').click()")
    page.wait("document.querySelector('h1')?.textContent === 'Reconstruct a photo'")
    assert page.evaluate("localStorage.getItem('physic-results')") == "[]"
    page.close()


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("127.8.8.8", True), ("0.0.0.0", False), ("a.b", False)],
)
def test_only_the_loopback_is_not_warned_about(host: str, loopback: bool):
    assert is_loopback(host) is loopback


def test_a_wrong_option_is_an_error_before_anything_is_loaded():
    done = CliRunner().invoke(main, ["serve", "--preset", "mokc"])
    assert done.exit_code == 2
    assert "mokc" in done.stderr


def test_a_file_as_the_folder_is_refused(tmp_path: Path):
    (tmp_path / "notes").write_text("mine")
    done = CliRunner().invoke(main, ["serve", "--preset", "mock", "--folder", str(tmp_path / "notes")])
    assert done.exit_code == 2
    assert str(tmp_path / "notes") in done.stderr


@pytest.mark.parametrize("option", ["--max-mb", "--timeout", "--keep-hours"])
def test_a_limit_that_is_no_number_is_refused(option: str):
    done = CliRunner().invoke(main, ["serve", option, "nan"])
    assert done.exit_code == 2
    assert f"Invalid value for '{option}': nan is not a number" in done.stderr
