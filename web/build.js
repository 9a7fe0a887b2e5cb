// Builds the script that the page contains: `node build.js <folder>`.

import { readFileSync } from 'node:fs';
import { build } from 'esbuild';

const [folder = 'dist'] = process.argv.slice(2);
const licence = readFileSync(new URL('node_modules/three/LICENSE', import.meta.url), 'utf8').trim();
const { version } = JSON.parse(readFileSync(new URL('node_modules/three/package.json', import.meta.url), 'utf8'));

await build({
  entryPoints: ['src/main.js'],
  outfile: `${folder}/viewer.js`,
  bundle: true,
  minify: true,
  format: 'iife',
  target: 'es2022',
  charset: 'ascii',
  legalComments: 'none',
  loader: { '.css': 'text' },
  banner: { js: `/*! Viewer of boresight, MIT OR Apache-2.0. It contains three.js ${version}:\n\n${licence}\n*/` },
  logLevel: 'warning',
});
