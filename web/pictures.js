// The pictures of README and book, from the report of a finished `boresight demo`:
//
//     node pictures.js OUT [OUT of a run whose mounting moves]
//
// Pages are drawn in light colours, 1280 px wide.

import { existsSync } from 'node:fs';
import { resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { browser } from './test/page.js';

const [demo, moving] = process.argv.slice(2);
if (!demo || !existsSync(resolve(demo, 'report.html'))) {
  console.error('node pictures.js OUT, the folder of a finished `boresight demo`');
  process.exit(2);
}
const to = (name) => fileURLToPath(new URL(`../docs/pictures/${name}.png`, import.meta.url));
const address = (out) => pathToFileURL(resolve(out, 'report.html')).href;

const run = await browser();
const page = await run.newPage({ viewport: { width: 1280, height: 900 }, colorScheme: 'light' });

/** Takes a picture of the first element that matches, with a margin, at most `height` px high. */
async function take(name, selector, height = 900) {
  const element = page.locator(selector).first();
  await element.scrollIntoViewIfNeeded();
  const box = await element.boundingBox();
  const scrolled = await page.evaluate(() => [scrollX, scrollY]);
  const clip = {
    x: Math.max(0, Math.round(box.x + scrolled[0]) - 12),
    y: Math.max(0, Math.round(box.y + scrolled[1]) - 8),
    width: Math.min(Math.round(box.width) + 24, 1280),
    height: Math.min(Math.round(box.height) + 16, height),
  };
  await page.screenshot({ path: to(name), clip, fullPage: true });
}

await page.goto(address(demo));
// The picture is the same wherever the demo ran.
await page.evaluate(() => document.querySelectorAll('.provenance b').forEach((one) => {
  one.textContent = one.textContent.replace(/^.*(?=data\/drive-1\/)/, 'out/');
}));
await page.screenshot({ path: to('page') });
await take('mounting', '#mounting', 620);
await take('distances', '#distances', 520);
await take('maps', '#maps figure', 620);
await take('tests', '#tests', 620);
await take('constancy', '#residuals', 620);
await take('trajectory', '#trajectory', 900);

await page.locator('#scene').scrollIntoViewIfNeeded();
await page.waitForSelector('#scene-viewer[data-state=ready]', { timeout: 120_000 });
await page.waitForTimeout(3000);
await take('scene', '#scene', 1500);

if (moving) {
  await page.goto(address(moving));
  await take('moving', 'h3:has-text("How the mountings moved") + figure', 800);
}
await run.close();
