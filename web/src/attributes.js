// The attributes by which points can be coloured: a byte for each point, a table of colours, and a legend.

import { along, gradient, table, turns } from './colours.js';
import { fixed, millimetres, seconds } from './text.js';

/** Limits of distances to choose from for the colours, metres. */
const NICE = [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5];

const DISTANCE = 'M3C2 distance';

/** The names of the attributes by which a drive can be coloured. */
export function namesFor(drive) {
  const last = drive.variants[drive.variants.length - 1];
  const carried = last.attributes.filter((a) => a.values.some((v) => v.some((byte) => byte > 0)));
  const names = carried.map((attribute) => attribute.name);
  if (drive.fans.length > 1 || names.length === 0) names.push('scanner');
  if (drive.passes > 1) names.push('pass');
  return [...names, 'time', 'height'];
}

/** The smallest round limit that 97 % of the distances of the last variant do not exceed, metres. */
export function distanceLimit(drive) {
  const last = drive.variants[drive.variants.length - 1];
  const attribute = last.attributes.find((a) => a.name === DISTANCE);
  const counts = new Float64Array(128);
  for (const values of attribute?.values ?? []) {
    for (const byte of values) if (byte > 0) counts[Math.abs(byte - 128)]++;
  }
  const all = counts.reduce((a, b) => a + b, 0);
  let [size, below] = [0, counts[0]];
  while (size < 127 && below < 0.97 * all) below += counts[++size];
  const most = attribute ? (size / 127) * attribute.high : 0;
  return NICE.find((nice) => nice >= Math.max(most, 0.001) * (1 - 1e-9)) ?? most;
}

/** Limits to choose from, metres. */
export function limits() {
  return NICE;
}

/** Bytes by point, colours by byte, and the legend for an attribute. */
export function colouring(drive, variant, name, limitM, theme) {
  const attribute = drive.variants[variant].attributes.find((a) => a.name === name);
  if (name === DISTANCE && attribute) return distances(drive, attribute, limitM, theme);
  if (attribute) return carried(drive, attribute, theme);
  const { unknown, series, passes, viridis, cividis } = theme;
  switch (name) {
    case 'scanner':
      return {
        bytes: perFan(drive, (fan) => new Uint8Array(fan.points).fill(1 + fan.number)),
        colours: turns(unknown, series),
        legend: { entries: drive.fans.map((fan) => [fan.name, series[fan.number % series.length]]) },
      };
    case 'pass': {
      const byte = (pass) => (pass === 0 ? 0 : 1 + ((pass - 1) % 255));
      const entries = Array.from({ length: Math.min(drive.passes, passes.length) }, (_, i) => [
        i + passes.length < drive.passes ? `${i + 1}, ${i + 1 + passes.length} …` : `${i + 1}`,
        passes[i],
      ]);
      return {
        bytes: byProfile(drive, (fan, profile) => byte(fan.passes[profile])),
        colours: turns(unknown, passes),
        legend: { entries: [...entries, ['turning or at rest', unknown]] },
      };
    }
    case 'time': {
      const [from, to] = drive.spanS;
      return {
        bytes: byProfile(drive, (fan, profile) => scaled(drive.timeS(fan, profile), from, to)),
        colours: table(unknown, (t) => along(viridis, t)),
        legend: { bar: gradient(viridis), ticks: ['0 s', `${seconds(0.5 * (to - from))}`, `${seconds(to - from)}`], note: `after ${fixed(from, 1)} s` },
      };
    }
    default: {
      const positions = drive.positions(variant);
      const [from, to] = middle(positions);
      const bytes = (fan) => Uint8Array.from({ length: fan.points }, (_, i) => scaled(positions[3 * (fan.first + i) + 2], from, to));
      const up = drive.origin[2];
      return {
        bytes: perFan(drive, bytes),
        colours: table(unknown, (t) => along(cividis, t)),
        legend: { bar: gradient(cividis), ticks: [from, 0.5 * (from + to), to].map((z) => `${fixed(up + z, 2)} m`) },
      };
    }
  }
}

function distances(drive, attribute, limitM, theme) {
  const { low, high } = attribute;
  const colour = (t) => along(theme.signed, 0.5 + (low + t * (high - low)) / (2 * limitM));
  const limit = millimetres(limitM);
  return {
    bytes: attribute.values,
    colours: table(theme.unknown, colour),
    legend: {
      bar: gradient(theme.signed),
      ticks: [`−${limit}`, '0', `+${limit} mm`],
      note: `M3C2 distance to ${drive.against}`,
      entries: [['no points within reach', theme.unknown]],
    },
  };
}

function carried(drive, attribute, theme) {
  const { low, high, unit, name } = attribute;
  const text = (value) => (unit === 'm' ? `${millimetres(value)} mm` : `${fixed(value, 3)} ${unit}`);
  return {
    bytes: attribute.values,
    colours: table(theme.unknown, (t) => along(theme.cividis, t)),
    legend: {
      bar: gradient(theme.cividis),
      ticks: [low, 0.5 * (low + high), high].map(text),
      note: name,
    },
  };
}

function perFan(drive, bytes) {
  return drive.fans.map(bytes);
}

/** Gives all points of a profile the same byte. */
function byProfile(drive, byte) {
  return perFan(drive, (fan) => {
    const ofProfile = Uint8Array.from(fan.counts, (_, profile) => byte(fan, profile));
    return Uint8Array.from(fan.profileOf, (profile) => ofProfile[profile]);
  });
}

function scaled(value, from, to) {
  return 1 + Math.round(254 * Math.min(Math.max((value - from) / (to - from || 1), 0), 1));
}

/** The heights between which 98 % of the points of a sample lie. */
function middle(positions) {
  const points = positions.length / 3;
  const every = Math.max(1, Math.floor(points / 20000));
  const heights = [];
  for (let i = 0; i < points; i += every) heights.push(positions[3 * i + 2]);
  heights.sort((a, b) => a - b);
  return [heights[Math.floor(0.01 * heights.length)] ?? 0, heights[Math.floor(0.99 * (heights.length - 1))] ?? 1];
}
