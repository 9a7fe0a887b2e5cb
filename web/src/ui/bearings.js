// North and scale in a corner of the view.

import { niceAbove } from '../section/chart.js';
import { el } from './dom.js';

/** Shortest scale, CSS pixels. */
const LEAST = 56;

export class Bearings {
  constructor() {
    this.north = el('div', { class: 'scene-north' }, el('span', {}, '↑'), el('b', {}, 'N'));
    this.bar = el('span', { class: 'scene-length' });
    this.length = el('span', {});
    this.element = el('div', { class: 'scene-bearings', 'aria-hidden': 'true' }, this.north, el('div', {}, this.length, this.bar));
  }

  /** Updates both for a view `height` CSS pixels high; the scale holds at the point about which the view turns. */
  show({ yaw, distance, camera }, height) {
    const perMetre = height / (2 * distance * Math.tan((camera.fov * Math.PI) / 360));
    const metres = niceAbove(LEAST / perMetre);
    this.north.style.transform = `rotate(${yaw}rad)`;
    this.bar.style.width = `${metres * perMetre}px`;
    this.length.textContent = metres >= 1 ? `${Number(metres.toPrecision(2))} m` : `${Number((1e3 * metres).toPrecision(2))} mm`;
  }
}
