// The angle curves: left and right of a joint in one chart, with the band of 1.96 sigma; inferred parts are pale.

import { prepared, seekable } from "./axis.js";
import { css, themed } from "./theme.js";

const HEIGHT = 74, LEFT = 34, LEAST_DEG = 20;

/** [{title, lines: [{side, column}]}]: the two sides of an angle in one chart. */
export function paired(names) {
  const charts = new Map();
  names.forEach((name, column) => {
    const side = name.endsWith("_left") ? "l" : name.endsWith("_right") ? "r" : "";
    const title = name.replace(/_(left|right)$/, "").replaceAll("_", " ");
    if (!charts.has(title)) charts.set(title, { title, lines: [] });
    charts.get(title).lines.push({ side, column });
  });
  return [...charts.values()];
}

export class Curves {
  constructor(box, names, motion, axis, playback) {
    Object.assign(this, { box, motion, axis, playback, count: names.length });
    this.charts = paired(names).map((chart) => this.chart(chart));
    this.cursor = document.createElement("div");
    this.cursor.className = "cursor";
    box.append(...this.charts.map(({ element }) => element), this.cursor);
    axis.addEventListener("changed", () => this.draw());
    playback.addEventListener("moved", () => this.move());
    new ResizeObserver(() => this.draw()).observe(box);
    themed(() => this.draw());
  }

  chart({ title, lines }) {
    const element = document.createElement("div"), head = document.createElement("h3"), canvas = document.createElement("canvas");
    const values = lines.map(({ side }) => Object.assign(document.createElement("span"), { className: side || "l" }));
    element.className = "chart";
    head.append(title, ...values);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${title} over time, degrees`);
    element.append(head, canvas);
    seekable(canvas, this.axis, this.playback, LEFT);
    return { element, canvas, lines, values };
  }

  value(name, row, column) { return this.motion[name][row * this.count + column]; }

  draw() {
    if (!this.box.clientWidth) return; // the panel is hidden
    for (const chart of this.charts) this.drawChart(chart);
    this.move();
  }

  drawChart({ canvas, lines }) {
    const { context, width, height } = prepared(canvas, HEIGHT), [first, last] = this.axis.range();
    const [low, high] = this.limits(lines, first, last);
    const x = (row) => LEFT + this.axis.share(this.motion.time_s[row]) * (width - LEFT);
    const y = (degrees) => 4 + ((high - degrees) / (high - low)) * (height - 14);
    context.clearRect(0, 0, width, height);
    this.grid(context, width, low, high, y);
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT, height);
    context.clip();
    lines.forEach(({ side, column }, i) => {
      context.strokeStyle = context.fillStyle = css(side === "r" ? "right" : "left");
      this.band(context, column, first, last, x, y);
      context.setLineDash(side === "r" ? [6, 4] : []);
      for (const seen of [false, true]) this.line(context, column, first, last, x, y, seen);
      this.inferredStrip(context, column, first, last, x, height - 4 * (lines.length - i));
    });
    context.restore();
  }

  /** The range of all frames shown, with their bands; a wide band is cut so that one frame does not set the scale. */
  limits(lines, first, last) {
    let low = Infinity, high = -Infinity;
    for (const { column } of lines) {
      for (let row = first; row <= last; row++) {
        const degrees = this.value("angles", row, column), sigma = Math.min(this.value("angle_sigma", row, column), 15);
        if (Number.isNaN(degrees)) continue;
        low = Math.min(low, degrees - 1.96 * (sigma || 0));
        high = Math.max(high, degrees + 1.96 * (sigma || 0));
      }
    }
    if (low > high) return [0, 90];
    const pad = Math.max(0, LEAST_DEG - (high - low)) / 2;
    return [low - pad, high + pad];
  }

  grid(context, width, low, high, y) {
    const step = [5, 10, 20, 30, 60, 90].find((size) => (high - low) / size <= 4) ?? 180;
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.lineWidth = 1;
    for (let tick = Math.ceil(low / step) * step; tick <= high; tick += step) {
      context.strokeStyle = css("edge");
      context.beginPath();
      context.moveTo(LEFT, y(tick));
      context.lineTo(width, y(tick));
      context.stroke();
      context.fillStyle = css("soft");
      context.fillText(`${tick}°`, LEFT - 4, y(tick));
    }
  }

  /** Runs of rows for which a test holds. */
  runs(first, last, test) {
    const found = [];
    for (let row = first; row <= last; row++) {
      if (!test(row)) continue;
      const open = found[found.length - 1];
      if (open && open[1] === row - 1) open[1] = row; else found.push([row, row]);
    }
    return found;
  }

  band(context, column, first, last, x, y) {
    context.globalAlpha = 0.18;
    for (const [from, to] of this.runs(first, last, (row) => !Number.isNaN(this.value("angle_sigma", row, column)))) {
      context.beginPath();
      for (let row = from; row <= to; row++) context.lineTo(x(row), y(this.value("angles", row, column) + 1.96 * this.value("angle_sigma", row, column)));
      for (let row = to; row >= from; row--) context.lineTo(x(row), y(this.value("angles", row, column) - 1.96 * this.value("angle_sigma", row, column)));
      context.fill();
    }
    context.globalAlpha = 1;
  }

  line(context, column, first, last, x, y, seen) {
    context.globalAlpha = seen ? 1 : 0.4;
    context.lineWidth = seen ? 2 : 1.5;
    const known = (row) => !Number.isNaN(this.value("angles", row, column));
    const wanted = (row) => known(row) && (this.value("angle_state", row, column) === 0) === seen;
    for (const [from, to] of this.runs(first, last, wanted)) {
      context.beginPath();
      const begin = !seen && from > first && known(from - 1) ? from - 1 : from; // pale parts connect to their neighbours
      const end = !seen && to < last && known(to + 1) ? to + 1 : to;
      for (let row = begin; row <= end; row++) context.lineTo(x(row), y(this.value("angles", row, column)));
      if (begin === end) context.lineTo(x(begin) + 1.5, y(this.value("angles", begin, column)));
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** A strip below the curve where this angle is inferred, for those who cannot distinguish pale from full. */
  inferredStrip(context, column, first, last, x, top) {
    context.globalAlpha = 0.75;
    for (const [from, to] of this.runs(first, last, (row) => this.value("angle_state", row, column) > 0)) {
      context.fillRect(x(from), top, Math.max(1.5, x(Math.min(to + 1, last)) - x(from)), 2.5);
    }
    context.globalAlpha = 1;
  }

  move() {
    const row = this.playback.position, share = this.axis.share(this.motion.time_s[row]);
    this.cursor.hidden = share < 0 || share > 1;
    this.cursor.style.transform = `translateX(${LEFT + share * (this.box.clientWidth - LEFT) - 1}px)`;
    for (const { lines, values } of this.charts) lines.forEach((line, i) => { values[i].textContent = this.inWords(line, row); });
  }

  inWords({ side, column }, row) {
    const degrees = this.value("angles", row, column), sigma = this.value("angle_sigma", row, column);
    const name = { l: "left ", r: "right ", "": "" }[side];
    if (Number.isNaN(degrees)) return `${name}lost`;
    const band = Number.isNaN(sigma) ? "" : ` ± ${(1.96 * sigma).toFixed(0)}`;
    return `${name}${degrees.toFixed(0)}°${band}${this.value("angle_state", row, column) > 0 ? " inferred" : ""}`;
  }
}
