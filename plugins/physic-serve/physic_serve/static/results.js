// The reconstructions of this browser: their addresses are kept in the browser, since an address is the key to a result.
"use strict";
const results = {
  key: "physic-results",
  read() {
    try { return JSON.parse(localStorage.getItem(this.key)) || []; } catch { return []; }
  },
  write(list) {
    try { localStorage.setItem(this.key, JSON.stringify(list)); } catch { return; }
  },
  add(id) {
    const list = this.read();
    if (!list.some((one) => one.id === id)) this.write([{ id, time: Date.now() }, ...list].slice(0, 100));
  },
  remove(id) {
    this.write(this.read().filter((one) => one.id !== id));
  },
};
