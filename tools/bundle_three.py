"""Bundle what the report page uses of three.js to
``plugins/visual/physic_visual/report/page/vendor/three.js``.

Needs node and npm, and fetches the packages ``three`` and ``esbuild`` in the versions below to a
temporary folder. Run from the repository's root:

    python tools/bundle_three.py          # writes three.js and three.sha256
    python tools/bundle_three.py --check  # compares with the committed bundle instead

The result depends only on the two versions. It starts with the licence of three.js, so that each
page that contains the bundle contains the notice too. The one address in three.js, the name of a
namespace that elements have anyway, is removed: a page has no address in it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

THREE = "0.187.0"
ESBUILD = "0.28.2"
VENDOR = (
    Path(__file__).resolve().parents[1]
    / "plugins"
    / "visual"
    / "physic_visual"
    / "report"
    / "page"
    / "vendor"
)
ENTRY = """
export {
  Box3, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, Float32BufferAttribute,
  Group, HemisphereLight, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial,
  PerspectiveCamera, PlaneGeometry, Points, PointsMaterial, Raycaster, SRGBColorSpace, Scene, SphereGeometry, Texture,
  Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
"""  # noqa: E501
NAMESPACED = "document.createElementNS( 'http://www.w3.org/1999/xhtml', name )"


def bundle(folder: Path) -> str:
    """Fetch the packages to a folder and return the bundle."""
    (folder / "package.json").write_text(
        json.dumps({"dependencies": {"three": THREE, "esbuild": ESBUILD}})
    )
    subprocess.run(["npm", "install", "--ignore-scripts", "--silent"], cwd=folder, check=True)
    three = folder / "node_modules" / "three"
    assert json.loads((three / "package.json").read_text())["version"] == THREE
    core = three / "build" / "three.core.js"
    text = core.read_text(encoding="utf-8")
    assert text.count(NAMESPACED) == 1, "createElementNS has changed: look at it again"
    core.write_text(text.replace(NAMESPACED, "document.createElement( name )"), encoding="utf-8")
    (folder / "entry.js").write_text(ENTRY)
    options = [
        "--bundle",
        "--minify",
        "--format=iife",
        "--global-name=THREE",
        "--legal-comments=none",
        "--target=es2022",
    ]
    command = [
        "node_modules/.bin/esbuild",
        "entry.js",
        *options,
        "--charset=ascii",
        "--outfile=three.js",
    ]
    subprocess.run([*command, "--log-level=warning"], cwd=folder, check=True)
    licence = (three / "LICENSE").read_text(encoding="utf-8").strip()
    script = (
        f"/*!\nthree.js {THREE}, with OrbitControls; bundled by "
        f"tools/bundle_three.py\n\n{licence}\n*/\n"
    )
    script += (folder / "three.js").read_text(encoding="utf-8").strip() + "\n"
    for wrong in ("http:", "https:", "</script", "<!--"):
        assert wrong not in script, f"{wrong} is in the bundle"
    return script


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="compare with the committed bundle")
    check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as folder:
        content = bundle(Path(folder)).encode("utf-8")
    digest = hashlib.sha256(content).hexdigest()
    if check:
        same = (VENDOR / "three.js").read_bytes() == content
        sys.exit(0 if same else f"three.js has another content than {digest}")
    (VENDOR / "three.js").write_bytes(content)
    (VENDOR / "three.sha256").write_text(f"{digest}  three.js\n")
    print(f"three.js: {len(content)} bytes, {digest}")


if __name__ == "__main__":
    main()
