// The page of a live session: skeleton, dials, facts, and what to know when nothing comes.

import { getJson, postJson } from "../view/api.js";
import { isFull, remember, remembered } from "./choice.js";
import { Dial } from "./dials.js";
import { showFacts } from "./facts.js";
import { Figure, People } from "./figure.js";
import { Markers } from "./markers.js";
import { Sound } from "./sound.js";
import { Stream } from "./stream.js";

const REFUSAL_MS = 5000; // that a refusal is shown

const byId = (id) => document.getElementById(id);

class Page {
  constructor(description) {
    this.angles = description.angles;
    this.figure = new Figure(byId("scene"), description, new People(byId("people"), (number) => this.choose(number)));
    this.refusal = "";
    this.sound = new Sound(byId("sound"));
    this.choices = remembered(this.angles);
    this.sentence = "";
    byId("add").addEventListener("click", () => this.add());
    for (const button of byId("presets").children) button.addEventListener("click", () => this.figure.look(button.dataset.view));
    if (description.markers) this.markers = new Markers(byId);
    this.build();
    showFacts(null);
    this.stream = new Stream("events");
    this.stream.addEventListener("frame", ({ detail }) => this.show(detail));
    this.stream.addEventListener("sentence", ({ detail }) => { this.sentence = detail; if (!this.stream.running) this.say(detail); });
    this.stream.addEventListener("silent", ({ detail }) => this.clear(detail));
  }

  build() {
    this.dials = this.choices.map((choice) => new Dial(choice, this.angles, {
      changed: () => remember(this.choices),
      removed: () => { this.choices = this.choices.filter((one) => one !== choice); this.rebuild(); },
    }));
    byId("dials").replaceChildren(...this.dials.map(({ element }) => element));
    byId("add").disabled = isFull(this.choices);
  }

  rebuild() {
    remember(this.choices);
    this.build();
  }

  add() {
    const free = this.angles.find((angle) => !this.choices.some((choice) => choice.angle === angle));
    this.choices.push({ angle: free ?? this.angles[0], from: 0, to: 10 });
    this.rebuild();
  }

  /** Another person is to be the patient; the server says what comes of it. */
  async choose(number) {
    try {
      await postJson("patient", { person: number });
    } catch (error) {
      this.refusal = error.message;
      this.say(error.message);
      setTimeout(() => { this.refusal = ""; }, REFUSAL_MS);
    }
  }

  show(message) {
    this.figure.set(message);
    for (const dial of this.dials) {
      const column = this.angles.indexOf(dial.choice.angle);
      const reading = { degrees: message.degrees[column], sigma: message.sigma_deg[column], state: message.angle_state[column] };
      if (dial.set(reading)) this.sound.play();
    }
    showFacts(message);
    byId("pace").textContent = `${message.latency_ms.toFixed(0)} ms from image to joints · ${message.dropped} images dropped`;
    this.say(message.why_lost ? `The patient is lost: ${message.why_lost}.` : this.refusal);
  }

  /** Nothing is known now: no value may stay. */
  clear(why) {
    this.figure.set(null);
    for (const dial of this.dials) dial.set(null);
    showFacts(null);
    byId("pace").textContent = "";
    this.say(why);
  }

  say(text) {
    const box = byId("message");
    if (box.textContent !== text) box.textContent = text;
    box.hidden = !text;
  }
}

try {
  globalThis.anchorpose = new Page(await getJson("description"));
  document.documentElement.dataset.ready = "";
} catch (error) {
  byId("message").textContent = error.message;
}
