// Shows the photo that was chosen or dropped.
"use strict";
const field = document.querySelector("input[type=file]");
const drop = document.querySelector(".drop");
const preview = drop.querySelector("img");
const words = drop.querySelector("span");

// The words of the drop field say what it would say.
field.classList.add("hidden");

function show() {
  URL.revokeObjectURL(preview.src);
  const photo = field.files[0];
  preview.hidden = !photo;
  if (!photo) return;
  preview.src = URL.createObjectURL(photo);
  words.textContent = `${photo.name}, ${(photo.size / 1e6).toFixed(1)} MB`;
}

// Browsers show no HEIC.
preview.addEventListener("error", () => { preview.hidden = true; });
field.addEventListener("change", show);
for (const [kind, over] of [["dragover", true], ["dragleave", false], ["drop", false]]) {
  drop.addEventListener(kind, (event) => {
    event.preventDefault();
    drop.classList.toggle("over", over);
    if (kind === "drop" && event.dataTransfer.files.length) { field.files = event.dataTransfer.files; show(); }
  });
}
// a browser that goes back keeps the photo
show();
