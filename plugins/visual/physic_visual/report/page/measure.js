// Clicks on the 3D view: select a person, or mark two points and show their distance; numbers over the people.

class Pointer {
  constructor(stage, labels, hint, onSelect) {
    Object.assign(this, { stage, labels, hint, onSelect, measuring: false, marks: [] });
    this.paint = new THREE.MeshBasicMaterial({ color: 0xff2f7d, depthTest: false });
    this.line = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 8), this.paint);
    Object.assign(this.line, { renderOrder: 1, visible: false });
    stage.scene.add(this.line);
    this.caster = new THREE.Raycaster();
    this.caster.params.Points.threshold = 0.015;
    this.numbers = stage.bodies.map((body, index) => body && this.number(index));
    this.names = stage.data.assumed.map(({ name }, i) => {
      const label = element("span", { className: "label assumed", textContent: name });
      labels.append(label);
      return { label, top: new THREE.Box3().setFromObject(stage.assumed[i]).getCenter(new THREE.Vector3()) };
    });
    this.length = element("span", { className: "label", hidden: true });
    labels.append(this.length);
    stage.listeners.push(() => this.place());
    let start = null;
    stage.canvas.addEventListener("pointerdown", event => { start = [event.clientX, event.clientY]; });
    stage.canvas.addEventListener("pointerup", event => {
      // A longer way is a turn of the view.
      if (start && Math.hypot(event.clientX - start[0], event.clientY - start[1]) < 5) this.click(event);
      start = null;
    });
  }

  number(index) {
    const label = element("span", { className: "label number", textContent: String(index) });
    label.style.background = cssColor(this.stage.data.people[index].color);
    label.style.color = "#14171a";
    const top = new THREE.Vector3(...this.stage.data.people[index].crown).applyMatrix4(this.stage.root.matrix);
    top.y += 0.1;
    this.labels.append(label);
    return { label, top };
  }

  measure(on) {
    this.measuring = on;
    this.clear();
    this.hint.textContent = on ? "Click on two points." : "";
    this.stage.draw();
  }

  clear() {
    for (const { ball } of this.marks) this.stage.scene.remove(ball);
    this.marks = [];
    this.line.visible = false;
    this.length.hidden = true;
  }

  // The person at a click on the photo, or null.
  personInPhoto(event) {
    const rect = event.target.getBoundingClientRect();
    this.caster.setFromCamera(new THREE.Vector2(
      (event.clientX - rect.left) / rect.width * 2 - 1, 1 - (event.clientY - rect.top) / rect.height * 2), this.stage.photoCamera);
    const [hit] = this.caster.intersectObjects(this.stage.bodies.filter(Boolean), false);
    return hit?.object.userData.index ?? null;
  }

  click(event) {
    const rect = this.stage.canvas.getBoundingClientRect();
    const spot = new THREE.Vector2(
      (event.clientX - rect.left) / rect.width * 2 - 1, 1 - (event.clientY - rect.top) / rect.height * 2);
    this.caster.setFromCamera(spot, this.stage.camera);
    const { mesh, points, people } = this.stage.groups;
    const targets = [...(people.visible ? this.stage.bodies.filter(Boolean) : []), ...[mesh, points].filter(o => o.visible)];
    const [hit] = this.caster.intersectObjects(this.measuring ? targets : targets.filter(o => o !== points), false);
    if (!this.measuring) this.onSelect(hit?.object.userData.index ?? null);
    else if (hit) this.mark(hit.point, hit.distance);
    else this.hint.textContent = "There is no surface here. Click on a person or on the scene.";
  }

  mark(point, distance) {
    if (this.marks.length === 2) this.clear();
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.006 * distance, 16, 12), this.paint);
    ball.renderOrder = 2;
    ball.position.copy(point);
    this.stage.scene.add(ball);
    this.marks.push({ point: point.clone(), ball, distance });
    this.hint.textContent = "Click on the second point.";
    if (this.marks.length === 2) {
      const [first, second] = this.marks.map(mark => mark.point), apart = first.distanceTo(second);
      const thick = 0.0022 * Math.max(...this.marks.map(mark => mark.distance));
      this.line.position.copy(first).add(second).multiplyScalar(0.5);
      this.line.scale.set(thick, apart, thick);
      this.line.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), second.clone().sub(first).normalize());
      this.line.visible = true;
      const sigma = this.stage.data.distance_sigma;
      this.length.textContent = meters(apart, sigma);
      this.hint.textContent = `${meters(apart, sigma)} apart, of which ${meters(Math.abs(first.y - second.y), sigma)} upwards. `
        + "Click again for other points.";
    }
    this.stage.draw();
  }

  // Move the labels to where their points are now.
  place() {
    const shown = this.stage.groups.people.visible;
    for (const one of this.numbers) if (one) this.put(one.label, shown ? one.top : null);
    const taken = [];
    for (const { label, top } of this.names) this.put(label, shown ? top : null, taken);
    const [first, second] = this.marks;
    this.put(this.length, second ? first.point.clone().add(second.point).multiplyScalar(0.5) : null);
  }

  // Move a label to a point; upwards where it would cover one of those that are there already, [column, row, half its width].
  put(label, point, taken = []) {
    const spot = point && this.stage.project(point);
    label.hidden = !spot;
    if (!spot) return;
    const half = label.offsetWidth / 2, tall = label.offsetHeight + 2;
    const covers = ([x, y, room]) => Math.abs(x - spot[0]) < room + half && Math.abs(y - spot[1]) < tall;
    while (taken.some(covers)) spot[1] -= tall;
    taken.push([...spot, half]);
    label.style.transform = `translate(-50%, -50%) translate(${spot[0].toFixed(1)}px, ${spot[1].toFixed(1)}px)`;
  }
}
