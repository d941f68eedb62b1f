// The three-dimensional view: camera, presets, drawing when something changed.

import { Color, GridHelper, PerspectiveCamera, Scene, Vector2, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "../three/OrbitControls.js";
import { css, themed } from "./theme.js";

const FIELD_DEG = 40;
const AWAY = { front: [1, 0.12, 0], side: [0, 0.12, 1], back: [-1, 0.12, 0], top: [0, 1, 0.001] };

/** Whether this computer draws without a graphics card: then smooth edges would halve the frame rate. */
function withoutCard() {
  const context = document.createElement("canvas").getContext("webgl2");
  const about = context?.getExtension("WEBGL_debug_renderer_info");
  const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

export class View {
  constructor(canvas, middle, floor) {
    this.canvas = canvas;
    const slow = withoutCard();
    this.renderer = new WebGLRenderer({ canvas, antialias: !slow });
    this.renderer.setPixelRatio(slow ? 1 : Math.min(devicePixelRatio, 2));
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(FIELD_DEG, 1, 0.05, 60);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.invalidate());
    this.middle = new Vector3(...middle);
    this.stale = true;
    this.drawn = 0;
    themed(() => {
      this.scene.background = new Color(css("scene"));
      this.scene.remove(this.grid);
      this.grid = new GridHelper(4, 8, new Color(css("room")), new Color(css("edge")));
      this.grid.position.set(this.middle.x, floor, this.middle.z);
      this.scene.add(this.grid);
      this.invalidate();
    });
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
    this.look("front");
  }

  /** Pixels per metre at one metre's distance. */
  get focal() { return this.renderer.getDrawingBufferSize(new Vector2()).y / 2 / Math.tan((this.camera.fov * Math.PI) / 360); }

  invalidate() { this.stale = true; }

  resize() {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }

  look(name) {
    this.free();
    const away = new Vector3(...AWAY[name]).normalize();
    const narrow = Math.min(1, this.camera.aspect);
    this.camera.position.copy(this.middle).addScaledVector(away, 3.3 / narrow);
    this.controls.target.copy(this.middle);
    this.controls.update();
    this.invalidate();
  }

  /** Keeps direction and distance, and looks at another middle. */
  moveTo(middle) {
    const step = new Vector3(...middle).sub(this.middle);
    this.middle.add(step);
    this.controls.target.add(step);
    this.camera.position.add(step);
    this.grid.position.add(step);
    this.controls.update();
    this.invalidate();
  }

  /** From the place of a depth camera, with its field of view; its roll is left out so that up stays up. */
  lookFrom(camera) {
    const pose = camera.camera_to_world;
    const eye = new Vector3(pose[0][3], pose[1][3], pose[2][3]);
    const ahead = new Vector3(pose[0][2], pose[1][2], pose[2][2]);
    this.camera.fov = (Math.atan(camera.height / 2 / camera.fy) * 360) / Math.PI;
    this.camera.updateProjectionMatrix();
    this.camera.position.copy(eye);
    const along = Math.max(0.5, this.middle.clone().sub(eye).dot(ahead));
    this.controls.target.copy(eye).addScaledVector(ahead, along);
    this.controls.update();
    this.invalidate();
  }

  free() {
    this.camera.fov = FIELD_DEG;
    this.camera.updateProjectionMatrix();
  }

  /** Turns by degrees to the right and up, and comes nearer by a factor; for the keyboard. */
  turn(right, up, nearer = 1) {
    const arm = this.camera.position.clone().sub(this.controls.target);
    arm.applyAxisAngle(new Vector3(0, 1, 0), (right * Math.PI) / 180);
    const level = new Vector3(0, 1, 0).cross(arm).normalize();
    const raised = arm.clone().applyAxisAngle(level, (-up * Math.PI) / 180);
    if (Math.abs(raised.clone().normalize().y) < 0.999) arm.copy(raised);
    this.camera.position.copy(this.controls.target).addScaledVector(arm, nearer);
    this.controls.update();
    this.invalidate();
  }

  /** Where a world point is on the canvas: [x, y] pixels of the page, and its distance; null behind the camera. */
  project(point) {
    const found = new Vector3(...point).project(this.camera);
    if (found.z > 1) return null;
    const { clientWidth, clientHeight } = this.canvas;
    return [((found.x + 1) / 2) * clientWidth, ((1 - found.y) / 2) * clientHeight, found.z];
  }

  draw() {
    if (!this.stale) return false;
    this.stale = false;
    this.renderer.render(this.scene, this.camera);
    this.drawn += 1;
    return true;
  }
}

/** The middle of the view, and the height of the floor below it: of the patient's median position and lowest joint. */
export const middleOf = ({ middle_m: middle, lowest_m: lowest }) => [middle ?? [0, 0, 0], lowest === null ? 0 : lowest - 0.04];
