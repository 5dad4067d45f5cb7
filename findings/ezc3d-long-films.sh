#!/bin/sh
# A film of 70,000 frames, 12 minutes at 100 per second, is written as C3D, whose header has 16 bits for the number of
# frames, so longer films state it in POINT:LONG_FRAMES, or in TRIAL. Five libraries read the files of two.
# Guessed: all but one read 70,000 frames.
# Measured on 2026-11-29 with ezc3d 1.7.2, kineticstoolkit 0.17.0, c3d 0.6.0, pupyC3D 0.1.3 and sqzc3d 0.4.0: ezc3d
# writes all frames and states 65,535 of them, without more, so that it and kineticstoolkit read 65,535 of its own file,
# and c3d none, in silence. Of the file of c3d they read 70,016: what fills the last block counts as frames, of zeros.
# pupyC3D reads 65,535 of both. sqzc3d refuses films from 32,768 frames on.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install ezc3d==1.7.2 kineticstoolkit==0.17.0 c3d==0.6.0 pupyC3D==0.1.3 sqzc3d==0.4.0 numpy==2.4.6
python -W ignore - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import c3d
import ezc3d
import kineticstoolkit
import numpy as np
import pupyC3D
import sqzc3d


def with_ezc3d(path):
    return ezc3d.c3d(path)["data"]["points"].shape[2]


def filled(path):
    """Number of frames that ezc3d has at the end where the head, 1 m high, is at 0."""
    return int(np.count_nonzero(ezc3d.c3d(path)["data"]["points"][2, 0] == 0))


def with_kineticstoolkit(path):
    return len(kineticstoolkit.read_c3d(path)["Points"].time)


def with_c3d(path):
    with open(path, "rb") as file:
        return sum(1 for _ in c3d.Reader(file).read_frames())


def with_pupyc3d(path):
    return pupyC3D.C3DFile(path).frame_count


def with_sqzc3d(path):
    try:
        return len(sqzc3d.read(path).points)
    except RuntimeError:
        return None


def write(frames):
    """Write a head that moves by 1 mm a frame, with ezc3d and with c3d."""
    points = np.ones((4, 1, frames))
    points[0] = np.arange(frames) / 1000
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["head"]
    file["data"]["points"] = points
    file.write("ezc3d.c3d")
    writer = c3d.Writer(point_rate=100.0, analog_rate=100.0, point_units="m")
    writer.set_point_labels(["head"])
    rows = np.pad(points[:3, 0].T, ((0, 0), (0, 2))).astype(np.float32)[:, None]
    writer.add_frames([(row, np.zeros((0, 1))) for row in rows])
    with open("c3d.c3d", "wb") as other:
        writer.write(other)


readers = (with_ezc3d, with_kineticstoolkit, with_c3d, with_pupyc3d, with_sqzc3d)
found = {}
for frames in (32_768, 70_000):
    write(frames)
    found[frames] = {path: [read(path) for read in readers] for path in ("ezc3d.c3d", "c3d.c3d")}
complete = Path("ezc3d.c3d").stat().st_size > 70_000 * 16
zeros = filled("c3d.c3d")
print(f"ezc3d {version('ezc3d')}, kineticstoolkit, c3d {version('c3d')}, pupyC3D, sqzc3d read: {found}, zeros: {zeros}")
if not complete or zeros != 16 or found != {
    32_768: dict.fromkeys(("ezc3d.c3d", "c3d.c3d"), [32_768] * 4 + [None]),
    70_000: {
        "ezc3d.c3d": [65_535, 65_535, 0, 65_535, None],
        "c3d.c3d": [70_016, 70_016, 70_000, 65_535, None],
    },
}:
    raise SystemExit("the behaviour has changed")
PYTHON
