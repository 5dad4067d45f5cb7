"""Write ``contact-sheet.html``: thumbnails and numbers of many photos on one page, with filters, without a network."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path, PurePath
from typing import Any

from physic_core.batch.journal import last_rows
from physic_core.batch.photos import photo_folder
from physic_core.batch.saving import thumbnail_path
from physic_core.files.atomic import atomic_write
from physic_core.io.result_folder import REPORT_FILE

__all__ = ["MAX_PHOTOS", "contact_sheet", "result_link", "write_contact_sheet"]

MAX_PHOTOS = 5000
"""Most photos of one page, which then has about 60 MB."""


def write_contact_sheet(out: Path, limit: int = MAX_PHOTOS) -> Path:
    """Write the contact sheet of a batch to its output folder and return its path.

    Raises:
        OutputError: the file cannot be written.
    """
    rows = last_rows(out)
    shown = [_card(out, row) for row in islice(rows, limit)]
    left_out = sum(1 for _ in rows)
    with atomic_write(out) as temporary:
        temporary("contact-sheet.html").write_text(contact_sheet(shown, left_out), encoding="utf-8")
    return out / "contact-sheet.html"


def contact_sheet(cards: Iterable[Mapping[str, Any]], left_out: int = 0) -> str:
    """Return the page.

    Args:
        cards: of photos: name (its id), title, path, link, thumbnail (base64 JPEG), state, error, message, grade,
            people, checks.
        left_out: number of photos that are not on the page; the page states it.
    """
    # "<" cannot end the script element.
    data = json.dumps(list(cards), ensure_ascii=True).replace("<", "\\u003c")
    note = f"{left_out:,} more photos are in the summary table only." if left_out else ""
    return _PAGE.replace("@NOTE@", html.escape(note)).replace("@DATA@", data)


def result_link(out: Path, folder: str) -> str:
    """Return the link to the page of a result, else to its folder, relative to the output folder; "" without files."""
    if not folder:
        return ""
    return f"{folder}/{REPORT_FILE}" if (out / folder / REPORT_FILE).is_file() else f"{folder}/"


def _card(out: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    folder, thumbnail = photo_folder(str(row["id"])), ""
    picture = out / thumbnail_path(folder)
    if row["state"] == "done" and picture.is_file():
        thumbnail = base64.b64encode(picture.read_bytes()).decode()
    path = str(row.get("path", ""))
    return {
        "name": row["id"],
        "title": PurePath(path).name or row["id"],
        "path": path,
        "link": result_link(out, str(row.get("folder", ""))),
        "thumbnail": thumbnail,
        "state": row["state"],
        "error": row.get("error", ""),
        "message": row.get("message", ""),
        "grade": row.get("grade", ""),
        "people": int(row.get("people") or 0) if row["state"] == "done" else None,
        "checks": str(row.get("checks_failed", "")).split(),
    }


_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>PhySIC contact sheet</title>
<style>
  body { font: 14px system-ui, sans-serif; margin: 0; color: #202226; background: #f4f4f2; }
  header { position: sticky; top: 0; background: #fff; padding: 10px 16px; border-bottom: 1px solid #ccc; z-index: 1;
           display: flex; flex-wrap: wrap; gap: 12px; align-items: center; }
  header input, header select { font: inherit; padding: 3px; }
  main { display: grid; grid-template-columns: repeat(auto-fill, minmax(320px, 1fr)); gap: 12px; padding: 16px; }
  article { background: #fff; border: 1px solid #ddd; border-radius: 6px; overflow: hidden; content-visibility: auto;
            contain-intrinsic-size: 320px 260px; }
  article img { width: 100%; display: block; }
  article p { margin: 6px 10px; overflow-wrap: anywhere; }
  .failed { border-color: #b23022; }
  .soft { color: #62666c; }
  .bad { color: #b23022; }
</style>
<header>
  <strong>PhySIC</strong>
  <label>State <select id="state"><option value="">all</option></select></label>
  <label>Grade <select id="grade"><option value="">all</option></select></label>
  <label>Failed check <select id="check"><option value="">any or none</option><option value="-">none</option>
    <option value="+">one or more</option></select></label>
  <label>People <select id="people"><option value="">all</option></select></label>
  <label>Name <input id="text" type="search" placeholder="part of the path"></label>
  <span id="count" class="soft"></span> <span class="soft">@NOTE@</span>
</header>
<main id="cards"></main>
<script id="data" type="application/json">@DATA@</script>
<script>
const cards = JSON.parse(document.getElementById("data").textContent);
const main = document.getElementById("cards");
const names = ["state", "grade", "check", "people", "text"];
const fields = Object.fromEntries(names.map(name => [name, document.getElementById(name)]));
const option = (field, value, label) => field.add(new Option(label ?? value, value));
const state = card => card.state === "done" ? "done" : card.error;
[...new Set(cards.map(state))].sort().forEach(s => option(fields.state, s));
[...new Set(cards.map(c => c.grade))].filter(Boolean).sort().forEach(s => option(fields.grade, s));
[...new Set(cards.flatMap(c => c.checks))].sort().forEach(s => option(fields.check, s));
const counts = [...new Set(cards.map(c => c.people))].filter(n => n !== null).sort((a, b) => a - b);
counts.forEach(n => option(fields.people, String(n)));
const part = (name, text, kind) => {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
};
for (const card of cards) {
  const box = card.box = document.createElement("article");
  if (card.state !== "done") box.className = "failed";
  if (card.thumbnail) {
    const image = new Image();
    image.loading = "lazy";
    image.alt = card.title;
    image.src = "data:image/jpeg;base64," + card.thumbnail;
    box.append(image);
  }
  const title = part("p", "");
  title.title = card.name;
  if (card.link) {
    const link = part("a", card.title);
    link.href = card.link.split("/").map(encodeURIComponent).join("/");
    title.append(link);
  } else title.textContent = card.title;
  box.append(title, part("p", card.path, "soft"));
  if (card.state === "done") {
    const people = card.people + (card.people === 1 ? " person" : " people");
    box.append(part("p", people + (card.grade ? ", grade: " + card.grade : "")));
  }
  if (card.checks.length) box.append(part("p", "failed: " + card.checks.join(", "), "bad"));
  const start = card.path + ": ";  // of many messages; the path stands above
  const message = card.message.startsWith(start) ? card.message.slice(start.length) : card.message;
  if (card.error) box.append(part("p", card.error + ": " + message, "bad"));
  main.append(box);
}
function show() {
  const check = fields.check.value, text = fields.text.value.toLowerCase();
  let count = 0;
  for (const card of cards) {
    const fits = (!fields.state.value || state(card) === fields.state.value)
      && (!check || (check === "-" ? card.state === "done" && !card.checks.length
                     : check === "+" ? card.checks.length > 0 : card.checks.includes(check)))
      && (!fields.grade.value || card.grade === fields.grade.value)
      && (!fields.people.value || String(card.people) === fields.people.value)
      && (!text || (card.name + " " + card.path).toLowerCase().includes(text));
    card.box.hidden = !fits;
    count += fits;
  }
  document.getElementById("count").textContent = count + " of " + cards.length + " photos";
}
for (const field of Object.values(fields)) field.addEventListener("input", show);
show();
</script>
</html>
"""
