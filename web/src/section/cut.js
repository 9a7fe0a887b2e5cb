// The points in the slab of a section.

/** Points farther above or below the surface than this belong to another surface, metres. */
const ANOTHER_M = 0.25;
/** Length of the pieces for which median heights are computed, metres. */
const PIECE_M = 0.01;
/** Fewest points of a piece of a line. */
const FEWEST = 3;
/** Ratio of the standard deviation to the median of absolute deviations, for normal errors. */
const SIGMAS_PER_MAD = 1.4826;

/** Calls `each` for the points in the slab, with distances along and above the surface (metres) and the number. */
function inSlab(positions, { centre, along, up, aside }, lengthM, halfM, each) {
  for (let i = 0; i < positions.length / 3; i++) {
    const x = positions[3 * i] - centre[0];
    const y = positions[3 * i + 1] - centre[1];
    const z = positions[3 * i + 2] - centre[2];
    if (Math.abs(x * aside[0] + y * aside[1] + z * aside[2]) > halfM) continue;
    const s = x * along[0] + y * along[1] + z * along[2];
    if (Math.abs(s) > 0.5 * lengthM) continue;
    const v = x * up[0] + y * up[1] + z * up[2];
    if (Math.abs(v) <= ANOTHER_M) each(s, v, i);
  }
}

/**
 * The section of a drive as one variant places it: the reference, and a series for each pass of each scanner, with the
 * median of its offsets from the reference and their spread about it, metres (null if there is no reference below it).
 * Medians, because single points at edges are centimetres off.
 */
export function cut(drive, variant, frame, { lengthM, halfM }) {
  const reference = [];
  inSlab(drive.reference.positions, frame, lengthM, halfM, (s, v) => reference.push([s, v]));
  const series = new Map();
  inSlab(drive.positions(variant), frame, lengthM, halfM, (s, v, point) => {
    const fan = drive.fanOf(point);
    const pass = fan.passes[fan.profileOf[point - fan.first]];
    const key = 65536 * fan.number + pass;
    if (!series.has(key)) series.set(key, { key, fan, pass, points: [] });
    series.get(key).points.push([s, v]);
  });
  const sorted = [...series.values()].sort((a, b) => a.key - b.key);
  const ground = heights(reference, lengthM, 1);
  sorted.forEach((one) => Object.assign(one, offset(one.points, ground, lengthM), { line: line(one.points, lengthM) }));
  return { reference, line: line(reference, lengthM), series: sorted };
}

/** The median; NaN for an empty list. */
export function median(values) {
  const sorted = Float64Array.from(values).sort();
  const middle = sorted.length >> 1;
  return sorted.length % 2 === 1 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

function pieceOf(s, lengthM) {
  return Math.min(Math.floor((s + 0.5 * lengthM) / PIECE_M), Math.ceil(lengthM / PIECE_M - 1e-9) - 1);
}

/** Median height of points in each piece of a section; NaN with fewer than `fewest`. */
function heights(points, lengthM, fewest) {
  const pieces = Array.from({ length: pieceOf(0.5 * lengthM, lengthM) + 1 }, () => []);
  for (const [s, v] of points) pieces[pieceOf(s, lengthM)].push(v);
  return pieces.map((piece) => (piece.length >= fewest ? median(piece) : NaN));
}

/** The median height of the points in each piece, as a line that is interrupted at pieces with too few points. */
function line(points, lengthM) {
  const parts = [[]];
  heights(points, lengthM, FEWEST).forEach((v, i) => {
    if (Number.isFinite(v)) parts.at(-1).push([(i + 0.5) * PIECE_M - 0.5 * lengthM, v]);
    else if (parts.at(-1).length > 0) parts.push([]);
  });
  return parts.filter((part) => part.length > 1);
}

function offset(points, ground, lengthM) {
  const over = points.map(([s, v]) => v - ground[pieceOf(s, lengthM)]).filter(Number.isFinite);
  if (over.length === 0) return { middle: null, spread: null };
  const middle = median(over);
  const spread = SIGMAS_PER_MAD * median(over.map((x) => Math.abs(x - middle)));
  return { middle, spread: over.length > 2 ? spread : null };
}

/** The range of heights without the outermost hundredth on each side, with a margin, metres; at least a millimetre. */
export function reach({ reference, series }) {
  const all = [...reference, ...series.flatMap((one) => one.points)].map(([, v]) => v).sort((a, b) => a - b);
  if (all.length === 0) return [-0.001, 0.001];
  const at = (share) => all[Math.round(share * (all.length - 1))];
  const [low, high] = [at(0.01), at(0.99)];
  const room = Math.max(0.15 * (high - low), 0.0005 - 0.5 * (high - low), 0.0001);
  return [low - room, high + room];
}
