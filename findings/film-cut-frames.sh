#!/bin/sh
# A film of 60 frames is cut by `ffmpeg -ss 0.5 -c copy`, which keeps the frames since the last key frame and an edit
# list that hides 15 of them, as phones do. OpenCV, PyAV and decord count and read its frames.
# Guessed: all count 45 frames, and read frames 15 to 59.
# Measured on 2026-12-01 with opencv-python-headless 5.0.0.93, av 18.1.0, eva-decord 0.6.1: only those that are read
# one after another are right. CAP_PROP_FRAME_COUNT and PyAV's `frames` are 60, of which 45 can be read. decord has 60,
# and repeats the last one 15 times; its timestamps begin at -.5 s.
. "$(dirname "$0")/common.sh"
install opencv-python-headless==5.0.0.93 av==18.1.0 eva-decord==0.6.1 imageio-ffmpeg==0.8.1 numpy==2.4.6
python - <<'PYTHON'
import subprocess

import av
import cv2
import decord
import imageio_ffmpeg
import numpy as np

with av.open("whole.mp4", "w") as film:
    stream = film.add_stream("libx264", rate=30)
    stream.width = stream.height = 64
    stream.pix_fmt = "yuv420p"
    stream.gop_size = 30
    for i in range(60):
        picture = np.full((64, 64, 3), 4 * i, np.uint8)
        film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
    film.mux(stream.encode())
cut = ["-y", "-loglevel", "error", "-ss", "0.5", "-i", "whole.mp4", "-c", "copy", "cut.mp4"]
subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *cut], check=True)


def number(picture):
    return round(float(np.mean(picture)) / 4)


def seen(count, numbers):
    return int(count), numbers[0], numbers[-1], len(set(numbers))


capture = cv2.VideoCapture("cut.mp4")
count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
by_opencv = seen(count, [number(picture) for ok, picture in iter(capture.read, (False, None))])
with av.open("cut.mp4") as film:
    numbers = [number(frame.to_ndarray(format="rgb24")) for frame in film.decode(video=0)]
    by_av = seen(film.streams.video[0].frames, numbers)
reader = decord.VideoReader("cut.mp4")
by_decord = seen(len(reader), [number(reader[i].asnumpy()) for i in range(len(reader))])
start = round(float(reader.get_frame_timestamp(0)[0]), 2)
print(f"opencv {cv2.__version__}, av {av.__version__}, decord {decord.__version__}: count, first, last, different frames")
print(f"{by_opencv}, {by_av}, {by_decord}; decord begins at {start} s")
whole = (60, 15, 59, 45)
if (by_opencv, by_av, by_decord, start) != (whole, whole, whole, -0.5):
    raise SystemExit("the behaviour has changed")
PYTHON
