// The angle curves: left and right of a joint in one chart, with the band of 1.96 sigma; inferred parts are pale.
// Drawn are points that the server chose of the frames shown (payloads.py); values are read from the frame itself.

import { getArrays } from "./api.js";
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
  constructor(box, { angles, states }, { motion, rows, axis, playback, say }) {
    Object.assign(this, { box, motion, rows, axis, playback, say, lost: states.indexOf("lost"), shown: null, asked: null });
    this.charts = paired(angles).map((chart) => this.chart(chart));
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

  draw() {
    if (!this.box.clientWidth) return; // the panel is hidden
    const [first, last] = this.axis.range(), range = `${first} ${last}`;
    if (this.shown?.range === range) {
      for (const chart of this.charts) this.drawChart(chart);
      this.move();
    } else if (this.asked !== range) this.fetch(first, last, range);
  }

  /** Fetches the points of the frames that are to be shown, and draws them; the curves before them stay so long. */
  async fetch(first, last, range) {
    this.asked = range;
    try {
      const { arrays } = await getArrays("curves", { first, count: last - first + 1 });
      if (this.asked === range) this.shown = { range, ...arrays };
    } catch (error) {
      this.say(error.message);
    }
    if (this.asked !== range) return; // another range was asked for meanwhile
    this.asked = null;
    if (this.shown?.range === range) this.draw();
  }

  /** The points of one angle: frame, degrees, sigma, state, and whether the curve is broken before the point. */
  points(column) {
    const [from, to] = this.shown.start.subarray(column, column + 2);
    return Object.fromEntries(["row", "degrees", "sigma", "state", "broken"].map((name) => [name, this.shown[name].subarray(from, to)]));
  }

  drawChart({ canvas, lines }) {
    const { context, width, height } = prepared(canvas, HEIGHT), curves = lines.map(({ column }) => this.points(column));
    const [low, high] = this.limits(curves);
    const x = (row) => LEFT + this.axis.share(this.motion.time_s[row]) * (width - LEFT);
    const y = (degrees) => 4 + ((high - degrees) / (high - low)) * (height - 14);
    context.clearRect(0, 0, width, height);
    this.grid(context, width, low, high, y);
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT, height);
    context.clip();
    lines.forEach(({ side }, i) => {
      context.strokeStyle = context.fillStyle = css(side === "r" ? "right" : "left");
      this.band(context, curves[i], x, y);
      context.setLineDash(side === "r" ? [6, 4] : []);
      for (const seen of [false, true]) this.line(context, curves[i], x, y, seen);
      this.inferredStrip(context, curves[i], x, height - 4 * (lines.length - i));
    });
    context.restore();
  }

  /** The range of all points shown, with their bands; a wide band is cut so that one frame does not set the scale. */
  limits(curves) {
    let low = Infinity, high = -Infinity;
    for (const { degrees, sigma } of curves) {
      degrees.forEach((value, k) => {
        if (Number.isNaN(value)) return;
        const band = 1.96 * (Math.min(sigma[k], 15) || 0);
        low = Math.min(low, value - band);
        high = Math.max(high, value + band);
      });
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

  /** Runs of points for which a test holds; none goes beyond a break of the curve. */
  runs({ row, broken }, test) {
    const found = [];
    for (let k = 0; k < row.length; k++) {
      if (!test(k)) continue;
      const open = found[found.length - 1];
      if (open && open[1] === k - 1 && !broken[k]) open[1] = k; else found.push([k, k]);
    }
    return found;
  }

  band(context, points, x, y) {
    const { row, degrees, sigma } = points;
    context.globalAlpha = 0.18;
    for (const [from, to] of this.runs(points, (k) => !Number.isNaN(sigma[k]))) {
      context.beginPath();
      for (let k = from; k <= to; k++) context.lineTo(x(row[k]), y(degrees[k] + 1.96 * sigma[k]));
      for (let k = to; k >= from; k--) context.lineTo(x(row[k]), y(degrees[k] - 1.96 * sigma[k]));
      context.fill();
    }
    context.globalAlpha = 1;
  }

  line(context, points, x, y, seen) {
    const { row, degrees, state, broken } = points;
    context.globalAlpha = seen ? 1 : 0.4;
    context.lineWidth = seen ? 2 : 1.5;
    const known = (k) => !Number.isNaN(degrees[k] ?? NaN), joined = (k) => known(k - 1) && known(k) && !broken[k];
    for (const [from, to] of this.runs(points, (k) => known(k) && (state[k] === 0) === seen)) {
      context.beginPath();
      const begin = !seen && joined(from) ? from - 1 : from; // pale parts connect to their neighbours
      const end = !seen && joined(to + 1) ? to + 1 : to;
      for (let k = begin; k <= end; k++) context.lineTo(x(row[k]), y(degrees[k]));
      if (begin === end) context.lineTo(x(row[begin]) + 1.5, y(degrees[begin]));
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** A strip below the curve where this angle is inferred, for those who cannot distinguish pale from full. */
  inferredStrip(context, points, x, top) {
    const { row, state, broken } = points;
    context.globalAlpha = 0.75;
    for (const [from, to] of this.runs(points, (k) => state[k] > 0)) {
      const end = to + 1 < row.length && !broken[to + 1] ? to + 1 : to;
      context.fillRect(x(row[from]), top, Math.max(1.5, x(row[end]) - x(row[from])), 2.5);
    }
    context.globalAlpha = 1;
  }

  move() {
    const { position } = this.playback, share = this.axis.share(this.motion.time_s[position]), row = this.rows.at(position);
    this.cursor.hidden = share < 0 || share > 1;
    this.cursor.style.transform = `translateX(${LEFT + share * (this.box.clientWidth - LEFT) - 1}px)`;
    for (const { lines, values } of this.charts) lines.forEach((line, i) => { values[i].textContent = this.inWords(line, row); });
  }

  inWords({ side, column }, row) {
    const name = { l: "left ", r: "right ", "": "" }[side];
    if (!row) return `${name}…`; // it is being fetched
    const degrees = row.angles[column], sigma = row.angleSigma[column];
    const state = row.angleState[column];
    if (Number.isNaN(degrees)) return `${name}${state === this.lost ? "lost" : "no value"}`;
    const band = Number.isNaN(sigma) ? "" : ` ± ${(1.96 * sigma).toFixed(0)}`;
    return `${name}${degrees.toFixed(0)}°${band}${state > 0 ? " inferred" : ""}`;
  }
}
