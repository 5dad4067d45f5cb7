// What a reader takes away: the 3D view as a picture, and on the whole screen.

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

function offerSaving(stage) {
  const name = stage.data.title.replace(/\.\w+$/, "").replace(/[^\w.-]+/g, "_") || "result";
  const view = document.querySelector(".stage");
  byId("picture").addEventListener("click", async () => download(await pictureOf(stage), `${name}.png`));
  byId("full").hidden = !document.fullscreenEnabled;
  byId("full").addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : view.requestFullscreen()));
}
