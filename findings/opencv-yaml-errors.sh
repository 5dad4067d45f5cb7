#!/bin/sh
# OpenCV reads YAML with a key in quotes, which is valid.
# Guessed: it reads it, or raises cv2.error.
# Measured on 2026-11-27 with opencv-python-headless 5.0.0.93: SystemError "returned a result with an exception set",
# which `except cv2.error` does not catch; the cv2.error is its cause.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install numpy==2.4.6 opencv-python-headless==5.0.0.93
python - "$folder/cameras.yml" <<'PYTHON'
import sys
from pathlib import Path

import cv2

Path(sys.argv[1]).write_text('%YAML:1.0\n---\n"focal": 1400\n')
try:
    cv2.FileStorage(sys.argv[1], cv2.FILE_STORAGE_READ)
    found, cause = "read", ""
except Exception as error:
    found, cause = type(error).__name__, type(error.__cause__).__name__
print(f"OpenCV {cv2.__version__}: {found}, caused by {cause}")
if (found, cause) != ("SystemError", "error"):
    raise SystemExit("the behaviour has changed")
PYTHON
