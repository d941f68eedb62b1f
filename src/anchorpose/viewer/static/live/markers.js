// Keys and buttons for what is kept with the recording: a condition begins or ends, and its rating.

import { postJson } from "../view/api.js";

const TYPED_IN = "input, select, textarea";

export class Markers {
  constructor(byId) {
    this.condition = byId("condition");
    this.marked = byId("marked");
    this.last = Promise.resolve();
    byId("begins").addEventListener("click", () => this.begin());
    byId("ends").addEventListener("click", () => this.send("end"));
    document.addEventListener("keydown", (event) => this.press(event));
    byId("markers").hidden = false;
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.repeat || event.target.matches?.(TYPED_IN)) return;
    if (event.key === "b") {
      event.preventDefault(); // the field that takes the name must not take this key
      this.begin();
    }
    if (event.key === "e") this.send("end");
    else if (/^[0-9]$/.test(event.key)) this.send(`rating ${event.key}`);
  }

  begin() {
    const name = this.condition.value.trim();
    if (name) this.send(`begin ${name}`);
    else this.condition.focus();
  }

  /** One after another: the server would keep them in any order. */
  send(text) {
    this.last = this.last.then(() => this.keep(text));
  }

  async keep(text) {
    try {
      this.marked.textContent = `Kept: ${(await postJson("marker", { text })).marker}`;
    } catch (error) {
      this.marked.textContent = error.message;
    }
  }
}
