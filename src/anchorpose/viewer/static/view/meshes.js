// The patient's seen surface, frame by frame, and the equipment, which stands.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, DynamicDrawUsage, EdgesGeometry, Group, LineBasicMaterial, LineSegments, Mesh,
  ShaderMaterial,
} from "three";
import { colour, css, themed } from "./theme.js";

const VERTEX = `
varying vec3 seen;
void main() { vec4 place = modelViewMatrix * vec4(position, 1.0); seen = place.xyz; gl_Position = projectionMatrix * place; }`;
const FRAGMENT = `
uniform vec3 tint; uniform float opacity;
varying vec3 seen;
void main() {
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = 0.45 + 0.55 * abs(dot(normal, normalize(vec3(0.3, 0.5, 0.8))));
  gl_FragColor = vec4(tint * light, opacity);
}`;

export const lit = (opacity) => new ShaderMaterial({
  vertexShader: VERTEX, fragmentShader: FRAGMENT, side: DoubleSide, transparent: opacity < 1,
  uniforms: { tint: { value: null }, opacity: { value: opacity } },
});

export class SurfaceLayer {
  constructor(view) {
    this.geometry = new BufferGeometry();
    this.mesh = new Mesh(this.geometry, lit(1));
    this.mesh.scale.setScalar(0.001); // millimetres
    this.mesh.frustumCulled = false;
    this.room = { position: 0, index: 0 };
    themed(() => { this.mesh.material.uniforms.tint.value = colour("patient"); view.invalidate(); });
  }

  set(held) {
    this.mesh.visible = held !== null;
    if (!held) return;
    const { counts } = held.chunk.meta, { vertices, faces } = held.chunk.arrays;
    const before = counts.slice(0, held.row).reduce(([v, f], [nv, nf]) => [v + nv, f + nf], [0, 0]);
    const [nodes, triangles] = counts[held.row];
    this.fill("position", vertices.subarray(3 * before[0], 3 * (before[0] + nodes)), Int16Array, 3);
    this.fill("index", faces.subarray(3 * before[1], 3 * (before[1] + triangles)), Uint32Array, 1);
    this.geometry.setDrawRange(0, 3 * triangles);
  }

  fill(name, values, Kind, size) {
    let attribute = name === "index" ? this.geometry.index : this.geometry.getAttribute(name);
    if (!attribute || values.length > this.room[name]) {
      this.room[name] = Math.ceil(values.length * 1.3);
      attribute = new BufferAttribute(new Kind(this.room[name] + size - (this.room[name] % size)), size);
      attribute.setUsage(DynamicDrawUsage);
      if (name === "index") this.geometry.setIndex(attribute); else this.geometry.setAttribute(name, attribute);
    }
    attribute.array.set(values);
    attribute.clearUpdateRanges();
    attribute.addUpdateRange(0, values.length);
    attribute.needsUpdate = true;
  }
}

export function equipmentLayer({ vertices, faces }, view) {
  const geometry = new BufferGeometry(), group = new Group();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(vertices), 3));
  geometry.setIndex(faces);
  const mesh = new Mesh(geometry, lit(0.45)), edges = new LineSegments(new EdgesGeometry(geometry, 30), new LineBasicMaterial());
  mesh.renderOrder = 1;
  group.add(mesh, edges);
  themed(() => {
    mesh.material.uniforms.tint.value = colour("equipment");
    edges.material.color = new Color(css("equipment"));
    view.invalidate();
  });
  return group;
}
