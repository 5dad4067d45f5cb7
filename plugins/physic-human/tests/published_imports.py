"""What the files of published repositories import that lie on the way from a backend to its network.

Of each file only its import statements are here, at the level where the published file has them; ``ENVIRONMENT`` is the
same of packages that import others. The commits are those of the classes' ``project``.
"""

from __future__ import annotations

__all__ = ["ENVIRONMENT", "FILES"]

ENVIRONMENT = {"timm": "import torchvision"}
"""Package -> what importing it imports: timm's own data sets and transforms."""

FILES: dict[str, dict[str, str]] = {
    "wilor": {
        "wilor_mini/__init__.py": "",
        "wilor_mini/models/__init__.py": "",
        "wilor_mini/models/wilor.py": """
import os
import roma
import torch
from torch import nn
from . import vit, refinement_net, mano_wrapper
""",
        "wilor_mini/models/vit.py": """
import numpy as np
import torch
from timm.models.layers import drop_path, to_2tuple, trunc_normal_
""",
        "wilor_mini/models/refinement_net.py": "import torch\nfrom . import vit",
        "wilor_mini/models/mano_wrapper.py": "import smplx\nimport torch",
    },
    "hamer": {
        "hamer/__init__.py": "",
        "hamer/configs/__init__.py": "import os\nfrom yacs.config import CfgNode as CN",
        "hamer/models/__init__.py": "from . import mano_wrapper, hamer\nfrom ..configs import CN",
        "hamer/models/mano_wrapper.py": "import torch\nimport numpy as np\nimport smplx",
        "hamer/models/hamer.py": """
import torch
import pytorch_lightning as pl
from yacs.config import CfgNode
from .. import utils
from . import backbones, heads
""",
        "hamer/models/backbones/__init__.py": "from . import vit",
        "hamer/models/backbones/vit.py": "import torch\nfrom timm.models.layers import drop_path, to_2tuple",
        "hamer/models/heads/__init__.py": "from . import mano_head",
        "hamer/models/heads/mano_head.py": "import torch\nimport einops\nfrom ..components import pose_transformer",
        "hamer/models/components/__init__.py": "",
        "hamer/models/components/pose_transformer.py": "import torch\nfrom einops import rearrange",
        "hamer/utils/__init__.py": "import torch\nfrom . import renderer, mesh_renderer, skeleton_renderer, pylogger",
        "hamer/utils/renderer.py": """
import torch
import numpy as np
import pyrender
import trimesh
import cv2
from yacs.config import CfgNode
""",
        "hamer/utils/mesh_renderer.py": """
import torch
from torchvision.utils import make_grid
import pyrender
import trimesh
""",
        "hamer/utils/skeleton_renderer.py": "import torch\nimport trimesh\nfrom yacs.config import CfgNode",
        "hamer/utils/pylogger.py": "import logging\nfrom pytorch_lightning.utilities import rank_zero_only",
    },
    "camerahmr": {
        "core/__init__.py": "",
        "core/constants.py": "",
        "core/camerahmr_model.py": """
import torch
import pytorch_lightning as pl
from .backbones import vit
from .heads import smpl_head_cliff
""",
        "core/backbones/__init__.py": "from . import vit",
        "core/backbones/vit.py": "import torch\nfrom timm.models.layers import drop_path, to_2tuple, trunc_normal_",
        "core/heads/__init__.py": "",
        "core/heads/smpl_head_cliff.py": """
import torch
import numpy as np
import einops
from ..components import pose_transformer
""",
        "core/components/__init__.py": "",
        "core/components/pose_transformer.py": "import torch\nfrom einops import rearrange",
        "core/cam_model/__init__.py": "",
        "core/cam_model/fl_net.py": "import torch.nn as nn\nfrom .backbone import hrnet",
        "core/cam_model/backbone/__init__.py": "",
        "core/cam_model/backbone/hrnet.py": """
import os
import torch
from loguru import logger
from yacs.config import CfgNode as CN
""",
    },
    "sam-3d-body": {
        "sam_3d_body/__init__.py": "from . import sam_3d_body_estimator, build_models",
        "sam_3d_body/sam_3d_body_estimator.py": """
import cv2
import numpy as np
import torch
from .data.transforms import common
from .data.utils import io
""",
        "sam_3d_body/build_models.py": "import torch\nfrom .models import meta_arch\nfrom .utils import config",
        "sam_3d_body/utils/__init__.py": "",
        "sam_3d_body/utils/config.py": "from omegaconf import OmegaConf\nfrom yacs.config import CfgNode as CN",
        "sam_3d_body/data/__init__.py": "",
        "sam_3d_body/data/transforms/__init__.py": "from . import common",
        "sam_3d_body/data/transforms/common.py": "import cv2\nimport torchvision.transforms.functional as F",
        "sam_3d_body/data/utils/__init__.py": "",
        "sam_3d_body/data/utils/io.py": "import os\nimport braceexpand\nimport cv2\nfrom PIL import Image",
        "sam_3d_body/models/__init__.py": "",
        "sam_3d_body/models/meta_arch/__init__.py": "from . import sam3d_body",
        "sam_3d_body/models/meta_arch/sam3d_body.py": """
import roma
import torch
from ..backbones import vit
from . import base_lightning_module
""",
        "sam_3d_body/models/meta_arch/base_lightning_module.py": "import pytorch_lightning as pl",
        "sam_3d_body/models/backbones/__init__.py": "",
        "sam_3d_body/models/backbones/vit.py": "import einops\nfrom timm.models.layers import drop_path, to_2tuple",
    },
    "deco": {
        "models/deco.py": "from models import components\nimport torch",
        "models/components.py": "import torch\nimport torchvision\nfrom utils import hrnet",
        "utils/hrnet.py": "import os\nimport torch\nfrom loguru import logger\nfrom yacs.config import CfgNode as CN",
    },
    "unidepth-v2": {
        "unidepth/__init__.py": "",
        "unidepth/models/__init__.py": "from .unidepthv2 import unidepthv2",
        "unidepth/models/unidepthv2/__init__.py": "",
        "unidepth/models/unidepthv2/unidepthv2.py": """
import torch
import torchvision.transforms.v2.functional as TF
from einops import rearrange
from huggingface_hub import PyTorchModelHubMixin
from unidepth.models.unidepthv2 import decoder
from unidepth.utils import misc
""",
        "unidepth/models/unidepthv2/decoder.py": "import torch\nfrom timm.models.layers import trunc_normal_",
        "unidepth/utils/__init__.py": "from . import visualization",
        "unidepth/utils/misc.py": "import torch\nfrom scipy import interpolate",
        "unidepth/utils/visualization.py": """
import os
import matplotlib.pyplot as plt
import numpy as np
import torch
import wandb
from PIL import Image
from unidepth.utils import misc
""",
    },
    "moge-1": {
        "moge/__init__.py": "",
        "moge/model/__init__.py": "",
        "moge/model/v1.py": "import torch\nimport utils3d\nfrom huggingface_hub import hf_hub_download",
    },
}
"""Backend -> file of its repository -> imports."""
