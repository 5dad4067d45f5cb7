// What a reader takes away: the 3D view as a GLB file or a picture, and the lines that put the page into another one.

class GlbFile {
  constructor(extras) {
    this.tree = {
      asset: { version: "2.0", generator: "PhySIC" }, extensionsUsed: ["KHR_materials_unlit"], scene: 0,
      scenes: [{ nodes: [0], extras }], nodes: [], meshes: [], materials: [], accessors: [], bufferViews: [],
    };
    this.chunks = [];
    this.size = 0;
  }

  add(kind, entry) {
    return (this.tree[kind] ??= []).push(entry) - 1;
  }

  view(bytes, target) {
    const entry = { buffer: 0, byteOffset: this.size, byteLength: bytes.byteLength };
    this.chunks.push(bytes, new Uint8Array(-bytes.byteLength & 3));
    this.size += bytes.byteLength + (-bytes.byteLength & 3);
    return this.add("bufferViews", target ? { ...entry, target } : entry);
  }

  values({ array, itemSize }, bounded) {
    const rows = { bufferView: this.view(array, 34962), componentType: 5126, count: array.length / itemSize, type: `VEC${itemSize}` };
    if (!bounded) return this.add("accessors", rows);
    const [min, max] = [Array(itemSize).fill(Infinity), Array(itemSize).fill(-Infinity)];
    array.forEach((value, i) => {
      min[i % itemSize] = Math.min(min[i % itemSize], value);
      max[i % itemSize] = Math.max(max[i % itemSize], value);
    });
    return this.add("accessors", { ...rows, min, max });
  }

  // Add a mesh in its own colours, with a texture (a data URL) or with colours of vertices.
  mesh(name, geometry, texture, colors) {
    const attributes = { POSITION: this.values(geometry.getAttribute("position"), true) };
    const material = { name, extensions: { KHR_materials_unlit: {} }, doubleSided: true };
    if (texture) {
      const { array } = geometry.getAttribute("uv");
      attributes.TEXCOORD_0 = this.values({ array: array.map((v, i) => (i % 2 ? 1 - v : v)), itemSize: 2 });
      const source = this.add("images", { bufferView: this.view(decodeBytes(texture.split(",")[1])), mimeType: "image/jpeg" });
      material.pbrMetallicRoughness = { baseColorTexture: { index: this.add("textures", { source, sampler: 0 }) } };
      this.tree.samplers ??= [{ magFilter: 9729, minFilter: 9987, wrapS: 33071, wrapT: 33071 }];
    } else attributes.COLOR_0 = this.values(colors);
    const { array } = geometry.getIndex(), indices = this.add("accessors", {
      bufferView: this.view(Uint32Array.from(array), 34963), componentType: 5125, count: array.length, type: "SCALAR" });
    const primitive = { attributes, indices, material: this.add("materials", material) };
    return this.add("nodes", { name, mesh: this.add("meshes", { name, primitives: [primitive] }) });
  }

  content() {
    const padded = text => text + " ".repeat(-text.length & 3);
    this.tree.buffers = [{ byteLength: this.size }];
    const ascii = JSON.stringify(this.tree).replace(/[^\x20-\x7e]/g, c => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`);
    const json = new TextEncoder().encode(padded(ascii));
    const words = (...numbers) => Uint32Array.from(numbers);
    return new Blob([
      words(0x46546c67, 2, 28 + json.length + this.size), words(json.length, 0x4e4f534a), json,
      words(this.size, 0x004e4942), ...this.chunks], { type: "model/gltf-binary" });
  }
}

// The scene and the bodies in the photo's colours, posed and without skeletons, y up.
function glbOf({ data, groups, bodies }) {
  const file = new GlbFile({ units: "metres", colors_of_people: "those of the photo, and grey where it does not show the body" });
  const root = file.add("nodes", { name: data.title, matrix: new THREE.Matrix4().set(...data.upright).toArray(), children: [] });
  const add = node => file.tree.nodes[root].children.push(node);
  if (groups.mesh.geometry.getIndex().count) add(file.mesh("scene", groups.mesh.geometry, data.background));
  bodies.forEach((body, index) => {
    if (body) add(file.mesh(`person_${index}`, body.geometry, data.bodies.people[index].texture, body.userData.colors.photo));
  });
  if (!file.size) delete file.tree.nodes[root].children;
  return file.content();
}

// The 3D view as it is now, on its background.
function pictureOf(stage) {
  const { canvas } = stage, picture = document.createElement("canvas"), style = getComputedStyle(document.documentElement);
  [picture.width, picture.height] = [canvas.width, canvas.height];
  const context = picture.getContext("2d"), shade = context.createLinearGradient(0, 0, 0, picture.height);
  shade.addColorStop(0, style.getPropertyValue("--stage-top"));
  shade.addColorStop(1, style.getPropertyValue("--stage-low"));
  context.fillStyle = shade;
  context.fillRect(0, 0, picture.width, picture.height);
  stage.render(); // the browser clears the canvas after each frame
  context.drawImage(canvas, 0, 0);
  return new Promise(resolve => picture.toBlob(resolve, "image/png"));
}

function download(blob, name) {
  const href = URL.createObjectURL(blob);
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60000);
}

// The element that shows the 3D view of this page in another page.
function embedding(title) {
  const [address] = location.href.split("#"), isOnline = location.protocol.startsWith("http");
  const escaped = text => text.replace(/[&"<>]/g, mark => `&#${mark.charCodeAt(0)};`);
  const source = escaped(isOnline ? address : address.split("/").pop());
  return `<iframe src="${source}#view" title="${escaped(title)}" width="900" height="600" style="border:0" allow="fullscreen" loading="lazy"></iframe>`;
}

function offerSaving(stage) {
  const { data } = stage, name = data.title.replace(/\.\w+$/, "").replace(/[^\w.-]+/g, "_") || "result";
  const view = document.querySelector(".stage"), dialog = byId("embedding"), lines = byId("snippet");
  byId("glb").addEventListener("click", () => download(glbOf(stage), `${name}.glb`));
  byId("picture").addEventListener("click", async () => download(await pictureOf(stage), `${name}.png`));
  byId("full").hidden = !document.fullscreenEnabled;
  byId("full").addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : view.requestFullscreen()));
  byId("embed").addEventListener("click", () => {
    lines.value = embedding(data.title);
    dialog.showModal();
    lines.select();
  });
  byId("copy").addEventListener("click", () => {
    lines.select();
    document.execCommand("copy"); // works in a page of a file too
  });
  byId("close").addEventListener("click", () => dialog.close());
}
