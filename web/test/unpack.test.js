// The parts of the viewer that need no browser.

import assert from 'node:assert/strict';
import { deflateSync } from 'node:zlib';
import { test } from 'node:test';
import { fromBase64, inflate, list } from '../src/data/unpack.js';
import { apply, compose, exaggerated, multiply } from '../src/data/transform.js';
import { corners, eigenvectors, frameOf } from '../src/section/frame.js';
import { cut, median, reach } from '../src/section/cut.js';
import { niceAbove } from '../src/section/chart.js';
import { packed } from './synthetic.js';

const close = (a, b, within = 1e-12) => a.every((x, i) => Math.abs(x - b[i]) <= within);

test('packed lists are read back exactly', async () => {
  const shorts = [0, 65535, 1, 40000, 3];
  const integers = [-5, 2 ** 31 - 1, -(2 ** 31), 0, 7];
  const all = new Uint8Array([...packed(shorts, 2), ...packed(integers, 4), 9, 255]);
  const bytes = await inflate(fromBase64(deflateSync(all).toString('base64')));
  assert.deepEqual([...list(bytes, { at: 0, length: 5, bits: 16 })], shorts);
  assert.deepEqual([...list(bytes, { at: 10, length: 5, bits: 32 })], integers);
  assert.deepEqual([...list(bytes, { at: 30, length: 2, bits: 8 })], [9, 255]);
});

test('transforms follow equation (1)', () => {
  const half = Math.SQRT1_2;
  // A quarter about z at (10, 0, 2), and a scanner one metre ahead.
  const mapFromBody = { t: [10, 0, 2], q: [0, 0, half, half] };
  const bodyFromScanner = { t: [1, 0, 0], q: [0, 0, 0, 1] };
  assert.ok(close(apply(mapFromBody, apply(bodyFromScanner, [0.2, 0, -1])), [10, 1.2, 1]));
  const both = compose(mapFromBody, bodyFromScanner);
  assert.ok(close(apply(both, [0.2, 0, -1]), [10, 1.2, 1]));
});

test('offsets of a mounting are exaggerated about its mean', () => {
  const turn = (angle) => [Math.sin(angle / 2), 0, 0, Math.cos(angle / 2)];
  const mean = { t: [1, 2, 3], q: [0.5, 0.5, 0.5, 0.5] };
  const mounting = { t: [1.01, 2, 3], q: multiply(turn(0.002), mean.q) };
  const ten = exaggerated(mounting, mean, 10);
  assert.ok(close(ten.t, [1.1, 2, 3]) && close(ten.q, multiply(turn(0.02), mean.q)));
  assert.ok(close(exaggerated(mounting, mean, 1).q, mounting.q));
  assert.ok(close(exaggerated(mean, mean, 100).q, mean.q));
});

test('the axes of a section follow its surface', () => {
  const slope = Math.PI / 4;
  const normal = [0, -Math.sin(slope), Math.cos(slope)];
  const frame = frameOf({ centre: [5, 6, 7], normal }, 0);
  assert.ok(close(frame.along, [0, Math.cos(slope), Math.sin(slope)]));
  assert.ok(close(frame.aside.map(Math.abs), [1, 0, 0]));
  const [a, , c] = corners(frame, 2, 0.1);
  assert.ok(close(a.map((x, i) => 0.5 * (x + c[i])), [5, 6, 7]));
  const [first, , last] = eigenvectors([[2, 1, 0], [1, 2, 0], [0, 0, 0.5]]);
  assert.ok(close(first.map(Math.abs), [Math.SQRT1_2, Math.SQRT1_2, 0]) && close(last.map(Math.abs), [0, 0, 1]));
  assert.deepEqual([0.00011, 0.0002, 0.7].map((x) => Number(niceAbove(x).toPrecision(3))), [0.0002, 0.0002, 1]);
});

test('a section contains the points in its slab', () => {
  // A board at a slope of 45° that rises to the north, a scanner half a millimetre above the reference, and a point on it
  // that belongs to another surface.
  const root = Math.SQRT1_2;
  const at = (along, up, aside) => [aside, root * along - root * up, root * along + root * up];
  const line = (up, aside) => Array.from({ length: 41 }, (_, i) => at(0.005 * (i - 20), up, aside));
  const scanned = [...line(0.0005, 0.002), at(0, 0.3, 0), at(0.01, 0.02, 0)];
  const fan = { number: 0, first: 0, passes: [4], profileOf: new Uint32Array(scanned.length) };
  const drive = {
    reference: { positions: Float64Array.from([...line(0, 0), ...line(0.1, 0.5)].flat()) },
    positions: () => Float64Array.from(scanned.flat()),
    fanOf: () => fan,
  };
  const frame = frameOf({ centre: [0, 0, 0], normal: [0, -root, root] }, 0);
  const { reference, series } = cut(drive, 0, frame, { lengthM: 0.3, halfM: 0.01 });
  assert.equal(reference.length, 41);
  assert.deepEqual(series.map(({ pass, points }) => [pass, points.length]), [[4, 42]]);
  assert.ok(Math.abs(series[0].middle - 0.0005) < 1e-12 && series[0].spread < 1e-12);
  const [low, high] = reach({ reference, series });
  assert.ok(low < 0 && low > -0.001 && high > 0.0005 && high < 0.002, `${low} ${high}`);
  assert.ok(median([3, 1, 2]) === 2 && median([4, 1, 2, 3]) === 2.5 && Number.isNaN(median([])));
});
