// Time of a frame at 1280 × 720, rendered in software: `npm run frames`.

import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { browser, open, ready } from './page.js';
import { writePage } from './synthetic.js';

const FRAMES = 20;
const folder = mkdtempSync(join(tmpdir(), 'boresight-frames-'));
const run = await browser();
for (const points of [200_000, 1_000_000]) {
  const address = writePage(join(folder, `${points}.html`), points);
  const started = performance.now();
  const { page } = await open(run, address, { width: 1400, height: 900 });
  await ready(page);
  const opened = performance.now() - started;
  const times = await page.evaluate(async (frames) => {
    const { viewer } = document.getElementById('scene-viewer');
    const { stage, navigation, canvas } = viewer;
    canvas.style.cssText = 'width: 1282px; height: 722px';
    await new Promise((resolve) => { setTimeout(resolve, 1000); });
    const gl = stage.renderer.getContext();
    const pixel = new Uint8Array(4);
    const measure = (share) => {
      const each = [];
      for (let i = 0; i < frames; i++) {
        navigation.yaw += 0.02;
        navigation.update();
        stage.isMoving = false;
        stage.thin(share);
        const before = performance.now();
        stage.draw();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits for the frame
        each.push(performance.now() - before);
      }
      return each.sort((a, b) => a - b)[Math.floor(frames / 2)];
    };
    const moving = Math.min(1, 150_000 / viewer.drive.points);
    const size = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const still = measure(1);
    const some = measure(moving);
    const none = measure(0);
    // A user turns the view for four seconds.
    const begin = performance.now();
    const first = stage.frames;
    while (performance.now() - begin < 4000) {
      navigation.yaw += 0.02;
      navigation.update();
      await new Promise((resolve) => { requestAnimationFrame(resolve); });
    }
    const turned = (performance.now() - begin) / (stage.frames - first);
    return { still, some, none, turned, kept: Math.round(stage.whileMoving), size };
  }, FRAMES);
  const text = (ms) => `${ms.toFixed(0)} ms`;
  console.log(`${points} points at ${times.size.join(' × ')}: frame ${text(times.still)}, with 150,000 points ${text(times.some)}, without ${text(times.none)}; `
    + `turned for four seconds ${text(times.turned)} per frame, finally with ${times.kept} points; open after ${text(opened)}`);
  await page.close();
}
await run.close();
rmSync(folder, { recursive: true });
