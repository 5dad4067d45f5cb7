// The photo, with the bodies drawn over it, numbers of the people, and boxes of those without a body.

class PhotoPanel {
  constructor(canvas, data, image) {
    Object.assign(this, { canvas, data, image, overlay: true, selected: null });
    const scale = Math.min(1, 1000 / Math.max(data.width, data.height));
    canvas.width = Math.round(data.width * scale);
    canvas.height = Math.round(data.height * scale);
    canvas.setAttribute("aria-label", `The photo, ${data.summary}`);
  }

  draw(stage) {
    const context = this.canvas.getContext("2d"), { width, height } = this.canvas;
    context.drawImage(this.image, 0, 0, width, height);
    if (!this.overlay) return;
    stage?.drawBodies(context, width, height);
    const scale = width / this.data.width, edge = Math.max(width, height) / 420;
    context.lineWidth = edge;
    this.data.unposed.forEach(({ box }) => this.frame(context, box, scale, "#ffd640", [3 * edge, 2 * edge]));
    this.data.people.forEach((person, index) => {
      const { box } = person;
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
