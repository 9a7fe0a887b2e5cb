// The point under the pointer.

/** Largest distance of a point from the pointer, CSS pixels. */
const REACH = 8;
/** Points count as visible if they are at most this share farther away than the nearest one. */
const DEPTH = 0.03;

/**
 * The number of the visible point nearest to a position on the canvas; −1 if there is none. `positions` holds x, y, z of
 * each point in turn; only numbers in `ranges`, [first, end), are considered.
 */
export function pick(camera, { width, height }, positions, ranges, x, y) {
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
  const candidates = [];
  for (const [first, end] of ranges) {
    for (let i = first; i < end; i++) {
      const [a, b, c] = [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
      const w = m[3] * a + m[7] * b + m[11] * c + m[15];
      if (w <= camera.near) continue;
      const right = ((m[0] * a + m[4] * b + m[8] * c + m[12]) / w + 1) * 0.5 * width - x;
      if (right > REACH || right < -REACH) continue;
      const down = (1 - (m[1] * a + m[5] * b + m[9] * c + m[13]) / w) * 0.5 * height - y;
      const squared = right * right + down * down;
      if (squared <= REACH * REACH) candidates.push({ i, squared, depth: w });
    }
  }
  const nearest = candidates.reduce((least, { depth }) => Math.min(least, depth), Infinity);
  const visible = candidates.filter(({ depth }) => depth <= nearest * (1 + DEPTH));
  visible.sort((a, b) => a.squared - b.squared || a.depth - b.depth);
  return visible[0]?.i ?? -1;
}

/** The position of a point on the canvas, CSS pixels. */
export function project(camera, { width, height }, [a, b, c]) {
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
  const w = m[3] * a + m[7] * b + m[11] * c + m[15];
  return [
    ((m[0] * a + m[4] * b + m[8] * c + m[12]) / w + 1) * 0.5 * width,
    (1 - (m[1] * a + m[5] * b + m[9] * c + m[13]) / w) * 0.5 * height,
  ];
}
