"""The presets paper and best: what they lack is said, each with how to get it; with stand-ins for all of it they run.

Stand-ins have the names, types and shapes of what is published, and answer from the truth of one world; what they
answer goes through the adapters as a published network's answer would.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from physic_core import Reconstruction, load_config
from physic_core.adapters import checkouts
from physic_core.cli import main
from physic_core.discovery.plugins import discover
from physic_testing.worlds import World, build_world

from .standins.checkouts import write_checkouts, write_checkpoints
from .standins.files import write_lama, write_moge_2, write_vitpose
from .standins.library import save_flux, save_networks, tell

SHARED = ("vitpose-h-wholebody", "wilor-mini", "https://github.com/warmshao/WiLoR-mini")
LACKING = {
    "paper": (
        *("grounding-dino-base-hf", "sam2.1-hiera-large-hf", "omnieraser", "depth-pro-hf", "moge-1-vitl", "camerahmr"),
        *("deco", "https://github.com/PRIS-CV/Omnieraser", "https://github.com/microsoft/MoGe"),
        *("https://github.com/pixelite1201/CameraHMR", "https://github.com/sha2nkt/deco"),
        *("hf download black-forest-labs/FLUX.1-dev", "https://smpl.is.tue.mpg.de", *SHARED),
    ),
    "best": (
        *("sam3-hf", "big-lama", "moge-2-vitl-normal", "sam-3d-body-vith"),
        *("https://github.com/facebookresearch/sam-3d-body", *SHARED),
    ),
}
"""Preset -> weights, code and files that it lacks where nothing is here."""


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """The variables of a shell in which no cache and no folder has any file."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PHYSIC", "HF_", "HUGGINGFACE", "XDG_"))}
    places = {name: tmp_path / name.lower() for name in ("PHYSIC_WEIGHTS", "PHYSIC_CACHE", "HF_HOME", "XDG_CACHE_HOME")}
    return kept | {name: str(place) for name, place in places.items()}


def physic(bare: dict[str, str], cwd: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from physic_core.cli import main; main()", *arguments]
    return subprocess.run(command, cwd=cwd, env=bare, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("preset", LACKING)
def test_missing_parts_of_a_preset_are_listed_with_the_way_to_get_them(
    preset: str, bare: dict[str, str], tmp_path: Path
) -> None:
    done = physic(bare, tmp_path, "config", "check", "--preset", preset)
    assert (done.returncode, done.stderr) == (4, "")
    for part in LACKING[preset]:
        assert part in done.stdout
    ways = (
        "physic weights fetch",
        "register at",
        "pip install",
        "git clone",
        "hf download",
        "https://",
        "a machine with",
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("  ")]
    assert all(any(way in line for way in ways) for line in lines), lines
    assert f"`physic setup {preset}` prints the steps" in done.stdout


PACKAGES = {
    "accelerate", "braceexpand", "diffusers", "einops", "loguru", "omegaconf", "peft", "pytorch_lightning", "roma",
    "smplx", "timm", "torchvision", "utils3d", "yacs",
}  # fmt: skip
"""What the repositories import, and their stand-ins do not."""


@pytest.fixture(scope="module")
def world() -> World:
    return build_world("sit_on_chair")


@dataclass(frozen=True)
class Place:
    """Where stand-ins for everything lie."""

    checkouts: dict[str, Path]
    smpl: Path


@pytest.fixture(scope="module")
def written(world: World, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Place]:
    folder = tmp_path_factory.mktemp("standins")
    weights, smpl = folder / "weights", folder / "SMPL_NEUTRAL.npz"
    save_networks(weights)
    write_checkpoints(weights, smpl)
    write_vitpose(weights / "vitpose-h-wholebody", world)
    write_moge_2(weights / "moge-2-vitl-normal", world)
    write_lama(weights / "big-lama", world)
    return weights, Place(write_checkouts(folder / "checkouts", world), smpl)


@pytest.fixture
def place(written: tuple[Path, Place], world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    """A folder with the world's photo, and stand-ins where a user would have the files."""
    exists = checkouts._exists
    monkeypatch.setattr(checkouts, "_exists", lambda module: module in PACKAGES or exists(module))
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(written[0]))
    # Stand-ins have the names of the published files, and other contents.
    monkeypatch.setattr(
        import_module("physic_core.weights.find"), "require_published_sha256", lambda path, file, advice: None
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    Image.fromarray(world.image).save("photo.png")
    return written[1]


def run(*arguments: str) -> Result:
    done = CliRunner().invoke(main, ["run", "photo.png", "-o", "out", *arguments])
    assert done.exit_code == 0, done.output
    return done


def require_no_fault(checked: Result) -> None:
    """Check that nothing is missing; stand-ins are not of the published sizes."""
    assert checked.exit_code == 0, checked.output
    head, *remarks = checked.output.splitlines()
    assert head.endswith(": no errors")
    assert all("instead of the published" in remark for remark in remarks), remarks


def backends_of(found: Reconstruction) -> dict[str, tuple[str, str, str]]:
    """Interface -> backend, distribution and licence of its weights, as the results say."""
    who = [stage.provenance for stage in found.stages if stage.provenance is not None]
    assert not any(stage.failed for stage in found.stages)
    return {p.interface: (p.backend, p.distribution, p.weights_license) for p in who}


def claimed(preset: str) -> dict[str, tuple[str, str, str]]:
    """The same, as the preset and the plugins say."""
    from physic_core.interfaces import INTERFACES

    registry, config = discover(), load_config(preset=preset)
    claims = {name: registry.get(name, config.choice(name).backend) for name in INTERFACES}
    return {
        name: (claim.record.name, claim.origin.distribution, claim.record.weights_license)
        for name, claim in claims.items()
    }


@dataclass(frozen=True)
class Score:
    """How near a run comes to the world.

    Attributes:
        joints: mean error of the 22 joints of the body, mm.
        contact: F1 over the vertices.
        depth: median error of the scene's depth, as a share.
    """

    joints: float
    contact: float
    depth: float


def judged(found: Reconstruction, world: World) -> Score:
    assert len(found.people) == len(world.vertices) == 1
    person = found.people[0]
    off = person.joints[:22] - world.joints[0, :22]
    touch = person.contact & world.contact[0]
    valid = found.scene.valid & np.isfinite(world.empty_depth)
    return Score(
        joints=1000 * float(np.linalg.norm(off, axis=1).mean()),
        contact=2 * float(touch.sum()) / float(person.contact.sum() + world.contact.sum()),
        depth=float(np.median(np.abs(found.scene.points[valid][:, 2] / world.empty_depth[valid] - 1))),
    )


def require_files(folder: Path) -> None:
    names = {"reconstruction.json", "reconstruction.npz", "combined.glb", "preview.png", "report.html", "people.csv"}
    assert {path.name for path in folder.iterdir()} == names
    assert (folder / "combined.glb").read_bytes()[:4] == b"glTF"


def write_papers_config(place: Place, flux: Path) -> None:
    """my.toml: the preset, with the stand-ins' files, on a CPU."""
    at = place.checkouts
    Path("my.toml").write_text(f"""
extends = "paper"
[run]
device = "cpu"
[inpainter.options]
checkout = "{at["Omnieraser"]}"
base = "{flux}"
allow_cpu = true
[relative_pointmap.options]
checkout = "{at["MoGe"]}"
[body_estimator.options]
checkout = "{at["CameraHMR"]}"
smpl_file = "{place.smpl}"
[hand_estimator.options]
checkout = "{at["WiLoR-mini"]}"
least_size_px = 5
[contact_prior.options]
checkout = "{at["deco"]}"
smpl_file = "{place.smpl}"
""")


def test_the_papers_pipeline_runs_from_photo_to_files(
    place: Place, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_flux(tmp_path / "flux", monkeypatch)
    asked = tell(monkeypatch, world)
    write_papers_config(place, tmp_path / "flux")
    require_no_fault(CliRunner().invoke(main, ["config", "check", "my.toml"]))
    run("--config", "my.toml")
    found = Reconstruction.load("out")
    score = judged(found, world)
    require_files(Path("out"))
    assert backends_of(found) == claimed("paper")
    assert asked == {"GroundingDinoForObjectDetection": 2, "Sam2Model": 1, "DepthProForDepthEstimation": 1}
    assert found.body_model == "embedded"
    assert any(note.startswith("bodies converted from 'smpl' to 'embedded'") for note in found.notes)
    assert f"contact transferred from the mesh 'smpl' to '{world.topology}'" in found.notes
    assert found.warnings == ()
    # The carried-over body has the mean shape, 3 % too large: keypoints put it too far away, and contact the scene too.
    assert score.joints < 150
    assert score.contact > 0.7
    assert score.depth < 0.06


@pytest.fixture
def best(place: Place) -> list[str]:
    """Flags of the preset, with the stand-ins' checkouts, on a CPU."""
    options = {
        "body_estimator.options.checkout": str(place.checkouts["sam-3d-body"]),
        "hand_estimator.options.checkout": str(place.checkouts["WiLoR-mini"]),
        "hand_estimator.options.least_size_px": "5",
        "run.device": "cpu",
    }
    return ["--preset", "best", *(part for key, value in options.items() for part in ("--set", f"{key}={value}"))]


@pytest.fixture
def on_a_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """SAM 3D Body's own code wants a GPU, of which the adapter makes sure; its stand-in does not."""
    from physic_human.sam3d_body import Sam3dBody

    monkeypatch.setattr(Sam3dBody, "load", Sam3dBody._build)


def test_the_best_pipeline_runs_from_photo_to_files(
    best: list[str], world: World, on_a_cpu: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = tell(monkeypatch, world)
    require_no_fault(CliRunner().invoke(main, ["config", "check", *best]))
    run(*best)
    found = Reconstruction.load("out")
    score = judged(found, world)
    require_files(Path("out"))
    assert backends_of(found) == claimed("best")
    assert asked == {"Sam3Model": 4}  # people, and three words for the floor
    assert found.body_model == "embedded"
    assert any(note.startswith("bodies converted from 'mhr' to 'embedded'") for note in found.notes)
    assert found.warnings == ()
    # The engine weighs all estimators as if they erred, and the contact of the static parts does: he is taken along.
    assert score.joints < 150
    assert score.contact > 0.35
    assert score.depth < 0.1


def test_without_a_gpu_the_best_bodies_are_refused_in_words(
    best: list[str], world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell(monkeypatch, world)
    done = CliRunner().invoke(main, ["run", "photo.png", "-o", "out", *best])
    assert (done.exit_code, done.stdout) == (2, "")
    assert "runs on a GPU only" in done.stderr
    assert not Path("out").exists()


def test_with_all_files_a_missing_gpu_is_reported_before_the_photo_is_read(
    best: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("physic_core.configuration.resolve.has_gpu", lambda: False)
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    wanted = [*best, "--set", "run.device=cuda"]
    checked = CliRunner().invoke(main, ["config", "check", *wanted])
    assert checked.exit_code == 2
    assert "run.device 'cuda': no GPU is found" in checked.output
    done = CliRunner().invoke(main, ["run", "no-such-photo.png", "-o", "out", *wanted])
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith("Error: device 'cuda' is not there: torch ")
    assert not (tmp_path / "out").exists()


def test_a_gpu_that_is_seen_is_left_to_torch(best: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("physic_core.configuration.resolve.has_gpu", lambda: True)
    wanted = [*best, "--set", "run.device=cuda"]
    require_no_fault(CliRunner().invoke(main, ["config", "check", *wanted]))
