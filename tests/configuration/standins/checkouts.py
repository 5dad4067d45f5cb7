"""Stand-ins for the repositories that backends run: the published names and signatures, and the truth of one world.

What they know lies beside them in ``truth.npz``; nothing of the project is imported by them.
"""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter, map_coordinates

from physic_testing.body_files import mano_arrays, write_published
from physic_testing.conformance.true_keypoints import world_keypoints, world_mhr_keypoints
from physic_testing.worlds import World

from .files import relative_points
from .neighbours import neighbour
from .pictures import on_grid

TRUTH = """
import pathlib
import numpy as np
import torch

FILE = pathlib.Path(__file__).parents[DEPTH] / "truth.npz"
TRUTH = {key: torch.from_numpy(value) for key, value in np.load(FILE).items()}
"""

MOGE = """
class MoGeModel(torch.nn.Module):
    num_tokens_range = [1200, 2500]
    mask_threshold = 0.5

    @classmethod
    def from_pretrained(cls, pretrained_model_name_or_path, model_kwargs=None, **hf_kwargs):
        assert set(torch.load(pretrained_model_name_or_path, weights_only=True)) == {"model_config", "model"}
        return cls()

    def forward(self, image, num_tokens):
        assert 1200 <= num_tokens <= 2500 and image.shape[:2] == (1, 3)
        apart = [(image[0].permute(1, 2, 0) * 255 - TRUTH[name].float()).abs().mean() for name in ("full", "empty")]
        assert min(apart) < 3, "another picture than the world's, in red, green, blue"
        which = "full" if apart[0] < apart[1] else "empty"
        return {"points": TRUTH[f"{which}_points"][None], "mask": TRUTH[f"{which}_mask"][None]}
"""

IMAGENET = """
MEAN, STD = (torch.tensor(row)[:, None, None] for row in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)))

"""
CAMERAHMR = (
    IMAGENET
    + """
class CameraHMR(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))

    def forward(self, batch):
        count = len(batch["img"])
        assert batch["img"].shape == (count, 3, 256, 256) and batch["cam_int"].shape == (count, 3, 3)
        shown = torch.nn.functional.avg_pool2d(batch["img"] * STD + MEAN, 8).permute(0, 2, 3, 1) * 255
        assert (shown - TRUTH["body_seen"]).abs().mean() < 6, "another crop than that of the body, in red, green, blue"
        focal, side = batch["cam_int"][:, 0, 0], batch["box_size"]
        own = TRUTH["own_focal"]
        assert (focal / own - 1).abs().max() < 1e-3, "another focal length than FLNet's"
        focal = TRUTH["focal"]
        height, width = batch["img_size"].T
        x, y, z = TRUTH["smpl_origin"]
        s = 2 * focal / (side * z)
        across = x - 2 * (batch["box_center"][:, 0] - width / 2) / (s * side)
        down = y - 2 * (batch["box_center"][:, 1] - height / 2) / (s * side)
        turns = TRUTH["smpl_turns"].expand(count, 24, 3, 3)
        parameters = {"global_orient": turns[:, :1], "body_pose": turns[:, 1:], "betas": torch.zeros(count, 10)}
        return parameters, torch.stack([s, across, down], -1) * self.gain, focal
"""
)

FLNET = (
    IMAGENET
    + """
class FLNet(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))

    def forward(self, images):
        assert images.shape[1:] == (3, 256, 256)
        shown = torch.nn.functional.avg_pool2d(images * STD + MEAN, 8).permute(0, 2, 3, 1).flip(-1) * 255
        assert (shown - TRUTH["photo_seen"]).abs().mean() < 3, "another photo than the world's, in blue first"
        vertical = 2 * torch.atan(TRUTH["full"].shape[0] / (2 * TRUTH["own_focal"]))
        fields = torch.stack([vertical * 0, vertical])[None] * self.gain
        return fields, torch.zeros(1, 720)
"""
)

WILOR = """
import pickle

class WiLor(torch.nn.Module):
    def __init__(self, **kwargs):
        super().__init__()
        assert pathlib.Path(kwargs["mano_mean_path"]).is_file()
        with open(kwargs["mano_model_path"], "rb") as file:  # as smplx does
            mano = pickle.load(file, encoding="latin1")
        assert mano["shapedirs"].shape == (778, 3, 10) and "RIGHT" in pathlib.Path(kwargs["mano_model_path"]).name
        assert kwargs["focal_length"] == 5000 and kwargs["image_size"] == 256
        self.gain = torch.nn.Parameter(torch.zeros(1))

    def forward(self, x):
        assert x.shape[1:] == (256, 256, 3)
        x = x.flip(dims=[-1])
        small = torch.nn.functional.avg_pool2d(x.permute(0, 3, 1, 2), 8)
        apart = (small[:, None] - TRUTH["hands_seen"].permute(0, 3, 1, 2)[None]).abs().mean((2, 3, 4))
        assert apart.min(1).values.max() < 4, "another crop than that of a hand, in blue, green, red"
        hand = apart.argmin(1)
        return {"hand_pose": TRUTH["fingers"][hand] * self.gain, "global_orient": TRUTH["wrists"][hand][:, None],
                "betas": torch.zeros(len(x), 10), "pred_cam": torch.ones(len(x), 3)}
"""

DECO = (
    IMAGENET
    + """
class DECO(torch.nn.Module):
    def __init__(self, encoder, context, device):
        super().__init__()
        assert (encoder, context) == ("hrnet", True)
        self.gain = torch.nn.Parameter(torch.zeros(1))

    def forward(self, img):
        assert img.shape[1:] == (3, 256, 256)
        shown = torch.nn.functional.avg_pool2d(img * STD + MEAN, 8).permute(0, 2, 3, 1).flip(-1) * 255
        assert (shown - TRUTH["contact_seen"]).abs().mean() < 3, "another crop than that of the person, in blue first"
        contact = TRUTH["smpl_contact"].expand(len(img), 6890) * self.gain
        return contact, torch.zeros(len(img), 133, 256, 256), torch.zeros(len(img), 26, 256, 256)
"""
)

OMNIERASER = """
from PIL import Image


class Answer:
    def __init__(self, images):
        self.images = images


class FluxControlRemovalPipeline:
    @classmethod
    def from_pretrained(cls, base, *, transformer, torch_dtype, local_files_only):
        assert local_files_only and transformer.x_embedder.in_features == transformer.config.in_channels
        return cls()

    def load_lora_weights(self, folder, *, weight_name):
        assert (pathlib.Path(folder) / weight_name).is_file()

    def to(self, device):
        return self

    def __call__(self, prompt=None, control_image=None, control_mask=None, height=None, width=None,
                 num_inference_steps=28, guidance_scale=3.5, generator=None, max_sequence_length=512):
        assert control_image.size == control_mask.size == (width, height)
        hole = control_mask.convert("L")
        empty = Image.fromarray(TRUTH["empty"].numpy()).resize((width, height), Image.Resampling.LANCZOS)
        return Answer([Image.composite(empty, control_image, hole)])
"""

SAM_3D_BODY = """
def load_sam_3d_body(checkpoint_path="", device="cuda", mhr_path=""):
    assert pathlib.Path(mhr_path).is_file()
    assert "state_dict" in torch.load(checkpoint_path, map_location="cpu", weights_only=False)
    # Bodies are placed about the principal point that is given.
    return torch.nn.Module(), {"MODEL": {"DECODER": {"USE_INTRIN_CENTER": True}}}

class SAM3DBodyEstimator:
    def __init__(self, sam_3d_body_model, model_cfg, human_detector=None, human_segmentor=None, fov_estimator=None):
        self.cfg, self.faces = model_cfg, TRUTH["faces"].numpy()

    def process_one_image(self, img, bboxes=None, masks=None, cam_int=None, det_cat_id=0, bbox_thr=0.5, nms_thr=0.3,
                          use_mask=False):
        assert img.dtype == np.uint8 and bboxes.shape == (len(bboxes), 4) and cam_int.shape == (1, 3, 3)
        assert np.abs(img.astype(int) - TRUTH["full"].numpy()).mean() < 1, "another picture than the world's, in RGB"
        place = TRUTH["keypoints"].mean(0)
        return [{
            "pred_vertices": (TRUTH["vertices"] - place).numpy(),
            "pred_cam_t": place.numpy(),
            "pred_keypoints_3d": (TRUTH["keypoints"] - place).numpy(),
            "pred_keypoints_2d": np.zeros((70, 2)),
            "focal_length": float(cam_int[0, 0, 0]),
            "shape_params": np.zeros(45),
        } for _ in bboxes]
"""

CHECKOUTS: dict[str, dict[str, str]] = {
    "MoGe": {"moge/__init__.py": "", "moge/model/__init__.py": "", "moge/model/v1.py": MOGE},
    "CameraHMR": {
        "core/constants.py": "SMPL_MEAN_PARAMS_FILE = 'data/smpl_mean_params.npz'\n",
        "core/camerahmr_model.py": CAMERAHMR,
        "core/cam_model/fl_net.py": FLNET,
    },
    "WiLoR-mini": {"wilor_mini/__init__.py": "", "wilor_mini/models/wilor.py": WILOR},
    "deco": {"models/deco.py": DECO},
    "Omnieraser": {"pipeline_flux_control_removal.py": OMNIERASER},
    "sam-3d-body": {"sam_3d_body/__init__.py": SAM_3D_BODY},
}
"""Repository -> its files."""


def write_checkouts(folder: Path, world: World) -> dict[str, Path]:
    """All of them, by name."""
    truth = truth_of(world)
    found = {}
    for name, files in CHECKOUTS.items():
        root = found[name] = folder / name
        for path, text in files.items():
            place = root / path
            place.parent.mkdir(parents=True, exist_ok=True)
            knows = "TRUTH[" in text
            head = TRUTH.replace("DEPTH", str(len(Path(path).parts) - 1)) if knows else ""
            place.write_text(head + textwrap.dedent(text))
        np.savez(root / "truth.npz", **truth)
    return found


OWN_FOCAL = 1.05
"""The focal length that CameraHMR's FLNet sees, in the world's."""


def truth_of(world: World) -> dict[str, np.ndarray]:
    """What they know of the world's one person, its two photos and its scene."""
    seen = neighbour("physic-human", "seen")
    smpl = seen.smpl_arrays()
    known = {"full": world.image.copy(), "empty": world.empty_image.copy()}
    for name, people in (("full", True), ("empty", False)):
        known[f"{name}_points"], known[f"{name}_mask"] = relative_points(world, people=people)
    pelvis = smpl["J_regressor"][0] @ smpl["v_template"]
    known["smpl_origin"] = (world.joints[0, 0] - pelvis).astype(np.float32)
    known["smpl_turns"] = _matrices(seen.smpl_pose(world)[0]).astype(np.float32)
    known["smpl_contact"] = np.where(seen.smpl_contact(world)[0], 0.9, 0.05).astype(np.float32)
    as_right = np.array([[[1, -1, -1]], [[1, 1, 1]]])  # in a mirror, y and z of a rotation change their sign
    p = world.parameters
    fingers = np.stack([p.left_hand_pose[0], p.right_hand_pose[0]]).reshape(2, 15, 3) * as_right
    known["fingers"] = fingers.astype(np.float32)
    known["wrists"] = (seen.wrist_turns(world)[0] * as_right[:, 0]).astype(np.float32)
    known["hands_seen"] = hands_seen(world).astype(np.float32)
    known["focal"] = np.float32(world.intrinsics.fx)
    known["own_focal"] = np.float32(OWN_FOCAL * world.intrinsics.fx)
    known["photo_seen"] = photo_seen(world)
    known["body_seen"], known["contact_seen"] = body_seen(world), contact_seen(world)
    known["faces"] = np.asarray(world.faces).copy()
    known["vertices"] = world.vertices[0].copy()
    known["keypoints"] = world_mhr_keypoints(world)[0].astype(np.float32)
    return known


SIDE = 32
"""px of the crops that the stand-ins compare with what they are shown."""


def hands_seen(world: World, margin: float = 2.5) -> np.ndarray:
    """(2, 32, 32, 3) grey levels: the left hand in a mirror, and the right one, in squares about them."""
    points, _ = world_keypoints(world, "coco_wholebody133")
    hands = [points[0, first : first + 21] for first in (91, 112)]
    boxes = [np.concatenate([hand.min(0), hand.max(0)]) + 0.5 for hand in hands]  # half open, from edges of pixels
    return np.stack([_square(world.image, box, margin, mirror=i == 0) for i, box in enumerate(boxes)])


def body_seen(world: World) -> np.ndarray:
    """(32, 32, 3) float32 grey levels: the square of the longer side of the person's box."""
    return _square(world.image, world.boxes[0], 1.0).astype(np.float32)


def contact_seen(world: World, growth: float = 0.1, white: float = 255) -> np.ndarray:
    """(32, 32, 3) float32 grey levels: a tenth more than the person's box, in the middle of a white square."""
    x0, y0, x1, y1 = world.boxes[0]
    dx, dy = growth * (x1 - x0), growth * (y1 - y0)
    left, top, right, bottom = (max(int(v), 0) for v in (x0 - dx, y0 - dy, x1 + dx, y1 + dy))
    cut = world.image[top:bottom, left:right].astype(float)
    rows, columns = (int(256 * n / max(cut.shape[:2])) for n in cut.shape[:2])
    square = np.full((256, 256, 3), white)
    first, second = (256 - rows) // 2, (256 - columns) // 2
    square[first : first + rows, second : second + columns] = on_grid(cut, rows, columns)
    return square.reshape(SIDE, 256 // SIDE, SIDE, 256 // SIDE, 3).mean((1, 3)).astype(np.float32)


def photo_seen(world: World, white: float = 255) -> np.ndarray:
    """(32, 32, 3) float32 grey levels: the whole photo in the middle of a white square."""
    height, width = world.image.shape[:2]
    rows, columns = (int(256 * n / max(height, width)) for n in (height, width))
    square = np.full((256, 256, 3), white)
    first, second = (256 - rows) // 2, (256 - columns) // 2
    square[first : first + rows, second : second + columns] = on_grid(world.image.astype(float), rows, columns)
    return square.reshape(SIDE, 256 // SIDE, SIDE, 256 // SIDE, 3).mean((1, 3)).astype(np.float32)


def _square(image: np.ndarray, box: np.ndarray, margin: float, *, mirror: bool = False) -> np.ndarray:
    """(32, 32, 3) about a box, black outside of the photo."""
    step = margin * (box[2:] - box[:2]).max() / SIDE
    middle = (box[:2] + box[2:] - 1) / 2
    across = (np.arange(SIDE) + 0.5 - SIDE / 2) * step
    grid = np.meshgrid(middle[1] + across, middle[0] + (-across if mirror else across), indexing="ij")
    smooth = gaussian_filter(image.astype(float), (max(0.0, 0.4 * (step - 1)),) * 2 + (0,))
    return np.stack([map_coordinates(smooth[..., c], grid, order=1) for c in range(3)], -1)


def _matrices(rotvecs: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(rotvecs).as_matrix())


def write_checkpoints(weights: Path, smpl: Path) -> None:
    """The files of the repositories' weights, and a made-up SMPL file."""
    state = {"state_dict": {"gain": torch.ones(1)}}
    for name, content in {
        "moge-1-vitl/model.pt": {"model_config": {}, "model": {}},
        "camerahmr/camerahmr_checkpoint_cleaned.ckpt": state,
        "camerahmr/cam_model_cleaned.ckpt": state,
        "wilor-mini/wilor_final.ckpt": state,
        "deco/deco_best.pth": {"deco": {"gain": torch.ones(1)}},
        "sam-3d-body-vith/model.ckpt": state,
    }.items():
        (weights / name).parent.mkdir(parents=True, exist_ok=True)
        torch.save(content, weights / name)
    for name in (
        "camerahmr/smpl_mean_params.npz",
        "wilor-mini/mano_mean_params.npz",
        "sam-3d-body-vith/model_config.yaml",
        "sam-3d-body-vith/assets/mhr_model.pt",
        "omnieraser/pytorch_lora_weights.safetensors",
    ):
        (weights / name).parent.mkdir(parents=True, exist_ok=True)
        (weights / name).write_bytes(b"stand-in")
    write_published(weights / "wilor-mini/MANO_RIGHT.pkl", mano_arrays())
    np.savez(smpl, **neighbour("physic-human", "seen").smpl_arrays())
