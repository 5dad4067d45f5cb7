// The 3D view: scene, people, floor and camera, in the upright frame (y up), meters.

const BODIES = 1; // layer of what is drawn over the photo
const FIELD_OF_VIEW = 40;
const LEAST_HEIGHT = 0.05; // of the eye above the floor, m: from below, the floor hides the people
const SCENE = ["mesh", "points", "backdrop"];
const LINEAR = Float32Array.from({ length: 256 }, (_, v) => new THREE.Color().setRGB(v / 255, 0, 0, THREE.SRGBColorSpace).r);

class Stage {
  constructor(canvas, data, photo, background, images) {
    Object.assign(this, { canvas, data, background, images });
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new THREE.Scene();
    this.root = new THREE.Group(); // its children are in the frame of the photo's camera
    this.root.matrix.set(...data.upright);
    this.root.matrixAutoUpdate = false;
    this.scene.add(this.root, ...lights());
    this.listeners = [];
    this.skin = "photo";
    this.isPhotoBehind = false; // the photo is behind the bodies in place of the scene

    const textures = images.map(image => image && makeTexture(image));
    this.bodies = data.people.map((person, index) => makeBody(data, index, textures[index]));
    const { mesh, points, backdrop, sky, ground } = makeScene(data, background);
    // Day stays day on a dark page.
    document.documentElement.style.setProperty("--stage-top", cssColor(sky));
    document.documentElement.style.setProperty("--stage-low", cssColor(ground));
    const people = new THREE.Group();
    for (const body of this.bodies) if (body) people.add(body);
    this.assumed = data.assumed.map(one => makeAssumed(data, one));
    for (const slab of this.assumed) people.add(slab);
    this.root.updateMatrixWorld(true);
    this.groups = { mesh, points, backdrop, people, camera: makeFrustum(data, photo) };
    this.root.add(...Object.values(this.groups));
    this.root.updateMatrixWorld(true);
    this.box = this.bounds(this.bodies);
    this.mainBodies = data.main.map(index => this.bodies[index]);
    this.mainBox = this.bounds(this.mainBodies);
    this.spots = this.bodies.filter(Boolean).flatMap(samples);
    this.groups.floor = makeFloor(data, this.box, this.root);
    this.scene.add(this.groups.floor);

    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.02, 500 + 2 * data.scene.backdrop.radius);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => {
      this.isPhotoBehind = false;
      this.stayAboveFloor();
      this.keepPeople();
      this.draw();
    });
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 20 * this.box.getSize(new THREE.Vector3()).length();
    this.photoCamera = makePhotoCamera(data, this.root); // a place to look from
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
    this.look("people");
  }

  // Lift the eye, at its distance from the target, to the least height; the frame is upright with the floor at y = 0.
  stayAboveFloor() {
    const { target } = this.controls, offset = this.camera.position.clone().sub(target);
    if (!this.data.floor || this.camera.position.y >= LEAST_HEIGHT) return;
    target.y = Math.max(target.y, 0);
    const distance = offset.length(), height = Math.min(0.99 * distance, LEAST_HEIGHT - target.y);
    const flat = Math.hypot(offset.x, offset.z) || 1, reach = Math.sqrt(distance ** 2 - height ** 2);
    offset.set(offset.x / flat * reach, height, offset.z / flat * reach);
    this.camera.position.copy(target).add(offset);
    this.camera.lookAt(target);
  }

  // Move eye and target together until the nearest point of the people is in the middle, if no person is in the view.
  keepPeople() {
    const { camera } = this, { target } = this.controls, place = new THREE.Vector3();
    camera.updateMatrixWorld();
    const isSeen = spot => place.copy(spot).project(camera).toArray().every(value => Math.abs(value) < 0.9999);
    if (!this.spots.length || this.spots.some(isSeen)) return;
    const nearest = this.spots.reduce((a, b) => (a.distanceToSquared(target) < b.distanceToSquared(target) ? a : b));
    const move = nearest.clone().sub(target);
    target.add(move);
    camera.position.add(move);
    this.stayAboveFloor();
  }

  // The box of bodies, else of most of the scene.
  bounds(bodies) {
    const box = new THREE.Box3();
    for (const body of bodies) if (body) box.expandByObject(body, true);
    if (box.isEmpty()) {
      const place = this.groups.points.geometry.getAttribute("position"), point = new THREE.Vector3();
      const sorted = [[], [], []];
      for (let i = 0; i < place.count; i += 16) {
        point.fromBufferAttribute(place, i).applyMatrix4(this.root.matrix).toArray().forEach((v, axis) => sorted[axis].push(v));
      }
      sorted.forEach(values => values.sort((a, b) => a - b));
      const at = share => sorted.map(values => values[Math.floor(share * (values.length - 1))] ?? 0);
      box.set(new THREE.Vector3(...at(0.1)), new THREE.Vector3(...at(0.9)));
    }
    return box;
  }

  show(name, shown) {
    this.groups[name].visible = shown;
    if (SCENE.includes(name)) this.isPhotoBehind = false;
    this.draw();
  }

  // Dress the bodies: "photo", "neutral", "contact", or "outline", the color of the person's number.
  wear(skin) {
    this.skin = skin;
    this.bodies.forEach(body => body?.userData.wear(skin));
    this.draw();
  }

  select(index) {
    this.bodies.forEach((body, i) => body?.userData.highlight(i === index));
    this.draw();
  }

  look(name) {
    const place = name === "camera" ? this.photoCamera.matrixWorld : this.root.matrix;
    const eye = new THREE.Vector3().setFromMatrixPosition(place), box = this.mainBox;
    const center = box.getCenter(new THREE.Vector3());
    const { width, height, camera } = this.data;
    this.camera.fov = FIELD_OF_VIEW;
    if (name === "camera") {
      const ahead = new THREE.Vector3(0, 0, -1).transformDirection(place);
      const tall = Math.max(height / camera.fy, width / camera.fx / this.camera.aspect);
      this.camera.fov = 2 * Math.atan(tall / 2) * 180 / Math.PI;
      this.camera.position.copy(eye);
      center.copy(eye).addScaledVector(ahead, Math.max(0.5, center.clone().sub(eye).dot(ahead)));
      this.controls.target.copy(center);
    } else if (name === "people") {
      this.fitFrom(new THREE.Vector3().setFromMatrixPosition(this.photoCamera.matrixWorld));
    } else {
      const turn = { angle: 48, side: 88, top: 0 }[name] * Math.PI / 180;
      const rise = { angle: 18, side: 4, top: 88 }[name] * Math.PI / 180;
      const back = Math.atan2(eye.x - center.x, eye.z - center.z) + turn;
      const points = corners(box.clone().expandByScalar(0.1));
      // The camera is in the picture too, unless it is far away.
      if (box.distanceToPoint(eye) < 6) points.push(...corners(new THREE.Box3().setFromObject(this.groups.camera)));
      this.fit(points, new THREE.Vector3(
        Math.sin(back) * Math.cos(rise), Math.sin(rise), Math.cos(back) * Math.cos(rise)));
    }
    this.camera.updateProjectionMatrix();
    this.controls.update();
    // The photo may be tilted; the controls keep the horizon level from the next turn on.
    if (name === "camera") {
      this.camera.position.copy(eye);
      this.camera.quaternion.setFromRotationMatrix(this.photoCamera.matrixWorld);
    }
    this.isPhotoBehind = name === "camera";
    this.draw();
  }

  // Move the camera to the nearest place in a direction (a unit vector towards it) from which all points are seen.
  fit(points, direction) {
    const right = new THREE.Vector3(0, 1, 0).cross(direction).normalize(), top = direction.clone().cross(right);
    const tall = 0.9 * Math.tan(FIELD_OF_VIEW * Math.PI / 360), wide = tall * this.camera.aspect, target = new THREE.Vector3();
    let distance = 0;
    for (const [axis, slope] of [[right, wide], [top, tall]]) {
      const most = Math.max(...points.map(point => point.dot(axis) + slope * point.dot(direction)));
      const least = Math.max(...points.map(point => slope * point.dot(direction) - point.dot(axis)));
      target.addScaledVector(axis, (most - least) / 2);
      distance = Math.max(distance, (most + least) / 2 / slope);
    }
    this.camera.position.copy(target).addScaledVector(direction, distance);
    // A turn is around the people.
    const depth = this.box.getCenter(new THREE.Vector3()).sub(target).dot(direction);
    this.controls.target.copy(target).addScaledVector(direction, depth);
  }

  // Look at the main people from a place, at an angle that just holds them and some of the scene around them.
  fitFrom(eye) {
    const points = this.mainBodies.length ? this.mainBodies.flatMap(samples) : corners(this.mainBox);
    const camera = this.camera, center = this.mainBox.getCenter(new THREE.Vector3());
    const reach = center.distanceTo(eye), seen = point => point.clone().applyMatrix4(camera.matrixWorldInverse);
    camera.position.copy(eye);
    let tall = 0;
    for (let round = 0; round < 3; round++) { // the middle of the picture depends on the direction a little
      camera.lookAt(center);
      camera.updateMatrixWorld();
      const spots = points.map(seen).filter(p => p.z < -0.1).map(p => [p.x / -p.z, p.y / -p.z]);
      if (!spots.length) return;
      const [[left, right], [low, high]] = [0, 1].map(axis => {
        const values = spots.map(spot => spot[axis]);
        return [Math.min(...values), Math.max(...values)];
      });
      tall = Math.max(high - low, (right - left) / camera.aspect);
      const turn = new THREE.Vector3((left + right) / 2, (low + high) / 2, -1).normalize().multiplyScalar(reach);
      center.copy(turn.applyMatrix4(camera.matrixWorld));
    }
    camera.fov = Math.min(100, 2 * Math.atan(1.3 * tall / 2) * 180 / Math.PI);
    this.controls.target.copy(center);
  }

  // Turn around the target by angles in radians, and change the distance by a factor.
  orbit(around, up, factor) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const flat = Math.hypot(offset.x, offset.z), distance = offset.length() * factor;
    const azimuth = Math.atan2(offset.x, offset.z) + around;
    const rise = Math.max(-1.5, Math.min(1.5, Math.atan2(offset.y, flat) + up));
    offset.set(Math.sin(azimuth) * Math.cos(rise), Math.sin(rise), Math.cos(azimuth) * Math.cos(rise));
    this.camera.position.copy(this.controls.target).addScaledVector(offset, distance);
    this.controls.update();
    this.stayAboveFloor();
    this.keepPeople();
    this.draw();
  }

  resize() {
    const { width, height } = this.canvas.getBoundingClientRect(), ratio = Math.min(window.devicePixelRatio, 2);
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    // A side is a fraction of a pixel long at times: draw the nearest number of whole ones. three.js rounds down.
    const [wide, high] = [width, height].map(side => (Math.round(side * ratio) + 0.25) / ratio);
    this.renderer.setDrawingBufferSize(wide, high, ratio);
    this.render();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.render();
    });
  }

  render() {
    const { camera } = this.groups, scene = SCENE.map(name => this.groups[name]), shown = scene.map(part => part.visible);
    const isBehind = this.isPhotoBehind && camera.visible;
    // From its own place, the photo would hide the scene, unless it is drawn first.
    const eye = new THREE.Vector3().setFromMatrixPosition(this.photoCamera.matrixWorld);
    const isInside = eye.distanceTo(this.camera.position) < 0.3;
    const [lines, picture] = camera.children;
    lines.visible = !isInside;
    picture.visible = !isInside || isBehind;
    picture.material.depthTest = picture.material.depthWrite = !isBehind;
    if (isBehind) for (const part of scene) part.visible = false;
    this.renderer.render(this.scene, this.camera);
    scene.forEach((part, i) => { part.visible = shown[i]; });
    this.listeners.forEach(listener => listener());
  }

  // Draw the bodies, in outlines of the people, as the photo's camera sees them on a 2D context of width x height px.
  drawBodies(context, width, height) {
    const before = this.renderer.getPixelRatio(), size = this.renderer.getSize(new THREE.Vector2());
    const shown = this.groups.people.visible, skin = this.skin;
    this.groups.people.visible = true;
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(width, height, false);
    const thick = Math.max(width, height) / 400;
    this.wear("outline");
    this.renderer.render(this.scene, this.photoCamera);
    // A white rim, so that the outline shows on clothes of its own color.
    for (const [picture, reach] of [[filled(this.canvas, "#fff"), 1.7 * thick], [this.canvas, thick]]) {
      for (let i = 0; i < 16; i++) {
        const angle = i * Math.PI / 8;
        context.drawImage(picture, reach * Math.cos(angle), reach * Math.sin(angle), width, height);
      }
    }
    this.wear(skin);
    this.renderer.render(this.scene, this.photoCamera);
    context.drawImage(this.canvas, 0, 0, width, height);
    this.groups.people.visible = shown;
    this.renderer.setPixelRatio(before);
    this.renderer.setSize(size.x, size.y, false);
    this.render();
  }

  // The position on the canvas of a point of the upright frame, px; null behind the camera.
  project(point) {
    const spot = point.clone().project(this.camera);
    if (spot.z > 1) return null;
    return [(spot.x + 1) / 2 * this.canvas.clientWidth, (1 - spot.y) / 2 * this.canvas.clientHeight];
  }
}

function corners({ min, max }) {
  return [min.x, max.x].flatMap(x => [min.y, max.y].flatMap(y => [min.z, max.z].map(z => new THREE.Vector3(x, y, z))));
}

function makeColor([red, green, blue]) {
  return new THREE.Color().setRGB(red / 255, green / 255, blue / 255, THREE.SRGBColorSpace);
}

function lights() {
  const sky = new THREE.HemisphereLight(0xffffff, 0x8d8678, 1.7), sun = new THREE.DirectionalLight(0xffffff, 1.9);
  sun.position.set(-2, 4, 5);
  sky.layers.enable(BODIES);
  sun.layers.enable(BODIES);
  return [sky, sun];
}

function makeTexture(image) {
  const texture = new THREE.Texture(image);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.anisotropy = 4;
  texture.needsUpdate = true;
  return texture;
}

// Surface with the photo without people as its texture, the points with the same colors, the backdrop, and the mean
// colors of the uppermost and lowest tenth of the photo.
function makeScene(data, background) {
  const { points, cells, faces } = decodeScene(data.scene), { columns, stride } = data.scene;
  const uv = new Float32Array(2 * cells.length), colors = new Float32Array(3 * cells.length);
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [background.width, background.height];
  const context = sheet.getContext("2d", { willReadFrequently: true });
  context.drawImage(background, 0, 0);
  const pixels = context.getImageData(0, 0, sheet.width, sheet.height).data;
  cells.forEach((cell, i) => {
    const u = (cell % columns * stride + 0.5) / data.width, v = (Math.floor(cell / columns) * stride + 0.5) / data.height;
    uv[2 * i] = u;
    uv[2 * i + 1] = 1 - v;
    const pixel = 4 * (Math.floor(v * sheet.height) * sheet.width + Math.floor(u * sheet.width));
    for (let k = 0; k < 3; k++) colors[3 * i + k] = LINEAR[pixels[pixel + k]];
  });
  const place = new THREE.BufferAttribute(points, 3), map = makeTexture(background);
  const sheetOf = (position, coordinates, triangles, side) => {
    const surface = new THREE.BufferGeometry();
    surface.setAttribute("position", position);
    surface.setAttribute("uv", new THREE.BufferAttribute(coordinates, 2));
    surface.setIndex(new THREE.BufferAttribute(triangles, 1));
    return new THREE.Mesh(surface, new THREE.MeshBasicMaterial({ map, side }));
  };
  const cloud = new THREE.BufferGeometry();
  cloud.setAttribute("position", place);
  cloud.setAttribute("color", new THREE.BufferAttribute(colors, 3));
  const dots = new THREE.PointsMaterial({ size: 2.2, sizeAttenuation: false, vertexColors: true });
  const shell = decodeBackdrop(data.scene.backdrop, data.width, data.height);
  const tenth = 4 * sheet.width * Math.ceil(sheet.height / 10), mean = (start, end) => {
    const sums = [0, 0, 0];
    for (let i = start; i < end; i++) if (i % 4 < 3) sums[i % 4] += pixels[i];
    const [gray, ...color] = [sums.reduce((a, b) => a + b) / 3, ...sums].map(sum => 4 * sum / (end - start));
    return color.map(value => Math.round((value + gray) / 2)); // half as colorful
  };
  const found = {
    mesh: sheetOf(place, uv, faces, THREE.DoubleSide),
    points: new THREE.Points(cloud, dots),
    // From outside, it must not hide what is before it.
    backdrop: sheetOf(new THREE.BufferAttribute(shell.points, 3), shell.uv, shell.faces, THREE.FrontSide),
    sky: mean(0, tenth),
    ground: mean(pixels.length - tenth, pixels.length),
  };
  found.points.visible = false;
  return found;
}

// A body with its three skins; its geometry has the vertices first, and those that seams of the texture split after them.
function makeBody(data, index, texture) {
  const packed = data.bodies.people[index];
  if (packed === null) return null;
  const points = decodePoints(packed.points), { texels, seams, vertices, uv } = decodeFaces(data.bodies, packed.points.count);
  const whole = new THREE.BufferGeometry();
  whole.setAttribute("position", new THREE.BufferAttribute(points, 3));
  whole.setIndex(new THREE.BufferAttribute(vertices, 1));
  whole.computeVertexNormals(); // before the split, so that light has no seams
  const extend = (values, size) => {
    const all = new Float32Array(size * (values.length / size + seams.length));
    all.set(values);
    seams.forEach((vertex, i) => all.set(values.subarray(size * vertex, size * (vertex + 1)), values.length + size * i));
    return new THREE.BufferAttribute(all, size);
  };
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", extend(points, 3));
  geometry.setAttribute("normal", extend(whole.getAttribute("normal").array, 3));
  geometry.setIndex(new THREE.BufferAttribute(texels, 1));
  if (uv) geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2));

  const own = data.people[index].tint.map(v => LINEAR[v]), any = data.colors.contact.map(v => LINEAR[v]);
  const partner = packed.partner && decodeIndices(packed.partner), strength = decodeBytes(packed.contact);
  const shades = [own, ...data.partners.map(({ color }) => color.map(v => LINEAR[v]))];
  const paint = color => {
    const values = new Float32Array(points.length);
    strength.forEach((_, i) => values.set(color(i), 3 * i));
    return extend(values, 3);
  };
  const colors = {
    neutral: paint(() => own),
    contact: paint(i => {
      const share = strength[i] / 255, touched = partner ? shades[partner[i]] : any;
      return own.map((value, k) => value + share * (touched[k] - value));
    }),
  };
  const matte = new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.82 });
  const outline = new THREE.MeshBasicMaterial({ color: makeColor(data.people[index].color) });
  const photo = new THREE.MeshBasicMaterial(texture ? { map: texture } : { vertexColors: true });
  if (!texture) {
    const bytes = decodeBytes(packed.colors);
    colors.photo = paint(i => [0, 1, 2].map(k => LINEAR[bytes[3 * i + k]]));
  }
  const body = new THREE.Mesh(geometry, photo);
  body.layers.enable(BODIES);
  body.userData = {
    index,
    colors,
    wear(skin) {
      body.material = { photo, outline }[skin] ?? matte;
      if (colors[skin]) geometry.setAttribute("color", colors[skin]);
    },
    highlight(on) {
      matte.emissive.set(on ? 0x2f2f2f : 0);
      photo.color.setScalar(on ? 1.3 : 1);
    },
  };
  body.userData.wear("photo");
  return body;
}

// A support that the photo does not show: a slab of glass with dashed edges.
function makeAssumed(data, { corners }) {
  const box = new THREE.BufferGeometry(), color = makeColor(data.colors.assumed);
  box.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
  const sides = [[0, 3, 2, 1], [4, 5, 6, 7], ...[0, 1, 2, 3].map(i => [i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i])];
  box.setIndex(sides.flatMap(([a, b, c, d]) => [a, b, c, a, c, d]));
  const glass = { color, transparent: true, opacity: 0.3, side: THREE.DoubleSide, depthWrite: false };
  const corner = i => new THREE.Vector3(...corners.slice(3 * i, 3 * i + 3)), spots = [];
  for (const side of sides) {
    side.forEach((from, i) => {
      const start = corner(from), end = corner(side[(i + 1) % 4]), count = Math.max(1, Math.round(start.distanceTo(end) / 0.06));
      for (let k = 0; k < count; k++) spots.push(start.clone().lerp(end, k / count), start.clone().lerp(end, (k + 0.6) / count));
    });
  }
  const slab = new THREE.Mesh(box, new THREE.MeshBasicMaterial(glass)), edges = new THREE.BufferGeometry();
  edges.setAttribute("position", new THREE.Float32BufferAttribute(spots.flatMap(spot => spot.toArray()), 3));
  slab.add(new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color })));
  return slab;
}

// Every n-th vertex of a body, in the upright frame.
function samples(body) {
  const place = body.geometry.getAttribute("position"), found = [];
  for (let i = 0; i < place.count; i += 24) found.push(new THREE.Vector3().fromBufferAttribute(place, i).applyMatrix4(body.matrixWorld));
  return found;
}

// The photo on a plane before its camera, with the edges of the field of view.
function makeFrustum(data, photo) {
  const { fx, fy, cx, cy } = data.camera, { width, height } = data;
  const nearest = Math.min(...data.people.map(person => person.camera ?? Infinity), 4);
  const depth = 0.22 * nearest * Math.min(1, fx / width);
  const at = (column, row) => [(column - cx - 0.5) / fx * depth, (row - cy - 0.5) / fy * depth, depth];
  const corners = [at(0, 0), at(width, 0), at(width, height), at(0, height)];
  const edges = corners.flatMap((corner, i) => [[0, 0, 0], corner, corner, corners[(i + 1) % 4]]);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute("position", new THREE.Float32BufferAttribute(edges.flat(), 3));
  const plane = new THREE.BufferGeometry();
  plane.setAttribute("position", new THREE.Float32BufferAttribute(corners.flat(), 3));
  plane.setAttribute("uv", new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
  plane.setIndex([0, 2, 1, 0, 3, 2]);
  const group = new THREE.Group();
  const paint = new THREE.MeshBasicMaterial({ map: makeTexture(photo), side: THREE.DoubleSide });
  const ink = new THREE.LineBasicMaterial({ color: makeColor(data.colors.camera) });
  const picture = new THREE.Mesh(plane, paint);
  picture.renderOrder = -1;
  group.add(new THREE.LineSegments(lines, ink), picture);
  return group;
}

// A camera with the photo's intrinsics; integer pixel coordinates are pixel centers.
function makePhotoCamera(data, root) {
  const { fx, fy, cx, cy } = data.camera, { width, height } = data, near = 0.05, far = 500;
  const camera = new THREE.PerspectiveCamera();
  camera.layers.set(BODIES);
  camera.matrixAutoUpdate = false;
  camera.matrix.copy(root.matrix).multiply(new THREE.Matrix4().makeScale(1, -1, -1));
  camera.matrixWorld.copy(camera.matrix);
  camera.matrixWorldInverse.copy(camera.matrix).invert();
  camera.projectionMatrix.set(
    2 * fx / width, 0, 1 - 2 * (cx + 0.5) / width, 0,
    0, 2 * fy / height, 2 * (cy + 0.5) / height - 1, 0,
    0, 0, -(far + near) / (far - near), -2 * far * near / (far - near),
    0, 0, -1, 0);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  return camera;
}

// A picture of what a canvas shows, in one color.
function filled(canvas, color) {
  const made = document.createElement("canvas"), { width, height } = canvas;
  Object.assign(made, { width, height });
  const context = made.getContext("2d");
  context.drawImage(canvas, 0, 0);
  context.globalCompositeOperation = "source-in";
  context.fillStyle = color;
  context.fillRect(0, 0, width, height);
  return made;
}

// Squares of one meter on the floor, around people and camera; empty without a floor.
function makeFloor(data, box, root) {
  const group = new THREE.Group();
  if (!data.floor) return group;
  const reach = box.clone().expandByPoint(new THREE.Vector3().setFromMatrixPosition(root.matrix)).expandByScalar(1);
  const low = [reach.min.x, reach.min.z].map(Math.floor), high = [reach.max.x, reach.max.z].map(Math.ceil), spots = [];
  for (let x = low[0]; x <= high[0]; x++) spots.push(x, 0, low[1], x, 0, high[1]);
  for (let z = low[1]; z <= high[1]; z++) spots.push(low[0], 0, z, high[0], 0, z);
  const grid = new THREE.BufferGeometry();
  grid.setAttribute("position", new THREE.Float32BufferAttribute(spots, 3));
  const sheet = new THREE.PlaneGeometry(high[0] - low[0], high[1] - low[1]).rotateX(-Math.PI / 2)
    .translate((low[0] + high[0]) / 2, 0, (low[1] + high[1]) / 2);
  const color = makeColor(data.colors.floor);
  const glass = { color, transparent: true, opacity: 0.09, side: THREE.DoubleSide, depthWrite: false };
  group.add(
    new THREE.LineSegments(grid, new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.65 })),
    new THREE.Mesh(sheet, new THREE.MeshBasicMaterial(glass)));
  return group;
}
