// Colour scales that colour-blind readers can tell apart, as tables of 256 colours for bytes: 0 is an unknown value.

const CIVIDIS = ['#00224e', '#123570', '#3b496c', '#575d6d', '#707173', '#8a8678', '#a59c74', '#c3b369', '#e1cc55', '#fee838'];
const VIRIDIS = ['#440154', '#482878', '#3e4989', '#31688e', '#26828e', '#1f9e89', '#35b779', '#6ece58', '#b5de2b', '#fde725'];
/** Negative to positive; the middle does not stand out too much from either background. */
const SIGNED = {
  light: ['#08306b', '#1c5fa8', '#4f93cd', '#93bfdf', '#b9b9b4', '#eab16f', '#dd7f24', '#b85506', '#7a3203'],
  dark: ['#2f74d0', '#4a92e0', '#7db4ea', '#b5d3f0', '#f1f1ec', '#f7cf9b', '#f2a54d', '#e57f1c', '#c65f06'],
};
/** Okabe and Ito's colours, without black and yellow. */
const PASSES = ['#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#8c6d00'];

const channels = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
const hex = (rgb) => `#${rgb.map((c) => Math.round(c).toString(16).padStart(2, '0')).join('')}`;

/** The colour at `t` from 0 to 1 along a list of colours. */
export function along(stops, t) {
  const place = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const below = Math.min(Math.floor(place), stops.length - 2);
  const [a, b] = [channels(stops[below]), channels(stops[below + 1])];
  return a.map((value, i) => value + (place - below) * (b[i] - value));
}

/** A mixture of two colours; `share`, from 0 to 1, is that of the second. */
export function mixed(from, to, share) {
  return hex(channels(from).map((value, i) => value + share * (channels(to)[i] - value)));
}

/** Colours of the page, from the variables of its style. */
export function theme(element) {
  const style = getComputedStyle(element);
  const get = (name) => style.getPropertyValue(`--${name}`).trim();
  const isDark = matchMedia('(prefers-color-scheme: dark)').matches;
  return {
    isDark,
    page: get('page'),
    ink: get('ink'),
    muted: get('muted'),
    grid: get('grid'),
    tint: get('tint'),
    ground: isDark ? '#0f1113' : '#f6f4ef',
    series: [0, 1, 2, 3, 4, 5].map((i) => get(`s${i}`)),
    unknown: isDark ? '#4a4f55' : '#d6d3cb',
    reference: isDark ? '#7d858e' : '#8b9198',
    signed: SIGNED[isDark ? 'dark' : 'light'],
    viridis: VIRIDIS,
    cividis: CIVIDIS,
    passes: PASSES,
    axes: [PASSES[5], PASSES[2], PASSES[0]],
  };
}

/** A table whose byte b, from 1 to 255, has the colour `colour(t)` with t from 0 to 1. */
export function table(unknown, colour) {
  const rgba = new Uint8Array(4 * 256);
  for (let byte = 0; byte < 256; byte++) {
    const rgb = byte === 0 ? channels(unknown) : colour((byte - 1) / 254);
    rgba.set([...rgb.map(Math.round), 255], 4 * byte);
  }
  return rgba;
}

/** A table that gives each byte one of the colours in turn. */
export function turns(unknown, colours) {
  return table(unknown, (t) => channels(colours[Math.round(254 * t) % colours.length]));
}

/** A CSS gradient of a list of colours. */
export function gradient(stops) {
  const colours = Array.from({ length: 21 }, (_, i) => hex(along(stops, i / 20)));
  return `linear-gradient(to right, ${colours.join(', ')})`;
}
