// The photos, with the bodies drawn over them, numbers of the people, and boxes of those without a body.

// Promises of all photos, the reference first: name, size, camera, pose in the reference frame, boxes and picture.
function loadPhotos(data) {
  const boxes = Object.fromEntries(data.people.map((person, index) => [index, person.box]));
  const first = { ...data, boxes, unposed: data.unposed, pose: new THREE.Matrix4() };
  const further = data.further.map(one => ({ ...one, unposed: [], pose: new THREE.Matrix4().set(...one.pose) }));
  return [first, ...further].map(async one => ({ ...one, image: await loadImage(one.photo) }));
}

// Fill a list with the names of the photos; one photo needs no list.
function offerPhotos(list, photos, onChoose) {
  list.hidden = photos.length === 1;
  list.replaceChildren(...photos.map(({ name }, index) => element("option", { value: index, textContent: name })));
  list.addEventListener("change", () => onChoose(photos[list.value]));
}

class PhotoPanel {
  constructor(canvas, data, photo) {
    Object.assign(this, { canvas, data, overlay: true, selected: null });
    this.show(photo);
  }

  show(photo) {
    this.photo = photo;
    const scale = Math.min(1, 1000 / Math.max(photo.width, photo.height));
    this.canvas.width = Math.round(photo.width * scale);
    this.canvas.height = Math.round(photo.height * scale);
    this.canvas.setAttribute("aria-label", `The photo ${photo.name}, ${this.data.summary}`);
  }

  draw(stage) {
    const context = this.canvas.getContext("2d"), { width, height } = this.canvas;
    context.drawImage(this.photo.image, 0, 0, width, height);
    if (!this.overlay) return;
    stage?.drawBodies(context, width, height, 0.78);
    const scale = width / this.photo.width, edge = Math.max(width, height) / 420;
    context.lineWidth = edge;
    this.photo.unposed.forEach(({ box }) => this.frame(context, box, scale, "#ffd640", [3 * edge, 2 * edge]));
    this.data.people.forEach((person, index) => {
      const box = this.photo.boxes[index];
      if (!box) return;
      if (!person.posed) this.frame(context, box, scale, "#ffd640", [3 * edge, 2 * edge]);
      else if (index === this.selected) this.frame(context, box, scale, "#fff", []);
      this.badge(context, box, person.color, index, scale, edge);
    });
  }

  frame(context, [x0, y0, x1, y1], scale, color, dash) {
    context.setLineDash(dash);
    context.strokeStyle = color;
    context.strokeRect(x0 * scale, y0 * scale, (x1 - x0) * scale, (y1 - y0) * scale);
    context.setLineDash([]);
  }

  badge(context, box, color, index, scale, edge) {
    const radius = 8.5 * edge, inside = (value, most) => Math.max(radius, Math.min(most - radius, value));
    const x = inside((box[0] + box[2]) / 2 * scale, this.canvas.width), y = inside(box[1] * scale, this.canvas.height);
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = cssColor(color);
    context.strokeStyle = "#fff";
    context.fill();
    context.stroke();
    context.fillStyle = "#14171a";
    context.font = `600 ${10.5 * edge}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(String(index), x, y + 0.6 * edge);
  }
}
