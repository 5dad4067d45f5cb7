// Arrays of the page: base64 text back to numbers; see packing.py.

function decodeBytes(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

function decodePoints({ count, origin, step, data }) {
  const bytes = new DataView(decodeBytes(data).buffer), points = new Float32Array(3 * count);
  for (let i = 0; i < 3 * count; i++) points[i] = origin[i % 3] + step[i % 3] * bytes.getUint16(2 * i, true);
  return points;
}

function decodeIndices({ bits, data }) {
  const bytes = new DataView(decodeBytes(data).buffer), size = bits / 8;
  const indices = new Uint32Array(bytes.byteLength / size);
  for (let i = 0; i < indices.length; i++) {
    indices[i] = bits === 16 ? bytes.getUint16(2 * i, true) : bytes.getUint32(4 * i, true);
  }
  return indices;
}

// Returns the triangles of all bodies, by vertices and by texels; the two differ on the seams of textures.
function decodeFaces({ faces, split, uv }, count) {
  const texels = decodeIndices(faces), seams = split ? decodeIndices(split) : [];
  const ofTexel = i => (i < count ? i : seams[i - count]);
  return { texels, seams, vertices: texels.map(ofTexel), uv: uv && Float32Array.from(decodeIndices(uv), v => v / 65535) };
}

// Returns a function that tells flag i.
function decodeFlags(text) {
  const bytes = decodeBytes(text);
  return i => Boolean(bytes[i >> 3] & (1 << (i & 7)));
}

// Returns the points of the backdrop, their places in a picture of the photo, from its lower left corner, and triangles.
function decodeBackdrop({ points, faces, pixels }, width, height) {
  const uv = Float32Array.from(decodeIndices(pixels), (v, i) => (i % 2 ? 1 - (v + 0.5) / height : (v + 0.5) / width));
  return { points: decodePoints(points), uv, faces: decodeIndices(faces) };
}

// Returns points, the index of each one's pixel in the grid, and the triangles between points.
function decodeScene({ rows, columns, valid, points, triangles }) {
  const isValid = decodeFlags(valid), isTriangle = decodeFlags(triangles);
  const vertexOf = new Int32Array(rows * columns).fill(-1), cells = [];
  for (let cell = 0; cell < rows * columns; cell++) {
    if (isValid(cell)) vertexOf[cell] = cells.push(cell) - 1;
  }
  const faces = [];
  for (let cell = 0; cell < rows * columns; cell++) {
    const right = cell + 1, below = cell + columns;
    const corners = [
      isTriangle(2 * cell) ? [cell, below, right] : [],
      isTriangle(2 * cell + 1) ? [right, below, below + 1] : [],
    ].flat();
    for (const corner of corners) faces.push(vertexOf[corner]);
  }
  return { points: decodePoints(points), cells: Uint32Array.from(cells), faces: Uint32Array.from(faces) };
}

function loadImage(url) {
  return new Promise((resolve, reject) => {
    const image = new Image();
    image.onload = () => resolve(image);
    image.onerror = () => reject(new Error("a picture in this page is damaged"));
    image.src = url;
  });
}
