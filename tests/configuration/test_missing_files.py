"""What chosen backends lack is told at once, before anything is computed, and by every command that looks at them."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from physic_core import interfaces, load_config, reconstruct
from physic_core.cli import main
from physic_core.configuration.resolve import missing_files, missing_gpu, require_available, resolve
from physic_core.discovery.plugins import discover
from physic_core.discovery.readiness import missing_requirements
from physic_core.discovery.registry import BackendRecord, Registry
from physic_core.errors import BackendError, WeightsMissingError
from physic_core.interfaces import INTERFACES
from physic_core.pipeline.run import reconstruct_photo
from physic_testing import check_backend
from physic_testing.commands.doctor import try_backend
from physic_testing.conformance.compare import compare

PLUGIN = """
from pathlib import Path
from pydantic import Field
from physic_core import BackendRecord, hookimpl, interfaces
from physic_core.weights import fingerprint, locate, missing

MANIFEST = Path(__file__).parent / "physic_heavy.toml"

class Options(interfaces.Options):
    weights: str = Field(default="net", description="a set, or a path")

class Shared:
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

@hookimpl
def physic_backends():
    return [
        BackendRecord("metric_depth", "heavy", "physic_heavy:Depth", api=1, needs=("weights",)),
        BackendRecord("relative_pointmap", "heavy", "physic_heavy:Points", api=1, needs=("weights",)),
        BackendRecord("hand_estimator", "heavy-hands", "physic_heavy:Hands", api=1),
    ]

@hookimpl
def physic_weights():
    return MANIFEST
"""
PLUGIN_WITH_SEED = (
    PLUGIN.replace("physic_heavy", "physic_slow")
    .replace('"heavy', '"slow')
    .replace("class Shared", "    noise_seed: int = Field(default=0, description='draws errors')\n\nclass Shared")
)
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
def heavy(site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plugin whose weights are not here; the folder that they would be found in."""
    site.install("physic-heavy", PLUGIN)
    (site.folder / "physic_heavy.toml").write_text(MANIFEST)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "mine"))
    (tmp_path / "my.toml").write_text(CONFIG)
    return tmp_path / "mine" / "net"


def physic(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def bring(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "model.onnx").write_bytes(b"net")


def test_one_error_lists_all_that_is_missing_before_anything_is_computed(heavy: Path):
    asked: list[str] = []
    with pytest.raises(WeightsMissingError) as caught:
        reconstruct(
            np.zeros((72, 96, 3), np.uint8), load_config("my.toml"), progress=lambda name, *_: asked.append(name)
        )
    assert str(caught.value) == (
        "2 things are missing, and nothing was computed:\n"
        f"  {BOTH}: {NET}\n"
        f"  hand_estimator 'heavy-hands' (physic-heavy 1.0): {HANDS}"
    )
    assert asked == []


def test_run_lists_missing_files_and_leaves_no_folder(heavy: Path, repository: Path, tmp_path: Path):
    photo = repository / "examples" / "couple.jpg"
    done = physic("run", str(photo), "--config", "my.toml", "-o", "out")
    assert (done.exit_code, done.stdout) == (4, "")
    assert done.stderr.startswith("Error: 2 things are missing, and nothing was computed:\n  metric_depth 'heavy'")
    assert not (tmp_path / "out").exists()


def test_it_is_said_before_the_photo_is_read(heavy: Path):
    with pytest.raises(WeightsMissingError, match="2 things are missing"):
        reconstruct_photo("no-such-photo.png", load_config("my.toml"))
    done = physic("run", "no-such-photo.png", "--config", "my.toml")
    assert done.stderr.startswith("Error: 2 things are missing, and nothing was computed:\n")
    bring(heavy)
    done = physic("run", "no-such-photo.png", "--config", "my.toml", "--set", "hand_estimator.backend=none")
    assert "no-such-photo.png" in done.stderr


def test_the_benchmark_lists_missing_files_before_it_builds_a_world(site, heavy: Path, tmp_path: Path):
    choice = "metric_depth={backend='slow', options={noise_seed=0}}"
    site.install("physic-slow", PLUGIN_WITH_SEED)
    (site.folder / "physic_slow.toml").write_text(MANIFEST)
    done = physic("bench", "accuracy", "--worlds", "1", "--set", choice, "--no-cache", "-o", "bench")
    assert (done.exit_code, done.stdout, done.stderr) == (
        4,
        "",
        f"Error: 1 thing is missing, and nothing was computed:\n  metric_depth 'slow' (physic-slow 1.0): {NET}\n",
    )
    assert not (tmp_path / "bench").exists()


def test_config_check_reports_a_valid_config_and_missing_files(heavy: Path):
    done = physic("config", "check", "my.toml")
    assert (done.exit_code, done.stdout) == (
        4,
        "my.toml: no errors\n"
        "2 things are missing; a run would stop:\n"
        f"  {BOTH}: {NET}\n"
        f"  hand_estimator 'heavy-hands' (physic-heavy 1.0): {HANDS}\n"
        "remark: 1 of 1 weight files are published without a SHA-256 or a revision\n",
    )


def test_config_check_lists_nothing_if_nothing_is_missing(heavy: Path):
    bring(heavy)
    with (heavy / "model.onnx").open("r+b") as file:
        file.truncate(140852051)
    done = physic("config", "check", "my.toml", "--set", "hand_estimator.backend=none")
    assert (done.exit_code, done.stdout) == (0, "my.toml: no errors\n")


def test_a_file_of_another_size_is_remarked_once_and_stops_nothing(heavy: Path):
    bring(heavy)
    done = physic("config", "check", "my.toml")
    assert (done.exit_code, done.stdout) == (
        4,
        "my.toml: no errors\n"
        "1 thing is missing; a run would stop:\n"
        f"  hand_estimator 'heavy-hands' (physic-heavy 1.0): {HANDS}\n"
        "remark: 1 of 1 weight files are published without a SHA-256 or a revision\n"
        "remark: weights 'net' are found, but model.onnx has 3 bytes instead of the published 140852051: "
        "`physic weights verify net`\n",
    )


def test_resolving_alone_needs_no_file(heavy: Path):
    plan = resolve(load_config("my.toml"), discover())
    assert len((*missing_files(plan), *missing_gpu(plan))) == 2
    with pytest.raises(WeightsMissingError):
        require_available(plan)


def test_the_doctor_calls_it_missing_and_loads_nothing(heavy: Path):
    done = physic("plugins", "doctor", "heavy")
    assert (done.exit_code, done.stdout) == (
        0,
        f"missing  metric_depth 'heavy' (physic-heavy 1.0): {NET}\n"
        f"missing  relative_pointmap 'heavy' (physic-heavy 1.0): {NET}\n"
        "2 checked: 0 ok, 2 missing, 0 broken\n",
    )


def test_show_lists_missing_files_and_search_folders(heavy: Path, tmp_path: Path):
    def shown() -> list[str]:
        lines = physic("plugins", "show", "heavy").stdout.split("\n\n")[0].splitlines()
        return [line for line in lines if line.startswith(("  status", "  files"))]

    status, files = shown()
    assert status == f"  status    NOT READY: {NET}"
    assert files.startswith(
        f"  files     'net' is missing; searched: {heavy}, {tmp_path / 'cache' / 'physic' / 'weights' / 'net'}"
    )
    bring(heavy)
    assert shown() == [
        "  status    unsure: needs weights; `physic plugins doctor heavy` checks it",
        f"  files     {heavy / 'model.onnx'}",
    ]


def test_the_listing_imports_nothing_and_is_unsure(heavy: Path):
    (row,) = [
        line for line in physic("plugins").stdout.splitlines() if line.startswith("metric_depth") and "heavy" in line
    ]
    assert row.endswith("unsure: needs weights; `physic plugins doctor heavy` checks it")


NAMED = PLUGIN.replace('needs=("weights",)', 'needs=("weights",), weights=("net",)')


def statuses() -> dict[str, str]:
    """The status of what the plugin offers, by interface, as the listing tells it."""
    return {
        one["interface"]: ": ".join(filter(None, (one["status"], one["why"])))
        for one in json.loads(physic("plugins", "--json").stdout)["backends"]
        if one["distribution"] == "physic-heavy"
    }


def test_the_listing_looks_for_the_weights_that_a_record_names(heavy: Path, site):
    (site.folder / "physic_heavy.py").write_text(NAMED)
    assert statuses()["metric_depth"] == "not ready: missing: net"
    bring(heavy)
    assert statuses()["metric_depth"] == "ready"


@pytest.mark.parametrize(
    ("record", "list_of_sets"), [('weights=("nut",)', MANIFEST), ('weights=("net",)', "no TOML")], ids=["name", "list"]
)
def test_the_listing_is_unsure_of_weights_that_no_list_has(heavy: Path, site, record: str, list_of_sets: str):
    (site.folder / "physic_heavy.py").write_text(NAMED.replace('weights=("net",)', record))
    (site.folder / "physic_heavy.toml").write_text(list_of_sets)
    assert statuses()["metric_depth"] == "unsure: needs weights; `physic plugins doctor heavy` checks it"


def test_the_kit_runs_no_check_of_a_backend_that_is_not_ready(heavy: Path):
    report = check_backend("heavy", "metric_depth", size=(96, 72))
    assert report.failures == ()
    assert report.not_run_reason == f"not ready: {NET}"
    done = physic("plugins", "check", "heavy", "--interface", "metric_depth", "--json")
    assert (done.exit_code, json.loads(done.stdout)[0]["not_asked"]) == (4, f"not ready: {NET}")


def test_a_comparison_states_why_a_backend_has_no_result(heavy: Path):
    found = compare("metric_depth", ["heavy"], worlds=[("stand", 0)], size=(96, 72))
    assert found.rows[0].problem == f"not ready: {NET}"


# ---- backends that cannot say what they lack -------------------------------------------------------------------------


def saying(answer: object) -> type[interfaces.Backend]:
    def say(self: object) -> object:
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return type("Own", (interfaces.MetricDepth,), {"missing": say, "infer": lambda self, image, hints: None})


WRONG = [
    (RuntimeError("no disk"), "missing() fails: RuntimeError: no disk (tests/configuration/test_missing_files.py:{})"),
    (SystemExit(2), "missing() fails: SystemExit: 2 (tests/configuration/test_missing_files.py:{})"),
    (None, "missing() must return a tuple of texts, got None"),
    ("model.onnx", "missing() must return a tuple of texts, got 'model.onnx'"),
    ([Path("x")], f"missing() must return a tuple of texts, got {[Path('x')]!r}"),
    (BackendError("this weight manifest is invalid:"), "this weight manifest is invalid:"),
]


@pytest.mark.parametrize(("answer", "says"), WRONG, ids=[says for _, says in WRONG])
def test_an_invalid_result_of_missing_is_a_backend_error(answer: object, says: str):
    with pytest.raises(BackendError) as caught:
        missing_requirements(saying(answer)())
    line = saying.__code__.co_firstlineno + 3
    assert str(caught.value) == says.replace("{}", str(line))


def test_a_weights_missing_error_counts_as_a_missing_file():
    assert missing_requirements(saying(WeightsMissingError("no file x: get it"))()) == ("no file x: get it",)


def test_a_backend_without_the_method_missing_is_complete():
    assert (
        missing_requirements(type("Own", (interfaces.MetricDepth,), {"infer": lambda self, image, hints: None})()) == ()
    )


def test_a_wrong_missing_method_is_named_by_every_command():
    registry = Registry(installed=False)
    for name, base in INTERFACES.items():
        kind = saying(None) if name == "metric_depth" else type("Own", (base,), {"infer": lambda self, *a: None})
        registry.register(BackendRecord(name, "own", kind, api=1))
    config = load_config(flags={"config": {name: {"backend": "own"} for name in INTERFACES}})
    with pytest.raises(BackendError) as caught:
        require_available(resolve(config, registry))
    says = "missing() must return a tuple of texts, got None"
    assert str(caught.value) == f"metric_depth 'own' (registered by hand): {says}"
    claim = registry.get("metric_depth", "own")
    assert str(try_backend(registry, claim, "cpu")) == f"BROKEN   metric_depth 'own' (registered by hand): {says}"
    report = check_backend("own", "metric_depth", registry=registry, size=(96, 72))
    assert [(f.check, f.got) for f in report.failures] == [("loads_or_reports_what_is_missing", says)]


def test_a_backend_whose_missing_method_uses_the_network_fails_the_kit():
    import socket

    def look(self):
        with suppress(OSError):
            socket.create_connection(("example.org", 443), timeout=1)
        return ()

    kind = type("Own", (interfaces.MetricDepth,), {"missing": look, "infer": lambda self, image, hints: None})
    report = check_backend(kind, size=(96, 72))
    failure = next(f for f in report.failures if f.check == "loads_or_reports_what_is_missing")
    assert (failure.expected, failure.got) == ("missing() to use no network", "it requests example.org")
