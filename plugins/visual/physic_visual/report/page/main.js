// Puts the page together. What fails is said on the page, and what does not need it still works.

const message = byId("message");

function say(text) {
  message.hidden = !text;
  message.textContent = text;
}

function chooseTheme() {
  const root = document.documentElement, dark = window.matchMedia("(prefers-color-scheme: dark)");
  const set = name => { root.dataset.theme = name; };
  set(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => set(dark.matches ? "dark" : "light"));
  byId("theme").addEventListener("click", () => set(root.dataset.theme === "dark" ? "light" : "dark"));
}

function makeStage(data, photo, background, images) {
  const canvas = byId("canvas");
  try {
    const stage = new Stage(canvas, data, photo, background, images);
    canvas.addEventListener("webglcontextlost", () => say("The browser took the 3D view away. Load the page again."));
    return stage;
  } catch (error) {
    say("This browser shows no 3D: it has no WebGL, or it is switched off. The photo and all numbers are on this page. "
      + `(${error.message})`);
    document.querySelectorAll(".tools button, .tools input, #overlay").forEach(control => { control.disabled = true; });
    return null;
  }
}

const KEYS = {
  ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, 0.1, 1], ArrowDown: [0, -0.1, 1],
  "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1.1],
};

function connect(stage, panel, select) {
  offerSaving(stage);
  const pointer = new Pointer(stage, byId("labels"), byId("hint"), select), button = byId("measure");
  const measure = on => {
    pointer.measure(on);
    button.setAttribute("aria-pressed", String(on));
    byId("view").classList.toggle("measuring", on);
  };
  button.addEventListener("click", () => measure(!pointer.measuring));
  byId("photo").addEventListener("click", event => select(pointer.personInPhoto(event)));
  document.addEventListener("keydown", event => { if (event.key === "Escape" && pointer.measuring) measure(false); });
  stage.canvas.addEventListener("keydown", event => {
    if (!KEYS[event.key] || event.ctrlKey || event.metaKey) return;
    stage.orbit(...KEYS[event.key]);
    event.preventDefault();
  });
  for (const view of document.querySelectorAll("[data-view]")) {
    view.addEventListener("click", () => stage.look(view.dataset.view));
  }
  const skins = [...document.querySelectorAll("[name=skin]")], people = document.querySelector("[data-show=people]");
  const dress = () => {
    const skin = skins.find(choice => choice.checked).value;
    showLegend(byId("legend"), stage.data, skin, people.checked);
    if (skin === stage.skin) return;
    stage.wear(skin);
    panel.draw(stage);
  };
  const { meaning, radius } = stage.data.scene.backdrop;
  byId("beyond").title = `What is farther than ${radius.toFixed(0)} m, or at no known distance: ${meaning}`;
  byId("beyond").hidden = !stage.data.scene.backdrop.points.count;
  dress(); // the browser may have kept an earlier choice
  for (const choice of skins) choice.addEventListener("change", dress);
  for (const box of document.querySelectorAll("[data-show]")) {
    const show = () => stage.show(box.dataset.show, box.checked);
    box.addEventListener("change", show);
    if (box === people) box.addEventListener("change", dress);
    if (box.dataset.show === "floor" && !stage.data.floor) {
      box.checked = false;
      box.disabled = true;
      box.parentElement.title = "No floor was detected in this photo.";
    }
    show(); // the browser may have kept an earlier choice
  }
}

async function start() {
  const data = JSON.parse(byId("data").textContent);
  byId("usable").textContent = data.usable;
  const byFocal = data.distance_sigma > data.scale_sigma
    ? `distances from the camera ±${(100 * data.distance_sigma).toFixed(0)} % by focal length and scale, ` : "";
  byId("summary").textContent = (byFocal + data.summary).replaceAll(" %", "\u00a0%");
  showRemarks(byId("remarks"), data);
  showChecks(byId("checks"), data);
  showLicenses(byId("licenses"), data);
  let stage = null, panel = null;
  const select = index => {
    showPeople(byId("people"), data, index, select);
    stage?.select(index);
    if (panel) {
      panel.selected = index;
      panel.draw(stage);
    }
  };
  select(null);
  const textures = data.bodies.people.map(body => (body?.texture ? loadImage(body.texture) : null));
  const [photo, background, images] = await Promise.all(
    [loadImage(data.photo), loadImage(data.background), Promise.all(textures)]);
  say("");
  stage = makeStage(data, photo, background, images);
  panel = new PhotoPanel(byId("photo"), data, photo);
  byId("overlay").addEventListener("change", event => {
    panel.overlay = event.target.checked;
    panel.draw(stage);
  });
  panel.overlay = byId("overlay").checked;
  if (stage) connect(stage, panel, select);
  select(data.people.length === 1 ? 0 : null);
  document.documentElement.dataset.ready = stage ? "3d" : "numbers";
}

chooseTheme();
document.documentElement.classList.toggle("alone", location.hash === "#view");
start().catch(error => {
  say(`The data of this page is damaged or incomplete. Copy the file again, or write it again with physic report. (${error.message})`);
  document.documentElement.dataset.ready = "failed";
});
