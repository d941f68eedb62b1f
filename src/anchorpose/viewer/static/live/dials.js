// An angle as a large dial: hand, number, target range. Inferred: dashed, hollow and with "~". Not known: "–".

const SVG = "http://www.w3.org/2000/svg", LOW = -30, HIGH = 150, SWEEP = 240, RADIUS = 78;

const made = (name, attributes = {}) => {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
};
const turn = (degrees, [low, high]) => -SWEEP / 2 + (SWEEP * (Math.min(high, Math.max(low, degrees)) - low)) / (high - low);
const at = (deg, radius) => [radius * Math.sin((deg * Math.PI) / 180), -radius * Math.cos((deg * Math.PI) / 180)];
const arc = (from, to) => `M ${at(from, RADIUS)} A ${RADIUS} ${RADIUS} 0 ${to - from > 180 ? 1 : 0} 1 ${at(to, RADIUS)}`;

export const inWords = (angle) => angle.replace(/^(.*)_(left|right)$/, "$2 $1").replaceAll("_", " ").replace(/^./, (first) => first.toUpperCase());

/** The scale of a dial: the usual one, wider where the target asks for it. */
const scale = ({ from, to }) => [Math.min(LOW, from - 10), Math.max(HIGH, to + 10)];

export class Dial {
  /** choice: {angle, from, to}, changed by the inputs; changed and removed are called after that. */
  constructor(choice, names, { changed, removed }) {
    Object.assign(this, { choice, names, changed, reached: false });
    this.element = Object.assign(document.createElement("article"), { className: "dial" });
    this.title = document.createElement("h2");
    this.svg = made("svg", { viewBox: "-100 -92 200 150", role: "img" });
    this.target = made("path", { class: "target" });
    this.hand = made("line", { class: "hand" });
    this.reading = made("text", { class: "reading", y: 22 });
    this.spread = made("text", { class: "spread", y: 38 });
    this.verdict = made("text", { class: "verdict", y: 55 });
    this.svg.append(made("path", { class: "track", d: arc(-SWEEP / 2, SWEEP / 2) }), this.target, this.hand, this.reading, this.spread, this.verdict);
    this.element.append(this.title, this.svg, this.inputs(removed));
    this.adjust();
    this.set(null);
  }

  inputs(removed) {
    const row = Object.assign(document.createElement("div"), { className: "row" });
    const select = document.createElement("select");
    select.append(...this.names.map((name) => new Option(inWords(name), name, false, name === this.choice.angle)));
    select.setAttribute("aria-label", "Angle");
    select.addEventListener("change", () => this.change({ angle: select.value }));
    const ends = ["from", "to"].map((end) => {
      const input = Object.assign(document.createElement("input"), { type: "number", step: 1, min: -180, max: 180, value: this.choice[end] });
      input.setAttribute("aria-label", `Target ${end}, degrees`);
      input.addEventListener("change", () => input.value !== "" && input.checkValidity() && this.change({ [end]: Number(input.value) }));
      return input;
    });
    const remove = Object.assign(document.createElement("button"), { type: "button", textContent: "×" });
    remove.setAttribute("aria-label", "Remove this angle");
    remove.addEventListener("click", removed);
    row.append(select, "target", ends[0], "to", ends[1], remove);
    return row;
  }

  change(part) {
    Object.assign(this.choice, part);
    this.adjust();
    this.set(null);
    this.changed();
  }

  adjust() {
    const { angle, from, to } = this.choice, range = scale(this.choice);
    this.title.textContent = inWords(angle);
    this.target.setAttribute("d", from <= to ? arc(turn(from, range), Math.max(turn(to, range), turn(from, range) + 1)) : "");
  }

  /** reading: {degrees, sigma, state}, null where nothing is known. Returns whether the target has just been reached. */
  set(reading) {
    const known = reading !== null && reading.degrees !== null, inferred = known && reading.state > 0;
    const before = this.reached;
    this.reached = known && reading.degrees >= this.choice.from && reading.degrees <= this.choice.to;
    this.element.classList.toggle("inferred", inferred);
    this.element.classList.toggle("reached", this.reached);
    this.hand.setAttribute("visibility", known ? "visible" : "hidden");
    this.reading.textContent = known ? `${inferred ? "~" : ""}${minus(reading.degrees)}°` : "–";
    this.spread.textContent = known && reading.sigma !== null ? `± ${(1.96 * reading.sigma).toFixed(0)}°${inferred ? " inferred" : ""}` : "";
    this.verdict.textContent = this.reached ? "✓ target" : "";
    this.svg.setAttribute("aria-label", `${inWords(this.choice.angle)}: ${known ? this.reading.textContent : "not known"}`);
    if (known) {
      const deg = turn(reading.degrees, scale(this.choice)), [[x1, y1], [x2, y2]] = [at(deg, 52), at(deg, 88)];
      for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) this.hand.setAttribute(name, value);
    }
    return this.reached && !before;
  }
}

const minus = (degrees) => (Math.round(degrees) || 0).toString().replace("-", "−"); // no minus before a zero
