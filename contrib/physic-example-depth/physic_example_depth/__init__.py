"""Example plugin: metric depth from the height of a person."""

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
            "metric_depth",
            "stature",
            "physic_example_depth.stature:Stature",
            api=1,
            summary="Scale from the height of the tallest person who stands on the floor",
        ),
    ]
