#!/bin/sh
# A depth map of 2000 and 3000 mm is a grey PNG of 16 bits. sharp, which web servers read pictures with, is asked for
# its raw values in 16 bits: `raw({ depth: "ushort" })`.
# Guessed: 2000 and 3000.
# Measured on 2026-11-29 with sharp 0.35.5: 7 and 11, in 16 bits and three channels, in silence: it makes a picture of
# 8 bits first. With `toColourspace("grey16")` before it has 2000 and 3000. A PNG that is turned by 90 degrees and
# written has 8 bits and three channels, too, without that.
# Readers guessed: right, right, right.
. "$(dirname "$0")/common.sh"
install_npm sharp@0.35.5 fast-png@8.0.0
cat > look.mjs <<'NODE'
import { decode, encode } from "fast-png";
import sharp from "sharp";

const file = encode({ width: 2, height: 1, depth: 16, channels: 1, data: new Uint16Array([2000, 3000]) });
async function raw(picture) {
  const { data, info } = await picture.raw({ depth: "ushort" }).toBuffer({ resolveWithObject: true });
  return [info.channels, ...new Uint16Array(data.buffer, data.byteOffset, data.length / 2)];
}
const turned = decode(await sharp(file).rotate(90).png().toBuffer());
const found = {
  plain: await raw(sharp(file)),
  grey16: await raw(sharp(file).toColourspace("grey16")),
  turned: [turned.depth, turned.channels],
};
console.log(`sharp ${sharp.versions.sharp}, channels and values of 2000 and 3000:`, JSON.stringify(found));
const expected = { plain: [3, 7, 7, 7, 11, 11, 11], grey16: [1, 2000, 3000], turned: [8, 3] };
if (JSON.stringify(found) !== JSON.stringify(expected)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
