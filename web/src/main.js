// Mounts the viewer into the page once its element is about to scroll into view.

import style from './style.css';
import { App } from './app.js';
import { el } from './ui/dom.js';
import { hasWebGl } from './view/stage.js';

const say = (root, text) => root.replaceChildren(el('p', { class: 'note scene-message', role: 'status' }, text));

async function start(root, { format, drives }) {
  if (format !== 1) return say(root, 'These clouds were written by another version of boresight.');
  if (typeof DecompressionStream === 'undefined') {
    return say(root, 'This browser cannot unpack the clouds: use one from 2023 or later.');
  }
  if (!hasWebGl()) {
    return say(root, 'This browser does not draw in three dimensions (WebGL 2 is off or missing). The maps above show the same distances.');
  }
  say(root, 'Unpacking the clouds …');
  try {
    const app = new App(root, drives);
    root.viewer = app; // for tests
    await app.open(0);
    root.dataset.state = 'ready';
  } catch (error) {
    console.error(error);
    say(root, `The clouds cannot be drawn: ${error.message}`);
  }
}

const root = document.getElementById('scene-viewer');
const header = document.getElementById('scene-header');
if (root && header) {
  document.head.append(el('style', {}, style));
  const observer = new IntersectionObserver((entries) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    start(root, JSON.parse(header.textContent));
  }, { rootMargin: '400px' });
  observer.observe(root);
}
