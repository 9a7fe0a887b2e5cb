// The section: its controls, its chart, and the offsets of scanners and passes as numbers.

import { mixed } from '../colours.js';
import { degrees, fixed, millimetres, signedMillimetres } from '../text.js';
import { choice, el, slider } from '../ui/dom.js';
import { SHAPES, drawSection, sample } from './chart.js';
import { cut, reach } from './cut.js';
import { corners, frameOf, surfaceAt } from './frame.js';

const LENGTHS_M = [0.1, 0.2, 0.3, 0.5, 1, 2];
const SLABS_M = [0.0025, 0.005, 0.01, 0.02, 0.05];
const HEIGHTS_M = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05];

export class SectionPanel {
  /** Calls `moved` with the corners of the section on its surface, from the origin, metres. */
  constructor({ theme, moved }) {
    Object.assign(this, { theme, moved });
    this.lengthM = 0.3;
    this.halfM = 0.01;
    this.heightM = 0;
    this.controls = el('div', { class: 'scene-controls' });
    this.canvas = el('canvas', { class: 'scene-section', role: 'img' });
    this.reading = el('p', { class: 'scene-reading', 'aria-live': 'off' });
    this.table = el('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': 'Scanners and passes in the section' });
    this.note = el('p', { class: 'note' });
    this.canvas.addEventListener('pointermove', (event) => this.read(event));
    this.canvas.addEventListener('pointerleave', () => { this.reading.textContent = ''; });
    this.element = el('div', {}, el('h3', {}, 'Section'), this.controls, this.canvas, this.reading, this.note, this.table);
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  setDrive(drive, variant) {
    Object.assign(this, { drive, variant });
    this.places = drive.places.map((place) => ({
      name: `${place.name} (slope ${degrees(place.slope_rad)}, seen ${place.seen} times)`,
      centre: place.centre_m,
    }));
    if (this.places.length === 0) this.places.push({ name: 'middle of the drive', centre: middle(drive) });
    this.goTo(this.places[0]);
  }

  setVariant(variant) {
    this.variant = variant;
    this.draw();
  }

  setTheme(theme) {
    this.theme = theme;
    this.draw();
  }

  /** Cuts through a picked point. */
  goToPoint(centre) {
    const name = 'the picked point';
    this.places = this.places.filter((place) => place.name !== name);
    const place = { name, centre };
    this.places.push(place);
    this.goTo(place);
  }

  goTo(place) {
    this.place = place;
    this.surface = surfaceAt(this.drive, place.centre);
    this.azimuth = this.surface.azimuth;
    this.buildControls();
    this.draw();
  }

  buildControls() {
    const again = () => this.draw();
    const places = this.places.map((place) => [place, place.name]);
    const millimetreList = (values, text) => values.map((value) => [value, text(millimetres(value))]);
    this.controls.replaceChildren(
      choice('Place', places, this.place, (place) => this.goTo(place)),
      slider('Azimuth', { min: 0, max: 179, step: 1, value: Math.round((180 / Math.PI) * this.azimuth) % 180, text: (deg) => `${deg}°` }, (deg) => {
        this.azimuth = (Math.PI / 180) * deg;
        again();
      }),
      choice('Length', LENGTHS_M.map((m) => [m, `${m} m`]), this.lengthM, (m) => { this.lengthM = m; again(); }),
      choice('Thickness', millimetreList(SLABS_M, (mm) => `± ${mm} mm`), this.halfM, (m) => { this.halfM = m; again(); }),
      choice('Heights', [[0, 'fit the points'], ...millimetreList(HEIGHTS_M, (mm) => `± ${mm} mm`)], this.heightM, (m) => { this.heightM = m; again(); }),
    );
  }

  /** Colour and shape of a series: colours stand for scanners, their shades and shapes for passes. */
  style({ fan, pass }) {
    const { series, ink, page } = this.theme;
    const passes = [...new Set(this.section.series.map((one) => one.pass))].sort((a, b) => a - b);
    const number = passes.indexOf(pass);
    const [ground, share] = [[ink, 0], [ink, 0.45], [page, 0.4], [ink, 0.7], [page, 0.6]][number % 5];
    return {
      colour: mixed(series[fan.number % series.length], ground, share),
      shape: SHAPES[number % SHAPES.length],
    };
  }

  draw() {
    if (!this.drive || this.canvas.clientWidth === 0) return;
    const { drive, variant, lengthM, halfM, theme } = this;
    this.frame = frameOf(this.surface, this.azimuth);
    this.section = cut(drive, variant, this.frame, { lengthM, halfM });
    const [low, high] = this.heightM > 0 ? [-this.heightM, this.heightM] : reach(this.section);
    const style = (series) => this.style(series);
    this.drawn = drawSection(this.canvas, this.section, { lengthM, low, high, theme, style });
    this.describe();
    this.moved(corners(this.frame, lengthM, halfM));
  }

  describe() {
    const { series, reference } = this.section;
    const name = this.drive.variants[this.variant].name;
    const times = this.drawn.exaggeration;
    const exaggeration = times >= 10 ? fixed(times, 0) : fixed(times, 1);
    this.note.textContent = `${name}. Heights are magnified ${exaggeration} times relative to lengths; 0 is the plane through the points of the last mounting. `
      + (reference.length > 0
        ? `Grey and dashed: the reference, ${reference.length} points. Lines are medians over each centimetre; offsets are from the medians of the reference, and spread is 1.48 times the median absolute deviation.`
        : 'There are no points of a reference here.');
    const known = series.filter((one) => one.middle !== null);
    const summary = known.map((one) => `${one.fan.name}, pass ${one.pass}: ${signedMillimetres(one.middle)} mm`).join('; ');
    this.canvas.setAttribute('aria-label', `Section, ${name}. ${summary}`);
    this.table.replaceChildren(this.rows(series));
  }

  rows(series) {
    const head = ['', 'scanner', 'pass', 'points', 'median offset (mm)', 'spread (mm)'];
    const value = (metres, text) => (metres === null ? '–' : text(metres));
    return el('table', { class: 'numbers' },
      el('thead', {}, el('tr', {}, ...head.map((text) => el('th', { scope: 'col' }, text)))),
      el('tbody', {}, ...series.map((one) => {
        const { colour, shape } = this.style(one);
        const mark = el('canvas', { class: 'scene-mark', 'aria-hidden': 'true' });
        sample(mark, shape, colour);
        return el('tr', {},
          el('td', {}, mark),
          el('td', { class: 'text' }, one.fan.name),
          el('td', {}, one.pass > 0 ? String(one.pass) : 'turning or at rest'),
          el('td', {}, String(one.points.length)),
          el('td', {}, value(one.middle, (m) => signedMillimetres(m, 2))),
          el('td', {}, value(one.spread, (m) => fixed(1e3 * m, 2))));
      })));
  }

  read(event) {
    const box = this.canvas.getBoundingClientRect();
    const [s, v] = this.drawn.toPoint(event.clientX - box.left, event.clientY - box.top);
    if (Math.abs(s) > 0.5 * this.lengthM) return;
    const { centre, along, up } = this.frame;
    const map = centre.map((x, i) => this.drive.origin[i] + x + s * along[i] + v * up[i]);
    this.reading.textContent = `${signedMillimetres(v, 2)} mm at east ${fixed(map[0], 4)}, north ${fixed(map[1], 4)}, up ${fixed(map[2], 4)} m`;
  }
}

function middle(drive) {
  const positions = drive.positions(drive.variants.length - 1);
  const at = 3 * Math.floor(drive.points / 2);
  return [...positions.subarray(at, at + 3)];
}
