#!/bin/sh
# A TRC file of markers, one of them not seen, so its three cells are empty.
# Guessed: OpenSim reads a missing marker as NaN.
# Measured on 2026-11-27 with opensim 4.6: it does where another marker follows. Where the last marker is missing,
# TimeSeriesTableVec3 refuses the file for its number of columns; MarkerData takes the same file.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install opensim==4.6 numpy==2.4.6
python - <<'PYTHON'
import opensim

HEAD = (
    "PathFileType\t4\t(X/Y/Z)\tjoints.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "100\t100\t1\t2\tmm\t100\t1\t1\n"
    "Frame#\tTime\tknee\t\t\tankle\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
)


def knee_and_ankle(row):
    with open("joints.trc", "w", encoding="utf-8") as file:
        file.write(HEAD + row)
    try:
        table = opensim.TimeSeriesTableVec3("joints.trc").flatten()
    except RuntimeError as failure:
        return "refused" if "columns" in str(failure) else "failed"
    return [table.getDependentColumnAtIndex(index)[0] for index in (0, 3)]


first = knee_and_ankle("1\t0.0\t\t\t\t10\t20\t30\n")
last = knee_and_ankle("1\t0.0\t10\t20\t30\t\t\t\n")
data = opensim.MarkerData("joints.trc")
frame = data.getFrame(0)
markers = [str(frame.getMarker(index)) for index in (0, 1)]
print(f"opensim {opensim.GetVersion()}: first missing {first}; last missing {last}; as MarkerData {markers}")
correct = first != "refused" and first[0] != first[0] and first[1] == 10
if not (correct and last == "refused" and "nan" in markers[1].lower()):
    raise SystemExit("the behaviour has changed")
PYTHON
