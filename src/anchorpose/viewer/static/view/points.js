// The depth cameras' points: pixels as recorded, placed in the world by the graphics card.

import {
  BufferAttribute, BufferGeometry, DataTexture, DynamicDrawUsage, FloatType, Group, Matrix4, NearestFilter, Points, RGFormat,
  ShaderMaterial,
} from "three";
import { colour, colours, themed } from "./theme.js";

export const EQUIPMENT = 2, PATIENT = 4, PERSON = 5, UNLABELLED = 255;

const VERTEX = `
attribute vec4 pixel; // column, row, grey value, 256 x shade + label
uniform sampler2D rays;
uniform mat4 cameraToWorld;
uniform float depthScale, spacing, focal, coarse;
uniform vec3 patient, equipment, room, others[4];
uniform bvec4 shown; // patient, others, equipment, room
varying vec3 tint;
void main() {
  float z = pixel.z * depthScale;
  vec4 world = cameraToWorld * vec4(texelFetch(rays, ivec2(pixel.xy), 0).xy * z, z, 1.0);
  float shade = floor(pixel.w / 256.0);
  int label = int(pixel.w - 256.0 * shade + 0.5);
  bool visible = true;
  float size = 1.25;
  if (label == 4) { tint = patient; visible = shown.x; }
  else if (label == 2) { tint = equipment; visible = shown.z; }
  else if (label == 255) { tint = room; size = 2.2; }
  else if (label >= 5) { int other = (label - 5) % 4; tint = other == 0 ? others[0] : other == 1 ? others[1] : other == 2 ? others[2] : others[3]; visible = shown.y; }
  else { tint = room; visible = shown.w; size = 1.6; }
  vec4 seen = viewMatrix * world;
  gl_Position = visible ? projectionMatrix * seen : vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = clamp(coarse * size * spacing * z * focal / max(0.1, -seen.z), 1.0, 8.0);
  tint *= label == 255 ? 0.35 + shade / 255.0 : 0.42 + 0.65 * shade / 255.0;
}`;
const FRAGMENT = `
varying vec3 tint;
void main() { gl_FragColor = vec4(tint, 1.0); }`;

export class PointLayer {
  constructor(description, rays, view) {
    this.group = new Group();
    this.view = view;
    this.share = 1;
    this.cameras = description.cameras.map((camera, number) => this.camera(camera, rays.arrays[`rays${number}`]));
    for (const camera of this.cameras) if (camera) this.group.add(camera.points);
    themed(() => this.each((uniforms) => {
      uniforms.patient.value = colour("patient");
      uniforms.equipment.value = colour("equipment");
      uniforms.room.value = colour("room");
      uniforms.others.value = colours("others");
      view.invalidate();
    }));
  }

  camera(about, rays) {
    if (!about.camera_to_world) return null;
    const texture = new DataTexture(rays, about.width, about.height, RGFormat, FloatType);
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.needsUpdate = true;
    const flat = about.camera_to_world.flat();
    const material = new ShaderMaterial({
      vertexShader: VERTEX, fragmentShader: FRAGMENT,
      uniforms: {
        rays: { value: texture }, cameraToWorld: { value: new Matrix4().set(...flat) },
        depthScale: { value: about.depth_scale }, spacing: { value: 1 / about.fx }, focal: { value: 1 }, coarse: { value: 1 },
        patient: { value: null }, equipment: { value: null }, room: { value: null }, others: { value: [] },
        shown: { value: [1, 1, 1, 0] },
      },
    });
    const geometry = new BufferGeometry(), points = new Points(geometry, material);
    points.frustumCulled = false;
    return { about, rays, points, capacity: 0, count: 0 };
  }

  each(change) { for (const camera of this.cameras) if (camera) change(camera.points.material.uniforms); }

  show({ patient, others, equipment, room }) {
    this.each((uniforms) => { uniforms.shown.value = [patient, others, equipment, room].map(Number); });
    this.shown = { patient, others, equipment, room };
  }

  /** Puts one frame of a chunk on the screen; null takes the points away. */
  set(held) {
    this.group.visible = held !== null;
    if (!held) return;
    const { chunk, row } = held, { counts } = chunk.meta;
    let start = counts.slice(0, row).flat().reduce((sum, count) => sum + count, 0);
    this.cameras.forEach((camera, number) => {
      const count = counts[row][number];
      if (camera) this.fill(camera, chunk.arrays.points.subarray(4 * start, 4 * (start + count)));
      start += count;
    });
    this.each((uniforms) => { uniforms.focal.value = this.view.focal; });
  }

  /** Only the share that is drawn is sent to the graphics card. */
  fill(camera, all) {
    const count = Math.ceil((all.length / 4) * this.share), pixels = all.subarray(0, 4 * count);
    if (count > camera.capacity) {
      camera.capacity = Math.ceil(count * 1.2);
      const attribute = new BufferAttribute(new Uint16Array(4 * camera.capacity), 4);
      attribute.setUsage(DynamicDrawUsage);
      camera.points.geometry.dispose();
      camera.points.geometry.setAttribute("pixel", attribute);
    }
    const attribute = camera.points.geometry.getAttribute("pixel");
    if (attribute) {
      attribute.array.set(pixels);
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 4 * count);
      attribute.needsUpdate = true;
    }
    camera.points.geometry.setDrawRange(0, count);
    camera.count = count;
  }

  /** The share of the points that the next frame draws, coarse grids first; fewer points are drawn larger. */
  set detail(share) {
    this.share = share;
    this.each((uniforms) => { uniforms.coarse.value = 1 / Math.sqrt(share); });
  }

  /** The world point under a place on the canvas that is nearest to the eye, or null; only of the patient, or unlabelled. */
  pick(x, y) { return this.find(x, y, (label) => label === PATIENT || label === UNLABELLED)?.place ?? null; }

  /** The same of a person, or else of anything that is shown: {place, camera, column, row}, or null. */
  pickPixel(x, y) {
    const { patient, others, equipment, room } = this.shown;
    const person = (label) => (label === PATIENT && patient) || label === UNLABELLED || (label >= PERSON && others);
    return this.find(x, y, person) ?? this.find(x, y, (label) => (label === EQUIPMENT ? equipment : label < PATIENT && room));
  }

  find(x, y, wanted, reach = 7) {
    let best = null, nearest = Infinity;
    for (const camera of this.cameras) {
      if (!camera || !camera.count) continue;
      const pixels = camera.points.geometry.getAttribute("pixel").array;
      for (let i = 0; i < camera.count; i++) {
        if (!wanted(pixels[4 * i + 3] & 255)) continue;
        const place = this.place(camera, pixels, i), seen = this.view.project(place);
        if (!seen || Math.hypot(seen[0] - x, seen[1] - y) > reach || seen[2] >= nearest) continue;
        nearest = seen[2];
        best = { place, camera: camera.about.name, column: pixels[4 * i], row: pixels[4 * i + 1] };
      }
    }
    return best;
  }

  /** Pixel i in the world: the same sum as in the shader. */
  place({ about, rays }, pixels, i) {
    const ray = 2 * (pixels[4 * i + 1] * about.width + pixels[4 * i]), z = pixels[4 * i + 2] * about.depth_scale;
    const own = [rays[ray] * z, rays[ray + 1] * z, z], pose = about.camera_to_world;
    return [0, 1, 2].map((axis) => pose[axis][0] * own[0] + pose[axis][1] * own[1] + pose[axis][2] * own[2] + pose[axis][3]);
  }
}
