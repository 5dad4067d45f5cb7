"""Example plugin: inpainting with an image pyramid."""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends. Nothing heavy is imported here, because it runs whenever plugins
    are listed.
    """
    return [
        BackendRecord(
            "inpainter",
            "pull-push",
            "physic_example_inpaint.pyramid:PullPush",
            api=1,
            summary="A smooth fill of any hole, from an image pyramid",
        ),
    ]
