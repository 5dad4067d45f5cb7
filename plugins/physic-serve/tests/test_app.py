"""The HTTP interface, with a scripted worker."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from physic_serve.worker import Message, Task

from .conftest import PHOTO, Served

Serve = Callable[..., Served]
HTML = {"accept": "text/html,*/*"}


def test_the_app_answers_a_photo_with_files(serve: Serve, tmp_path: Path):
    served = serve()
    posted = served.post()
    name = posted.json()["id"]
    assert (posted.status_code, posted.headers["location"]) == (202, f"/reconstructions/{name}")
    assert re.fullmatch(r"[\w-]{22}", name)
    served.release.set()
    done = served.wait(name)
    files = {file: f"/reconstructions/{name}/files/{file}" for file in ("preview.png", "report.html")}
    assert done == {
        "id": name,
        "photo": "",
        "state": "done",
        "position": 0,
        "stages": ["people", "scene"],
        "error": "",
        "summary": {"people": 2, "grade": "good"},
        "files": files,
    }
    picture = served.client.get(files["preview.png"])
    assert (picture.content, picture.headers["content-type"]) == (b"picture", "image/png")
    assert picture.headers["content-disposition"] == 'attachment; filename="preview.png"'
    assert picture.headers["x-content-type-options"] == "nosniff"
    assert served.client.get(f"/reconstructions/{name}/report").text == "<p>report</p>"
    assert not list(tmp_path.rglob("photo"))


def test_the_events_are_those_of_the_job_from_its_beginning(serve: Serve):
    served = serve()
    served.release.set()
    name = served.post().json()["id"]
    served.wait(name)
    text = served.client.get(f"/reconstructions/{name}/events")
    assert text.headers["content-type"] == "text/event-stream; charset=utf-8"
    events = re.findall(r"event: (\w+)\ndata: (.*)\n\n", text.text)
    assert [(kind, json.loads(data)) for kind, data in events] == [
        ("stage", {"stage": "people", "number": 0, "count": 2}),
        ("stage", {"stage": "scene", "number": 1, "count": 2}),
        ("done", {"error": ""}),
    ]


def test_photos_wait_in_order_and_a_full_queue_is_503(serve: Serve):
    served = serve(queue=2)
    first = served.post().json()["id"]
    served.wait(first, "running")
    others = [served.post().json() for _ in range(2)]
    assert [other["position"] for other in others] == [1, 2]
    refused = served.post()
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "30")
    assert refused.json() == {"detail": "the queue is full: try again in 30 s"}
    assert served.client.get("/health").json() == {"state": "ready", "waiting": 2, "running": 1, "kept": 0}
    served.release.set()
    assert [served.wait(other["id"])["state"] for other in others] == ["done", "done"]
    assert [task.folder.name for task in served.workers[0].tasks] == [first, *(other["id"] for other in others)]


@pytest.mark.parametrize(
    ("content", "status", "detail"),
    [
        (b"", 400, "there is no photo: send its bytes as the body, or as the form's field 'photo'"),
        (b"<!doctype html><p>photo", 415, "the file is not a photo: send JPEG, PNG, WebP, TIFF, AVIF or HEIC"),
        (b"PK\x03\x04" + bytes(100), 415, "the file is not a photo: send JPEG, PNG, WebP, TIFF, AVIF or HEIC"),
        (b"GIF89a" + bytes(100), 415, "the file is not a photo: send JPEG, PNG, WebP, TIFF, AVIF or HEIC"),
        (b"\xff\xd8\xff" + bytes(200_000), 413, "the photo is too large"),
    ],
    ids=["empty", "html", "zip", "gif", "large"],
)
@pytest.mark.parametrize("way", ["body", "form", "counted"])
def test_a_broken_upload_is_refused(serve: Serve, content: bytes, status: int, detail: str, way: str):
    served = serve(upload_mb=0.1)
    if way == "form":
        found = served.client.post("/reconstructions", files={"photo": ("photo.jpg", content)})
    else:
        found = served.post(content if way == "body" else (content[i : i + 5000] for i in range(0, len(content), 5000)))  # type: ignore[arg-type]
    assert (found.status_code, found.json()) == (status, {"detail": detail})
    assert served.client.get("/health").json()["waiting"] == 0


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("../../../evil.jpg", "evil.jpg"),
        ("/etc/passwd", "passwd"),
        ("a\x1b[2Jb.jpg", "a[2Jb.jpg"),
        ("reconstruction.json", "reconstruction.json"),
        ("C:\\evil", "evil"),
        ("n" * 300, "n" * 100),
    ],
)
def test_the_name_of_the_file_is_shown_and_names_no_file(serve: Serve, tmp_path: Path, name: str, shown: str):
    served = serve()
    served.release.set()
    posted = served.client.post("/reconstructions", files={"photo": (name, PHOTO)})
    assert served.wait(posted.json()["id"])["photo"] == shown
    written = {file.relative_to(tmp_path).parts[-1] for file in tmp_path.rglob("*") if file.is_file()}
    assert written == {"preview.png", "report.html"}


@pytest.mark.parametrize(
    "file", ["photo", "..%2fphoto", "%2e%2e%2fpreview.png", "/etc/passwd", "%2fetc%2fpasswd", "preview.png%00"]
)
def test_only_files_of_the_result_can_be_read(serve: Serve, file: str):
    served = serve()
    name = served.post().json()["id"]
    assert served.client.get(f"/reconstructions/{name}/files/{file}").status_code in (404, 405)
    served.release.set()
    served.wait(name)
    assert served.client.get(f"/reconstructions/{name}/files/{file}").status_code in (404, 405)


def test_settings_come_from_the_form_or_the_query(serve: Serve):
    served = serve()
    served.release.set()
    by_form = served.client.post(
        "/reconstructions",
        files={"photo": ("p.jpg", PHOTO)},
        data={"stature": "1.8", "age": "4.5", "focal_px": "", "other": "3"},
    )
    by_query = served.post(params={"focal_px": "900"})
    for posted in (by_form, by_query):
        served.wait(posted.json()["id"])
    assert [task.settings for task in served.workers[0].tasks] == [{"stature": 1.8, "age": 4.5}, {"focal_px": 900.0}]


@pytest.mark.parametrize("text", ["tall", "-1", "0", "nan", "inf", "3"])
def test_a_setting_out_of_its_range_is_refused(serve: Serve, text: str):
    found = serve().post(params={"stature": text})
    assert found.status_code == 422
    assert found.json()["detail"] == f"stature must be a number over 0 and at most 2.7, got '{text}'"


@pytest.mark.parametrize(
    ("headers", "status", "detail"),
    [
        ({"origin": "http://evil.example"}, 403, "this request came from a page of another site"),
        ({"origin": "null"}, 403, "this request came from a page of another site"),
        ({"origin": "http://["}, 400, "the Origin header must be like http://name:port, or null; got 'http://['"),
        ({"host": "[::1"}, 400, "the Host header must be a name or an address, optionally with a port; got '[::1'"),
        ({"host": "a@testserver"}, 400, "the Host header must be a name or an address, optionally with a port; got"),
        ({"host": "evil.example:80"}, 421, "this server is not called 'evil.example'"),
    ],
)
def test_a_foreign_or_malformed_host_or_origin_is_refused(
    serve: Serve, headers: dict[str, str], status: int, detail: str
):
    found = serve().post(headers=headers)
    assert (found.status_code, found.json()["detail"][: len(detail)]) == (status, detail)


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://testserver"},
        {"host": "TestServer:8000", "origin": "https://testserver:8000"},
        {"host": "192.0.2.7:80"},
        {"host": "[::1]"},
    ],
)
def test_the_names_and_addresses_of_the_server_are_answered(serve: Serve, headers: dict[str, str]):
    assert serve().post(headers=headers).status_code == 202


def test_a_deleted_job_is_gone_and_its_folder_too(serve: Serve, tmp_path: Path):
    served = serve()
    running, waiting = (served.post().json()["id"] for _ in range(2))
    served.wait(running, "running")
    for name in (running, waiting):
        assert served.client.delete(f"/reconstructions/{name}").status_code == 204
        assert "it was deleted, or never there" in served.client.get(f"/reconstructions/{name}").json()["detail"]
    served.release.set()
    after = served.wait(served.post().json()["id"])
    assert after["state"] == "done"
    assert [folder.name for folder in (tmp_path / "results-0").iterdir()] == [after["id"]]


def test_the_oldest_results_are_deleted(serve: Serve):
    served = serve(results=2)
    served.release.set()
    names = []
    for _ in range(4):
        names.append(served.post().json()["id"])
        served.wait(names[-1])
    served.jobs.delete_old()
    assert [served.client.get(f"/reconstructions/{name}").status_code for name in names] == [404, 404, 200, 200]


def test_a_result_that_is_too_old_is_deleted(serve: Serve):
    served = serve(result_s=0.0)
    served.release.set()
    name = served.post().json()["id"]
    while served.client.get(f"/reconstructions/{name}").status_code == 200:
        served.jobs.delete_old()


def test_a_photo_that_cannot_be_stored_is_507(serve: Serve):
    served = serve()
    served.jobs.folder.rmdir()
    found = served.post()
    assert found.status_code == 507
    assert found.json() == {"detail": f"the server cannot store the photo: {os.strerror(errno.ENOENT)}"}


def test_a_failed_photo_leaves_no_file(serve: Serve):
    served = serve()
    posted = served.post().json()["id"]
    served.wait(posted, "running")
    (worker,) = served.workers

    def write_half(task: Task) -> Message:
        worker.write(task)
        return Message("failed", "the disk is full")

    worker.outcome = write_half
    served.release.set()
    assert served.wait(posted)["error"] == "the disk is full"
    assert list(served.jobs.folder.iterdir()) == []


def test_a_worker_that_ends_without_a_photo_costs_none(serve: Serve):
    served = serve()
    assert served.jobs.wait_until_open() == ""
    served.workers[0].end()
    served.release.set()
    assert served.wait(served.post().json()["id"])["state"] == "done"
    assert len(served.workers) == 2


def test_a_browser_gets_pages(serve: Serve):
    served = serve(queue=1)
    start = served.client.get("/", headers=HTML).text
    assert 'enctype="multipart/form-data"' in start
    assert "at most 40 MB" in start
    posted = served.client.post(
        "/reconstructions", files={"photo": ("p.jpg", PHOTO)}, headers=HTML, follow_redirects=False
    )
    assert posted.status_code == 303
    place = posted.headers["location"]
    served.wait(place.removeprefix("/jobs/"), "running")
    running = served.client.get(place, headers=HTML)
    assert "Running." in running.text
    assert "<li>people</li>" in running.text
    assert "default-src 'self'" in running.headers["content-security-policy"]
    served.post()
    full = served.post(headers=HTML)
    assert (full.status_code, "the queue is full" in full.text) == (503, True)
    broken = served.client.post("/reconstructions", files={"photo": ("p.jpg", b"<b>")}, headers=HTML)
    assert broken.status_code in (415, 503)
    served.release.set()
    served.wait(place.removeprefix("/jobs/"))
    done = served.client.get(place, headers=HTML).text
    assert 'Done. Grade: <span class="good">good</span>.' in done
    assert "<h1>p.jpg</h1>" in done
    assert done.count(" download>") == 2
    missing = served.client.get("/jobs/none", headers=HTML)
    assert (missing.status_code, "it was deleted, or never there" in missing.text) == (404, True)
    assert served.client.get("/none", headers=HTML).text.count("there is no such page") == 1


def test_the_page_of_a_result_lists_its_files_for_people_first(serve: Serve):
    served = serve()
    posted = served.client.post("/reconstructions", files={"photo": ("<b>&.jpg", PHOTO)}).json()["id"]
    served.wait(posted, "running")
    (worker,) = served.workers

    def write(task: Task) -> Message:
        for name in ("reconstruction.npz", "reconstruction.json", "points.ply", "skeleton_0.bvh", "combined.glb"):
            (task.folder / name).write_bytes(bytes(200_000))
        return Message("done", {"grade": "bad", "missing_exports": {"mjcf": "the result has no floor"}})

    worker.outcome = write
    served.release.set()
    served.wait(posted)
    text = served.client.get(f"/jobs/{posted}", headers=HTML).text
    assert "<title>&lt;b&gt;&amp;.jpg</title>" in text
    assert re.findall(r"download>([^<]+)</a><span>([^<]*)</span><span class=\"soft\">([^<]+)", text) == [
        ("combined.glb", "Scene and people, for every 3D viewer", "0.2 MB"),
        ("skeleton_0.bvh", "Skeleton and pose of a person, for Blender, Maya, MotionBuilder", "0.2 MB"),
        ("points.ply", "", "0.2 MB"),
        ("reconstruction.json", "", "0.2 MB"),
        ("reconstruction.npz", "", "0.2 MB"),
    ]
    assert text.index("points.ply") < text.index("<details>") < text.index("reconstruction.json")
    assert "Not exported to mjcf: the result has no floor." in text
    # A worker without a plugin that makes reports writes none.
    assert f'<img src="/reconstructions/{posted}/files/preview.png"' in text
    assert "<iframe" not in text
