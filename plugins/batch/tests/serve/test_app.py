"""The pages, with a scripted worker."""

from __future__ import annotations

import re

import pytest

from physic_serve import app
from physic_serve.worker import Message

from .conftest import PHOTO


def test_a_photo_becomes_a_page_with_its_files(served):
    page = served.post("<b>&.jpg")
    running = served.wait(page, "<li>people</li>")
    assert "Stop" in running
    served.release.set()
    done = served.wait(page, "Done")
    usable = "pose usable for 0 of 3 people, place for 2, contact for 1, size for 3"
    assert f'<p role="status">Done: {usable}.</p>' in done
    assert "<title>&lt;b&gt;&amp;.jpg</title>" in done
    assert re.findall(r"download>([^<]+)", done) == [
        "combined.glb",
        "preview.png",
        "report.html",
        "other.ply",
    ]
    assert "Not exported to mjcf: the result has no floor" in done
    assert "Stop" not in done
    picture = served.client.get(f"{page}/files/preview.png")
    assert (picture.text, picture.headers["content-type"]) == ("preview.png", "image/png")
    assert picture.headers["x-content-type-options"] == "nosniff"
    assert served.workers[0].tasks[0].photo == PHOTO


def test_pages_run_no_scripts_of_others_and_a_report_its_own_only(served):
    page = served.post()
    served.release.set()
    assert "default-src 'self'" in served.client.get(page).headers["content-security-policy"]
    served.wait(page, "Done")
    report = served.client.get(f"{page}/files/report.html")
    assert report.headers["content-security-policy"] == "frame-ancestors 'self'"


def test_results_of_a_browser_are_in_a_cookie_that_no_script_or_other_site_gets(served):
    posted = served.client.post("/jobs", data={"example": "an-example.jpg"}, follow_redirects=False)
    words = set(posted.headers["set-cookie"].lower().split("; "))
    assert {"httponly", "samesite=strict"} <= words


@pytest.mark.parametrize(
    ("header", "value"),
    [
        ("referrer-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
        ("x-content-type-options", "nosniff"),
        ("content-security-policy", "frame-ancestors 'none'"),
        ("x-frame-options", "DENY"),
        ("content-security-policy", "form-action 'self'"),
    ],
)
def test_every_page_states_what_a_browser_may_do_with_it(header, value, served):
    for address in ("/", "/jobs/none", "/examples/an-example.jpg"):
        assert value in served.client.get(address).headers[header]


def test_a_link_in_the_folder_of_a_result_that_leads_out_is_no_file_of_it(served):
    page = served.post()
    served.release.set()
    served.wait(page, "Done")
    job = served.jobs.get(page.rpartition("/")[2])
    (job.folder / "secret.txt").symlink_to("/etc/hostname")
    assert served.client.get(f"{page}/files/secret.txt").status_code == 404
    assert "secret.txt" not in served.client.get(page).text


def test_an_example_is_a_click(served):
    assert 'value="an-example.jpg"' in served.client.get("/").text
    assert served.client.get("/examples/an-example.jpg").status_code == 200
    posted = served.client.post("/jobs", data={"example": "an-example.jpg"})
    assert "<h1>an-example.jpg</h1>" in posted.text
    assert served.client.post("/jobs", data={"example": "../conftest.py"}).status_code == 400


def test_stopped_photos_have_no_result_and_the_next_one_has_a_new_worker(served):
    running = served.post()
    waiting = served.post()
    served.wait(running, "Running")
    for page in (waiting, running):
        assert "it was stopped" in served.client.post(f"{page}/stop").text
    third = served.post()
    served.release.set()
    served.wait(third, "Done")
    assert [len(worker.tasks) for worker in served.workers] == [1, 1]
    assert "it was stopped" in served.client.get(running).text


def test_a_failed_photo_says_why_and_gives_no_file(served):
    served.release.set()
    worker = served.workers[0]

    def write_half(task):
        worker.write(task)
        return Message("failed", "the disk is full")

    worker.outcome = write_half
    page = served.post()
    served.wait(page, "the disk is full")
    assert served.client.get(f"{page}/files/preview.png").status_code == 404


def test_photos_wait_on_the_disk_until_their_turn_or_until_they_are_stopped(served, tmp_path):
    running = served.post()
    served.wait(running, "Running")
    waiting = served.post(content=b"second")
    assert [file.read_bytes() for file in tmp_path.iterdir() if file.is_file()] == [b"second"]
    served.client.post(f"{waiting}/stop")
    assert all(file.is_dir() for file in tmp_path.iterdir())


def test_a_browser_lists_its_own_results(served):
    pages = [served.post(f"{number}.jpg") for number in range(2)]
    listed = re.findall(r'<li><a href="([^"]+)">([^<]+)', served.client.get("/").text)
    assert listed == [(pages[1], "1.jpg"), (pages[0], "0.jpg")]
    assert "Earlier results" not in served.browser().get("/").text


@pytest.mark.parametrize(
    "name", ["../../../evil.jpg", "/etc/passwd", "reconstruction.json", "n" * 300]
)
def test_the_name_of_the_file_is_shown_and_names_no_file(served, tmp_path, name):
    served.release.set()
    page = served.post(name)
    served.wait(page, "Done")
    assert f"<h1>{name[:100]}</h1>" in served.client.get(page).text
    written = {file.name for file in tmp_path.rglob("*") if file.is_file()}
    assert written == {"preview.png", "report.html", "combined.glb", "other.ply"}


@pytest.mark.parametrize(
    "file", ["..%2fphoto", "%2e%2e%2fpreview.png", "%2fetc%2fpasswd", "preview.png%00", "photo"]
)
def test_only_files_of_the_result_can_be_read(served, file):
    page = served.post()
    served.release.set()
    served.wait(page, "Done")
    assert served.client.get(f"{page}/files/{file}").status_code == 404


def test_settings_come_from_the_form(served):
    served.release.set()
    served.wait(served.post(stature="1.8", age="4.5", focal_px="", other="3"), "Done")
    assert served.workers[0].tasks[0].settings == {"stature": 1.8, "age": 4.5}
    assert (
        served.client.post(
            "/jobs", files={"photo": ("p.jpg", PHOTO)}, data={"age": "old"}
        ).status_code
        == 400
    )


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "http://["}, 403),
        ({"host": "evil.example:80"}, 400),
        ({"host": "testserver.evil.example"}, 400),
    ],
)
def test_a_page_of_another_site_can_send_and_read_nothing(served, headers, status):
    files = {"photo": ("photo.jpg", PHOTO)}
    assert served.client.post("/jobs", files=files, headers=headers).status_code == status
    assert served.client.get("/", headers=headers).status_code == status
    assert served.workers[0].tasks == []


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://testserver"},
        {"host": "TestServer:8000", "origin": "https://testserver:8000"},
    ],
)
def test_the_own_page_is_answered(served, headers):
    assert served.client.get("/", headers=headers).status_code == 200
    assert served.client.get("/", headers={"host": "[::1]:8000"}).status_code == 200


def test_what_cannot_be_found_or_read_is_a_page_of_words(served, monkeypatch):
    for answer, status in (
        (served.client.get("/jobs/none"), 404),
        (served.client.get("/none"), 404),
        (served.client.post("/jobs"), 400),
    ):
        assert (answer.status_code, "It did not work" in answer.text) == (status, True)


def test_an_upload_of_too_many_bytes_is_refused(served):
    large = {
        "content-length": str(app.MAX_UPLOAD_BYTES + 1),
        "content-type": "multipart/form-data; boundary=b",
    }
    assert served.client.post("/jobs", content=b"", headers=large).status_code == 413
