"""Make the keypoint files of the tests anew with the code of the tools that write them, from one
invented pose.

    python -m venv venv
    venv/bin/pip install ultralytics==8.4.190 mmpose==1.3.2 mmengine==0.10.7 mmcv-lite==2.2.0 \
        rtmlib==0.0.16 transformers==5.23.0 label-studio-sdk==2.1.2 pycocotools==2.0.11
    YOLO_CONFIG_DIR=/tmp venv/bin/python tools/real_files/keypoints.py \
        plugins/embedded/tests/opencv/keypoints [TOOL ...]

No network runs: each tool gets what its network returns for the pose. OpenPose has no package.
"""

from __future__ import annotations

import json
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

WIDTH = 720
HEIGHT = 1280
BOX = (395.0, 420.0, 589.0, 1044.0)  # of the person, x0 y0 x1 y1
# fmt: off
POSE = np.array([
    [524.26, 490.55], [526.76, 478.78], [512.2, 475.9], [519.56, 480.82], [490.52, 475.72], [537.58, 543.36],  # noqa: E501
    [432.09, 550.91], [559.51, 625.14], [414.77, 650.46], [573.95, 702.31], [420.26, 736.28], [525.73, 729.12],  # noqa: E501
    [459.65, 736.26], [538.76, 854.64], [457.25, 861.54], [562.31, 976.59], [443.85, 979.6],
])
# fmt: on
SCORE = 0.9


def ultralytics() -> str:
    """Return ``Results.to_json()`` of a pose model."""
    import torch
    from ultralytics.engine.results import Results

    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    boxes = torch.tensor([[*BOX, SCORE, 0]])
    keypoints = torch.tensor(np.c_[POSE, np.full(17, SCORE)], dtype=torch.float32)[None]
    return str(
        Results(picture, "photo.jpg", {0: "person"}, boxes=boxes, keypoints=keypoints).to_json()
    )


def mmpose_inferencer() -> str:
    """Return what the inferencer writes with ``pred_out_dir``."""
    import mmengine
    from mmengine.structures import InstanceData
    from mmpose.structures import split_instances

    found = InstanceData(
        keypoints=np.float32(POSE)[None],
        keypoint_scores=np.full((1, 17), SCORE, np.float32),
        bboxes=np.float32([BOX]),
        bbox_scores=np.float32([SCORE]),
    )
    return str(mmengine.dump(split_instances(found), file_format="json"))


def mmpose_results() -> str:
    """Return the COCO results of mmpose's metric, as ``tools/test.py`` writes them."""
    # The wheel of xtcocotools, its copy of pycocotools, does not import with NumPy 2.
    for name in ("", ".coco", ".cocoeval", ".mask"):
        sys.modules[f"xtcocotools{name}"] = import_module(f"pycocotools{name}")
    from mmpose.evaluation.metrics.coco_metric import CocoMetric

    person = {
        "img_id": 7,
        "keypoints": np.c_[POSE, np.full(17, SCORE)].ravel().tolist(),
        "score": SCORE,
    }
    person |= {"bbox": np.float32(BOX), "category_id": 1, "area": 1.0}
    metric = object.__new__(CocoMetric)
    metric._dataset_meta = {"num_keypoints": 17}
    with tempfile.TemporaryDirectory() as folder:
        metric.results2json({7: [person]}, f"{folder}/results")
        return Path(folder, "results.keypoints.json").read_text()


def rtmlib() -> str:
    """Return the arrays of ``RTMPose``, which its user stores as lists: SimCC bins of half a pixel
    of the input.
    """
    from rtmlib.tools.pose_estimation.rtmpose import RTMPose

    size = np.array([192, 256])
    scale = np.array([480.0, 640.0])
    centre = np.array([492.0, 732.0])
    model: Any = object.__new__(RTMPose)
    model.model_input_size = tuple(size)
    model.to_openpose = False
    bins = [np.zeros((1, 17, 2 * side), np.float32) for side in size]
    at = np.rint((POSE - centre + scale / 2) / scale * size * 2).astype(int)
    for axis in (0, 1):
        bins[axis][0, np.arange(17), at[:, axis]] = SCORE
    keypoints, scores = model.postprocess(bins, centre, scale)
    return json.dumps({"keypoints": keypoints.tolist(), "scores": scores.tolist()})


def vitpose() -> str:
    """Return ``post_process_pose_estimation`` of transformers as lists, by Gaussians in its
    heatmaps.
    """
    import torch
    from transformers import VitPoseImageProcessorPil
    from transformers.models.vitpose.modeling_vitpose import VitPoseEstimatorOutput

    box = np.array([[BOX[0], BOX[1], BOX[2] - BOX[0], BOX[3] - BOX[1]]])
    height = 1.25 * box[0, 3]
    width = 1.25 * box[0, 3] * 192 / 256
    corner = box[0, :2] + box[0, 2:] / 2 - np.array([width, height]) / 2
    peaks = (POSE - corner) / np.array([width, height]) * np.array([47, 63])
    rows, columns = np.mgrid[:64, :48]
    away = (columns - peaks[:, 0, None, None]) ** 2 + (rows - peaks[:, 1, None, None]) ** 2
    heatmaps = torch.tensor(SCORE * np.exp(-away / 8), dtype=torch.float32)[None]
    found = VitPoseImageProcessorPil().post_process_pose_estimation(
        VitPoseEstimatorOutput(heatmaps=heatmaps), boxes=[box]
    )
    return json.dumps(
        [
            [{key: value.tolist() for key, value in one.items()} for one in people]
            for people in found
        ]
    )


def label_studio_coco() -> str:
    """Return the COCO data set that Label Studio's converter makes of a task with keypoints in a
    rectangle.
    """
    from label_studio_sdk.converter import Converter

    names = (
        "nose",
        "left_eye",
        "right_eye",
        "left_ear",
        "right_ear",
        "left_shoulder",
        "right_shoulder",
    )
    config = (
        '<View><Image name="image" value="$image"/><RectangleLabels name="box" '
        'toName="image"><Label value="person"/>'
        '</RectangleLabels><KeyPointLabels name="joint" toName="image" model_index="person">'
        + "".join(f'<Label value="{name}" model_index="{i}"/>' for i, name in enumerate(names))
        + "</KeyPointLabels></View>"
    )
    size = {
        "original_width": WIDTH,
        "original_height": HEIGHT,
        "image_rotation": 0,
        "to_name": "image",
    }
    x0, y0, x1, y1 = (
        100 * value / side for value, side in zip(BOX, (WIDTH, HEIGHT) * 2, strict=True)
    )
    rectangle = {
        "x": x0,
        "y": y0,
        "width": x1 - x0,
        "height": y1 - y0,
        "rotation": 0,
        "rectanglelabels": ["person"],
    }
    marks: list[dict[str, Any]] = [
        {"id": "person", "from_name": "box", "type": "rectanglelabels", "value": rectangle, **size}
    ]
    for name, (x, y) in zip(names, POSE, strict=False):
        place = {
            "x": 100 * (x + 0.5) / WIDTH,
            "y": 100 * (y + 0.5) / HEIGHT,
            "width": 0.5,
            "keypointlabels": [name],
        }
        marks.append(
            {
                "id": name,
                "from_name": "joint",
                "type": "keypointlabels",
                "parentID": "person",
                "value": place,
                **size,
            }
        )
    task = {
        "id": 1,
        "data": {"image": "/data/photo.jpg"},
        "annotations": [{"id": 1, "result": marks}],
    }
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "task.json")
        source.write_text(json.dumps([task]))
        converter = Converter(config, folder, download_resources=False)
        converter.convert_to_coco(
            str(source), f"{folder}/out", output_image_dir=folder, is_dir=False
        )
        return Path(folder, "out", "result.json").read_text()


TOOLS = {
    "ultralytics_to_json": ultralytics,
    "mmpose_inferencer": mmpose_inferencer,
    "mmpose_results": mmpose_results,
    "rtmlib": rtmlib,
    "vitpose": vitpose,
    "label_studio_coco": label_studio_coco,
}


def main() -> None:
    """Write the files of the named tools, or of all."""
    folder, *chosen = sys.argv[1:]
    for name in chosen or TOOLS:
        text = TOOLS[name]()
        (Path(folder) / f"{name}.json").write_text(text.rstrip("\n") + "\n")


main()
