"""Bodies of other models converted to SMPL-X parameters and to other meshes: fits of surfaces and
joints.
"""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_body_converters() -> list[PluginItem]:
    """Return the converter in closed form."""
    return [PluginItem("closed-form", "physic_convert.body_conversion:ClosedForm")]
