// Follows a photo: shows its stages as they begin, and the whole page when it has ended.
"use strict";
const isOpen = (page) => ["queued", "running"].includes(page.getElementById("progress")?.dataset.state);
async function follow() {
  while (isOpen(document)) {
    await new Promise((resolve) => setTimeout(resolve, 300));
    const response = await fetch(location.href).catch(() => null);
    if (!response) continue;
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    const part = isOpen(page) ? "#progress" : "main";
    document.querySelector(part).replaceWith(page.querySelector(part));
  }
}
follow();
