// The plane of a section: through a point, across a surface.

/** Radius of the neighbourhood from which the surface is estimated, metres. */
const SURFACE_M = 0.12;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

/** Eigenvectors of a symmetric 3 × 3 matrix by Jacobi rotations, in the order of descending eigenvalues. */
export function eigenvectors(matrix) {
  const a = matrix.map((row) => [...row]);
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let sweep = 0; sweep < 30; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(a[p][q]) < 1e-300) continue;
      const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.hypot(theta, 1));
      const c = 1 / Math.hypot(t, 1);
      const s = t * c;
      for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
      for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
      for (let k = 0; k < 3; k++) [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
    }
  }
  const order = [0, 1, 2].sort((i, j) => a[j][j] - a[i][i]);
  return order.map((i) => v.map((row) => row[i]));
}

/** Numbers of the points within `radius` of a centre. */
function near(positions, centre, radius) {
  const numbers = [];
  for (let i = 0; i < positions.length / 3; i++) {
    const x = positions[3 * i] - centre[0];
    const y = positions[3 * i + 1] - centre[1];
    const z = positions[3 * i + 2] - centre[2];
    if (x * x + y * y + z * z <= radius * radius) numbers.push(i);
  }
  return numbers;
}

function scatter(offsets) {
  const sum = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (const d of offsets) for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) sum[i][j] += d[i] * d[j];
  return sum;
}

/**
 * The surface at a point, from the points of the last variant around it: its centre, its normal (upwards), and the
 * azimuth of the profiles that cross it, clockwise from north, radians.
 */
export function surfaceAt(drive, centre) {
  const positions = drive.positions(drive.variants.length - 1);
  const inside = near(positions, centre, SURFACE_M);
  if (inside.length < 3) return { centre, normal: [0, 0, 1], azimuth: Math.PI / 2 };
  const at = (i) => [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
  const mean = inside.map(at).reduce((sum, p) => sum.map((x, k) => x + p[k] / inside.length), [0, 0, 0]);
  const minus = (a, b) => a.map((x, k) => x - b[k]);
  let normal = eigenvectors(scatter(inside.map((i) => minus(at(i), mean))))[2];
  if (normal[2] < 0) normal = normal.map((x) => -x);
  // From the first to the last point of each profile.
  const steps = [];
  for (let k = 0, first = 0; k < inside.length; k++) {
    const isEnd = k + 1 === inside.length || profileKey(drive, inside[k + 1]) !== profileKey(drive, inside[first]);
    if (!isEnd) continue;
    if (k > first) steps.push(minus(at(inside[k]), at(inside[first])));
    first = k + 1;
  }
  const along = steps.length > 0 ? eigenvectors(scatter(steps))[0] : [1, 0, 0];
  const azimuth = Math.atan2(along[0], along[1]);
  return { centre: mean, normal, azimuth: ((azimuth % Math.PI) + Math.PI) % Math.PI };
}

function profileKey(drive, point) {
  const fan = drive.fanOf(point);
  return `${fan.number}-${fan.profileOf[point - fan.first]}`;
}

/** Axes of a section whose horizontal direction is at `azimuth`: along the surface, normal to it, and to the side. */
export function frameOf({ centre, normal }, azimuth) {
  const level = [Math.sin(azimuth), Math.cos(azimuth), 0];
  const share = dot(level, normal);
  const inSurface = level.map((x, i) => x - share * normal[i]);
  // Straight up a vertical surface, the azimuth does not define a direction in the surface.
  const along = Math.hypot(...inSurface) > 1e-6 ? unit(inSurface) : [0, 0, 1];
  return { centre, along, up: normal, aside: cross(normal, along) };
}

/** The corners of a section on its surface. */
export function corners({ centre, along, aside }, lengthM, halfM) {
  const corner = (a, b) => centre.map((x, i) => x + 0.5 * a * lengthM * along[i] + b * halfM * aside[i]);
  return [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
}
