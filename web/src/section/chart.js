// Draws a section on a canvas: along the surface to the right, normal to it upwards and magnified.

import { fixed, millimetres } from '../text.js';

const MARGIN = { left: 58, right: 14, top: 14, bottom: 44 };
const FONT = '12.5px system-ui, -apple-system, "Segoe UI", "Noto Sans", "Liberation Sans", Arial, sans-serif';

/** The smallest of 1, 2, 5 times a power of ten that is at least `value`. */
export function niceAbove(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((factor) => factor * decade).find((nice) => nice >= value * (1 - 1e-9));
}

function ticks(low, high, step) {
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => (first + i) * step);
}

/** How points of a pass are drawn: passes of one scanner differ in shape. */
export const SHAPES = ['disc', 'ring', 'cross', 'triangle', 'square', 'plus'];

function mark(context, shape, x, y, r) {
  context.beginPath();
  switch (shape) {
    case 'ring': context.arc(x, y, r, 0, 7); break;
    case 'cross': context.moveTo(x - r, y - r); context.lineTo(x + r, y + r); context.moveTo(x - r, y + r); context.lineTo(x + r, y - r); break;
    case 'plus': context.moveTo(x - r, y); context.lineTo(x + r, y); context.moveTo(x, y - r); context.lineTo(x, y + r); break;
    case 'triangle': context.moveTo(x, y - r); context.lineTo(x + r, y + r); context.lineTo(x - r, y + r); context.closePath(); break;
    case 'square': context.rect(x - r, y - r, 2 * r, 2 * r); break;
    default: context.arc(x, y, r * 0.8, 0, 7);
  }
  if (shape === 'disc') context.fill();
  else context.stroke();
}

/** Draws a mark of a series into a small canvas, for a legend. */
export function sample(canvas, shape, colour) {
  const ratio = Math.min(devicePixelRatio, 2);
  canvas.width = canvas.height = 14 * ratio;
  const context = canvas.getContext('2d');
  context.scale(ratio, ratio);
  Object.assign(context, { fillStyle: colour, strokeStyle: colour, lineWidth: 1.4 });
  mark(context, shape, 7, 7, 3.2);
}

/**
 * Draws a section. `style(series)` gives colour and shape. Returns the exaggeration of heights and `toPoint(x, y)`,
 * along and up in metres at a place of the canvas.
 */
export function drawSection(canvas, { reference, line, series }, { lengthM, low, high, theme, style }) {
  const ratio = Math.min(devicePixelRatio, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext('2d');
  context.scale(ratio, ratio);
  const inner = { width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
  const x = (s) => MARGIN.left + (s / lengthM + 0.5) * inner.width;
  const y = (v) => MARGIN.top + ((high - v) / (high - low)) * inner.height;
  const exaggeration = inner.height / (high - low) / (inner.width / lengthM);
  context.font = FONT;
  context.lineWidth = 1;
  axes(context, { x, y, inner, low, high, lengthM, theme, width, height });
  context.save();
  context.beginPath();
  context.rect(MARGIN.left, MARGIN.top, inner.width, inner.height);
  context.clip();
  // The reference below everything, as a light band of points.
  context.fillStyle = theme.reference;
  context.globalAlpha = 0.55;
  for (const [s, v] of reference) context.fillRect(x(s) - 1.5, y(v) - 1.5, 3, 3);
  context.globalAlpha = 0.6;
  for (const one of series) {
    const { colour, shape } = style(one);
    Object.assign(context, { fillStyle: colour, strokeStyle: colour, lineWidth: 1.1 });
    for (const [s, v] of one.points) mark(context, shape, x(s), y(v), 2.4);
  }
  context.globalAlpha = 1;
  const draw = (parts, colour, width, dash = []) => {
    Object.assign(context, { strokeStyle: colour, lineWidth: width, lineJoin: 'round' });
    context.setLineDash(dash);
    for (const part of parts) {
      context.beginPath();
      part.forEach(([s, v], i) => (i === 0 ? context.moveTo(x(s), y(v)) : context.lineTo(x(s), y(v))));
      context.stroke();
    }
    context.setLineDash([]);
  };
  for (const one of series) {
    draw(one.line, theme.page, 3.5);
    draw(one.line, style(one).colour, 1.8);
  }
  draw(line, theme.page, 4);
  draw(line, theme.ink, 2, [6, 4]);
  context.restore();
  const toPoint = (px, py) => [
    ((px - MARGIN.left) / inner.width - 0.5) * lengthM,
    high - ((py - MARGIN.top) / inner.height) * (high - low),
  ];
  return { exaggeration, toPoint, x, y };
}

function axes(context, { x, y, inner, low, high, lengthM, theme, width, height }) {
  const step = Math.max(niceAbove(((high - low) / inner.height) * 42), 1e-4);
  const fine = step > 1.5e-4 ? [step / (String(step).match(/^0*\.?0*2|^2/) ? 4 : 5)] : [];
  const right = MARGIN.left + inner.width;
  const bottom = MARGIN.top + inner.height;
  const line = (x0, y0, x1, y1) => { context.beginPath(); context.moveTo(x0, y0); context.lineTo(x1, y1); context.stroke(); };
  context.textBaseline = 'middle';
  context.textAlign = 'right';
  context.strokeStyle = theme.muted;
  for (const part of fine) for (const v of ticks(low, high, part)) line(MARGIN.left - 3, y(v), MARGIN.left, y(v));
  for (const v of ticks(low, high, step)) {
    context.strokeStyle = theme.grid;
    line(MARGIN.left, y(v), right, y(v));
    context.strokeStyle = theme.muted;
    line(MARGIN.left - 6, y(v), MARGIN.left, y(v));
    context.fillStyle = theme.muted;
    context.fillText(fixed(1e3 * v, 1), MARGIN.left - 9, y(v));
  }
  context.textAlign = 'center';
  context.textBaseline = 'top';
  for (const s of ticks(-0.5 * lengthM, 0.5 * lengthM, niceAbove((lengthM / inner.width) * 70))) {
    context.strokeStyle = theme.muted;
    line(x(s), bottom, x(s), bottom + 5);
    context.fillStyle = theme.muted;
    context.fillText(millimetres(s), x(s), bottom + 8);
  }
  context.strokeStyle = theme.muted;
  line(MARGIN.left, bottom, right, bottom);
  line(MARGIN.left, MARGIN.top, MARGIN.left, bottom);
  context.fillStyle = theme.muted;
  context.textBaseline = 'bottom';
  context.fillText('along the surface (mm)', MARGIN.left + 0.5 * inner.width, height - 2);
  context.save();
  context.translate(13, MARGIN.top + 0.5 * inner.height);
  context.rotate(-Math.PI / 2);
  context.textBaseline = 'middle';
  context.fillText('normal to it (mm)', 0, 0);
  context.restore();
  return width;
}
