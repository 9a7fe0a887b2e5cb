// A page of a synthetic drive with any number of points.

import { readFileSync, writeFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';
import { deflateSync } from 'node:zlib';

/** Bytes of numbers as `crates/report/src/report/scene/packed.rs` writes them: differences, lowest bytes first. */
export function packed(numbers, width) {
  const bytes = new Uint8Array(numbers.length * width);
  let last = 0;
  numbers.forEach((number, i) => {
    const difference = (number - last) | 0;
    last = number;
    for (let plane = 0; plane < width; plane++) bytes[plane * numbers.length + i] = difference >> (8 * plane);
  });
  return bytes;
}

/** Points per profile. */
const BEAMS = 250;

/**
 * Writes a page with `points` points of one scanner to `path`; if `moves`, the mounting of the last variant moves.
 * Returns the address of the page.
 */
export function writePage(path, points, moves = false) {
  const parts = [];
  let at = 0;
  const put = (numbers, bits) => {
    const bytes = bits === 8 ? Uint8Array.from(numbers) : packed(numbers, bits / 8);
    parts.push(bytes);
    at += bytes.length;
    return { at: at - bytes.length, length: numbers.length, bits };
  };
  const profiles = Math.round(points / BEAMS);
  const list = (n, value) => Array.from({ length: n }, (_, i) => Math.round(value(i)));
  const beam = (i) => (i % BEAMS) / BEAMS;
  // Ten passes of ten metres, one metre apart.
  const track = {
    translation: [
      put(list(profiles, (i) => 1e7 * ((10 * i) / profiles % 1)), 32),
      put(list(profiles, (i) => 1e6 * Math.floor((10 * i) / profiles)), 32),
      put(list(profiles, () => 2e6), 32),
    ],
    rotation: [0, 0, 1, 1].map((x) => put(list(profiles, () => x * Math.SQRT1_2 * 2 ** 30), 32)),
  };
  // A centimetre up and down, and three degrees about the body's x axis.
  const angle = (i) => 0.026 * Math.sin(i / 50);
  const one = 2 ** 30;
  const moving = moves && {
    translation: [0, 0, 1].map((z) => put(list(profiles, (i) => 1e4 * z * Math.sin(i / 30)), 32)),
    rotation: [
      put(list(profiles, (i) => one * Math.sin(angle(i))), 32),
      put(list(profiles, () => 0), 32),
      put(list(profiles, () => 0), 32),
      put(list(profiles, (i) => Math.min(one * Math.cos(angle(i)), 2 ** 31 - 1)), 32),
    ],
  };
  const attribute = (name) => ({
    name, unit: 'm', low: -0.005, high: 0.005, values: [put(list(points, (i) => 128 + 60 * Math.sin(i / 9000) + 30 * Math.sin(i)), 8)],
  });
  const drive = {
    name: `${points} points`,
    script: 'scene-drive-0',
    origin_m: [0, 0, 0],
    step_m: 1e-6,
    rotation_step: 2 ** -30,
    start_s: 0,
    step_s: 1e-6,
    fans: [{
      name: 'scanner',
      of: points,
      points,
      x_m: { low: -0.6, high: 0.6, values: put(list(points, (i) => 65535 * beam(i)), 16) },
      y_m: { low: 0, high: 0, values: null },
      z_m: { low: -2.1, high: -1.9, values: put(list(points, (i) => 32768 + 9000 * Math.sin(40 * beam(i)) + 9000 * Math.sin(i / 7000)), 16) },
      counts: put(list(profiles, () => BEAMS), 16),
      times: put(list(profiles, (i) => 1e4 * i), 32),
      numbers: put(list(profiles, (i) => i), 32),
      passes: put(list(profiles, (i) => 1 + Math.floor((10 * i) / profiles)), 16),
    }],
    poses: [[track]],
    variants: ['initial', 'calibrated'].map((name) => ({
      name,
      poses: 0,
      mountings: [{ translation_m: [0, 0, name === 'initial' ? 0.05 : 0], rotation: [0, 0, 0, 1] }],
      moving: moves && name === 'calibrated' ? [moving] : [],
      attributes: [attribute('M3C2 distance'), attribute('level of detection')],
    })),
    against: 'the reference',
    reference: { of: 0, step_m: 1e-5, axes: [put([], 32), put([], 32), put([], 32)] },
    surfels: {
      size_m: 0, step_m: 1e-5, low: 0, high: 1,
      axes: [put([], 32), put([], 32), put([], 32)], normals: [put([], 8), put([], 8), put([], 8)], sizes: put([], 8), roughness: put([], 8),
    },
    places: [],
    place_radius_m: 0.2,
  };
  const bytes = Buffer.concat(parts);
  const viewer = readFileSync(new URL('../dist/viewer.js', import.meta.url), 'utf8');
  const style = readFileSync(new URL('../../crates/report/src/report/style.css', import.meta.url), 'utf8');
  writeFileSync(path, `<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"/><title>Points</title><style>${style}</style></head><body>
<div id="scene-viewer" class="scene"></div>
<script type="application/json" id="scene-header">${JSON.stringify({ format: 1, drives: [drive] })}</script>
<script type="application/octet-stream;base64" id="scene-drive-0">${deflateSync(bytes).toString('base64')}</script>
<script>
${viewer}</script></body></html>
`);
  return pathToFileURL(path).href;
}
