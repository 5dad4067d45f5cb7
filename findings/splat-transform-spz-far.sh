#!/bin/sh
# Splats of a scene in the coordinates of a map lie up to 5 km from its origin. PlayCanvas' splat-transform writes
# them as SPZ, which stores places in 24 bits with 12 bits of fraction, so up to 2048 m.
# Guessed: what does not fit is refused, or ends at 2048 m.
# Measured on 2026-11-29 with @playcanvas/splat-transform 2.7.1: 3000 m becomes -1096 m, and -5000.25 m becomes
# -904.25 m, in silence.
. "$(dirname "$0")/common.sh"
install_npm @playcanvas/splat-transform@2.7.1
cat > write.mjs <<'NODE'
import { writeFileSync } from "node:fs";

const NAMES = "x y z scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 opacity f_dc_0 f_dc_1 f_dc_2".split(" ");
const splats = [1, 2000, 3000, -5000.25].map((x) => [x, 0, 0, -3, -3, -3, 1, 0, 0, 0, 2, 0.1, 0.1, 0.1]);
const head = `ply\nformat binary_little_endian 1.0\nelement vertex ${splats.length}\n`;
const properties = NAMES.map((name) => `property float ${name}\n`).join("");
const bytes = Buffer.from(new Float32Array(splats.flat()).buffer);
writeFileSync("map.ply", Buffer.concat([Buffer.from(`${head}${properties}end_header\n`), bytes]));
NODE
node write.mjs
npx splat-transform -w map.ply map.spz > log.txt 2>&1
npx splat-transform -w map.spz map.csv >> log.txt 2>&1
found=$(tail -n +2 map.csv | cut -d , -f 1 | tr '\n' ' ')
version=$(npx splat-transform --version 2>&1 | grep -o '[0-9][0-9.]*' | head -n 1)
echo "splat-transform $version: x of 1, 2000, 3000, -5000.25 m becomes $found"
if grep -qi warn log.txt || [ "$found" != "1 2000 -1096 -904.25 " ]; then
    echo "the behaviour has changed"
    exit 1
fi
