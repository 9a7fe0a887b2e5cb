// Rigid transforms in double precision: { t: translation in metres, q: unit quaternion x, y, z, w }.

/** R(q) v. */
export function rotate([x, y, z, w], [a, b, c]) {
  const i = 2 * (y * c - z * b);
  const j = 2 * (z * a - x * c);
  const k = 2 * (x * b - y * a);
  return [
    a + w * i + y * k - z * j,
    b + w * j + z * i - x * k,
    c + w * k + x * j - y * i,
  ];
}

/** R x + t. */
export function apply({ t, q }, x) {
  const [a, b, c] = rotate(q, x);
  return [t[0] + a, t[1] + b, t[2] + c];
}

/** The Hamilton product of two quaternions. */
export function multiply([a, b, c, d], [e, f, g, h]) {
  return [
    d * e + a * h + b * g - c * f,
    d * f - a * g + b * h + c * e,
    d * g + a * f - b * e + c * h,
    d * h - a * e - b * f - c * g,
  ];
}

export function normalised(q) {
  const norm = Math.hypot(...q);
  return q.map((component) => component / norm);
}

/** outer ∘ inner. */
export function compose(outer, inner) {
  return { t: apply(outer, inner.t), q: multiply(outer.q, inner.q) };
}

/** Offset of a mounting from its mean: metres and radians. */
export function offset(mounting, mean) {
  const [x, y, z, w] = multiply(mounting.q, [-mean.q[0], -mean.q[1], -mean.q[2], mean.q[3]]);
  return {
    shift: Math.hypot(...mounting.t.map((value, i) => value - mean.t[i])),
    turn: 2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)),
  };
}

/**
 * A mounting with `factor` times its offset (δφ, δp) from its mean, in the convention R ← Exp(δφ) R, t ← t + δp, both in
 * body axes.
 */
export function exaggerated(mounting, mean, factor) {
  const [x, y, z, w] = multiply(mounting.q, [-mean.q[0], -mean.q[1], -mean.q[2], mean.q[3]]);
  const sine = Math.hypot(x, y, z);
  const angle = 2 * Math.atan2(sine, w);
  const wrapped = angle > Math.PI ? angle - 2 * Math.PI : angle;
  const half = (factor * wrapped) / 2;
  const scale = sine > 0 ? Math.sin(half) / sine : 0;
  return {
    t: mounting.t.map((value, i) => mean.t[i] + factor * (value - mean.t[i])),
    q: multiply([x * scale, y * scale, z * scale, Math.cos(half)], mean.q),
  };
}
