"""``physic serve`` as a user starts it: a process of its own, a real socket on the loopback, and a
browser.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import httpx2
import pytest
from PIL import Image

from physic_core import Reconstruction
from physic_serve.command import example_photos
from physic_testing import load_world

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "walk.png"
    Image.fromarray(load_world("walk").image).save(path)
    return path


def _heed_closed_terminals():
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@contextmanager
def started(folder, end=signal.SIGTERM):
    """Yield the address of a server with mock estimators, which the signal ends; its folder is then
    as before.
    """
    before = sorted(folder.rglob("*"))
    command = [
        sys.executable,
        "-P",
        "-m",
        "physic_core",
        "serve",
        "--preset",
        "mock",
        "--port",
        "0",
    ]
    options = ["--allow-host", "photos.example", "--folder", str(folder)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # Tests that nohup starts ignore SIGHUP, and so would the server.
    with subprocess.Popen(
        [*command, *options], preexec_fn=_heed_closed_terminals, **pipes
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
def address(tmp_path_factory):
    with started(tmp_path_factory.mktemp("served")) as found:
        yield found


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_a_closed_terminal_leaves_no_photo_and_the_files_of_the_user(photo, tmp_path):
    (tmp_path / "metricbody-batch-docker" / "jobs").mkdir(parents=True)
    (tmp_path / "metricbody-batch-docker" / "docker-compose.yml").write_text("mine")
    with started(tmp_path, signal.SIGHUP) as address:
        posted = httpx2.post(f"{address}/jobs", files={"photo": ("walk.png", photo.read_bytes())})
        assert posted.status_code == 303
        assert len(list(tmp_path.glob("metricbody-batch-*"))) == 2


@pytest.mark.parametrize(
    ("host", "status"), [("Photos.Example:80", 200), ("photos.example.evil.example", 400)]
)
def test_another_name_of_the_server_is_given_with_an_option(address, host, status):
    assert httpx2.get(f"{address}/", headers={"host": host}).status_code == status


def test_a_person_uploads_a_photo_in_the_browser(address, photo, chromium, tmp_path):
    page = chromium.open(f"{address}/", 420, 900)
    root = page.call("DOM.getDocument")["root"]["nodeId"]
    field = page.call("DOM.querySelector", nodeId=root, selector="input[type=file]")["nodeId"]
    page.call("DOM.setFileInputFiles", nodeId=field, files=[str(photo)])
    page.wait("document.querySelector('.drop img').naturalWidth > 0")
    assert page.evaluate("document.querySelector('.drop span').textContent").startswith(
        "walk.png, "
    )
    page.evaluate("document.querySelector('button').click()")
    # On a loaded machine, the page may be shown when the photo has ended.
    page.wait(
        "document.querySelectorAll('#progress li').length > 3 || !!document.querySelector('iframe')"
    )
    page.wait("!!document.querySelector('iframe')")
    assert page.evaluate("document.querySelector('h1').textContent") == "walk.png"
    assert "pose usable" in page.evaluate("document.querySelector('#progress').textContent")
    page.wait("document.querySelector('iframe').contentDocument?.documentElement?.dataset.ready")
    assert page.picture("iframe").std() > 10
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.errors() == []
    assert {re.match(r"\w+://[^/]+", place)[0] for place in page.requests()} == {address}
    links = page.evaluate(
        "[...document.querySelectorAll('a[download]')].map(a => [a.textContent, a.href])"
    )
    assert {"combined.glb", "skinned.glb", "skeleton.bvh", "report.html", "mujoco.xml"} <= {
        name for name, _ in links
    }
    for name, place in links:
        (tmp_path / name).write_bytes(httpx2.get(place).content)
    assert len(Reconstruction.load(str(tmp_path)).people) == 1
    page.close()


def test_an_example_is_clicked_and_stopped_in_the_browser(address, chromium):
    page = chromium.open(f"{address}/", 1000, 900)
    page.wait(
        "[...document.querySelectorAll('.examples img')].every(picture => picture.naturalWidth > 0)"
    )
    names = page.evaluate(
        "[...document.querySelectorAll('.examples button')].map(button => button.value)"
    )
    assert names == list(example_photos())
    assert "couple.jpg" in names
    page.evaluate("document.querySelector('.examples button').click()")
    page.wait("!!document.querySelector('#progress')")
    page.evaluate("document.querySelector('button.quiet')?.click()")
    page.wait("['done', 'failed'].includes(document.querySelector('#progress')?.dataset.state)")
    assert page.errors() == []
    page.close()


def test_a_wrong_option_is_an_error_before_anything_is_loaded(physic):
    done = physic("serve", "--preset", "mokc")
    assert done.exit_code == 2
    assert "mokc" in done.stderr
