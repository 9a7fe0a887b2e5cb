// The points of one scanner on the graphics card.

import {
  BufferAttribute, BufferGeometry, DataTexture, GLSL3, NearestFilter, Points, RGBAFormat, ShaderMaterial, Sphere, Vector2,
  Vector3,
} from 'three';
import { FRAGMENT, VERTEX, transformTexture } from './shader.js';

/** The numbers below `n` in a pseudo-random order, the same every time; its first part, however long, is spread evenly. */
export function shuffled(n) {
  const order = Uint32Array.from({ length: n }, (_, i) => i);
  let state = 0x9e3779b9;
  for (let i = n - 1; i > 0; i--) {
    state = (Math.imul(state, 1664525) + 1013904223) | 0;
    const j = Math.floor(((state >>> 0) / 2 ** 32) * (i + 1));
    [order[i], order[j]] = [order[j], order[i]];
  }
  return order;
}

/** A texture of 256 colours, one per byte. */
export function colourTexture() {
  const texture = new DataTexture(new Uint8Array(4 * 256), 256, 1, RGBAFormat);
  texture.minFilter = NearestFilter;
  texture.magFilter = NearestFilter;
  return texture;
}

export class Cloud {
  constructor(drive, fan, colours) {
    this.drive = drive;
    this.fan = fan;
    this.points = fan.points;
    this.order = shuffled(fan.points);
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute('scan', new BufferAttribute(this.scan(), 3, true));
    this.geometry.setAttribute('profile', new BufferAttribute(this.order.map((i) => fan.profileOf[i]), 1));
    this.value = new BufferAttribute(new Uint8Array(fan.points), 1);
    this.geometry.setAttribute('value', this.value);
    // The graphics card moves the points, so that their bounds are not known here.
    this.geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    this.geometry.setDrawRange(0, fan.points);
    this.poses = drive.poses.map((set) => this.texture((profile) => drive.transform(set[fan.number], profile)));
    const none = transformTexture([]);
    this.mountings = drive.variants.map((_, number) => (drive.moves(number)
      ? this.texture((profile) => drive.mounting(number, fan, profile))
      : none));
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        low: { value: new Vector3(...fan.axes.map(({ low }) => low)) },
        span: { value: new Vector3(...fan.axes.map(({ span }) => span)) },
        posesFrom: { value: null },
        posesTo: { value: null },
        mountingsFrom: { value: null },
        mountingsTo: { value: null },
        moves: { value: new Vector2() },
        shiftFrom: { value: [0, 0, 0] },
        turnFrom: { value: [0, 0, 0, 1] },
        shiftTo: { value: [0, 0, 0] },
        turnTo: { value: [0, 0, 0, 1] },
        share: { value: 1 },
        size: { value: 1 },
        most: { value: 6 },
        colours: { value: colours },
      },
    });
    this.object = new Points(this.geometry, this.material);
    this.object.frustumCulled = false;
    this.show(0, 0, 1);
  }

  texture(transform) {
    return transformTexture(Array.from(this.fan.counts, (_, profile) => transform(profile)));
  }

  /** Coordinates in the scanner frame as shares of their ranges, in 16 bits. */
  scan() {
    const scan = new Uint16Array(3 * this.fan.points);
    this.fan.axes.forEach(({ values }, axis) => {
      if (values) this.order.forEach((from, to) => { scan[3 * to + axis] = values[from]; });
    });
    return scan;
  }

  /** Places the points by variant `to`, or at a share of the way from variant `from` to it. */
  show(from, to, share) {
    const { uniforms } = this.material;
    const { drive } = this;
    uniforms.posesFrom.value = this.poses[drive.variants[from].poses];
    uniforms.posesTo.value = this.poses[drive.variants[to].poses];
    uniforms.mountingsFrom.value = this.mountings[from];
    uniforms.mountingsTo.value = this.mountings[to];
    uniforms.moves.value.set(drive.moves(from), drive.moves(to));
    for (const [end, variant] of [['From', from], ['To', to]]) {
      const { t, q } = drive.variants[variant].mountings[this.fan.number];
      uniforms[`shift${end}`].value = t;
      uniforms[`turn${end}`].value = q;
    }
    uniforms.share.value = share;
  }

  /** Colours the points by these bytes. */
  colour(bytes) {
    const values = this.value.array;
    this.order.forEach((from, to) => { values[to] = bytes[from]; });
    this.value.needsUpdate = true;
  }

  /** Draws only this share of the points. */
  thin(share) {
    this.geometry.setDrawRange(0, Math.ceil(share * this.fan.points));
  }

  dispose() {
    this.geometry.dispose();
    this.material.dispose();
    [...this.poses, ...this.mountings].forEach((texture) => texture.dispose());
  }
}
