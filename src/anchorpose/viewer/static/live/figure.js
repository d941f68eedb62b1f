// The skeleton of the newest frame, by the viewer's own drawing, and where everybody else is.

import { View } from "../view/scene.js";
import { SkeletonLayer } from "../view/skeleton.js";
import { DotLayer } from "../view/skeleton.js";

const SIZE = 2; // of dots and limbs, against the viewer's: this is looked at from afar
const FAR_M = 1.2; // from the middle of the view: then the view follows

export class Figure {
  constructor(canvas, description, people) {
    Object.assign(this, { canvas, description, people, view: null });
    this.count = description.joints.length;
    this.base = description.joints.indexOf("SpineBase");
    this.head = description.joints.indexOf("Head");
    this.newest = { joints: new Float32Array(3 * this.count), sigma: new Float32Array(this.count), states: new Uint8Array(this.count) };
    const draw = () => { this.view?.draw(); requestAnimationFrame(draw); };
    draw();
  }

  /** message: of a frame; null where nothing is known. */
  set(message) {
    if (message) this.take(message);
    const head = message?.joints_m[this.head] ?? [null];
    this.people.set(message?.people ?? [], head.includes(null) ? null : head);
    if (!this.view) return;
    this.skeleton.group.visible = message !== null;
    this.skeleton.set(0);
    this.view.invalidate();
  }

  take({ joints_m: joints, sigma_m: sigma, state }) {
    joints.forEach((place, i) => this.newest.joints.set(place.map((value) => value ?? NaN), 3 * i));
    this.newest.sigma.set(sigma.map((value) => value ?? NaN));
    this.newest.states.set(state);
    const place = joints[this.base];
    if (place.includes(null)) return;
    if (!this.view) this.begin(place, joints);
    const { target } = this.view.controls, [x, , z] = place;
    if (Math.hypot(target.x - x, target.z - z) > FAR_M) this.view.moveTo([x, this.view.middle.y, z]);
  }

  begin([x, y, z], joints) {
    const floor = Math.min(...joints.map((place) => place[1] ?? Infinity)) - 0.03; // the sole below the foot's joint
    this.view = new View(this.canvas, [x, Math.max(y, floor + 0.9), z], floor);
    this.skeleton = new SkeletonLayer(this.description, { at: () => this.newest }, this.view, SIZE);
    this.view.scene.add(this.skeleton.group);
    this.people.begin(this.view, floor);
  }

  look(name) { this.view?.look(name); }
}

// Who is the patient, and everybody else in view: a column of diamonds each, and a button that makes them the patient.
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
