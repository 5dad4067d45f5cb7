#!/bin/sh
# A PLY of six splats, each with a label of its own (a property "label"), is converted by PlayCanvas' splat-transform
# to other formats and back.
# Guessed: the splats keep their order, so a list of labels beside the file still fits.
# Measured on 2026-11-28 with @playcanvas/splat-transform 2.7.1: PLY, CSV and SPZ keep the order, compressed PLY and
# SOG sort the splats by place, in silence. The label is kept in PLY and CSV alone.
. "$(dirname "$0")/common.sh"
install_npm @playcanvas/splat-transform@2.7.1
cat > make.mjs <<'NODE'
import { writeFileSync } from "node:fs";

const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
names.push("rot_0", "rot_1", "rot_2", "rot_3", "label");
const rows = [5, 1, 4, 2, 3, 0].map((x, i) => [x, 0, 0, 0, 0, 0, 2, -3, -3, -3, 1, 0, 0, 0, 10 + i]);
const header = ["ply", "format binary_little_endian 1.0", `element vertex ${rows.length}`];
header.push(...names.map((name) => `property float ${name}`), "end_header", "");
const values = Buffer.from(new Float32Array(rows.flat()).buffer);
writeFileSync("in.ply", Buffer.concat([Buffer.from(header.join("\n")), values]));
NODE
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";

const found = {};
for (const name of ["ply", "spz", "compressed.ply", "sog"]) {
  const lines = readFileSync(`${name}.csv`, "utf8").trim().split("\n");
  const heads = lines[0].split(",");
  const column = heads.indexOf("x");
  const places = lines.slice(1).map((line) => Math.round(Number(line.split(",")[column])));
  found[name] = places.join(" ") + (heads.includes("label") ? " with labels" : "");
}
console.log("@playcanvas/splat-transform 2.7.1, 5 1 4 2 3 0 in the file:", JSON.stringify(found));
const sorted = "0 1 2 3 4 5";
const expected = { ply: "5 1 4 2 3 0 with labels", spz: "5 1 4 2 3 0", "compressed.ply": sorted, sog: sorted };
if (JSON.stringify(found) !== JSON.stringify(expected)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node make.mjs
for name in ply spz compressed.ply sog; do
    npx splat-transform -w in.ply "out.$name" > "$name.log" 2>&1
    npx splat-transform -w "out.$name" "$name.csv" > "$name.log" 2>&1
done
node look.mjs
