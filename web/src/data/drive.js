// The clouds of one drive: points in the scanner frame, poses, mountings, and the points placed with them.

import { fromBase64, inflate, list } from './unpack.js';
import { apply, normalised } from './transform.js';

const STEPS_16 = 65535;

/** The drive of a header; its bytes are in the script that the header names. */
export async function loadDrive(header) {
  const script = document.getElementById(header.script);
  return new Drive(header, await inflate(fromBase64(script.textContent)));
}

export class Drive {
  constructor(header, bytes) {
    const get = (place) => list(bytes, place);
    this.name = header.name;
    /** Map coordinates of the origin of all positions, metres. */
    this.origin = header.origin_m;
    this.startS = header.start_s;
    this.stepS = header.step_s;
    this.stepM = header.step_m;
    this.rotationStep = header.rotation_step;
    this.against = header.against;
    this.places = header.places;
    this.placeRadiusM = header.place_radius_m;
    this.fans = [];
    let first = 0;
    for (const fan of header.fans) {
      this.fans.push(readFan(fan, this.fans.length, first, get));
      first += fan.points;
    }
    /** Number of points of all scanners: they are numbered scanner by scanner. */
    this.points = first;
    const track = ({ translation, rotation }) => ({
      translation: translation.map(get),
      rotation: rotation.map(get),
    });
    this.poses = header.poses.map((set) => set.map(track));
    this.variants = header.variants.map((variant) => ({
      name: variant.name,
      poses: variant.poses,
      mountings: variant.mountings.map((m) => ({ t: m.translation_m, q: m.rotation })),
      moving: variant.moving.map(track),
      attributes: variant.attributes.map((attribute) => ({
        ...attribute,
        values: attribute.values.map(get),
      })),
    }));
    this.reference = readReference(header.reference, get);
    this.surfels = readSurfels(header.surfels, get);
    this.positionsOf = new Map();
  }

  /** Number of passes. */
  get passes() {
    return this.fans.reduce((most, fan) => fan.passes.reduce((a, b) => Math.max(a, b), most), 0);
  }

  /** First and last time of the profiles, seconds. */
  get spanS() {
    const ends = this.fans
      .filter((fan) => fan.times.length > 0)
      .flatMap((fan) => [fan.times[0], fan.times[fan.times.length - 1]]);
    const [low, high] = [Math.min(...ends), Math.max(...ends)];
    return [this.startS + this.stepS * low, this.startS + this.stepS * high];
  }

  timeS(fan, profile) {
    return this.startS + this.stepS * fan.times[profile];
  }

  /** The scanner that measured a point. */
  fanOf(point) {
    return this.fans.findLast((fan) => fan.first <= point);
  }

  transform(track, profile) {
    return {
      t: track.translation.map((axis) => axis[profile] * this.stepM),
      q: normalised(track.rotation.map((axis) => axis[profile] * this.rotationStep)),
    };
  }

  /** map_from_body at a profile; its translation is that from the origin. */
  pose(variant, fan, profile) {
    const set = this.poses[this.variants[variant].poses];
    return this.transform(set[fan.number], profile);
  }

  /** body_from_scanner at a profile. */
  mounting(variant, fan, profile) {
    const { moving, mountings } = this.variants[variant];
    return moving.length > 0
      ? this.transform(moving[fan.number], profile)
      : mountings[fan.number];
  }

  /** Whether the mountings of a variant move. */
  moves(variant) {
    return this.variants[variant].moving.length > 0;
  }

  /** Coordinates of a point of a scanner in its frame, metres. */
  inScanner(fan, index) {
    return fan.axes.map(({ low, step, values }) => (values ? low + step * values[index] : low));
  }

  /** x_m = t_mb + R_mb (t_bs + R_bs x_s) of all points, from the origin, metres: x, y, z of one point after the other. */
  positions(variant) {
    const known = this.positionsOf.get(variant);
    if (known) return known;
    const all = new Float64Array(3 * this.points);
    let at = 0;
    for (const fan of this.fans) {
      let index = 0;
      for (let profile = 0; profile < fan.counts.length; profile++) {
        const mapFromBody = this.pose(variant, fan, profile);
        const bodyFromScanner = this.mounting(variant, fan, profile);
        for (let i = 0; i < fan.counts[profile]; i++) {
          const x = apply(mapFromBody, apply(bodyFromScanner, this.inScanner(fan, index)));
          all[at++] = x[0];
          all[at++] = x[1];
          all[at++] = x[2];
          index++;
        }
      }
    }
    this.positionsOf.set(variant, all);
    return all;
  }

  /** The value of an attribute at a point, or null. */
  value(variant, name, point) {
    const attribute = this.variants[variant].attributes.find((a) => a.name === name);
    const fan = this.fanOf(point);
    const byte = attribute?.values[fan.number][point - fan.first];
    if (!byte) return null;
    const value = attribute.low + ((byte - 1) / 254) * (attribute.high - attribute.low);
    return { value, isBeyond: byte === 255 || (byte === 1 && attribute.low < 0) };
  }

  /** Coordinates and attributes of a point. */
  describe(variant, point) {
    const fan = this.fanOf(point);
    const profile = fan.profileOf[point - fan.first];
    const local = this.positions(variant).subarray(3 * point, 3 * point + 3);
    return {
      map: this.origin.map((value, axis) => value + local[axis]),
      local: [...local],
      distance: this.value(variant, 'M3C2 distance', point),
      detection: this.value(variant, 'level of detection', point),
      scanner: fan.name,
      profile: fan.numbers[profile],
      timeS: this.timeS(fan, profile),
      pass: fan.passes[profile],
    };
  }
}

function readFan(fan, number, first, get) {
  const axis = ({ low, high, values }) => ({
    low,
    span: high - low,
    step: (high - low) / STEPS_16,
    values: values && get(values),
  });
  const counts = get(fan.counts);
  const profileOf = new Uint32Array(fan.points);
  let at = 0;
  counts.forEach((count, profile) => {
    profileOf.fill(profile, at, at + count);
    at += count;
  });
  return {
    name: fan.name,
    number,
    total: fan.of,
    first,
    points: fan.points,
    axes: [fan.x_m, fan.y_m, fan.z_m].map(axis),
    counts,
    profileOf,
    times: get(fan.times),
    numbers: get(fan.numbers),
    passes: get(fan.passes),
  };
}

/** Points of the reference from the origin, metres: x, y, z of one point after the other. */
function readReference({ axes, step_m: step, of: total }, get) {
  const [x, y, z] = axes.map(get);
  const positions = new Float64Array(3 * x.length);
  for (let i = 0; i < x.length; i++) {
    positions[3 * i] = x[i] * step;
    positions[3 * i + 1] = y[i] * step;
    positions[3 * i + 2] = z[i] * step;
  }
  return { positions, points: x.length, total };
}

function readSurfels({ axes, normals, step_m: step, size_m: largestM, sizes, low, high, roughness }, get) {
  const [x, y, z] = axes.map(get);
  const parts = normals.map((place) => new Int8Array(get(place)));
  const [positions, directions] = [new Float64Array(3 * x.length), new Float64Array(3 * x.length)];
  for (let i = 0; i < x.length; i++) {
    [x, y, z].forEach((list, axis) => { positions[3 * i + axis] = list[i] * step; });
    parts.forEach((list, axis) => { directions[3 * i + axis] = list[i] / 127; });
  }
  const sizesM = Float64Array.from(get(sizes), (byte) => ((byte - 1) / 254) * largestM);
  return { positions, normals: directions, points: x.length, sizesM, low, high, roughness: get(roughness) };
}
