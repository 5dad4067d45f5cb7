#!/bin/sh
# An MJCF mesh has its vertices in the file (`vertex`), which MuJoCo reads.
# Guessed: NVIDIA's and Newton's converter to USD writes it.
# Measured on 2026-11-28 with mujoco-usd-converter 0.8.0: it refuses the model, since the mesh has no file.
# Readers guessed: wrong, in part, wrong.
. "$(dirname "$0")/common.sh"
install mujoco-usd-converter==0.8.0
cat > model.xml <<'XML'
<mujoco>
  <asset><mesh name="tile" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>
  <worldbody><geom type="mesh" mesh="tile"/></worldbody>
</mujoco>
XML
python -c "import mujoco; assert mujoco.MjModel.from_xml_path('model.xml').nmesh == 1"
status=0
"$folder/venv/bin/mujoco_usd_converter" model.xml out > out.log 2>&1 || status=$?
version=$(python -c "from importlib.metadata import version as v; print(v('mujoco-usd-converter'))")
echo "mujoco-usd-converter $version: exit status $status, $(grep -o 'Mesh tile has no file' out.log | head -1)"
if [ "$status" -eq 0 ] || ! grep -q "Mesh tile has no file" out.log; then
    echo "the behaviour has changed"
    exit 1
fi
