// The hypotheses of one frame: requested, awaited, drawn as lines from each node to where a subset finds it.

import { BufferAttribute, BufferGeometry, Color, Group, LineBasicMaterial, LineSegments, Points, PointsMaterial } from "three";
import { getArrays, getJson, postJson } from "./api.js";
import { css } from "./theme.js";

const COLOURS = ["#e69f00", "#56b4e9", "#009e73", "#d6c400", "#0072b2", "#d55e00", "#cc79a7", "#8a8a8a", "#9b5de5", "#00bbf9"];
const ASK_EVERY_MS = 400;

export class Hypotheses {
  constructor(view, playback, motion, elements, say) {
    Object.assign(this, { view, playback, motion, elements, say });
    this.group = new Group();
    this.group.visible = false;
    this.position = null;
    elements.start.addEventListener("click", () => this.start());
    elements.cancel.addEventListener("click", () => this.cancel());
    playback.addEventListener("moved", () => this.moved());
  }

  async start() {
    this.playback.pause();
    this.clear();
    try {
      await postJson("hypotheses/start", { position: this.playback.position });
    } catch (error) {
      this.say(error.message);
      return;
    }
    this.elements.cancel.hidden = false;
    this.elements.start.disabled = true;
    this.wait();
  }

  async cancel() {
    this.showStatus(await postJson("hypotheses/cancel", {}));
  }

  async wait() {
    const status = await getJson("hypotheses").catch((error) => ({ progress: "failed", messages: [error.message] }));
    this.showStatus(status);
    if (status.progress === "working") setTimeout(() => this.wait(), ASK_EVERY_MS);
    if (status.progress === "done") this.take(status, await getArrays("hypotheses/found"));
  }

  showStatus({ progress, frames_read: read, messages }) {
    const sentences = { working: `Working: ${read} frames read so far.`, cancelled: "Cancelled.", idle: "" };
    this.elements.state.textContent = sentences[progress] ?? messages.join(" ");
    this.elements.cancel.hidden = progress !== "working";
    this.elements.start.disabled = progress === "working";
  }

  take(status, { meta, arrays }) {
    this.clear();
    this.position = status.position;
    this.found = { meta, arrays };
    const { nodes, best, reached, asked } = arrays, subsets = meta.subsets.length;
    const place = [], tint = [], missed = new Color(css("ink")).toArray();
    for (let i = 0; i < best.length; i++) {
      if (!asked[i]) continue;
      place.push(nodes[3 * i], nodes[3 * i + 1], nodes[3 * i + 2]);
      tint.push(...(best[i] >= 0 ? shadeOf(best[i]) : missed));
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(place), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(tint), 3));
    const spots = new PointsMaterial({ size: 3, sizeAttenuation: false, vertexColors: true, depthTest: false, transparent: true });
    this.group.add(Object.assign(new Points(geometry, spots), { renderOrder: 5 }));
    this.lines = meta.subsets.map((_, subset) => this.linesOf(subset, nodes, reached, subsets, asked));
    this.group.add(...this.lines);
    this.legend(meta, arrays);
    this.moved();
  }

  linesOf(subset, nodes, reached, subsets, asked) {
    const ends = [];
    for (let i = 0; i < nodes.length / 3; i++) {
      const to = 3 * (i * subsets + subset);
      if (!asked[i] || Number.isNaN(reached[to])) continue;
      ends.push(nodes[3 * i], nodes[3 * i + 1], nodes[3 * i + 2], reached[to], reached[to + 1], reached[to + 2]);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
    const lines = new LineSegments(geometry, new LineBasicMaterial({ color: COLOURS[subset % COLOURS.length], depthTest: false, transparent: true }));
    lines.renderOrder = 6;
    return lines;
  }

  legend(meta, { best, reached, asked }) {
    const subsets = meta.subsets.length, total = asked.reduce((sum, one) => sum + one, 0);
    this.elements.legend.replaceChildren(...meta.subsets.map((names, subset) => {
      let known = 0, chosen = 0;
      for (let i = 0; i < asked.length; i++) {
        known += asked[i] && !Number.isNaN(reached[3 * (i * subsets + subset)]) ? 1 : 0;
        chosen += best[i] === subset ? 1 : 0;
      }
      const label = document.createElement("label"), box = document.createElement("input"), line = document.createElement("i");
      box.type = "checkbox";
      box.checked = true;
      box.addEventListener("change", () => { this.lines[subset].visible = box.checked; this.view.invalidate(); });
      line.style.borderColor = COLOURS[subset % COLOURS.length];
      label.append(box, line, `${names.join(", ").replaceAll("_", " ")}: ${known} of ${total} found, ${chosen} chosen`);
      return label;
    }));
  }

  /** Hypotheses belong to one frame and are hidden in others. */
  moved() {
    this.group.visible = this.position === this.playback.position;
    this.view.invalidate();
  }

  clear() {
    this.group.clear();
    this.position = null;
    this.elements.legend.replaceChildren();
    this.view.invalidate();
  }
}

function shadeOf(subset) {
  return new Color(COLOURS[subset % COLOURS.length]).toArray();
}
