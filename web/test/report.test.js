// The page around the viewer: accessibility, wide and narrow screens, keyboard, print.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { browser, open, ready, smallRun } from './page.js';

const AXE = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
/** Width and height between the margins of an A4 sheet, CSS pixels. */
const SHEET = { width: 688, height: 1001 };

let run;
let out;
let address;
/** Pages of the tests on a wide and a narrow screen, in which `axe` unfolds what is folded, last. */
let wide;
let narrow;

before(async () => {
  out = smallRun();
  address = pathToFileURL(join(out, 'report.html')).href;
  run = await browser();
  wide = await open(run, address, { width: 1280, height: 900, colorScheme: 'dark' });
  narrow = await open(run, address, { width: 390, height: 844, colorScheme: 'light' });
});

after(async () => {
  await run?.close();
});

test('the first screen shows the result, the mounting, the platform and a map', async () => {
  const { page } = wide;
  const bottom = async (selector) => {
    const box = await page.locator(selector).first().boundingBox();
    return box.y + box.height;
  };
  await page.evaluate(() => scrollTo(0, 0));
  for (const selector of ['.headline', '.why', '.mounting.brief', '.screen svg', '.screen div:last-child svg']) {
    assert.ok((await bottom(selector)) < 900, `${selector} ends at ${await bottom(selector)}`);
  }
});

test('a narrow screen shows the column of the result', async () => {
  const { page } = narrow;
  for (const table of ['#mounting table.mounting', '#distances table.rmse']) {
    const cells = page.locator(`${table} >> nth=0`).locator('td.result');
    await cells.first().scrollIntoViewIfNeeded();
    const box = await cells.first().boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 390.5, `${table}: from ${box.x}, ${box.width} wide`);
  }
  assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= 390);
});

test('a keyboard reaches links, folded parts and the clouds', async () => {
  const { page } = wide;
  await ready(page);
  await page.evaluate(() => { scrollTo(0, 0); document.activeElement.blur(); });
  const reached = new Set();
  for (let i = 0; i < 120; i++) {
    await page.keyboard.press('Tab');
    const focused = await page.evaluate(() => {
      const { activeElement } = document;
      const style = getComputedStyle(activeElement);
      const isSeen = style.outlineStyle !== 'none' || style.boxShadow !== 'none';
      return { name: activeElement.className || activeElement.tagName, tag: activeElement.tagName, isSeen };
    });
    if (focused.tag === 'BODY') break;
    assert.ok(focused.isSeen || focused.tag === 'INPUT', `${focused.name} does not show that it has the focus`);
    reached.add(focused.tag);
    if (`${focused.name}`.includes('scene-canvas')) reached.add('CANVAS');
  }
  for (const tag of ['A', 'SUMMARY', 'SELECT', 'CANVAS']) assert.ok(reached.has(tag), `${tag} of ${[...reached]}`);
});

for (const [name, opened] of [['1280 px, dark', () => wide], ['390 px, light', () => narrow]]) {
  test(`axe finds nothing at ${name}`, async () => {
    const { page, wrong } = opened();
    await ready(page);
    await page.evaluate(() => document.querySelectorAll('details').forEach((one) => { one.open = true; }));
    await page.evaluate(AXE);
    const { violations } = await page.evaluate(() => globalThis.axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa'] }));
    const messages = violations.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => `${node.html.slice(0, 160)} ${node.any[0]?.message ?? ''}`).join('; ')}`);
    assert.deepEqual(messages, []);
    assert.deepEqual(wrong, []);
  });
}

test('the summary fits on two printed pages, and no heading is separated from its text', async () => {
  const { page } = await open(run, address, { width: SHEET.width, height: SHEET.height });
  await page.emulateMedia({ media: 'print' });
  const first = await page.evaluate(() => document.querySelector('main > section').getBoundingClientRect().top + scrollY);
  assert.ok(first <= 2 * SHEET.height, `the summary takes ${(first / SHEET.height).toFixed(2)} sheets`);
  const breaks = await page.evaluate(() => ['h2', 'h3', 'h4'].map((tag) => getComputedStyle(document.querySelector(tag)).breakAfter));
  assert.deepEqual(breaks, ['avoid', 'avoid', 'avoid']);
  const pdf = await page.pdf({ format: 'A4', preferCSSPageSize: true });
  const sheets = pdf.toString('latin1').match(/\/Type\s*\/Page\b/g)?.length ?? 0;
  assert.ok(sheets > 3 && sheets < 60, `${sheets} sheets`);
  await page.close();
});
