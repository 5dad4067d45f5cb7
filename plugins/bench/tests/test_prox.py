"""``physic evaluate prox`` on a miniature of the set: every metric has a known answer."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from physic_bench.data_files import picture_file
from physic_bench.datasets.base import FrameChoice
from physic_bench.datasets.prox import DATA_SET
from physic_core.body.joints import JOINT_NAMES
from physic_core.errors import OutputError

from .miniatures import figures, run, write_plain
from .prox_miniature import TO_SCENE, Miniature, write_prox


@pytest.fixture(scope="session")
def written(files, tmp_path_factory):
    return write_prox(tmp_path_factory.mktemp("prox") / "quantitative", files)


@pytest.fixture
def mini(written, tmp_path):
    """A copy that a test may damage."""
    shutil.copytree(written.root, tmp_path / "quantitative")
    return Miniature(
        tmp_path / "quantitative", written.vertices, written.joints, written.height, written.faces
    )


def run_on_results(mini, files, tmp_path, move=lambda points: points, smplx=None):
    """Evaluate the true bodies, moved, with contact within 2 cm of the floor."""
    for name, vertices in mini.vertices.items():
        write_plain(
            tmp_path / "theirs",
            name,
            vertices=move(vertices)[None],
            contact=mini.height[name][None] <= 0.02,
            joints=move(mini.joints[name])[None, :22],
            joint_names=np.array(JOINT_NAMES[:22]),
        )
    theirs = ("--results", f"theirs=plain:{tmp_path / 'theirs'}")
    models = ("--smplx", str(smplx)) if smplx else files.arguments()
    return run("prox", str(mini.root), "-o", str(tmp_path / "out"), *theirs, *models)


def evaluated(mini, files, tmp_path, **options):
    done = run_on_results(mini, files, tmp_path, **options)
    assert done.exit_code == 0, done.output
    return figures(tmp_path / "out", "theirs")


def test_the_truth_itself_has_no_error(mini, files, tmp_path):
    values = evaluated(mini, files, tmp_path)
    for key in ("me_mpjpe", "pa_mpjpe", "rt_error", "me_pve", "ca_pve", "pa_pve"):
        assert values[key] == pytest.approx(0, abs=0.01), key
    for key in ("precision", "recall", "f1_of_means", "f1_mean", "f1_pooled"):
        assert values[f"{key}@2 cm"] == 1
    assert values["penetration_mm"] == 0
    recall = np.mean([(h <= 0.02).sum() / (h <= 0.05).sum() for h in mini.height.values()])
    assert values["recall@5 cm"] == pytest.approx(recall)
    gaps = np.mean([1000 * h[h <= 0.02].mean() for h in mini.height.values()])
    assert values["floating_mm"] == pytest.approx(gaps, abs=0.01)


def test_a_shift_of_5_cm_down_has_an_error_of_5_cm_in_every_measure(mini, files, tmp_path):
    down = -0.05 * TO_SCENE[2, :3]
    values = evaluated(mini, files, tmp_path, move=lambda points: points + down)
    deep = np.mean([1000 * (0.05 - h[h < 0.05]).mean() for h in mini.height.values()])
    wanted = {
        "me_mpjpe": 50,
        "me_pve": 50,
        "rt_error": 50,
        "ca_mpjpe": 0,
        "pa_pve": 0,
        "penetration_mm": deep,
        "penetration_max_mm": 40,
        "floating_mm": 0,
    }
    assert {key: values[key] for key in wanted} == pytest.approx(wanted, abs=0.01)


def frames_of(mini, files):
    return DATA_SET.frames(mini.root, FrameChoice(), files.bodies, mini.mesh_frame)


@pytest.mark.parametrize("frame", ["camera", "scene"])
def test_meshes_are_in_the_stated_frame(files, tmp_path, frame):
    mini = write_prox(tmp_path / "quantitative", files, frame)
    first = frames_of(mini, files).frames[0]
    vertices = first.truth().people[0].vertices
    np.testing.assert_allclose(vertices, mini.vertices[first.id], atol=1e-5)


def test_a_transposed_rotation_is_refused(mini, files, tmp_path):
    file = mini.root / "cam2world" / "vicon.json"
    matrix = np.array(json.loads(file.read_text()))
    matrix[:3, :3] = matrix[:3, :3].T
    file.write_text(json.dumps(matrix.tolist()))
    done = run_on_results(mini, files, tmp_path)
    assert done.exit_code != 0
    assert "do not project onto the annotated people" in done.output


def test_pictures_are_mirrored_before_use_and_replace_no_other_picture(mini, files, tmp_path):
    frame = frames_of(mini, files).frames[0]
    path = picture_file(frame, tmp_path / "pictures")
    written = path.stat().st_mtime_ns
    assert picture_file(frame, tmp_path / "pictures").stat().st_mtime_ns == written
    with Image.open(path) as picture:
        left = picture.getpixel((10, 10))
        right = picture.getpixel((470, 10))
    assert left[0] > 240
    assert right[0] < 15
    assert frame.camera.distortion == (0.02, -0.03, 0.001, 0.0005, 0.01)
    shutil.copy(frame.picture.path, path)
    with pytest.raises(OutputError, match="did not write"):
        picture_file(frame, tmp_path / "pictures")


def test_a_model_file_of_another_gender_is_refused(mini, files, tmp_path):
    neutral = files.bodies.smplx / "SMPLX_NEUTRAL.npz"
    done = run_on_results(mini, files, tmp_path, smplx=neutral)
    assert done.exit_code != 0
    assert "posed by SMPLX_NEUTRAL.npz, is" in done.output


def test_a_damaged_scan_is_an_error_and_gives_no_table(mini, files, tmp_path):
    scan = mini.root / "scenes" / "vicon.ply"
    scan.write_bytes(scan.read_bytes()[: scan.stat().st_size // 2])
    done = run_on_results(mini, files, tmp_path)
    assert done.exit_code == 3
    assert f"Error: no frame can be evaluated: {scan} cannot be" in done.output
    assert not (tmp_path / "out" / "table.txt").exists()
