// The reference, drawn behind the clouds that lie on it.

import { BufferAttribute, BufferGeometry, Color, GLSL3, Points, ShaderMaterial, Sphere, Vector3 } from 'three';
import { shuffled } from './cloud.js';
import { FRAGMENT } from './shader.js';

/** How far points are pushed back in depth, metres: correct clouds lie among them and would be hidden. */
const BEHIND_M = 0.02;

const VERTEX = /* glsl */ `
uniform vec3 only;
uniform float size;
uniform float most;
out vec3 colour;

void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * seen;
  vec4 behind = projectionMatrix * (seen - vec4(0.0, 0.0, ${BEHIND_M}, 0.0));
  gl_Position.z = behind.z / behind.w * gl_Position.w;
  gl_PointSize = clamp(size / -seen.z, 1.0, most);
  colour = only;
}
`;

export class Reference {
  /** `positions` holds x, y and z of each point in turn, metres. */
  constructor(positions) {
    this.points = positions.length / 3;
    const order = shuffled(this.points);
    const mixed = new Float32Array(positions.length);
    order.forEach((from, to) => {
      for (let axis = 0; axis < 3; axis++) mixed[3 * to + axis] = positions[3 * from + axis];
    });
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute('position', new BufferAttribute(mixed, 3));
    this.geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { only: { value: new Color() }, size: { value: 1 }, most: { value: 6 } },
    });
    this.object = new Points(this.geometry, this.material);
    this.object.frustumCulled = false;
  }

  colour(colour) {
    this.material.uniforms.only.value.set(colour);
  }

  thin(share) {
    this.geometry.setDrawRange(0, Math.ceil(share * this.points));
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
  }
}
