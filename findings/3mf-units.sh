#!/bin/sh
# A 3MF file, from which a figure of a person is printed, states unit="meter" and a height of 1.8. Two programs read it
# and write it again as 3MF.
# Guessed: the height is 1.8 m afterwards, as 1.8 with the unit or as 1800 mm.
# Measured on 2026-12-01 with trimesh 5.2.0 and PyMeshLab 2025.7.post1: both write 1.8 in millimeters, in silence,
# although trimesh read the unit. The person is 1.8 mm tall.
# Readers guessed: wrong for trimesh, right, wrong for trimesh; right for PyMeshLab.
. "$(dirname "$0")/common.sh"
install trimesh==5.2.0 pymeshlab==2025.7.post1 lxml==6.1.3 networkx==3.6.1 numpy==2.4.6
python - <<'PYTHON'
import re
import zipfile
from importlib.metadata import version

import pymeshlab
import trimesh

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
points = [(0, 0, 0), (1, 0, 0), (0, 0, 1.8), (0, 1, 0)]
faces = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points)
triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
model = (
    f'<model unit="meter" xmlns="{CORE}"><resources><object id="1" type="model">{mesh}</object></resources>'
    '<build><item objectid="1"/></build></model>'
)
kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
link = f'<Relationships xmlns="{PACKAGE}/relationships"><Relationship Target="/3D/3dmodel.model" Id="r" Type="{kind}"/></Relationships>'
types = (
    f'<Types xmlns="{PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
with zipfile.ZipFile("person.3mf", "w") as package:
    package.writestr("[Content_Types].xml", types)
    package.writestr("_rels/.rels", link)
    package.writestr("3D/3dmodel.model", model)


def unit_and_height(path: str) -> tuple[str, float]:
    with zipfile.ZipFile(path) as package:
        text = next(package.read(name).decode() for name in package.namelist() if name.endswith(".model"))
    unit = re.search(r'unit="(\w+)"', text)
    return unit[1] if unit else "millimeter", round(max(map(float, re.findall(r' z="([^"]+)"', text))), 3)


scene = trimesh.load_scene("person.3mf")
scene.export("trimesh.3mf")
meshes = pymeshlab.MeshSet()
meshes.load_new_mesh("person.3mf")
meshes.save_current_mesh("pymeshlab.3mf")
written = [unit_and_height(path) for path in ("trimesh.3mf", "pymeshlab.3mf")]
print(
    f"trimesh {version('trimesh')} reads the unit {scene.units}, writes {written[0]}; "
    f"PyMeshLab {version('pymeshlab')} writes {written[1]}"
)
if scene.units not in ("meter", "meters") or written != [("millimeter", 1.8), ("millimeter", 1.8)]:
    raise SystemExit("the behaviour has changed")
PYTHON
