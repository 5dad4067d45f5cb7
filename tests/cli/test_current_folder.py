"""No command takes a module from the current folder, whatever the libraries that it uses try to
import.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from PIL import Image

from physic_testing.worlds import load_world

pytestmark = pytest.mark.slow

ALWAYS = (
    "IPython",
    "cupy",
    "sitecustomize",
    "usercustomize",
    "pydantic_settings",
    "colorama",
    "physic_mine",
)
"""Names that may be tried elsewhere, if not on this machine."""

RECORD = """
import json, sys

class Recorder:
    names = set()
    def find_spec(self, name, path=None, target=None):
        if path is None:
            self.names.add(name)

sys.meta_path.append(Recorder())
from physic_core.cli import main
main(sys.argv[1:], standalone_mode=False)
loaded = {name.partition(".")[0] for name in sys.modules}
print(json.dumps({"absent": sorted(Recorder.names), "loaded": sorted(loaded)}))
"""

POISON = """
import os
with open(os.environ["POISON_MARKER"], "a") as marker:
    marker.write(__name__ + "\\n")
raise ImportError("a module of the current folder was imported")
"""


def python(folder, *arguments, code=0):
    environment = os.environ | {
        "PHYSIC_CACHE": "off",
        "POISON_MARKER": str(folder.parent / "marker"),
    }
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """Top-level names that a run imports, and those that it tries in vain."""
    folder = tmp_path_factory.mktemp("clean") / "here"
    folder.mkdir()
    photo(folder)
    names = json.loads(python(folder, "-P", "-c", RECORD, *RUN).splitlines()[-1])
    return names


# No module depends on the number of pixels or steps.
SMALL = (
    "engine.joint.optimiser.steps=2",
    "relative_pointmap.options.short_side=154",
    "segmenter.options.tile_fractions=[]",
)
RUN = (
    "run",
    "photo.png",
    "-o",
    "out",
    "--preset",
    "light-cpu",
    *(word for one in SMALL for word in ("--set", one)),
)
COMMANDS = [
    RUN,
    ("plugins",),
    ("plugins", "doctor", "embedded", "--interface", "inpainter"),
    ("batch", *RUN[1:], "--workers", "1", "--save", "none", "--no-thumbnails"),
    ("config", "check"),
    ("--version",),
]


def photo(folder):
    Image.fromarray(load_world("stand").image).save(folder / "photo.png")


@pytest.fixture
def poisoned(names, tmp_path):
    """A folder in which every name that a run imports or tries to import is a module that leaves a
    mark.
    """
    folder = tmp_path / "here"
    folder.mkdir()
    photo(folder)
    for name in (*names["absent"], *names["loaded"], *ALWAYS):
        (folder / f"{name}.py").write_text(POISON)
    (folder / "mine.pth").write_text("import physic_mine\n")
    (folder / "physic.toml").write_text('[segmenter]\nbackend = "physic_mine:Segmenter"\n')
    return folder


def test_a_module_of_the_current_folder_would_be_noticed(poisoned):
    python(poisoned, "-c", "import physic_mine", code=1)
    assert (poisoned.parent / "marker").read_text() == "physic_mine\n"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:4]))
def test_physic_imports_nothing_of_the_current_folder(poisoned, command):
    script = poisoned.parent / "physic"  # as pip makes it
    script.write_text(
        "from physic_core.cli import main\n\nif __name__ == '__main__':\n    main()\n"
    )
    python(poisoned, str(script), *command)
    assert not (poisoned.parent / "marker").exists(), (poisoned.parent / "marker").read_text()


@pytest.mark.parametrize("command", COMMANDS[1:3], ids=" ".join)
def test_python_m_physic_core_imports_nothing_of_the_current_folder(poisoned, names, command):
    """Python itself takes modules from there until the first line of ours is reached: its own
    library only.
    """
    for name in sys.stdlib_module_names:
        (poisoned / f"{name}.py").unlink(missing_ok=True)
    (poisoned / "physic_core.py").unlink()
    python(poisoned, "-m", "physic_core", *command)
    assert not (poisoned.parent / "marker").exists(), (poisoned.parent / "marker").read_text()
