// What lies in the slab of a section.

/** Points farther above or below the surface belong to another one, metres. */
const ANOTHER_M = 0.25;
/** Length of the pieces over which the reference is averaged, metres. */
const PIECE_M = 0.01;
/** Fewest points of a piece of a line. */
const FEWEST = 3;

/** Along and above the surface of the points in the slab: calls `each` with both, metres, and the point's number. */
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
 * The section of a drive as one variant places it: the reference, and a series for each pass of each scanner, each with
 * its mean offset from the reference and the spread about that, metres (null without a reference beside it).
 */
export function cut(drive, variant, frame, { lengthM, halfM }) {
  const reference = [];
  inSlab(drive.reference.positions, frame, lengthM, halfM, (s, v) => reference.push([s, v]));
  const series = new Map();
  inSlab(drive.positions(variant), frame, lengthM, halfM, (s, v, point) => {
    const fan = drive.fanOf(point);
    const pass = fan.passes[fan.profileOf[point - fan.first]];
    const key = 65536 * fan.number + pass;
    if (!series.has(key)) series.set(key, { key, fan, pass, points: [], numbers: [] });
    series.get(key).points.push([s, v]);
    series.get(key).numbers.push(point);
  });
  const found = [...series.values()].sort((a, b) => a.key - b.key);
  const ground = heights(reference, lengthM);
  found.forEach((one) => Object.assign(one, offset(one.points, ground, lengthM), { line: line(one.points, lengthM) }));
  return { reference, line: line(reference, lengthM), series: found };
}

/** Mean height of points in each piece of a section; NaN with fewer than `fewest`. */
function heights(reference, lengthM, fewest = 1) {
  const pieces = Math.ceil(lengthM / PIECE_M);
  const [sums, counts] = [new Float64Array(pieces), new Float64Array(pieces)];
  for (const [s, v] of reference) {
    const piece = Math.min(Math.floor((s + 0.5 * lengthM) / PIECE_M), pieces - 1);
    sums[piece] += v;
    counts[piece]++;
  }
  return sums.map((sum, i) => (counts[i] >= fewest ? sum / counts[i] : NaN));
}

/** The mean height of points over each piece, as parts of a line without the pieces that have fewer than {@link FEWEST}. */
function line(points, lengthM) {
  const means = heights(points, lengthM, FEWEST);
  const parts = [[]];
  means.forEach((v, i) => {
    if (Number.isFinite(v)) parts.at(-1).push([(i + 0.5) * PIECE_M - 0.5 * lengthM, v]);
    else if (parts.at(-1).length > 0) parts.push([]);
  });
  return parts.filter((part) => part.length > 1);
}

function offset(points, ground, lengthM) {
  const over = points
    .map(([s, v]) => v - ground[Math.min(Math.floor((s + 0.5 * lengthM) / PIECE_M), ground.length - 1)])
    .filter(Number.isFinite);
  if (over.length === 0) return { mean: null, spread: null };
  const mean = over.reduce((a, b) => a + b, 0) / over.length;
  const squares = over.reduce((sum, x) => sum + (x - mean) ** 2, 0);
  return { mean, spread: over.length > 1 ? Math.sqrt(squares / (over.length - 1)) : null };
}

/** Heights that leave out the outermost hundredth on each side, metres, with some room; at least a millimetre. */
export function reach({ reference, series }) {
  const all = [...reference, ...series.flatMap((one) => one.points)].map(([, v]) => v).sort((a, b) => a - b);
  if (all.length === 0) return [-0.001, 0.001];
  const at = (share) => all[Math.round(share * (all.length - 1))];
  const [low, high] = [at(0.01), at(0.99)];
  const room = Math.max(0.15 * (high - low), 0.0005 - 0.5 * (high - low), 0.0001);
  return [low - room, high + room];
}
