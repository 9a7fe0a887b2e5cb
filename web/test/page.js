// The page of a small simulated drive, opened in a browser.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { chromium } from 'playwright-core';

const here = (path) => fileURLToPath(new URL(path, import.meta.url));

/** The program, built before: `BORESIGHT`, or the one in the target folder. */
function program() {
  const target = process.env.CARGO_TARGET_DIR ?? here('../../target');
  return process.env.BORESIGHT ?? join(target, 'release', 'boresight');
}

/** A folder with the results of the small drive: the one that `VIEWER_RUN` names, or a new one until the process ends. */
export function smallRun() {
  if (process.env.VIEWER_RUN) return process.env.VIEWER_RUN;
  const folder = mkdtempSync(join(tmpdir(), 'boresight-viewer-'));
  process.on('exit', () => rmSync(folder, { recursive: true, force: true }));
  const run = (...words) => execFileSync(program(), words, { stdio: ['ignore', 'ignore', 'inherit'] });
  const [data, out] = [join(folder, 'data'), join(folder, 'out')];
  run('--quiet', 'simulate', '--scenario', here('scenario.toml'), '--out', data);
  run('--quiet', 'run', join(data, 'drive-1', 'project.toml'), '--out', out);
  return out;
}

/** The address of a copy of a page with the viewer in `dist`, so that the program need not be built again. */
export function withOwnViewer(page) {
  const text = readFileSync(page, 'utf8');
  const viewer = readFileSync(here('../dist/viewer.js'), 'utf8');
  const begin = text.lastIndexOf('<script>\n') + '<script>\n'.length;
  const end = text.lastIndexOf('</script>');
  assert.ok(begin > 100 && end > begin, 'a page with a viewer');
  const own = join(page, '..', 'own.html');
  writeFileSync(own, text.slice(0, begin) + viewer + text.slice(end));
  return pathToFileURL(own).href;
}

/** A browser that renders WebGL in software. */
export async function browser(more = []) {
  const path = process.env.CHROMIUM ?? ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'].find(existsSync);
  assert.ok(path, 'Chromium is installed, or CHROMIUM names it');
  const software = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-accelerated-2d-canvas', '--no-sandbox'];
  return chromium.launch({ executablePath: path, args: more.length > 0 ? [...more, '--no-sandbox'] : software });
}

/** Opens the address; `wrong` collects errors, warnings and requests, of which there must be none. */
export async function open(run, address, { width = 1280, height = 900, colorScheme = 'light' } = {}) {
  const page = await run.newPage({ viewport: { width, height }, colorScheme });
  const wrong = [];
  page.on('console', (message) => {
    // Caused by tests that read the pixels.
    const isOwn = message.text().startsWith('Canvas2D: Multiple readback');
    if (['error', 'warning'].includes(message.type()) && !isOwn) wrong.push(message.text());
  });
  page.on('pageerror', (error) => wrong.push(error.message));
  page.on('request', (request) => {
    const { protocol } = new URL(request.url());
    if (!['file:', 'data:', 'blob:'].includes(protocol) || (protocol === 'file:' && request.url() !== address)) wrong.push(request.url());
  });
  await page.goto(address);
  await page.locator('#scene-viewer').scrollIntoViewIfNeeded();
  return { page, wrong };
}

export async function ready(page) {
  await page.waitForSelector('#scene-viewer[data-state=ready]', { timeout: 60_000 });
  await settled(page);
}

/**
 * Waits until nothing is drawn any more. On a busy machine a frame may take longer than any wait, so that the stage is
 * asked; the wait is for what begins only in the next frame.
 */
export async function settled(page) {
  await page.evaluate(async () => {
    const { stage } = document.getElementById('scene-viewer').viewer;
    let frames = -1;
    while (frames !== stage.frames || stage.isAsked || stage.isMoving) {
      frames = stage.frames;
      await new Promise((resolve) => { setTimeout(resolve, 350); });
    }
  });
}

/** Bytes in the page as base64 text, which is shorter than JSON. */
const asText = `(bytes) => {
  let text = '';
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}`;

/** The pixels of the clouds' canvas, drawn anew, as bytes RGBA. */
export async function pixels(page) {
  const text = await page.evaluate(`(() => {
    const { stage } = document.getElementById('scene-viewer').viewer;
    stage.draw();
    const gl = stage.renderer.getContext();
    const bytes = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return (${asText})(bytes);
  })()`);
  return Buffer.from(text, 'base64');
}

/** The pixels of the section. */
export async function sectionPixels(page) {
  const text = await page.evaluate(`(() => {
    const canvas = document.querySelector('.scene-section');
    return (${asText})(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data);
  })()`);
  return Buffer.from(text, 'base64');
}
