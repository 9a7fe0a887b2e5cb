// Runs all tests, which share one run of the small drive.

import { spawnSync } from 'node:child_process';
import { readdirSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import { smallRun } from './page.js';

const folder = fileURLToPath(new URL('.', import.meta.url));
const files = readdirSync(folder).filter((name) => name.endsWith('.test.js')).map((name) => folder + name);
const env = { ...process.env, VIEWER_RUN: smallRun() };
process.exitCode = spawnSync(process.execPath, ['--test', ...files], { env, stdio: 'inherit' }).status ?? 1;
