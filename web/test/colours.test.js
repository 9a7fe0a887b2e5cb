// The colours of the lines in the page, as seen with colour vision deficiencies.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

const style = readFileSync(new URL('../../crates/report/src/report/style.css', import.meta.url), 'utf8');

/** The simulation of Machado, Oliveira and Fernandes 2009, full deficiency, in linear light. */
const VISION = {
  normal: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  protanopia: [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
  deuteranopia: [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
  tritanopia: [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
};

const linear = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255)
  .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
const times = (matrix, v) => matrix.map((row) => row.reduce((sum, x, i) => sum + x * v[i], 0));

/** CIE L*a*b*, as seen with one of the visions. */
function lab(hex, vision) {
  const rgb = times(VISION[vision], linear(hex)).map((c) => Math.min(Math.max(c, 0), 1));
  const [x, y, z] = times([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], rgb);
  const f = (t) => (t > 0.008856 ? Math.cbrt(t) : 7.787 * t + 16 / 116);
  const [fx, fy, fz] = [f(x / 0.9505), f(y), f(z / 1.089)];
  return [116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)];
}

const luminance = (hex) => times([[0.2126, 0.7152, 0.0722]], linear(hex))[0];

function contrast(a, b) {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (high + 0.05) / (low + 0.05);
}

const themes = [...style.matchAll(/:root\s*{([^}]*)}/g)].map(([, text]) => {
  const colours = Object.fromEntries([...text.matchAll(/--([a-z0-9]+):\s*(#[0-9a-f]{3,6})/g)].map(([, name, hex]) => [name, hex]));
  if (colours.page?.length === 4) colours.page = `#${[...colours.page.slice(1)].map((c) => c + c).join('')}`;
  return colours;
});

test('lines differ from each other with every colour vision, and from the page', () => {
  assert.equal(themes.length, 3, 'light, dark, print');
  for (const theme of themes) {
    const lines = [0, 1, 2, 3, 4, 5].map((i) => theme[`s${i}`]);
    for (const line of lines) assert.ok(contrast(line, theme.page) >= 3, `${line} on ${theme.page}: ${contrast(line, theme.page)}`);
    for (const vision of Object.keys(VISION)) {
      lines.forEach((a, i) => lines.slice(0, i).forEach((b) => {
        const [x, y] = [lab(a, vision), lab(b, vision)];
        const apart = Math.hypot(...x.map((value, axis) => value - y[axis]));
        // Twenty is a clear difference: a just noticeable one is about 2.
        assert.ok(apart >= 20, `${a} and ${b}, ${vision}: ${apart.toFixed(1)}`);
      }));
    }
  }
});
