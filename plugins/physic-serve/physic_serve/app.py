"""The HTTP interface: photos in, states, stages and files out."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any, Literal

from fastapi import FastAPI, HTTPException, Request
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException as StarletteHTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response, StreamingResponse

from physic_serve.answers import answer, wants_page
from physic_serve.guards import Guard
from physic_serve.jobs import Job, Jobs, QueueFull
from physic_serve.pages import STATIC, job_page, start_page, static_file
from physic_serve.uploads import KINDS, SETTINGS, read_upload
from physic_serve.worker import PHOTO_FILE, REPORT_FILE

if TYPE_CHECKING:
    from starlette.types import ASGIApp

_POLL_S, _HEARTBEAT_S = 0.2, 15.0
_TYPES = {
    ".json": "application/json",
    ".npz": "application/octet-stream",
    ".png": "image/png",
    ".glb": "model/gltf-binary",
    ".html": "text/html",
}
_PLAIN = {(404, "Not Found"): "there is no such page", (413, "Content Too Large"): "the photo is too large"}
_PAGE_POLICY = "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'; form-action 'self'"


class Status(BaseModel):
    """State of one reconstruction."""

    id: str
    photo: str = Field(description="name of the photo's file, as the client gave it, or empty")
    state: Literal["queued", "running", "done", "failed"]
    position: int = Field(description="photos before this one; 0 unless it waits")
    stages: list[str] = Field(description="names of the stages that have begun")
    error: str = Field(description="why it failed, or empty")
    summary: dict[str, Any] = Field(description="numbers of the result and its grade; empty until it is done")
    files: dict[str, str] = Field(description="address of each file of the result, by its name")


class Failure(BaseModel):
    """Body of every error."""

    detail: str


def make_app(jobs: Jobs, hosts: frozenset[str]) -> ASGIApp:
    """Return the application.

    Args:
        jobs: the queue; started and closed by the caller.
        hosts: names under which the server is reached, in lower case; it can be reached under every address.
    """
    app = FastAPI(
        title="PhySIC",
        description="Photos in; people, scene and contact out, in one metric camera frame. One photo at a time.",
        version="1",
        docs_url=None,  # its pages load scripts from elsewhere
        redoc_url=None,
        max_body_size=int(jobs.limits.upload_mb * 1e6),
    )
    _add_errors(app)
    _add_interface(app, jobs)
    _add_pages(app, jobs)
    # Outside of FastAPI's own limit, whose refusal of a stated length is neither a page nor JSON.
    return Guard(app, hosts, jobs.limits)


def _find(jobs: Jobs, name: str) -> Job:
    if (job := jobs.get(name)) is None:
        raise HTTPException(404, "there is no such reconstruction: it was deleted, or never there")
    return job


def _status(jobs: Jobs, job: Job) -> Status:
    return Status(
        id=job.id,
        photo=job.photo,
        state=job.state,
        position=jobs.position(job),
        stages=[name for name, *_ in job.stages],
        error=job.error,
        summary=job.summary,
        files={name: f"/reconstructions/{job.id}/files/{name}" for name in job.files},
    )


def _add_interface(app: FastAPI, jobs: Jobs) -> None:
    limits = jobs.limits
    known: dict[int | str, dict[str, Any]] = {404: {"model": Failure}}
    refusals: dict[int | str, dict[str, Any]] = {
        400: {"model": Failure, "description": "no photo, or a form that cannot be read"},
        413: {"model": Failure, "description": f"more than {limits.upload_mb:g} MB"},
        415: {"model": Failure, "description": f"not {KINDS}"},
        422: {"model": Failure, "description": "a setting is not a number in its range"},
        503: {"model": Failure, "description": "the queue is full: the header Retry-After gives seconds"},
        507: {"model": Failure, "description": "the server has no room for the photo"},
    }

    @app.post(
        "/reconstructions",
        status_code=202,
        response_model=Status,
        responses=refusals,
        summary="Put a photo into the queue",
        openapi_extra={"requestBody": _request_body(), "parameters": _parameters()},
    )
    async def upload(request: Request) -> Response:
        try:
            with jobs.new() as job:
                job.photo, job.settings = await read_upload(request, job.folder / PHOTO_FILE)
        except OSError as error:
            raise HTTPException(507, f"the server cannot store the photo: {error.strerror}") from error
        if wants_page(request):
            return RedirectResponse(f"/jobs/{job.id}", 303)
        content = _status(jobs, job).model_dump()
        return JSONResponse(content, 202, {"Location": f"/reconstructions/{job.id}"})

    @app.get("/reconstructions/{name}", responses=known, summary="State of a reconstruction")
    def status(name: str) -> Status:
        return _status(jobs, _find(jobs, name))

    @app.get(
        "/reconstructions/{name}/events",
        responses=known | {200: {"content": {"text/event-stream": {}}}},
        response_class=StreamingResponse,
        summary="Server-sent events: queued, stage, done, failed",
    )
    async def events(name: str) -> Response:
        return StreamingResponse(_events(jobs, _find(jobs, name)), media_type="text/event-stream")

    @app.get(
        "/reconstructions/{name}/files/{file}",
        responses=known | {200: {"content": {"application/octet-stream": {}}}},
        response_class=FileResponse,
        summary="One file of the result",
    )
    def download(name: str, file: str) -> Response:
        path = _find(jobs, name).files.get(file)  # a name of our list, or nothing: no path is made of it
        if path is None or not path.is_file():
            raise HTTPException(404, "the result has no such file")
        return FileResponse(path, media_type=_TYPES.get(path.suffix, "application/octet-stream"), filename=path.name)

    @app.delete("/reconstructions/{name}", status_code=204, responses=known, summary="Delete photo and result")
    def delete(name: str) -> None:
        jobs.delete(_find(jobs, name))

    @app.get("/health", summary="Whether the server works, and how much it has to do")
    def health() -> dict[str, Any]:
        return {"state": jobs.refused or "ready", **jobs.counts()}


def _add_pages(app: FastAPI, jobs: Jobs) -> None:
    policy = {"Content-Security-Policy": _PAGE_POLICY}

    @app.get("/", include_in_schema=False)
    def start() -> HTMLResponse:
        return HTMLResponse(start_page(jobs.limits), headers=policy)

    @app.get("/jobs/{name}", include_in_schema=False)
    def page(name: str) -> HTMLResponse:
        job = _find(jobs, name)
        return HTMLResponse(job_page(job, jobs.position(job)), headers=policy | {"Cache-Control": "no-store"})

    @app.get("/reconstructions/{name}/report", include_in_schema=False)
    def report(name: str) -> Response:
        path = _find(jobs, name).files.get(REPORT_FILE)
        if path is None or not path.is_file():
            raise HTTPException(404, "there is no report yet")
        return FileResponse(path, media_type="text/html", headers={"Content-Security-Policy": "frame-ancestors 'self'"})

    @app.post("/reconstructions/{name}/delete", include_in_schema=False)
    def delete(name: str) -> Response:
        jobs.delete(_find(jobs, name))
        return RedirectResponse("/", 303)

    @app.get("/static/{name}", include_in_schema=False)
    def static(name: str) -> Response:
        if name not in STATIC:
            raise HTTPException(404, "there is no such page")
        return Response(static_file(name), media_type=STATIC[name])


def _add_errors(app: FastAPI) -> None:
    """Answer errors with a page for browsers, and with JSON for programs."""

    @app.exception_handler(StarletteHTTPException)
    async def http(request: Request, error: StarletteHTTPException) -> Response:
        # The framework's own words for what no route of ours has said.
        text = _PLAIN.get((error.status_code, error.detail), str(error.detail))
        return answer(request, error.status_code, text, dict(error.headers or {}))

    @app.exception_handler(ClientDisconnect)
    async def gone(request: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=400)  # nobody reads it

    @app.exception_handler(QueueFull)
    async def full(request: Request, error: QueueFull) -> Response:
        return answer(request, 503, str(error), {"Retry-After": str(error.retry_s)})


async def _events(jobs: Jobs, job: Job) -> AsyncIterator[str]:
    """Yield what happens to a job until it has ended, from its beginning."""
    stages, position, quiet = 0, -1, 0.0
    while True:
        finished = job.finished  # read first: no stage is added afterwards
        if job.state == "queued" and position != (position := jobs.position(job)):
            yield _event("queued", {"position": position})
        for name, number, count in job.stages[stages:]:
            stages, quiet = stages + 1, 0.0
            yield _event("stage", {"stage": name, "number": number, "count": count})
        if finished:
            yield _event(job.state, {"error": job.error})
            return
        await asyncio.sleep(_POLL_S)
        quiet += _POLL_S
        if quiet > _HEARTBEAT_S:
            quiet = 0.0
            yield ": still there\n\n"


def _event(kind: str, content: dict[str, Any]) -> str:
    return f"event: {kind}\ndata: {json.dumps(content)}\n\n"


def _request_body() -> dict[str, Any]:
    numbers = {name: {"type": "number", "description": meaning} for name, (meaning, _) in SETTINGS.items()}
    photo = {"type": "string", "format": "binary", "description": KINDS}
    form = {"type": "object", "required": ["photo"], "properties": {"photo": photo, **numbers}}
    return {"required": True, "content": {"multipart/form-data": {"schema": form}, "image/*": {"schema": photo}}}


def _parameters() -> list[dict[str, Any]]:
    return [
        {"name": name, "in": "query", "description": meaning, "schema": {"type": "number", "maximum": most}}
        for name, (meaning, most) in SETTINGS.items()
    ]
