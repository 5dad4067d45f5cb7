"""Missing files of chosen backends are reported at once, before any computation, by every command
that needs them.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import interfaces, load_config, reconstruct
from physic_core.discovery.backends import missing_requirements
from physic_core.errors import BackendError, WeightsMissingError

PLUGIN = """
from pathlib import Path
from pydantic import Field
from physic_core import interfaces
from physic_core.weights import fingerprint, locate, missing

MANIFEST = Path(__file__).parent / "physic_heavy_weights"

class Options(interfaces.Options):
    weights: str = Field(default="net", description="a set, or a path")

class Shared:
    written_for = 1
    Options = Options
    def missing(self):
        return missing(MANIFEST, self.options.weights)
    def fingerprint(self):
        return fingerprint(MANIFEST, self.options.weights)
    def load(self, device="cpu"):
        raise RuntimeError(f"loaded {locate(MANIFEST, self.options.weights)}")
    def infer(self, *arguments):
        raise RuntimeError("asked")

class Depth(Shared, interfaces.MetricDepth): pass
class Points(Shared, interfaces.RelativePointmap): pass
class Hands(Shared, interfaces.HandEstimator):
    def missing(self):
        return ("no checkout of hands in /x: git clone it there",)
"""
ENTRIES = """
[physic.metric_depth]
heavy = physic_heavy:Depth
[physic.relative_pointmap]
heavy = physic_heavy:Points
[physic.hand_estimator]
heavy-hands = physic_heavy:Hands
[physic.weights]
heavy = physic_heavy_weights
""".lstrip()
MANIFEST = """
[net]
summary = "A network"
license = "MIT"
commercial = true
[[net.files]]
path = "model.onnx"
bytes = 140852051
source = "https://example.org/model.onnx"
"""
NET = "weights 'net' (141 MB, MIT) are missing: `physic weights fetch net`"
HANDS = "no checkout of hands in /x: git clone it there"
CONFIG = """
extends = "mock"
[metric_depth]
backend = "heavy"
[relative_pointmap]
backend = "heavy"
[hand_estimator]
backend = "heavy-hands"
"""
BOTH = "metric_depth 'heavy' (physic-heavy 1.0) and relative_pointmap 'heavy' (physic-heavy 1.0)"


@pytest.fixture
def heavy(site, tmp_path, monkeypatch):
    """A plugin whose weights are not here; the folder that they would be found in."""
    site.install("physic-heavy", PLUGIN, entry=ENTRIES)
    (site.folder / "physic_heavy_weights").mkdir()
    (site.folder / "physic_heavy_weights" / "net.toml").write_text(MANIFEST)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "mine"))
    (tmp_path / "my.toml").write_text(CONFIG)
    return tmp_path / "mine" / "net"


def test_one_error_lists_all_that_is_missing_before_anything_is_computed(heavy):
    asked = []
    photo = np.zeros((72, 96, 3), np.uint8)
    with pytest.raises(WeightsMissingError) as caught:
        reconstruct(photo, load_config("my.toml"), progress=lambda name, *_: asked.append(name))
    assert str(caught.value).splitlines()[1:] == [
        f"  {BOTH}: {NET}",
        f"  hand_estimator 'heavy-hands' (physic-heavy 1.0): {HANDS}",
    ]
    assert asked == []


def test_config_check_reports_a_valid_config_and_missing_files(heavy, physic):
    done = physic("config", "check", "--config", "my.toml")
    assert done.exit_code == 4
    assert done.stdout.startswith("my.toml: no errors\n2 things are missing")
    assert f"{BOTH}: {NET}\n" in done.stdout


def saying(answer):
    def say(self):
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return type(
        "Own", (interfaces.MetricDepth,), {"missing": say, "infer": lambda self, image, hints: None}
    )


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (RuntimeError("no disk"), "RuntimeError: no disk"),
        (SystemExit(2), "SystemExit: 2"),
        ("model.onnx", "must return a tuple of texts, got 'model.onnx'"),
        (BackendError("this weight manifest is invalid"), "this weight manifest is invalid"),
    ],
)
def test_an_invalid_result_of_missing_is_a_backend_error(answer, says):
    with pytest.raises(BackendError, match=says):
        missing_requirements(saying(answer)())
