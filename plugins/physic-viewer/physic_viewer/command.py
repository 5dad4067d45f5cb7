"""The command ``physic view``: show saved results in a viewer in the browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from time import sleep

import click

from physic_core.cli.output import echo

_LOOK_S = 2.0  # seconds between two looks for new results
_LOCAL = ("127.0.0.1", "localhost", "::1")


@click.command()
@click.argument("results", metavar="OUT...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on; 0.0.0.0 for all.")
@click.option("--port", type=click.IntRange(1, 65535), default=8080, show_default=True, help="Or the next free one.")
@click.option("--allow-host", metavar="NAME", multiple=True, help="A name of this machine; may be repeated.")
@click.option("--follow/--no-follow", default=True, show_default=True, help="Show new and changed results.")
@click.option("--open/--no-open", "show", default=None, help="Open a browser.  [default: where there is a display]")
def view(
    results: tuple[Path, ...], host: str, port: int, allow_host: tuple[str, ...], follow: bool, show: bool | None
) -> None:
    """Show results OUT live in the browser, several side by side; Ctrl-C ends it.

    OUT is the folder of a result, or a folder of results, such as that of a batch that is running.
    """
    from importlib.util import find_spec

    from physic_core.errors import InputError, PackageMissingError

    if find_spec("viser") is None:
        raise PackageMissingError(
            "physic view needs viser, which is not installed: `pip install -e 'plugins/physic-viewer[live]'` in a "
            "checkout of PhySIC"
        )
    from physic_viewer.sources import ResultSource

    sources = [ResultSource(folder) for folder in results]
    if not follow:
        for source in sources:
            if not source.find():
                raise InputError(f"no result in {source.folder}: name the folder of a finished run, or let it follow")
    from physic_viewer.viewer import Viewer

    viewer = Viewer(sources, host, port, allow_host)
    try:
        echo(f"showing {', '.join(source.title for source in sources)} at {viewer.address}  (Ctrl-C ends it)")
        if host not in _LOCAL:
            echo(f"warning: whoever reaches {host} can see these photos; --host 127.0.0.1 is this machine only")
        if has_display() if show is None else show:
            webbrowser.open(viewer.address)
        while True:
            sleep(_LOOK_S)
            if follow:
                viewer.refresh()
    except KeyboardInterrupt:
        echo("")
    finally:
        viewer.stop()


def has_display() -> bool:
    """Whether a browser window can be opened on this machine."""
    if sys.platform in ("win32", "darwin"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
