// The page for blinded raters: plays one trial after the other in the server's order, and takes a score for each.

import { getArrays, getJson, postJson } from "../view/api.js";
import { Rows } from "../view/chunks.js";
import { Frames, animate } from "../view/frames.js";
import { key, listKeys, listen } from "../view/keys.js";
import { layerList, layersOf, presetButtons, presetsOf } from "../view/panels.js";
import { Playback } from "../view/playback.js";
import { View, middleOf } from "../view/scene.js";
import { transport } from "../view/transport.js";

const TEN = "T"; // the key of the score that has two digits

const element = (id) => document.getElementById(id);
const say = (sentence) => { element("status").textContent = sentence; };

class Session {
  constructor({ spans, scores, best, rater }, playback) {
    Object.assign(this, { spans, scores, playback, at: 0 });
    element("title").textContent = `Rating by ${rater}`;
    this.buttons = Array.from({ length: best + 1 }, (_, score) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: score });
      if (score > 9) button.append(Object.assign(document.createElement("kbd"), { textContent: TEN }));
      button.addEventListener("click", () => { this.give(score); element("scene").focus(); });
      return button;
    });
    element("scores").replaceChildren(...this.buttons);
    this.go(Math.max(0, scores.indexOf(null)));
  }

  get left() { return this.scores.filter((score) => score === null).length; }

  /** Shows and plays a trial, by its place in the order. */
  go(at) {
    this.at = Math.min(this.spans.length - 1, Math.max(0, at));
    this.playback.limit(...this.spans[this.at]);
    this.playback.play(1);
    this.show();
  }

  /** The next trial; after the last, the first without a score. */
  next() {
    if (this.at + 1 < this.spans.length) this.go(this.at + 1);
    else this.unscored();
  }

  /** The next trial without a score, also one that was passed over. */
  unscored() {
    const after = this.scores.indexOf(null, this.at + 1), any = after < 0 ? this.scores.indexOf(null) : after;
    if (any >= 0) this.go(any);
  }

  async give(score) {
    const { at } = this;
    try {
      ({ scores: this.scores } = await postJson("score", { shown: at + 1, score }));
      say(`Saved: ${score}.`);
    } catch (error) {
      say(`Not saved: ${error.message}`);
    }
    this.show();
  }

  show() {
    const given = this.scores[this.at];
    this.buttons.forEach((button, score) => button.setAttribute("aria-pressed", String(score === given)));
    element("progress").textContent = this.left
      ? `Trial ${this.at + 1} of ${this.spans.length}, ${this.left} without a score`
      : `Trial ${this.at + 1} of ${this.spans.length}; all have a score, you may close this page`;
    element("before").disabled = this.at === 0;
    element("next").disabled = this.at === this.spans.length - 1 && !this.left;
    element("unscored").disabled = !this.left;
  }
}

function keyTable(session, playback, help) {
  return [
    { title: "Score", keys: [
      key(["0 … 9"], "the score of this trial", ({ key: digit }) => session.give(Number(digit)), [..."0123456789"]),
      key([TEN], "the score 10", () => session.give(10)),
      key(["Enter", "→"], "next trial", () => session.next(), ["Enter", "ArrowRight"]),
      key(["←"], "trial before", () => session.go(session.at - 1), ["ArrowLeft"]),
      key(["N"], "next trial without a score", () => session.unscored()),
    ] },
    { title: "Time", keys: [
      key(["Space"], "play, pause; at the end: again", () => playback.toggle()),
      key(["Home"], "from the beginning", () => { playback.seek(playback.first); playback.play(1); }),
      key(["?"], "this list of keys", help),
    ] },
  ];
}

async function start() {
  const [description, { arrays: motion, meta }] = await Promise.all([getJson("description"), getArrays("overview")]);
  const rows = new Rows(description.frames, say), unkeyed = (list) => list.map((each) => ({ ...each, key: "" }));
  const playback = new Playback(motion.time_s), view = new View(element("scene"), ...middleOf(meta));
  const frames = new Frames(description, rows, view, playback, say);
  const layers = layerList(element("layer-list"), unkeyed(layersOf(description)), () => frames.show(layers.state));
  frames.show(layers.state);
  presetButtons(element("presets"), unkeyed(presetsOf(description, view)));
  await frames.loadOnce();
  playback.addEventListener("moved", () => frames.set());
  rows.addEventListener("arrived", () => frames.set());
  transport(playback, () => {
    const [now, from, to] = [playback.position, playback.first, playback.last].map((row) => motion.time_s[row]);
    return { clock: `${(now - from).toFixed(1)} of ${(to - from).toFixed(1)} s`, spoken: `${(now - from).toFixed(1)} seconds` };
  });
  const session = new Session(description, playback), help = () => element("help").showModal();
  const keys = keyTable(session, playback, help);
  listKeys(element("key-list"), keys);
  listen(keys, () => document.querySelector("dialog[open]") !== null);
  element("before").addEventListener("click", () => session.go(session.at - 1));
  element("next").addEventListener("click", () => session.next());
  element("unscored").addEventListener("click", () => session.unscored());
  element("help-button").addEventListener("click", help);
  for (const button of document.querySelectorAll("[data-close]")) button.addEventListener("click", () => button.closest("dialog").close());
  window.anchorpose = { playback, view, frames, session, rows };
  animate(frames, say, () => element("status").textContent);
  document.documentElement.dataset.ready = "yes";
}

start().catch((error) => {
  element("notice").textContent = error.message;
  element("notice").hidden = false;
  throw error;
});
