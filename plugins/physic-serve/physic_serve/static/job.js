// Follows a job: adds its stages as they begin, and loads the page again when it has ended.
"use strict";
const state = document.getElementById("state");
results.add(state.dataset.id);
document.querySelector("form").addEventListener("submit", () => results.remove(state.dataset.id));
if (state.dataset.state === "queued" || state.dataset.state === "running") {
  const list = document.getElementById("stages");
  const bar = document.getElementById("progress");
  const events = new EventSource(`/reconstructions/${state.dataset.id}/events`);
  events.addEventListener("open", () => list.replaceChildren());  // also after a lost connection: it begins again
  events.addEventListener("queued", (event) => {
    const before = JSON.parse(event.data).position;
    state.textContent = before ? `Waiting; ${before} before this photo.` : "Waiting.";
  });
  events.addEventListener("stage", (event) => {
    const { stage, number, count } = JSON.parse(event.data);
    state.textContent = "Running.";
    list.querySelector(".now")?.classList.remove("now");
    const item = document.createElement("li");
    item.className = "now";
    item.textContent = stage;
    list.append(item);
    if (count) { bar.max = count; bar.value = number; }
  });
  for (const end of ["done", "failed"]) {
    events.addEventListener(end, () => { events.close(); location.reload(); });
  }
}
