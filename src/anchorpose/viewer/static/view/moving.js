// Moving a joint to its place: by the arrows of a gizmo, by keys, or onto a point of the surface.

import { Object3D, Vector3 } from "three";
import { TransformControls } from "../three/TransformControls.js";

const STEP_M = 0.005, FINE_STEP_M = 0.001;

export class JointMover {
  constructor({ view, playback, skeleton, rows, points, corrections, signing, description, motion, elements, say, redraw }) {
    Object.assign(this, { view, playback, skeleton, rows, points, corrections, signing, description, motion, elements, say, redraw });
    this.place = new Object3D();
    view.scene.add(this.place);
    this.active = false;
    this.snapping = false;
    this.gizmo = new TransformControls(view.camera, view.canvas);
    this.gizmo.setSize(0.75);
    this.helper = this.gizmo.getHelper();
    this.helper.visible = false;
    view.scene.add(this.helper);
    this.gizmo.addEventListener("dragging-changed", ({ value }) => { view.controls.enabled = !value; });
    this.gizmo.addEventListener("change", () => view.invalidate());
    this.gizmo.addEventListener("objectChange", () => this.changed());
    this.gizmo.enabled = false;
    elements.select.append(...description.joints.map((name, i) => new Option(name, i)));
    elements.select.addEventListener("change", () => this.choose(Number(elements.select.value)));
    elements.sigma.addEventListener("change", () => redraw());
    elements.edit.addEventListener("click", () => this.begin());
    elements.snap.addEventListener("click", () => this.snap(!this.snapping));
    elements.save.addEventListener("click", () => this.save());
    elements.cancel.addEventListener("click", () => this.end());
    playback.addEventListener("moved", () => { if (this.active) this.end("The joint was left where it was: the frame changed."); });
  }

  get joint() { return this.skeleton.chosen; }

  choose(joint) {
    if (this.active) this.end();
    this.skeleton.chosen = joint;
    this.elements.select.value = joint ?? 0;
    this.redraw();
  }

  next(count) {
    const all = this.description.joints.length;
    this.choose(((this.joint ?? (count > 0 ? -1 : 0)) + count + all) % all);
  }

  /** Where the joint is now: corrected or tracked; null where it is lost, or its frame is being fetched. */
  now() {
    const corrected = this.corrections.jointsAt(this.playback.position).find(({ joint }) => joint === this.description.joints[this.joint]);
    if (corrected) return corrected.position_m;
    const row = this.rows.at(this.playback.position);
    const found = row ? Array.from(row.joints.subarray(3 * this.joint, 3 * this.joint + 3)) : [NaN];
    return Number.isNaN(found[0]) ? null : found;
  }

  begin() {
    this.playback.pause();
    if (!this.rows.at(this.playback.position)) return this.say("This frame is being loaded.");
    if (this.joint === null) this.choose(Number(this.elements.select.value));
    const start = this.now();
    this.start = new Vector3(...(start ?? this.view.controls.target.toArray()));
    this.place.position.copy(this.start);
    this.gizmo.attach(this.place);
    this.gizmo.enabled = this.helper.visible = this.active = true;
    this.elements.snap.disabled = !this.points;
    this.elements.moving.hidden = false;
    this.view.canvas.focus({ preventScroll: true });
    this.changed();
    return start ? null : this.say("This joint is lost in this frame: it starts in the middle of the view.");
  }

  changed() {
    const moved = this.place.position.distanceTo(this.start) * 1000;
    const [x, y, z] = this.place.position.toArray().map((value) => value.toFixed(3));
    this.elements.moved.textContent = `${this.description.joints[this.joint]}: moved by ${moved.toFixed(0)} mm, to x ${x}, y ${y}, z ${z} m.`;
    this.redraw();
  }

  /** The joint being moved, in the form of a correction; null where none is. */
  get draft() {
    return this.active ? { position_m: this.place.position.toArray(), sigma_m: Number(this.elements.sigma.value) } : null;
  }

  /** Along the screen's right, its up, and away, in steps. */
  nudge(right, up, away, fine) {
    const axes = ["x", "y", "z"].map((_, column) => new Vector3().setFromMatrixColumn(this.view.camera.matrixWorld, column));
    const step = fine ? FINE_STEP_M : STEP_M;
    this.place.position.addScaledVector(axes[0], right * step).addScaledVector(axes[1], up * step).addScaledVector(axes[2], -away * step);
    this.changed();
  }

  snap(on) {
    this.snapping = on && this.active;
    this.elements.snap.setAttribute("aria-pressed", String(this.snapping));
    this.view.canvas.style.cursor = this.snapping ? "crosshair" : "";
    if (this.snapping) this.say("Click a point of the patient's surface.");
  }

  /** A click on the canvas while snapping; by keyboard a joint is nudged instead. */
  clicked(x, y) {
    const found = this.points?.pick(x, y);
    if (!found) return this.say("There is no point of the patient's surface here.");
    this.place.position.set(...found);
    this.snap(false);
    return this.changed();
  }

  async save() {
    if (!this.active || this.saving) return;
    const name = this.description.joints[this.joint], frame = this.motion.frame[this.playback.position];
    this.saving = true;
    const signed = await this.signing.ask(`${name} in frame ${frame}`);
    this.saving = false;
    if (!signed || !this.active) return;
    const entry = { frame, joint: name, position_m: this.place.position.toArray(), sigma_m: Number(this.elements.sigma.value), ...signed };
    if (await this.corrections.add(entry)) this.end();
  }

  end(message) {
    this.snap(false);
    this.active = this.gizmo.enabled = this.helper.visible = false;
    this.gizmo.detach();
    this.elements.moving.hidden = true;
    this.elements.snap.disabled = true;
    if (message) this.say(message);
    this.redraw();
  }
}
