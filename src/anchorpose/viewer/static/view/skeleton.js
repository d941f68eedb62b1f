// Joints (filled where observed, hollow where inferred, with a halo of 1.96 sigma), limbs, anchors, corrected joints.

import { BufferAttribute, BufferGeometry, Group, Mesh, Points, ShaderMaterial, Vector2 } from "three";
import { colour, themed } from "./theme.js";

const DOT = `
attribute vec4 look; // shape (0 disc, 1 ring, 2 diamond), radius px, halo metres, chosen
uniform float focal, ratio;
varying vec4 kind;
varying float radius, halo, whole;
void main() {
  vec4 seen = viewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * seen;
  kind = look;
  radius = look.y * ratio;
  halo = look.z * focal / max(0.1, -seen.z);
  whole = max(radius * 1.7, halo) + 2.0;
  gl_PointSize = look.y > 0.0 ? 2.0 * whole : 0.0;
}`;
const DOT_FRAGMENT = `
uniform vec3 tint, rim, marked;
varying vec4 kind;
varying float radius, halo, whole;
float within(float distance, float edge) { return 1.0 - smoothstep(edge - 0.8, edge + 0.8, distance); }
void main() {
  vec2 offset = (gl_PointCoord - 0.5) * 2.0 * whole;
  float away = kind.x > 1.5 ? (abs(offset.x) + abs(offset.y)) * 0.8 : length(offset);
  float circle = length(offset);
  vec4 found = vec4(tint, 0.16 * within(circle, halo) + 0.3 * within(abs(circle - halo), 1.0) * step(0.5, halo));
  float outline = within(away, radius + 1.5);
  found = mix(found, vec4(rim, 1.0), outline);
  float inside = within(away, radius);
  float hole = kind.x > 0.5 && kind.x < 1.5 ? within(away, radius * 0.55) : 0.0;
  found = mix(found, vec4(mix(tint, rim, hole), 1.0), inside);
  float choice = kind.w * within(abs(away - radius * 1.45), 1.6);
  found = mix(found, vec4(marked, 1.0), choice);
  if (found.a < 0.01) discard;
  gl_FragColor = found;
}`;
const LIMB = `
attribute vec3 from, to;
attribute vec3 corner; // along, across, sure
uniform vec2 screen;
uniform float width;
varying float along, sure;
void main() {
  vec4 a = projectionMatrix * viewMatrix * vec4(from, 1.0), b = projectionMatrix * viewMatrix * vec4(to, 1.0);
  vec2 direction = (b.xy / b.w - a.xy / a.w) * screen;
  float reach = max(length(direction), 0.001);
  vec2 across = vec2(-direction.y, direction.x) / reach * width / screen;
  gl_Position = corner.x > 0.5 ? b : a;
  gl_Position.xy += across * corner.y * gl_Position.w;
  along = corner.x * reach * 0.5;
  sure = corner.z;
}`;
const LIMB_FRAGMENT = `
uniform vec3 tint;
varying float along, sure;
void main() { if (sure < 0.5 && mod(along, 9.0) > 5.0) discard; gl_FragColor = vec4(tint, sure < 0.5 ? 0.75 : 0.95); }`;

export class DotLayer {
  constructor(count, view, tint, order) {
    this.view = view;
    this.place = new BufferAttribute(new Float32Array(3 * count), 3);
    this.look = new BufferAttribute(new Float32Array(4 * count), 4);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.place);
    geometry.setAttribute("look", this.look);
    this.uniforms = { focal: { value: 1 }, ratio: { value: 1 }, tint: { value: null }, rim: { value: null }, marked: { value: null } };
    this.points = new Points(geometry, new ShaderMaterial({
      vertexShader: DOT, fragmentShader: DOT_FRAGMENT, uniforms: this.uniforms, transparent: true, depthTest: false, depthWrite: false,
    }));
    this.points.frustumCulled = false;
    this.points.renderOrder = order;
    themed(() => {
      this.uniforms.tint.value = colour(tint);
      this.uniforms.rim.value = colour("joint-rim");
      this.uniforms.marked.value = colour("cursor");
      view.invalidate();
    });
  }

  /** dots: one per point, {place, shape, radius, halo, chosen} or null. */
  set(dots) {
    dots.forEach((dot, i) => {
      this.place.array.set(dot ? dot.place : [0, 0, 0], 3 * i);
      this.look.array.set(dot ? [dot.shape, dot.radius, dot.halo ?? 0, dot.chosen ? 1 : 0] : [0, 0, 0, 0], 4 * i);
    });
    this.points.geometry.setDrawRange(0, dots.length);
    this.place.needsUpdate = this.look.needsUpdate = true;
    this.uniforms.focal.value = this.view.focal;
    this.uniforms.ratio.value = this.view.renderer.getPixelRatio();
  }
}

const NOWHERE = [0, 0, 0]; // a limb of no length is not drawn

class LimbLayer {
  constructor(limbs, view, size) {
    this.size = size;
    const count = 4 * limbs.length, corner = new Float32Array(3 * count), index = [];
    this.limbs = limbs;
    this.view = view;
    this.corner = new BufferAttribute(corner, 3);
    this.from = new BufferAttribute(new Float32Array(3 * count), 3);
    this.to = new BufferAttribute(new Float32Array(3 * count), 3);
    limbs.forEach((_, i) => {
      [[0, -1], [0, 1], [1, -1], [1, 1]].forEach(([along, across], k) => corner.set([along, across, 1], 3 * (4 * i + k)));
      index.push(4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 1, 4 * i + 3, 4 * i + 2);
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.from); // three.js requires this name
    geometry.setAttribute("from", this.from);
    geometry.setAttribute("to", this.to);
    geometry.setAttribute("corner", this.corner);
    geometry.setIndex(index);
    this.uniforms = { screen: { value: new Vector2() }, width: { value: 4 }, tint: { value: null } };
    this.mesh = new Mesh(geometry, new ShaderMaterial({
      vertexShader: LIMB, fragmentShader: LIMB_FRAGMENT, uniforms: this.uniforms, transparent: true, depthTest: false, depthWrite: false, side: 2,
    }));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 9;
    themed(() => { this.uniforms.tint.value = colour("joint"); view.invalidate(); });
  }

  set(joints, states) {
    this.limbs.forEach(([a, b], i) => {
      const seen = states[a] === 0 && states[b] === 0 ? 1 : 0;
      const known = !Number.isNaN(joints[3 * a]) && !Number.isNaN(joints[3 * b]);
      for (let k = 0; k < 4; k++) {
        this.from.array.set(known ? joints.subarray(3 * a, 3 * a + 3) : NOWHERE, 3 * (4 * i + k));
        this.to.array.set(known ? joints.subarray(3 * b, 3 * b + 3) : NOWHERE, 3 * (4 * i + k));
        this.corner.array[3 * (4 * i + k) + 2] = seen;
      }
    });
    this.from.needsUpdate = this.to.needsUpdate = this.corner.needsUpdate = true;
    this.view.renderer.getDrawingBufferSize(this.uniforms.screen.value);
    this.uniforms.width.value = 3 * this.size * this.view.renderer.getPixelRatio();
  }
}

export class SkeletonLayer {
  /** rows: at(position) has joints, sigma and states of a frame, or null; size: of dots and limbs, 1 as in the viewer. */
  constructor({ joints, limbs, states }, rows, view, size = 1) {
    this.size = size;
    this.count = joints.length;
    this.lost = states.indexOf("lost");
    this.rows = rows;
    this.chosen = null;
    this.limbs = new LimbLayer(limbs, view, size);
    this.dots = new DotLayer(this.count, view, "joint", 10);
    this.group = new Group();
    this.group.add(this.limbs.mesh, this.dots.points);
  }

  set(position) {
    const row = this.rows.at(position);
    if (!row) {
      this.group.visible = false;
      return;
    }
    const { joints, sigma, states } = row;
    this.limbs.set(joints, states);
    this.dots.set(Array.from(states, (state, i) => state === this.lost ? null : {
      place: joints.subarray(3 * i, 3 * i + 3), shape: state === 0 ? 0 : 1, radius: 5.5 * this.size, halo: 1.96 * sigma[i], chosen: i === this.chosen,
    }));
  }
}
