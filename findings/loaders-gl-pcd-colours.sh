#!/bin/sh
# PCD stores a colour as 0xRRGGBB, as the bits of a float (TYPE F) or as an integer (TYPE U). loaders.gl, which
# deck.gl reads points with, reads four such files of an orange and a dark blue point.
# Guessed: red, green, blue.
# Measured on 2026-11-29 with @loaders.gl/pcd 4.4.2: red and blue are exchanged in all of them, so skin is blue. An
# integer in an ASCII file is taken for a number first, of whose bits as a float it makes the colour: other colours
# altogether.
# Readers guessed: right, in part, in part.
. "$(dirname "$0")/common.sh"
install_npm @loaders.gl/core@4.4.2 @loaders.gl/pcd@4.4.2 \
    @math.gl/types@4.1.0
cat > look.mjs <<'NODE'
import { readFileSync } from "node:fs";
import { parse } from "@loaders.gl/core";
import { PCDLoader } from "@loaders.gl/pcd";

const COLOURS = [0xff8040, 0x0a141e];
const view = new DataView(new ArrayBuffer(4));
const asFloat = (bits) => (view.setUint32(0, bits), view.getFloat32(0));

function file(type, data) {
  const head =
    `# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F ${type}\nCOUNT 1 1 1 1\n` +
    `WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ${data}\n`;
  if (data === "ascii")
    return Buffer.from(head + COLOURS.map((bits) => `0 0 1 ${type === "F" ? asFloat(bits) : bits}\n`).join(""));
  const bytes = Buffer.alloc(32);
  COLOURS.forEach((bits, row) => {
    bytes.writeFloatLE(1, 16 * row + 8);
    bytes.writeUInt32LE(bits, 16 * row + 12);
  });
  return Buffer.concat([Buffer.from(head), bytes]);
}

const found = {};
for (const type of ["F", "U"])
  for (const data of ["ascii", "binary"]) {
    const bytes = new Uint8Array(file(type, data)).buffer;
    const { attributes } = await parse(bytes, PCDLoader, { worker: false });
    found[`${type} ${data}`] = Array.from(attributes.COLOR_0.value).join(" ");
  }
const { version } = JSON.parse(readFileSync("node_modules/@loaders.gl/pcd/package.json", "utf8"));
console.log(`@loaders.gl/pcd ${version}: 255 128 64 10 20 30 becomes`, found);
const exchanged = ["F ascii", "F binary", "U binary"].every((name) => found[name] === "64 128 255 30 20 10");
if (!exchanged || found["U ascii"] !== "64 128 127 224 65 33") {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
