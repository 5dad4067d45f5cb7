// Shows the photo that was chosen or dropped, and the earlier results of this browser.
"use strict";
const field = document.querySelector("input[type=file]");
const drop = document.querySelector(".drop");
const preview = drop.querySelector("img");
const words = drop.querySelector("span");
const warning = document.querySelector(".warning");

// The words of the drop field say what it would say.
field.classList.add("hidden");

function show() {
  URL.revokeObjectURL(preview.src);
  const photo = field.files[0];
  preview.hidden = !photo;
  if (!photo) return;
  preview.src = URL.createObjectURL(photo);
  words.textContent = `${photo.name}, ${(photo.size / 1e6).toFixed(1)} MB`;
  warning.hidden = photo.size <= field.dataset.megabytes * 1e6;
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

async function listResults() {
  const found = await Promise.all(results.read().map(async (one) => {
    const response = await fetch(`/reconstructions/${encodeURIComponent(one.id)}`);
    return response.status === 404 ? null : { ...one, status: response.ok ? await response.json() : null };
  }));
  const kept = found.filter(Boolean);
  results.write(kept.map(({ id, time }) => ({ id, time })));
  for (const { id, time, status } of kept) {
    if (!status) continue;
    const item = document.createElement("li"), link = document.createElement("a");
    const grade = document.createElement("span"), when = document.createElement("span");
    link.href = `/jobs/${encodeURIComponent(id)}`;
    link.textContent = status.photo || "Photo without a name";
    grade.textContent = grade.className = status.summary.grade || status.state;
    when.className = "soft";
    when.textContent = new Date(time).toLocaleString();
    item.append(link, grade, when);
    document.querySelector(".results").append(item);
    document.getElementById("earlier").hidden = false;
  }
}
// without the server, the page has no list
listResults().catch(() => {});
