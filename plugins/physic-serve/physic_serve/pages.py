"""The pages of the server: upload, one job, and errors. They load nothing from other servers."""

from __future__ import annotations

import html
import re
from importlib.resources import files
from string import Template

from physic_serve.jobs import Job
from physic_serve.settings import Limits
from physic_serve.uploads import KINDS
from physic_serve.worker import REPORT_FILE

STATIC = {
    "style.css": "text/css",
    "results.js": "text/javascript",
    "start.js": "text/javascript",
    "job.js": "text/javascript",
}
"""Files that the pages load, and their media types."""

_MEANINGS = {
    "combined": "Scene and people, for every 3D viewer",
    "skinned": "Scene and people with skeletons, for Blender, Unity, Unreal, three.js",
    "skeleton": "Skeleton and pose of a person, for Blender, Maya, MotionBuilder",
    "stage": "USD, for Omniverse, Isaac Sim, Houdini",
    "mujoco": "Collision meshes of scene and people, for MuJoCo",
    "person": "One person",
    "scene": "Scene without people",
    "preview": "Picture of the result",
    "report": "The page above, in one file",
}
"""What the files of a result are, by the begin of their names, in the order of the page."""

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
<label class="drop"><img alt="The chosen photo" hidden><span>Drop a photo here, or choose one</span>
<input type="file" name="photo" accept="image/*" data-megabytes="$megabytes" required></label>
<p class="warning" role="alert" hidden>This file is larger than $megabytes MB, and the server will refuse it.</p>
<details><summary>Known sizes</summary>
<label>Stature of the people, m <input name="stature" inputmode="decimal" placeholder="1.75"></label>
<label>Age of the people, years <input name="age" inputmode="decimal"></label>
<label>Focal length, px <input name="focal_px" inputmode="decimal"></label>
<label>Camera over the floor, m <input name="camera_height" inputmode="decimal"></label>
</details>
<button>Reconstruct</button>
</form>
<p class="soft">$kinds, at most $megabytes MB. The photo stays on the machine of this server. Its file is deleted
after the reconstruction. The result, which shows the photo, is deleted after $hours h at the latest, or when you delete
it. Programs use the <a href="/openapi.json">HTTP interface</a>.</p>
<section id="earlier" hidden><h2>Earlier results</h2><ul class="results"></ul></section>
<script src="/static/results.js"></script>
<script src="/static/start.js"></script>
""")

_JOB = Template("""<h1>$title</h1>
<p id="state" role="status" data-id="$id" data-state="$state">$words</p>
<progress id="progress" max="1" $hidden></progress>
<ol id="stages">$stages</ol>
$refresh
$result
<form method="post" action="/reconstructions/$id/delete"><button class="quiet">Delete</button></form>
<script src="/static/results.js"></script>
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
        "done": f'Done. Grade: <span class="{(grade := job.summary.get("grade") or "none")}">{grade}</span>.',
        "failed": f"It failed: {html.escape(job.error)}.",
    }[job.state]
    result = _result(job) if job.state == "done" else ""
    if job.state == "failed":
        result = '<p><a href="/">Try another photo</a></p>'
    title = html.escape(job.photo or {"done": "Result", "failed": "No result"}.get(job.state, "Reconstruction"))
    return _FRAME.substitute(
        title=title,
        body=_JOB.substitute(
            title=title,
            id=job.id,
            state=job.state,
            words=words,
            hidden="hidden" if job.finished else "",
            stages="" if job.finished else "".join(f"<li>{html.escape(name)}</li>" for name, *_ in job.stages),
            refresh="" if job.finished else '<noscript><meta http-equiv="refresh" content="2"></noscript>',
            result=result,
        ),
    )


def _result(job: Job) -> str:
    there = {name: path.stat().st_size for name, path in job.files.items() if path.exists()}

    def links(names: list[str]) -> str:
        rows = (
            f'<li><a href="/reconstructions/{job.id}/files/{html.escape(name)}" download>{html.escape(name)}</a>'
            f"<span>{_MEANINGS.get(re.split(r'[_.]', name)[0], '')}</span>"
            f'<span class="soft">{_size(there[name])}</span></li>'
            for name in names
        )
        return f'<ul class="files">{"".join(rows)}</ul>'

    data = [name for name in there if name.startswith("reconstruction.")]
    order = list(_MEANINGS)
    others = sorted(
        (name for name in there if name not in data),
        key=lambda name: order.index(stem) if (stem := re.split(r"[_.]", name)[0]) in order else len(order),
    )
    missing = "".join(
        f'<p class="soft">Not exported to {html.escape(name)}: {html.escape(why)}.</p>'
        for name, why in job.summary.get("missing_exports", {}).items()
    )
    return (
        f"{_picture(job, REPORT_FILE in there)}\n"
        f"<h2>Files</h2>\n{links(others)}{missing}\n"
        f"<details><summary>All numbers, for Python and other programs</summary>{links(data)}</details>"
    )


def _picture(job: Job, with_report: bool) -> str:
    """Return the report of a result, or its preview where no plugin makes reports."""
    if not with_report:
        return f'<p><img src="/reconstructions/{job.id}/files/preview.png" alt="Preview"></p>'
    return (
        f'<iframe src="/reconstructions/{job.id}/report" title="Report"></iframe>\n'
        f'<p><a href="/reconstructions/{job.id}/report">Open the report alone</a></p>'
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count > 99_950 else f"{count / 1e3:.0f} kB"


def error_page(status: int, message: str) -> str:
    """Return the page of an error."""
    body = f'<h1>It did not work</h1>\n<p>{html.escape(message)}</p>\n<p><a href="/">Start again</a></p>'
    return _FRAME.substitute(title=f"Error {status}", body=body)


def static_file(name: str) -> str:
    """Return the text of a file of :data:`STATIC`."""
    return (files("physic_serve") / "static" / name).read_text(encoding="utf-8")
