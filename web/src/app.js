// The viewer: what is shown, and the controls that change it.

import { colouring, distanceLimit, limits, namesFor } from './attributes.js';
import { along, table, theme } from './colours.js';
import { loadDrive } from './data/drive.js';
import { SectionPanel } from './section/panel.js';
import { millimetres } from './text.js';
import { Bearings } from './ui/bearings.js';
import { button, checkbox, choice, el, segmented } from './ui/dom.js';
import { factList, facts, legend } from './ui/legend.js';
import { Player } from './ui/player.js';
import { Cloud, colourTexture } from './view/cloud.js';
import { axes, cross, dispose, outline, way, wayLine } from './view/lines.js';
import { Navigation } from './view/navigation.js';
import { pick, project } from './view/pick.js';
import { Reference } from './view/reference.js';
import { Stage } from './view/stage.js';
import { SurfelLayer } from './view/surfels.js';

/** Duration of the transition from one mounting to the next, milliseconds. */
const MOVES_MS = 450;
/** Edge of a point, metres. */
const POINT_M = 0.009;

const KEYS = 'Drag to turn, with Shift or two fingers to pan; after a click, the wheel zooms. Keys: arrows turn, Shift with '
  + 'arrows pans, + and − zoom, Home returns to the whole view, T looks from above, Enter picks the point in the middle.';

export class App {
  constructor(root, headers) {
    Object.assign(this, { root, headers });
    this.theme = theme(root);
    this.hidden = new Set();
    this.shows = { reference: true, way: true, axes: true, surfels: false };
    this.canvas = el('canvas', {
      class: 'scene-canvas',
      tabindex: 0,
      role: 'application',
      'aria-label': 'Clouds in three dimensions',
      'aria-describedby': 'scene-keys',
    });
    this.controls = el('div', { class: 'scene-controls' });
    this.legend = el('div', { class: 'scene-legend' });
    this.picked = el('div', { class: 'scene-picked', 'aria-live': 'polite' });
    this.bearings = new Bearings();
    const middle = el('div', { class: 'scene-middle', 'aria-hidden': 'true' });
    const stageBox = el('div', { class: 'scene-stage' }, this.canvas, middle, this.bearings.element);
    this.player = new Player(this);
    this.section = new SectionPanel({ theme: this.theme, moved: (corners) => this.showOutline(corners) });
    root.replaceChildren(
      this.controls,
      stageBox,
      this.legend,
      el('p', { class: 'note', id: 'scene-keys' }, KEYS),
      this.player.element,
      this.picked,
      this.section.element,
    );
    this.stage = new Stage(this.canvas);
    this.colours = colourTexture();
    this.navigation = new Navigation(this.stage.camera, this.canvas, {
      changed: () => this.stage.move(),
      clicked: (x, y) => this.pickAt(x, y),
    });
    this.stage.before = () => {
      this.fitPoints();
      this.bearings.show(this.navigation, this.canvas.clientHeight);
    };
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.retheme());
  }

  async open(number) {
    const drive = await loadDrive(this.headers[number]);
    this.number = number;
    this.drive = drive;
    this.variant = drive.variants.length - 1;
    this.hidden.clear();
    const names = namesFor(drive);
    if (!names.includes(this.colour)) [this.colour] = names;
    this.limitM = distanceLimit(drive);
    this.stage.clouds.forEach((cloud) => {
      cloud.object.removeFromParent();
      cloud.dispose();
    });
    this.clouds = drive.fans.map((fan) => new Cloud(drive, fan, this.colours));
    this.clouds.forEach((cloud) => {
      cloud.show(this.variant, this.variant, 1);
      this.stage.scene.add(cloud.object);
    });
    this.stage.clouds = [...this.clouds];
    this.addReference();
    this.addSurfels();
    this.select(-1);
    this.buildControls();
    this.recolour();
    this.player.setDrive(drive);
    this.showWay();
    this.section.setDrive(drive, this.variant);
    this.frame();
  }

  addReference() {
    const { positions, points } = this.drive.reference;
    this.reference = points > 0 ? new Reference(positions) : null;
    if (!this.reference) return;
    this.reference.colour(this.theme.reference);
    this.reference.object.visible = this.shows.reference;
    this.stage.scene.add(this.reference.object);
    this.stage.clouds.push(this.reference);
  }

  addSurfels() {
    this.surfels?.dispose();
    this.surfels = null;
    const { surfels } = this.drive;
    if (surfels.points === 0) return;
    this.surfels = new SurfelLayer(surfels, this.roughnessColours());
    this.surfels.object.visible = this.shows.surfels;
    this.stage.lines.add(this.surfels.object);
  }

  roughnessColours() {
    return table(this.theme.unknown, (t) => along(this.theme.viridis, t));
  }

  /** Fits the view to the points, without the outermost 2 % on each side of each axis. */
  frame() {
    const positions = this.drive.positions(this.variant);
    const every = Math.max(1, Math.floor(this.drive.points / 20000));
    const ends = [0, 1, 2].map((axis) => {
      const values = [];
      for (let i = 0; i < this.drive.points; i += every) values.push(positions[3 * i + axis]);
      values.sort((a, b) => a - b);
      return [values[Math.floor(0.02 * values.length)] ?? 0, values[Math.floor(0.98 * (values.length - 1))] ?? 1];
    });
    const centre = ends.map(([low, high]) => 0.5 * (low + high));
    const radius = 0.5 * Math.hypot(...ends.map(([low, high]) => high - low));
    this.navigation.frame(centre, Math.max(radius, 0.2) * 0.64);
  }

  buildControls() {
    const { drive, headers } = this;
    const parts = [];
    if (headers.length > 1) {
      const options = headers.map((header, number) => [number, header.name]);
      parts.push(choice('Drive', options, this.number, (number) => this.open(number)));
    }
    this.mountings = segmented('Mounting', drive.variants.map(({ name }) => name), this.variant, (v) => this.setVariant(v));
    const colours = namesFor(drive).map((name) => [name, name]);
    const sizes = limits().map((m) => [m, `± ${millimetres(m)} mm`]);
    this.limit = choice('Colour range', sizes, this.limitM, (m) => { this.limitM = m; this.recolour(); });
    parts.push(
      this.mountings,
      choice('Colour', colours, this.colour, (name) => { this.colour = name; this.recolour(); }),
      this.limit,
    );
    const checks = el('div', { class: 'scene-checks', role: 'group', 'aria-label': 'Layers' });
    if (drive.fans.length > 1) {
      for (const fan of drive.fans) checks.append(checkbox(fan.name, true, (on) => this.showFan(fan, on)));
    }
    if (this.reference) checks.append(checkbox('reference', this.shows.reference, (on) => this.toggle('reference', on)));
    if (this.surfels) {
      const { low, high } = drive.surfels;
      const title = `Patches of the joint adjustment, by the roughness of the surface: ${millimetres(low)} to ${millimetres(high)} mm`;
      const box = checkbox('surfels', this.shows.surfels, (on) => this.toggle('surfels', on));
      box.title = title;
      checks.append(box);
    }
    checks.append(
      checkbox('trajectory', this.shows.way, (on) => this.toggle('way', on)),
      checkbox('body axes', this.shows.axes, (on) => this.toggle('axes', on)),
      button('Whole view', () => this.navigation.reset()),
      button('From above', () => this.navigation.top()),
    );
    this.controls.replaceChildren(...parts, checks);
  }

  setVariant(variant) {
    const from = this.variant;
    if (variant === from) return;
    this.variant = variant;
    this.recolour();
    this.showWay();
    this.section.setVariant(variant);
    if (this.point >= 0) this.select(this.point);
    const isQuick = matchMedia('(prefers-reduced-motion: reduce)').matches;
    const started = performance.now();
    const step = (now) => {
      if (this.variant !== variant) return;
      const share = isQuick ? 1 : Math.min(1, Math.max(0, now - started) / MOVES_MS);
      const eased = share * share * (3 - 2 * share);
      this.clouds.forEach((cloud) => cloud.show(from, variant, eased));
      this.stage.move();
      if (share < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  recolour() {
    const { bytes, colours, legend: shown } = colouring(this.drive, this.variant, this.colour, this.limitM, this.theme);
    this.colours.image.data.set(colours);
    this.colours.needsUpdate = true;
    this.clouds.forEach((cloud, fan) => cloud.colour(bytes[fan]));
    this.legend.replaceChildren(...legend(shown), ...legend({ entries: this.axisEntries() }));
    this.limit.hidden = this.colour !== 'M3C2 distance';
    this.stage.ground(this.theme.ground);
  }

  axisEntries() {
    return ['x', 'y', 'z'].map((name, i) => [i === 0 ? `body axes: ${name}` : name, this.theme.axes[i]]);
  }

  retheme() {
    this.theme = theme(this.root);
    if (!this.drive) return;
    this.reference?.colour(this.theme.reference);
    this.surfels?.colour(this.roughnessColours());
    this.recolour();
    this.showWay();
    this.player.show();
    this.section.setTheme(this.theme);
  }

  toggle(name, on) {
    this.shows[name] = on;
    if (name === 'reference') this.reference.object.visible = on;
    else if (name === 'surfels') this.surfels.object.visible = on;
    else this.showWay();
    this.stage.ask();
  }

  showFan(fan, on) {
    if (on) this.hidden.delete(fan.number);
    else this.hidden.add(fan.number);
    this.clouds[fan.number].object.visible = on;
    this.stage.ask();
  }

  showWay() {
    dispose(this.way);
    dispose(this.axes);
    const { drive, variant, theme: colours } = this;
    const positions = way(drive, variant);
    this.way = this.shows.way ? wayLine(positions, colours.muted) : null;
    if (this.way) this.stage.lines.add(this.way);
    const [fan] = drive.fans;
    const isKnown = this.shows.axes && fan.counts.length > 0;
    this.axes = isKnown ? axes(drive.pose(variant, fan, 0), colours.axes) : null;
    if (this.axes) this.stage.lines.add(this.axes);
    this.stage.ask();
  }

  showOutline(corners) {
    dispose(this.outline);
    this.outline = outline(corners, this.theme.ink);
    this.stage.lines.add(this.outline);
    this.stage.ask();
  }

  /** Draws points as large as their usual spacing, within limits in pixels. */
  fitPoints() {
    const { renderer, camera } = this.stage;
    const ratio = renderer.getPixelRatio();
    const height = this.canvas.clientHeight * ratio;
    const size = (POINT_M * height) / (2 * Math.tan((camera.fov * Math.PI) / 360));
    for (const { material } of this.stage.clouds) {
      material.uniforms.size.value = size;
      material.uniforms.most.value = 7 * ratio;
    }
  }

  ranges() {
    return this.drive.fans
      .filter((fan) => !this.hidden.has(fan.number))
      .map((fan) => [fan.first, fan.first + fan.points]);
  }

  size() {
    return { width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  pickAt(x, y) {
    const positions = this.drive.positions(this.variant);
    this.select(pick(this.stage.camera, this.size(), positions, this.ranges(), x, y));
  }

  /** The position of a point on the canvas, CSS pixels. */
  placeOf(point) {
    return project(this.stage.camera, this.size(), this.drive.positions(this.variant).subarray(3 * point, 3 * point + 3));
  }

  /** Describes a point; −1 for none. */
  select(point) {
    this.point = point;
    dispose(this.mark);
    this.mark = null;
    if (point < 0) {
      this.picked.replaceChildren(el('p', { class: 'note' }, 'Click or tap a point to read its coordinates.'));
    } else {
      const known = this.drive.describe(this.variant, point);
      this.mark = cross(known.local, 0.02, this.theme.ink);
      this.stage.lines.add(this.mark);
      this.picked.replaceChildren(
        factList(facts(known)),
        button('Section through this point', () => this.section.goToPoint(known.local)),
        button('Look closer', () => this.navigation.goTo(known.local, Math.min(this.navigation.distance, 0.6))),
      );
    }
    this.stage.ask();
  }
}
