#!/bin/sh
# A depth photo as phones of Google write it: a JPEG whose XMP has Near and Far, and the depth map as a PNG of 120 kB in
# base64, over three segments of extended XMP. In a second file these stand in reverse order, which a robust reader
# tolerates, by the specification.
# Guessed: exifr has Near and Far, and the depth where `multiSegment` asks for it; ExifReader has all of both files.
# Measured on 2026-11-29 with exifr 7.1.3 and exifreader 4.46.0: from a path, exifr returns nothing without
# `multiSegment`, and throws nothing: a RangeError lies in the field `errors`. From the bytes of the same file it has
# all, with or without. Of the second file neither has the depth, in silence.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install_npm exifr@7.1.3 exifreader@4.46.0 jpeg-js@0.4.4 fast-png@8.0.0
cat > look.mjs <<'NODE'
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import ExifReader from "exifreader";
import exifr from "exifr";
import { encode } from "fast-png";
import jpeg from "jpeg-js";

const [width, height] = [400, 300];
let state = 1;
const noise = Uint8Array.from({ length: width * height }, () => {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return state >>> 24;
});
const depth = Buffer.from(encode({ width, height, data: noise, channels: 1, depth: 8 })).toString("base64");
const packet = (attributes) =>
  Buffer.from(`<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="" xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/"
xmlns:xmpNote="http://ns.adobe.com/xmp/note/" ${attributes}/></rdf:RDF></x:xmpmeta>`);
const extended = packet(`GDepth:Data="${depth}"`);
const digest = createHash("md5").update(extended).digest("hex").toUpperCase();
const stated = 'GDepth:Format="RangeInverse" GDepth:Near="0.5" GDepth:Far="8.0" GDepth:Mime="image/png"';
const standard = packet(`xmpNote:HasExtendedXMP="${digest}" ${stated}`);

function segment(name, ...parts) {
  const content = Buffer.concat([Buffer.from(`${name}\0`), ...parts]);
  return Buffer.concat([Buffer.from([0xff, 0xe1, (content.length + 2) >> 8, (content.length + 2) & 255]), content]);
}
const chunks = [];
for (let offset = 0; offset < extended.length; offset += 65400) {
  const head = Buffer.alloc(8);
  head.writeUInt32BE(extended.length);
  head.writeUInt32BE(offset, 4);
  const chunk = extended.subarray(offset, offset + 65400);
  chunks.push(segment("http://ns.adobe.com/xmp/extension/", Buffer.from(digest), head, chunk));
}
const grey = jpeg.encode({ width, height, data: Buffer.alloc(width * height * 4, 128) }, 90).data;
const first = segment("http://ns.adobe.com/xap/1.0/", standard);
writeFileSync("photo.jpg", Buffer.concat([grey.subarray(0, 2), first, ...chunks, grey.subarray(2)]));
writeFileSync("reverse.jpg", Buffer.concat([grey.subarray(0, 2), first, ...chunks.reverse(), grey.subarray(2)]));

const seen = (near, data) => `${near === undefined ? "-" : Number(near)} ${data === depth ? "depth" : "-"}`;
async function withExifr(source, options) {
  const { Near, Data, errors } = await exifr.parse(source, { xmp: true, ...options });
  return seen(Near, Data) + (errors ? ` ${errors[0].name}` : "");
}
function withExifReader(path) {
  const { Near, Data } = ExifReader.load(readFileSync(path));
  return seen(Near?.value, Data?.value);
}
const found = {};
for (const path of ["photo.jpg", "reverse.jpg"]) {
  found[path] = [
    await withExifr(path),
    await withExifr(path, { multiSegment: true }),
    await withExifr(readFileSync(path)),
    withExifReader(path),
  ];
}
console.log("exifr 7.1.3 of a path, with multiSegment, of bytes, exifreader 4.46.0:", JSON.stringify(found));
const expected = {
  "photo.jpg": ["- - RangeError", "0.5 depth", "0.5 depth", "0.5 depth"],
  "reverse.jpg": ["- - RangeError", "0.5 -", "0.5 -", "0.5 -"],
};
if (chunks.length !== 3 || JSON.stringify(found) !== JSON.stringify(expected)) {
  console.log("the behaviour has changed");
  process.exit(1);
}
NODE
node look.mjs
