"""The pages of the server: upload, one job, and errors. They load nothing from other servers."""

from __future__ import annotations

import html
from importlib.resources import files
from string import Template

from physic_serve.jobs import Job
from physic_serve.settings import Limits
from physic_serve.uploads import KINDS

__all__ = ["STATIC", "error_page", "job_page", "start_page"]

STATIC = {"style.css": "text/css", "job.js": "text/javascript"}
"""Files that the pages load, and their media types."""

_FRAME = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="/static/style.css">
</head>
<body>
<header><a href="/">PhySIC</a></header>
<main>
$body
</main>
</body>
</html>
""")

_START = Template("""<h1>Reconstruct a photo</h1>
<p>People, scene and contact from one photo, in metres.</p>
<form method="post" action="/reconstructions" enctype="multipart/form-data">
<label>Photo <input type="file" name="photo" accept="image/*" required></label>
<details><summary>Known sizes</summary>
<label>Stature of the people, m <input name="stature" inputmode="decimal" placeholder="1.75"></label>
<label>Focal length, px <input name="focal_px" inputmode="decimal"></label>
<label>Camera over the floor, m <input name="camera_height" inputmode="decimal"></label>
</details>
<button>Reconstruct</button>
</form>
<p class="soft">$kinds, at most $megabytes MB. The photo stays on this machine. It is deleted after the
reconstruction; the result is deleted after $hours h at the latest, or when you delete it. Programs use the
<a href="/openapi.json">HTTP interface</a>.</p>
""")

_JOB = Template("""<h1>$title</h1>
<p id="state" role="status" data-id="$id" data-state="$state">$words</p>
<progress id="progress" max="1" $hidden></progress>
<ol id="stages">$stages</ol>
$refresh
$result
<form method="post" action="/reconstructions/$id/delete"><button class="quiet">Delete</button></form>
<script src="/static/job.js"></script>
""")


def start_page(limits: Limits) -> str:
    """Return the page with the form."""
    body = _START.substitute(
        kinds=KINDS, megabytes=f"{limits.upload_mb:g}", hours=f"{max(0.1, limits.result_s / 3600):.3g}"
    )
    return _FRAME.substitute(title="PhySIC", body=body)


def job_page(job: Job, position: int) -> str:
    """Return the page of a job: its stages while it runs, the report and the files afterwards."""
    words = {
        "queued": f"Waiting; {position} before this photo." if position else "Waiting.",
        "running": "Running.",
        "done": f"Done. Grade: {job.summary.get('grade') or 'none'}.",
        "failed": f"It failed: {html.escape(job.error)}.",
    }[job.state]
    result = ""
    if job.state == "done":
        links = "".join(
            f'<li><a href="/reconstructions/{job.id}/files/{html.escape(name)}" download>{html.escape(name)}</a> '
            f'<span class="soft">{path.stat().st_size / 1e6:.1f} MB</span></li>'
            for name, path in job.files.items()
            if path.exists()
        )
        result = (
            f'<iframe src="/reconstructions/{job.id}/report" title="Report"></iframe>\n'
            f'<p><a href="/reconstructions/{job.id}/report">Open the report alone</a></p>\n'
            f"<h2>Files</h2>\n<ul>{links}</ul>"
        )
    elif job.state == "failed":
        result = '<p><a href="/">Try another photo</a></p>'
    return _FRAME.substitute(
        title="Reconstruction",
        body=_JOB.substitute(
            title={"done": "Result", "failed": "No result"}.get(job.state, "Reconstruction"),
            id=job.id,
            state=job.state,
            words=words,
            hidden="hidden" if job.finished else "",
            stages="" if job.finished else "".join(f"<li>{html.escape(name)}</li>" for name, *_ in job.stages),
            refresh="" if job.finished else '<noscript><meta http-equiv="refresh" content="2"></noscript>',
            result=result,
        ),
    )


def error_page(status: int, message: str) -> str:
    """Return the page of an error."""
    body = f'<h1>It did not work</h1>\n<p>{html.escape(message)}</p>\n<p><a href="/">Start again</a></p>'
    return _FRAME.substitute(title=f"Error {status}", body=body)


def static_file(name: str) -> str:
    """Return the text of a file of :data:`STATIC`."""
    return (files("physic_serve") / "static" / name).read_text(encoding="utf-8")
