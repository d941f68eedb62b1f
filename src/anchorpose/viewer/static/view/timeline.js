// The recording at a glance: the states of the joints, what the body does not explain, contacts, corrections.

import { prepared, seekable } from "./axis.js";
import { css, themed } from "./theme.js";

const LEFT = 136, ROW = 15, TOP = 18;
const FULL = 4; // times the limit at which a bar of the unexplained frames has its full height

export class Timeline {
  constructor(canvas, description, motion, axis, playback, corrections) {
    Object.assign(this, { canvas, description, motion, axis, playback, corrections });
    this.joints = description.joints.length;
    this.touches = [...new Set(description.contacts.map(named))];
    this.moments = description.unexplained ?? [];
    const rows = ["joints", ...(motion.unexplained ? ["not explained"] : []), "marked, corrected", ...this.touches];
    this.rowOf = Object.fromEntries(rows.map((name, row) => [name, row]));
    this.chosen = () => {}; // called with the place of a moment in the list when its number is clicked
    this.cursor = Object.assign(document.createElement("div"), { className: "cursor" });
    canvas.parentElement.style.position = "relative";
    canvas.after(this.cursor);
    seekable(canvas, axis, playback, LEFT);
    canvas.addEventListener("click", ({ offsetX: x, offsetY: y }) => this.clicked(x, y));
    axis.addEventListener("changed", () => this.draw());
    corrections.addEventListener("changed", () => this.draw());
    playback.addEventListener("moved", () => this.move());
    new ResizeObserver(() => this.draw()).observe(canvas.parentElement);
    themed(() => this.draw());
    canvas.setAttribute("aria-label", this.inWords());
  }

  x(time) { return LEFT + this.axis.share(time) * (this.width - LEFT); }

  top(name) { return TOP + ROW * this.rowOf[name]; }

  draw() {
    const height = TOP + ROW * Object.keys(this.rowOf).length + 2;
    this.canvas.style.height = `${height}px`;
    const { context, width } = prepared(this.canvas, height);
    this.width = width;
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    this.ticks(context, width, height);
    Object.keys(this.rowOf).forEach((name) => this.label(context, name));
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT, height);
    context.clip();
    this.states(context);
    if (this.motion.unexplained) this.unexplained(context);
    this.marks(context, height);
    this.contacts(context);
    context.restore();
    this.move();
  }

  label(context, name) {
    context.fillStyle = css("soft");
    context.textAlign = "right";
    context.fillText(name, LEFT - 8, this.top(name) + ROW / 2, LEFT - 10);
  }

  ticks(context, width, height) {
    const span = this.axis.to - this.axis.from, first = this.description.first_s;
    const step = [0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600].find((size) => span / size <= (width - LEFT) / 70) ?? 1800;
    context.textAlign = "center";
    for (let tick = Math.ceil((this.axis.from - first) / step) * step; tick <= this.axis.to - first + 1e-9; tick += step) {
      const x = this.x(first + tick);
      context.fillStyle = css("edge");
      context.fillRect(x, TOP - 4, 1, height - TOP + 4);
      context.fillStyle = css("soft");
      if (x < width - 16) context.fillText(`${Number(tick.toFixed(1))} s`, Math.max(LEFT + 8, x), 8);
    }
  }

  /** What is drawn of frames: one after the other, or where several share a pixel, once, worst as worse(a, b) has it. */
  columns(value, worse, draw) {
    const [first, last] = this.axis.range(), times = this.motion.time_s;
    const shown = (row) => Math.floor(this.x(times[row]));
    for (let row = first; row <= last; row++) {
      const from = row;
      let worst = value(row);
      while (row < last && shown(row + 1) === shown(from)) worst = worse(worst, value(++row));
      const x = this.x(times[from]);
      draw(worst, x, this.x(times[Math.min(row + 1, times.length - 1)]) - x);
    }
  }

  /** A column per frame: the shares of the joints that are observed (from below), inferred, lost. */
  states(context) {
    const inner = ROW - 3, { observed, lost } = this.motion;
    const worse = (a, b) => ({ lost: Math.max(a.lost, b.lost), seen: Math.min(a.seen, b.seen) });
    this.columns((row) => ({ lost: lost[row] / this.joints, seen: observed[row] / this.joints }), worse, (share, x, width) => {
      const wide = Math.max(1, width + 0.5), top = TOP + 1;
      context.fillStyle = css("lost");
      context.fillRect(x, top, wide, inner * share.lost);
      context.fillStyle = css("inferred");
      context.fillRect(x, top + inner * share.lost, wide, inner * (1 - share.lost - share.seen));
      context.fillStyle = css("observed");
      context.fillRect(x, top + inner * (1 - share.seen), wide, inner * share.seen);
    });
  }

  /** A bar where the body does not explain the frame, the higher the worse; the worst moments by their numbers. */
  unexplained(context) {
    const inner = ROW - 3, times = this.motion.time_s, bottom = this.top("not explained") + 1 + inner;
    context.fillStyle = css("unexplained");
    const known = (row) => this.motion.unexplained[row] || 0; // NaN where it is not known
    this.columns(known, Math.max, (value, x, width) => {
      const high = inner * Math.min(1, value / FULL);
      if (value >= 1) context.fillRect(x, bottom - high, Math.max(2, width + 0.5), high);
    });
    context.textAlign = "center";
    context.font = "bold 10px system-ui, sans-serif";
    [...this.moments.entries()].reverse().forEach(([i, { position }]) => { // the worst on top
      const x = this.x(times[position]), y = bottom - inner / 2;
      context.fillStyle = css("ink");
      context.beginPath();
      context.arc(x, y, 6.5, 0, 7);
      context.fill();
      context.fillStyle = css("panel");
      context.fillText(i + 1, x, y + 0.5);
    });
    context.font = "12px system-ui, sans-serif";
  }

  clicked(x, y) {
    if (!this.motion.unexplained || Math.abs(y - this.top("not explained") - ROW / 2) > ROW / 2) return;
    const i = this.moments.findIndex(({ position }) => Math.abs(this.x(this.motion.time_s[position]) - x) <= 7);
    if (i >= 0) this.chosen(i);
  }

  contacts(context) {
    for (const contact of this.description.contacts) {
      const top = this.top(named(contact)) + 3, from = this.x(contact.start_s);
      const wide = Math.max(3, this.x(contact.end_s) - from);
      context.fillStyle = context.strokeStyle = css("touch");
      if (contact.state === "seen") context.fillRect(from, top, wide, ROW - 6);
      else context.strokeRect(from + 0.5, top + 0.5, wide - 1, ROW - 7); // hollow: inferred, as with joints
    }
  }

  marks(context, height) {
    const top = this.top("marked, corrected") + 2;
    for (const { start_s: start, end_s: end } of this.corrections.held.unusable) {
      const from = this.x(start), wide = Math.max(3, this.x(end) - from);
      context.fillStyle = css("unusable");
      context.globalAlpha = 0.16;
      context.fillRect(from, TOP, wide, height - TOP);
      context.globalAlpha = 1;
      context.fillRect(from, top, wide, ROW - 4);
    }
    context.fillStyle = css("ink");
    const { joints, patient } = this.corrections.held;
    for (const { time_s: time } of patient ? [...joints, patient] : joints) {
      context.beginPath();
      context.arc(this.x(time), top + (ROW - 4) / 2, 4, 0, 7);
      context.fill();
    }
    const open = this.corrections.open;
    for (const row of [open.first, open.last]) {
      if (row === null) continue;
      context.fillStyle = css("unusable");
      context.fillRect(this.x(this.motion.time_s[row]) - 1, TOP, 3, height - TOP);
    }
  }

  move() {
    const share = this.axis.share(this.motion.time_s[this.playback.position]);
    this.cursor.hidden = share < 0 || share > 1;
    this.cursor.style.transform = `translateX(${LEFT + share * (this.canvas.clientWidth - LEFT) - 1}px)`;
  }

  inWords() {
    const { observed, lost } = this.motion, share = (counts) => ((100 * counts.reduce((sum, count) => sum + count, 0)) / (this.joints * counts.length)).toFixed(0);
    const wrong = this.motion.unexplained?.filter((value) => value >= 1).length;
    return `Over time: ${share(observed)} % of the joints observed, ${share(lost)} % lost; `
      + (wrong === undefined ? "" : `${wrong} frames that the body does not explain; `)
      + `${this.description.contacts.length} contacts${this.touches.length ? `: ${this.touches.join(", ")}` : ""}`;
  }
}

const named = ({ part, toucher }) => `${part.replaceAll("_", " ")}, ${toucher}`;
