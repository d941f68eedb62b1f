// The skeleton of the newest frame, by the viewer's own drawing, and where everybody else is.

import { View } from "../view/scene.js";
import { SkeletonLayer } from "../view/skeleton.js";

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
