"""Find the formats of ``physic export``: the GLB of the core, and those of installed plugins."""

from __future__ import annotations

from physic_core.discovery.catalog import EXPORTERS, how_to_install
from physic_core.discovery.hooks import ExporterRecord
from physic_core.discovery.plugins import Found, explain_absence, find_items
from physic_core.errors import InputError, PackageMissingError

_GLB = ExporterRecord(
    "glb",
    (".glb",),
    "physic_core.visual.glb:export_glb",
    "Blender, Unity, Unreal, three.js",
    "skinned bodies, skeletons, contact, scene, floor, camera",
    stem="skinned",
)

_ELSEWHERE = {
    "fbx": (
        "FBX is a closed format that PhySIC does not write: export the skinned GLB (--to glb) and convert it with "
        "Blender, as docs/exports.md shows"
    ),
    "gltf": "the export is binary glTF: use --to glb, and a path that ends in .glb",
    "pkl": "pickles can run code when they are read: use --to amass, which writes .npz",
    "mp4": "a photo has no motion: use preview.png of the result",
}
"""What to do in place of formats that no installed plugin writes."""


def find_exporters() -> tuple[Found[ExporterRecord], ...]:
    """Return the exporters of all installed plugins, sorted by name, and the core's GLB if no plugin writes one.

    Nothing of them is imported.
    """
    found = find_items("physic_exporters")
    if not any(exporter.record.name == _GLB.name for exporter in found):
        found = (Found(_GLB, "physic-core"), *found)
    return tuple(sorted(found, key=lambda exporter: exporter.record.name))


def find_exporter(name: str | None, suffix: str = "") -> Found[ExporterRecord]:
    """Return the exporter of a format by its name or, without a name, by a file suffix (".glb").

    Its ``record`` is an :class:`physic_core.ExporterRecord`, its ``distribution`` the plugin's name.

    Raises:
        InputError: no format has this name or suffix, or several have; the message names a known distribution that
            writes the format.
        PackageMissingError: a package that the format needs is not installed.
    """
    exporters = find_exporters()
    wanted = (name or suffix.removeprefix(".")).lower()
    found = [e for e in exporters if (e.record.name == wanted if name else suffix.lower() in e.record.suffixes)]
    if len(found) == 1:
        kind = found[0].record
        if kind.missing_packages:
            install = f": {how_to_install(found[0].distribution, kind.extra)}" if kind.extra else ""
            raise PackageMissingError(
                f"export to {kind.name} needs {', '.join(kind.missing_packages)}, which is not installed{install}"
            )
        return found[0]
    if found:
        names = " or ".join(dict.fromkeys(each.record.name for each in found))
        if len({each.record.name for each in found}) == len(found):
            raise InputError(f"a file {suffix} can be {names}: state which (--to, or format= in Python)")
        owners = " and ".join(sorted(each.distribution for each in found))
        raise InputError(f"the export format {names} is offered by {owners}: uninstall one of them")
    if wanted in _ELSEWHERE:
        raise InputError(f"cannot export to '{wanted}': {_ELSEWHERE[wanted]}")
    if wanted in EXPORTERS:
        raise InputError(f"the export format '{wanted}' needs {explain_absence(EXPORTERS[wanted])}")
    known = [each.record.name for each in exporters]
    choose = f"choose one of {', '.join(known)}"
    if absent := [other for other in EXPORTERS if other not in known]:
        choose += f"; {', '.join(absent)} are in {explain_absence(EXPORTERS[absent[0]])}"
    if name:
        raise InputError(f"there is no export format '{name}': {choose}")
    what = f"'{suffix}' is the suffix of none" if suffix else "the path has no suffix"
    raise InputError(f"no export format is given, and {what}: {choose} (--to, or format= in Python)")
