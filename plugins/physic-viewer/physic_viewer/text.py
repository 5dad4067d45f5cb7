"""Text of the panels of the viewer: results and people as Markdown, and the contact legend as HTML."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from physic_core.types import summarize_checks
from physic_core.types.metres_text import metres_text
from physic_core.visual.palette import BODY_RGB, FAINT, contact_legend, has_faint_contact

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

_SPECIAL = re.compile(r"([\\`*_{}\[\]()#+.!|<>~$&-])")


def escape(text: str) -> str:
    """Escape text of others for Markdown: names of folders, warnings."""
    return _SPECIAL.sub(r"\\\1", " ".join(text.split()))


def result_text(result: Reconstruction) -> str:
    """Return grade, summary, checks and warnings of a result."""
    summary = repr(result).removeprefix("Reconstruction(").removesuffix(")")
    lines = [f"**{result.grade or 'no grade'}**: {escape(summary)}", f"checks: {summarize_checks(result.checks)}"]
    lines += [f"- {escape(warning)}" for warning in result.warnings]
    return "\n\n".join(lines[:2]) + "\n\n" + "\n".join(lines[2:])


def person_text(index: int, record: Mapping[str, Any], result: Reconstruction) -> str:
    """Return the numbers of a person.

    Args:
        index: of the person.
        record: of :func:`physic_viewer.report.people.people_records`.
        result: of the person.
    """
    lines = [f"**Person {index}**: {record['grade'] or 'no grade'}", ""]
    size, distance = result.scene.scale_sigma, result.distance_sigma
    lines += [
        f"- stature: {_metres(record['stature'], size)}",
        f"- to the camera: {_metres(record['camera'], distance)}",
        f"- pelvis over the floor: {_metres(record['pelvis_height'], size)}",
        f"- lowest point over the floor: {_metres(record['lowest'], size)}",
    ]
    for other in record["others"]:
        apart, gap = (_metres(other[name], distance) for name in ("pelvis", "gap"))
        lines.append(f"- to person {other['person']}: {apart}, gap {gap}")
    touching = [f"{row['part']} {row['cm2']:.0f} cm²" for row in record["contact"] or ()]
    lines.append(f"- contact: {', '.join(touching) or record['contact_vertices'] or 'none'}")
    failed = [str(check) for check in result.checks if check.person == index and check.failed]
    lines.append(f"- failed checks: {escape('; '.join(failed)) or 'none'}")
    return "\n".join(lines)


def legend_html(skin: str, results: Sequence[Reconstruction]) -> str:
    """Return what the colours of the bodies of results mean in a skin of the people; "" if there is nothing to say."""
    dot = "display:inline-block;width:0.8em;height:0.8em;border-radius:50%;border:1px solid #888;margin-right:0.4em"
    legend, title, note = dict[str, tuple[int, int, int]](), "", ""
    if skin == "photo" and any(result.people for result in results):
        legend = {"what the photo does not show": BODY_RGB}
    elif skin == "contact":
        legend, title, note = contact_legend(*results), "Contact with", FAINT if has_faint_contact(*results) else ""
    rows = [f'<div><span style="{dot};background:rgb{rgb}"></span>{label}</div>' for label, rgb in legend.items()]
    if not rows:
        return ""
    return f'<div style="padding:0 0.75em;font-size:0.85em">{title}{"".join(rows)}<div>{note}</div></div>'


def _metres(value: float | None, log_sigma: float | None) -> str:
    return "unknown" if value is None else metres_text(value, log_sigma)
