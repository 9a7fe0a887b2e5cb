// Places points on the graphics card: x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s), for two variants and between them.

import { DataTexture, FloatType, NearestFilter, RGBAFormat } from 'three';

/** Transforms per row of a texture; each takes two texels: translation, quaternion. */
const ROW = 1024;

/** A texture of transforms { t, q }. */
export function transformTexture(transforms) {
  const rows = Math.max(1, Math.ceil(transforms.length / ROW));
  const data = new Float32Array(rows * ROW * 8);
  transforms.forEach(({ t, q }, i) => {
    data.set(t, 8 * i);
    data.set(q, 8 * i + 4);
  });
  const texture = new DataTexture(data, 2 * ROW, rows, RGBAFormat, FloatType);
  texture.minFilter = NearestFilter;
  texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

export const VERTEX = /* glsl */ `
in vec3 scan;
in uint profile;
in float value;
uniform vec3 low;
uniform vec3 span;
uniform highp sampler2D posesFrom;
uniform highp sampler2D posesTo;
uniform highp sampler2D mountingsFrom;
uniform highp sampler2D mountingsTo;
uniform bvec2 moves;
uniform vec3 shiftFrom;
uniform vec4 turnFrom;
uniform vec3 shiftTo;
uniform vec4 turnTo;
uniform float share;
uniform float size;
uniform float most;
uniform sampler2D colours;
out vec3 colour;

vec3 turned(vec4 q, vec3 v) {
  vec3 t = 2.0 * cross(q.xyz, v);
  return v + q.w * t + cross(q.xyz, t);
}

vec3 placed(highp sampler2D transforms, uint index, vec3 x) {
  ivec2 at = ivec2(int(index % ${ROW}u) * 2, int(index / ${ROW}u));
  vec3 t = texelFetch(transforms, at, 0).xyz;
  return t + turned(texelFetch(transforms, at + ivec2(1, 0), 0), x);
}

void main() {
  vec3 x = low + span * scan;
  vec3 body = moves.y ? placed(mountingsTo, profile, x) : shiftTo + turned(turnTo, x);
  vec3 map = placed(posesTo, profile, body);
  if (share < 1.0) {
    body = moves.x ? placed(mountingsFrom, profile, x) : shiftFrom + turned(turnFrom, x);
    map = mix(placed(posesFrom, profile, body), map, share);
  }
  vec4 seen = modelViewMatrix * vec4(map, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(size / -seen.z, 1.5, most);
  colour = texelFetch(colours, ivec2(int(value + 0.5), 0), 0).rgb;
}
`;

export const FRAGMENT = /* glsl */ `
in vec3 colour;
out vec4 shown;

void main() {
  shown = vec4(colour, 1.0);
}
`;
