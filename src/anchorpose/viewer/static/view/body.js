// The learnt body in the pose of each frame: linear blend skinning on the graphics card.

import { BufferAttribute, BufferGeometry, Mesh, ShaderMaterial, Vector3, Vector4 } from "three";
import { colour, themed } from "./theme.js";

const VERTEX = `
attribute vec4 bones, weights;
uniform vec3 rest[21], place[21];
uniform vec4 turn[21]; // x, y, z, w
varying vec3 facing;
vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  vec3 world = vec3(0.0), across = vec3(0.0);
  for (int i = 0; i < 4; i++) {
    int bone = int(bones[i] + 0.5);
    world += weights[i] * (turned(turn[bone], position - rest[bone]) + place[bone]);
    across += weights[i] * turned(turn[bone], normal);
  }
  facing = normalize(mat3(viewMatrix) * across);
  vec4 seen = viewMatrix * vec4(world, 1.0);
  seen.xyz *= 1.0 - 0.04 / length(seen.xyz); // 4 cm nearer to the eye: before the points that lie on it, not among them
  gl_Position = projectionMatrix * seen;
}`;
const FRAGMENT = `
uniform vec3 tint;
varying vec3 facing;
void main() {
  vec3 normal = normalize(facing);
  float rim = 1.0 - abs(normal.z);
  float light = 0.55 + 0.45 * max(0.0, dot(normal, normalize(vec3(0.3, 0.5, 0.8))));
  gl_FragColor = vec4(tint * light, 0.38 + 0.45 * rim * rim);
}`;

export class BodyLayer {
  constructor({ arrays }, rows, view) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(arrays.vertices, 3));
    geometry.setAttribute("normal", new BufferAttribute(arrays.normals, 3));
    geometry.setAttribute("bones", new BufferAttribute(arrays.bones, 4));
    geometry.setAttribute("weights", new BufferAttribute(arrays.weights, 4));
    geometry.setIndex(new BufferAttribute(arrays.faces, 1));
    const each = (Kind) => Array.from({ length: 21 }, () => new Kind());
    const rest = each(Vector3).map((head, i) => head.fromArray(arrays.heads, 3 * i));
    this.uniforms = { rest: { value: rest }, place: { value: each(Vector3) }, turn: { value: each(Vector4) }, tint: { value: null } };
    this.rows = rows;
    this.mesh = new Mesh(geometry, new ShaderMaterial({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: this.uniforms, transparent: true,
    }));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 2;
    themed(() => { this.uniforms.tint.value = colour("body"); view.invalidate(); });
  }

  set(position) {
    const poses = this.rows.at(position)?.poses;
    this.mesh.visible = Boolean(poses) && !Number.isNaN(poses[0]);
    if (!this.mesh.visible) return;
    for (let bone = 0; bone < 21; bone++) {
      const [x, y, z, qw, qx, qy, qz] = poses.subarray(7 * bone, 7 * bone + 7);
      this.uniforms.place.value[bone].set(x, y, z);
      this.uniforms.turn.value[bone].set(qx, qy, qz, qw);
    }
  }
}
