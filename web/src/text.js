// Numbers as text.

/** With a true minus sign, and no minus before zero. */
export function fixed(value, digits) {
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace('-', '') : text).replace('-', '−');
}

/** Metres as millimetres, with as few digits as they need. */
export function millimetres(metres) {
  return String(Number((1e3 * metres).toPrecision(3))).replace('-', '−');
}

/** Metres as millimetres with one digit and a sign. */
export function signedMillimetres(metres, digits = 1) {
  const text = fixed(1e3 * metres, digits);
  return Number(text.replace('−', '-')) > 0 ? `+${text}` : text;
}

export function seconds(value) {
  return `${fixed(value, 1)} s`;
}

export function degrees(radians) {
  return `${fixed((180 / Math.PI) * radians, 0)}°`;
}

/** With a comma between thousands. */
export function count(n) {
  return n.toLocaleString('en');
}
