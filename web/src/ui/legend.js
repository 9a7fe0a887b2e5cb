// Legends and the description of a point.

import { fixed, signedMillimetres } from '../text.js';
import { el } from './dom.js';

/** The legend of a colouring: a bar with ticks, or colours with names. */
export function legend({ bar, ticks, note, entries }) {
  const parts = [];
  if (bar) {
    parts.push(el('div', { class: 'scene-scale' },
      note ? el('span', { class: 'scene-note' }, note) : '',
      el('div', { class: 'scene-bar', style: `background: ${bar}` }),
      el('div', { class: 'scene-ticks' }, ...ticks.map((tick) => el('span', {}, tick)))));
  }
  if (entries) {
    parts.push(el('ul', { class: 'scene-entries' }, ...entries.map(([text, colour]) => el('li', {},
      el('span', { class: 'scene-swatch', style: `background: ${colour}` }), text))));
  }
  return parts;
}

/** Coordinates and attributes of a point, as pairs of a name and a value. */
export function facts(point) {
  const [east, north, up] = point.map.map((value) => `${fixed(value, 4)} m`);
  const rows = [['East', east], ['North', north], ['Up', up]];
  if (point.distance) {
    const sign = point.distance.isBeyond ? 'beyond ' : '';
    rows.push(['M3C2 distance', `${sign}${signedMillimetres(point.distance.value, 2)} mm`]);
  }
  if (point.detection) {
    const is = point.distance && Math.abs(point.distance.value) > point.detection.value;
    const meaning = point.distance ? (is ? ', exceeded' : ', not exceeded') : '';
    rows.push(['Level of detection', `${fixed(1e3 * point.detection.value, 2)} mm${meaning}`]);
  }
  rows.push(
    ['Scanner', point.scanner],
    ['Profile', String(point.profile)],
    ['Time', `${fixed(point.timeS, 3)} s`],
    ['Pass', point.pass > 0 ? String(point.pass) : 'turning or at rest'],
  );
  return rows;
}

export function factList(rows) {
  return el('dl', { class: 'scene-facts' }, ...rows.map(([name, value]) => el('div', {}, el('dt', {}, name), el('dd', {}, value))));
}
