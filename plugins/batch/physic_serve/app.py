"""The pages of the server: upload, one photo and its files, and errors.

They load nothing from other servers.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders, UploadFile
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from physic_core.pictures import REPORT_FILE
from physic_core.types import MARKS, usable_text
from physic_serve.jobs import Job, Jobs

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_UPLOAD_BYTES = 400_000_000
"""Of the largest JPEG that is read."""

_SETTINGS = {
    "stature": "Stature of the people, m",
    "age": "Age of the people, years",
    "focal_px": "Focal length, px",
    "camera_height": "Camera over the floor, m",
}
_MEANINGS = {
    "combined.glb": "Scene and people, for every 3D viewer",
    "skinned.glb": "Scene and people with skeletons, for Blender, Unity, Unreal, three.js",
    "stage.usdc": "USD, for Omniverse, Isaac Sim, Houdini",
    "mujoco.xml": "Scene and people with joints, for MuJoCo",
    "preview.png": "Picture of the result",
    "report.html": "The page above, in one file",
    "reconstruction.json": "All numbers",
    "reconstruction.npz": "All arrays",
}
_PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'; form-action 'self'"
)
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    # a stricter one would make browsers send forms with the origin "null"
    "Referrer-Policy": "same-origin",
    "Content-Security-Policy": _PAGE_POLICY,
    "X-Frame-Options": "DENY",
}
_COOKIE = "physic-results"
_MOST_LISTED = 100
_LONGEST_TITLE = 100  # characters
_TEMPLATES = Jinja2Templates(str(files("physic_serve") / "templates"))


def _usable_text(summary: Mapping[str, Any]) -> str:
    """Return the usable marks of a finished job in words; "" of another job."""
    if "people" not in summary:
        return ""
    return usable_text({name: summary[f"usable_{name}"] for name in MARKS}, summary["people"])


_TEMPLATES.env.filters["usable"] = _usable_text


def make_app(jobs: Jobs, hosts: Collection[str], examples: Mapping[str, Path]) -> Starlette:
    """Return the application.

    Args:
        jobs: closed by the caller.
        hosts: names and addresses under which the server is reached, without port; IPv6 addresses
            in brackets.
        examples: photos to click, by name.
    """

    pages = _Pages(jobs, examples)
    return Starlette(
        routes=[
            Route("/", pages.start),
            Route("/jobs", pages.upload, methods=["POST"]),
            Route("/jobs/{id}", pages.page),
            Route("/jobs/{id}/stop", pages.stop, methods=["POST"]),
            Route("/jobs/{id}/files/{name}", pages.download),
            Route("/examples/{name}", pages.example),
            Mount("/static", StaticFiles(packages=[("physic_serve", "static")])),
        ],
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=list(hosts), www_redirect=False),
            Middleware(_OwnSiteOnly),
        ],
        exception_handlers={HTTPException: _error_page},
        max_body_size=MAX_UPLOAD_BYTES,
    )


class _Pages:
    """Answers of the server to requests for its pages and files.

    Args:
        jobs: with the results.
        examples: photos to click, by name.
    """

    def __init__(self, jobs: Jobs, examples: Mapping[str, Path]) -> None:
        self._jobs = jobs
        self._examples = examples

    def _find(self, request: Request) -> Job:
        if (job := self._jobs.get(request.path_params["id"])) is None:
            raise HTTPException(404, "there is no such result: the server deletes all when it ends")
        return job

    def start(self, request: Request) -> Response:
        earlier = [job for name in _own_results(request) if (job := self._jobs.get(name))]
        values = {"settings": _SETTINGS, "examples": self._examples, "earlier": earlier}
        return _TEMPLATES.TemplateResponse(request, "start.html", values)

    async def upload(self, request: Request) -> Response:
        try:
            return await self._take_upload(request)
        except ClientDisconnect:  # the browser broke the upload off, and reads no answer
            return Response(status_code=400)
        except OSError as error:
            why = f"the server cannot store the photo: {error.strerror}; free disk space"
            raise HTTPException(507, why) from error

    async def _take_upload(self, request: Request) -> Response:
        async with request.form(max_files=1, max_fields=8) as form:
            file = form.get("photo")
            example = str(form.get("example", ""))
            if isinstance(file, UploadFile):
                photo = await file.read()
                title = str(file.filename)[:_LONGEST_TITLE]
            elif example in self._examples:
                photo = self._examples[example].read_bytes()
                title = example
            else:
                raise HTTPException(400, "there is no photo: choose one")
            settings = {name: _number(str(text)) for name in _SETTINGS if (text := form.get(name))}
        job = self._jobs.add(photo, title, settings)
        response = RedirectResponse(f"/jobs/{job.id}", 303)
        listed = " ".join([job.id, *_own_results(request)][:_MOST_LISTED])
        response.set_cookie(_COOKIE, listed, httponly=True, samesite="strict")
        return response

    def page(self, request: Request) -> Response:
        job = self._find(request)
        paths = job.files
        names = [*filter(paths.get, _MEANINGS), *(name for name in paths if name not in _MEANINGS)]
        rows = [(name, _MEANINGS.get(name, ""), paths[name].stat().st_size) for name in names]
        values = {"job": job, "rows": rows, "report": REPORT_FILE}
        return _TEMPLATES.TemplateResponse(
            request, "job.html", values, headers={"Cache-Control": "no-store"}
        )

    def stop(self, request: Request) -> Response:
        job = self._find(request)
        self._jobs.stop(job)
        return RedirectResponse(f"/jobs/{job.id}", 303)

    def download(self, request: Request) -> Response:
        return _file_response(self._find(request).files, request)

    def example(self, request: Request) -> Response:
        return _file_response(self._examples, request)


class _OwnSiteOnly:
    """Refuse what a page of another site makes its reader's browser send, and add headers to all
    other answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        headers = Headers(scope=scope)
        origin = headers.get("origin")
        if origin is None or origin.partition("://")[2].lower() == headers["host"].lower():
            await self._app(scope, receive, send_with_headers)
        else:
            await PlainTextResponse("this request came from a page of another site", 403)(
                scope, receive, send
            )


def _error_page(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _TEMPLATES.TemplateResponse(
        request, "error.html", {"message": error.detail}, error.status_code
    )


def _own_results(request: Request) -> list[str]:
    """Return the ids of the results of this browser, the newest first."""
    return request.cookies.get(_COOKIE, "").split()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise HTTPException(400, f"'{text[:40]}' is not a number") from None


def _file_response(paths: Mapping[str, Path], request: Request) -> Response:
    """Return one of these files; no path is made of the name in a request."""
    name = request.path_params["name"]
    if name not in paths:
        raise HTTPException(404, "there is no such file")
    if name == REPORT_FILE:  # a page of this server frames it; it states which scripts may run
        headers = {
            "Content-Security-Policy": "frame-ancestors 'self'",
            "X-Frame-Options": "SAMEORIGIN",
        }
        return FileResponse(paths[name], headers=headers, media_type="text/html")
    return FileResponse(paths[name], filename=name)
