#!/bin/sh
# OpenImageIO reads an RGBA PNG and writes it again. Pixels of alpha 0 have a colour, as the padding of a texture has,
# and those of alpha 2 too.
# Guessed: the same colours come back, since PNG keeps colour and alpha apart.
# Measured on 2026-11-28 with openimageio 3.2.2.0: it multiplies 8-bit colours by alpha when it reads. Those of alpha
# 0 come back black, and 200, 100, 50 of alpha 2 come back as 255, 128, 0. With "oiio:UnassociatedAlpha" = 1 in the
# configuration of the reader they stay.
. "$(dirname "$0")/common.sh"
install openimageio==3.2.2.0 pillow==13.0.0 numpy==2.4.6
python - <<'PYTHON'
import importlib.metadata

import numpy as np
import OpenImageIO
from PIL import Image

COLOUR = (200, 100, 50)
stored = np.array([[(*COLOUR, alpha) for alpha in (0, 2, 255)]], np.uint8)
Image.fromarray(stored).save("in.png")
hint = OpenImageIO.ImageSpec()
hint.attribute("oiio:UnassociatedAlpha", 1)
found = {}
for name, options in {"default": (), "unassociated": (0, 0, hint)}.items():
    OpenImageIO.ImageBuf("in.png", *options).write("out.png")
    with Image.open("out.png") as image:
        found[name] = np.array(image)[0, :, :3].tolist()
version = importlib.metadata.version("openimageio")
print(f"openimageio {version}: {list(COLOUR)} of alpha 0, 2, 255 comes back as {found}")
default, kept = found["default"], found["unassociated"]
if not (default[0] == [0, 0, 0] and default[1] != list(COLOUR) == default[2] and kept == [list(COLOUR)] * 3):
    raise SystemExit("the behaviour has changed")
PYTHON
