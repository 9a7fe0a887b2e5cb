// The committed bundle in `dist` is up to date.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const root = fileURLToPath(new URL('..', import.meta.url));

test('the committed viewer is the bundle of the sources, byte for byte', () => {
  const folder = mkdtempSync(join(tmpdir(), 'boresight-bundle-'));
  execFileSync(process.execPath, ['build.js', folder], { cwd: root });
  const [built, committed] = [folder, join(root, 'dist')].map((at) => readFileSync(join(at, 'viewer.js')));
  rmSync(folder, { recursive: true });
  assert.ok(built.equals(committed), 'run `just web` and commit web/dist/viewer.js');
});

test('the bundle can be embedded in a page and contains the licence of three.js', () => {
  const text = readFileSync(join(root, 'dist', 'viewer.js'), 'utf8');
  assert.ok(!/<\/script|<!--/i.test(text));
  assert.match(text, /three\.js authors/);
  assert.match(text, /Permission is hereby granted/);
});
