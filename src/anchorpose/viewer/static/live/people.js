// Who is the patient, and everybody else in view: a column of diamonds each, and a button that makes them the patient.

import { DotLayer } from "../view/skeleton.js";

const COLUMN = 7; // dots from floor to head
const MOST = 8; // people; more do not fit into a picture
const RADIUS_PX = 9;
const ABOVE_M = 0.12; // of a label, over the head

export class People {
  /** box: holds the labels; chosen(number): called where somebody is to be the patient. */
  constructor(box, chosen) {
    Object.assign(this, { box, chosen, view: null, buttons: new Map() });
    this.patient = Object.assign(document.createElement("span"), { className: "patient-label", textContent: "Patient", hidden: true });
    box.append(this.patient);
  }

  begin(view, floor) {
    Object.assign(this, { view, floor, dots: new DotLayer(COLUMN * MOST, view, "other", 11) });
    view.scene.add(this.dots.points);
  }

  /** people: of the newest frame, none where nothing is known; head: the patient's, null where it is not known. */
  set(people, head) {
    const shown = people.slice(0, MOST);
    for (const [number, button] of this.buttons) {
      if (shown.some((one) => one.number === number)) continue;
      button.remove();
      this.buttons.delete(number);
    }
    shown.forEach((one, i) => this.put(this.button(one.number), [one.x, one.top + ABOVE_M, one.z], i));
    this.patient.hidden = !head;
    if (head) this.put(this.patient, [head[0], head[1] + 2 * ABOVE_M, head[2]], 0);
    this.dots?.set(shown.flatMap((one) => this.column(one)));
  }

  column({ x, z, top }) {
    return Array.from({ length: COLUMN }, (_, k) => (
      { place: [x, this.floor + ((top - this.floor) * k) / (COLUMN - 1), z], shape: 2, radius: RADIUS_PX }));
  }

  button(number) {
    if (!this.buttons.has(number)) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: `Person ${number}` });
      button.dataset.person = number;
      button.setAttribute("aria-label", `Make person ${number} the patient`);
      button.addEventListener("click", () => this.chosen(number));
      this.buttons.set(number, button);
      this.box.append(button);
    }
    return this.buttons.get(number);
  }

  /** Over a place in the world; within the picture where that is outside, one under the other before there is a view. */
  put(label, place, row) {
    const { clientWidth: width, clientHeight: height } = this.box;
    const [x, y] = this.view?.project(place) ?? [0, row * 1.5 * label.offsetHeight];
    label.style.left = `${Math.min(Math.max(x - label.offsetWidth / 2, 0), width - label.offsetWidth)}px`;
    label.style.top = `${Math.min(Math.max(y - label.offsetHeight, 0), height - label.offsetHeight)}px`;
  }
}
