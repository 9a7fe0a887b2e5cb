// The viewer in a browser, on the page of a small simulated drive.

import assert from 'node:assert/strict';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { browser, open, pixels, ready, sectionPixels, settled, smallRun, withOwnViewer } from './page.js';
import { writePage } from './synthetic.js';

let run;
let out;
let address;
/** A page of tests that leave the view as they found it, or do not ask how they found it: opening one takes longest. */
let shared;

before(async () => {
  out = smallRun();
  address = withOwnViewer(join(out, 'report.html'));
  run = await browser();
  shared = await open(run, address);
  await ready(shared.page);
});

after(async () => {
  await run?.close();
});

/** Share of the pixels that differ from the first one. */
function filled(bytes) {
  let other = 0;
  for (let i = 0; i < bytes.length; i += 4) {
    if (bytes[i] !== bytes[0] || bytes[i + 1] !== bytes[1] || bytes[i + 2] !== bytes[2]) other++;
  }
  return other / (bytes.length / 4);
}

function differing(a, b) {
  assert.equal(a.length, b.length);
  let other = 0;
  for (let i = 0; i < a.length; i += 4) if (a[i] !== b[i] || a[i + 1] !== b[i + 1] || a[i + 2] !== b[i + 2]) other++;
  return other / (a.length / 4);
}

/** Share of the pixels whose colours differ strongly. */
function far(a, b) {
  let other = 0;
  for (let i = 0; i < a.length; i += 4) {
    if ([0, 1, 2].some((channel) => Math.abs(a[i + channel] - b[i + channel]) > 60)) other++;
  }
  return other / (a.length / 4);
}

for (const { width, colorScheme } of [{ width: 1280, colorScheme: 'dark' }, { width: 390, colorScheme: 'light' }]) {
  test(`clouds are drawn at ${width} px, ${colorScheme}, without requests and errors`, async () => {
    const { page, wrong } = await open(run, address, { width, height: 844, colorScheme });
    await ready(page);
    assert.ok(filled(await pixels(page)) > 0.1);
    const beyond = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    assert.ok(beyond <= 0, `the page is ${beyond} px too wide`);
    const sides = await page.locator('.scene-canvas').boundingBox();
    assert.ok(sides.width > 0.85 * Math.min(width, 950), `${sides.width}`);
    // Nothing is drawn while nothing changes.
    const frames = () => page.evaluate(() => document.getElementById('scene-viewer').viewer.stage.frames);
    const then = await frames();
    await page.waitForTimeout(600);
    assert.equal(await frames(), then);
    assert.deepEqual(wrong, []);
    await page.close();
  });
}

test('another mounting changes clouds and section', async () => {
  const { page, wrong } = shared;
  const section = () => sectionPixels(page);
  const [last, lastSection] = [await pixels(page), await section()];
  const choices = page.locator('.scene-segmented input');
  assert.ok((await choices.count()) >= 2);
  await choices.first().check({ force: true });
  await settled(page);
  assert.ok(differing(last, await pixels(page)) > 0.02);
  assert.ok(differing(lastSection, await section()) > 0.01);
  await choices.last().check({ force: true });
  await settled(page);
  assert.ok(differing(last, await pixels(page)) < 0.001);
  // Browsers may smooth the edges of the same marks differently.
  assert.ok(far(lastSection, await section()) < 0.001);
  assert.deepEqual(wrong, []);
});

test('surfels of the joint adjustment lie on the surface', async () => {
  const { page, wrong } = shared;
  const before = await pixels(page);
  await page.getByLabel('surfels').check();
  await settled(page);
  assert.ok(differing(before, await pixels(page)) > 0.05);
  // More than half of the surfels contain a scanner point within a millimetre of their plane.
  const share = await page.evaluate(() => {
    const { viewer } = document.getElementById('scene-viewer');
    const { surfels } = viewer.drive;
    const points = viewer.drive.positions(viewer.variant);
    let near = 0;
    const every = Math.max(1, Math.floor(surfels.points / 50));
    let all = 0;
    for (let i = 0; i < surfels.points; i += every) {
      all++;
      const c = surfels.positions.subarray(3 * i, 3 * i + 3);
      const n = surfels.normals.subarray(3 * i, 3 * i + 3);
      for (let p = 0; p < points.length; p += 3) {
        const d = [points[p] - c[0], points[p + 1] - c[1], points[p + 2] - c[2]];
        if (Math.max(...d.map(Math.abs)) > 0.5 * surfels.sizesM[i]) continue;
        if (Math.abs(d[0] * n[0] + d[1] * n[1] + d[2] * n[2]) < 1e-3) { near++; break; }
      }
    }
    return near / all;
  });
  assert.ok(share > 0.5, `${share}`);
  await page.getByLabel('surfels').uncheck();
  await settled(page);
  assert.deepEqual(wrong, []);
});

test('keys reach every control and move the view', async () => {
  const { page, wrong } = shared;
  const count = await page.locator('.scene input:not([type=radio]), .scene select, .scene button, .scene [tabindex="0"]').evaluateAll(
    (all) => all.filter((element) => element.checkVisibility()).length,
  );
  const seen = await page.evaluate(() => {
    const first = document.querySelector('.scene select, .scene input, .scene button');
    first.focus();
    return 0;
  });
  assert.equal(seen, 0);
  const reached = new Set();
  const names = [];
  for (let i = 0; i < count + 10; i++) {
    const here = await page.evaluate(() => {
      const element = document.activeElement;
      if (!element.closest('.scene') || element.type === 'radio') return null;
      element.dataset.reached ??= String(Math.random());
      const label = element.getAttribute('aria-label') ?? element.closest('label')?.textContent ?? element.textContent;
      return { key: element.dataset.reached, label };
    });
    if (here) {
      reached.add(here.key);
      names.push(here.label);
    }
    await page.keyboard.press('Tab');
  }
  assert.equal(reached.size, count, names.join(', '));
  assert.ok(names.every((name) => name.trim().length > 0));
  const view = () => page.evaluate(() => {
    const { yaw, pitch, distance, target } = document.getElementById('scene-viewer').viewer.navigation;
    return [yaw, pitch, distance, ...target];
  });
  await page.locator('.scene-canvas').focus();
  const home = await view();
  for (const key of ['ArrowLeft', 'ArrowUp', '+', 'Shift+ArrowRight']) {
    const last = await view();
    await page.keyboard.press(key);
    assert.notDeepEqual(await view(), last, key);
  }
  await page.keyboard.press('Home');
  assert.deepEqual(await view(), home);
  const radios = page.locator('.scene-segmented input');
  await radios.last().focus();
  await page.keyboard.press('ArrowLeft');
  assert.equal(await radios.last().isChecked(), false);
  await radios.last().check({ force: true });
  await settled(page);
  assert.deepEqual(wrong, []);
});

test('every colour is drawn', async () => {
  const { page, wrong } = shared;
  const colours = page.getByLabel('Colour', { exact: true });
  const names = await colours.locator('option').allTextContents();
  assert.ok(names.includes('M3C2 distance') && names.includes('time') && names.includes('scanner') && names.includes('omnivariance') && names.includes('pose sigma'), `${names}`);
  let before = await pixels(page);
  for (const name of names.slice(1)) {
    await colours.selectOption(name);
    await settled(page);
    const now = await pixels(page);
    assert.ok(differing(before, now) > 0.02, name);
    before = now;
  }
  assert.deepEqual(wrong, []);
});

test('a click picks the point it was aimed at', async () => {
  const { page, wrong } = shared;
  const box = await page.locator('.scene-canvas').boundingBox();
  for (const share of [0.2, 0.5, 0.8]) {
    // Seen from close by, the point in the middle of the view is not hidden by another.
    const aim = await page.evaluate((part) => {
      const { viewer } = document.getElementById('scene-viewer');
      const point = Math.floor(part * viewer.drive.points);
      const { local, map } = viewer.drive.describe(viewer.variant, point);
      viewer.navigation.top();
      viewer.navigation.goTo(local, 0.25);
      return { point, map, place: viewer.placeOf(point) };
    }, share);
    await settled(page);
    await page.mouse.click(box.x + aim.place[0], box.y + aim.place[1]);
    const picked = await page.evaluate(() => document.getElementById('scene-viewer').viewer.point);
    assert.equal(picked, aim.point);
    const shown = await page.locator('.scene-facts dd').allTextContents();
    aim.map.forEach((value, axis) => {
      const text = Number(shown[axis].replace('−', '-').replace(' m', ''));
      assert.ok(Math.abs(text - value) <= 0.50001e-4, `${shown[axis]} instead of ${value}`);
    });
  }
  // Enter picks the point in the middle, which is the last one.
  await page.evaluate(() => document.getElementById('scene-viewer').viewer.select(-1));
  await page.locator('.scene-canvas').press('Enter');
  assert.ok(await page.locator('.scene-facts').isVisible());
  await page.getByRole('button', { name: 'Section through this point' }).click();
  assert.ok((await page.locator('.scene .numbers tbody tr').count()) > 0);
  assert.deepEqual(wrong, []);
});

test('the platform shows how mountings move', async () => {
  const { page, wrong } = await open(run, writePage(join(out, 'moving.html'), 20_000, true));
  await ready(page);
  const player = page.getByRole('group', { name: 'The platform along the drive' });
  assert.ok(await player.isVisible());
  const first = await pixels(page);
  const time = page.getByLabel('Time', { exact: true });
  await time.fill('0.4');
  await settled(page);
  const then = await pixels(page);
  assert.ok(differing(first, then) > 0.001);
  await page.getByLabel('Motion of the mountings').selectOption('× 30');
  await settled(page);
  assert.ok(differing(then, await pixels(page)) > 0.0005);
  assert.match(await player.textContent(), /scanner \d+\.\d mm, \d\.\d\d°/);
  const before = Number(await time.inputValue());
  await page.getByRole('button', { name: 'Play' }).click();
  // It stops at the end of the drive.
  await page.getByRole('button', { name: 'Play' }).waitFor({ timeout: 20_000 });
  assert.ok(Number(await time.inputValue()) > before);
  await settled(page);
  assert.deepEqual(wrong, []);
  await page.close();
  const rigid = await open(run, address);
  await ready(rigid.page);
  assert.equal(await rigid.page.getByRole('button', { name: 'Play' }).isVisible(), false);
  await rigid.page.close();
});

test('without WebGL there is a message', async () => {
  const without = await browser(['--disable-gpu', '--disable-webgl', '--disable-3d-apis']);
  const { page, wrong } = await open(without, address);
  await page.waitForSelector('.scene-message');
  assert.match(await page.locator('.scene-message').textContent(), /does not draw in three dimensions/);
  assert.deepEqual(wrong, []);
  await without.close();
});
