// The platform along the drive, if its mountings move: time, play, and the exaggeration of the motion.

import { offset } from '../data/transform.js';
import { fixed, seconds } from '../text.js';
import { dispose, nearestProfile, platform } from '../view/lines.js';
import { button, choice, el, slider } from './dom.js';

const FACTORS = [1, 3, 10, 30, 100];
/** Speed of playing, seconds of the drive per second. */
const SPEED = 8;

export class Player {
  constructor(app) {
    this.app = app;
    this.factor = 10;
    this.isPlaying = false;
    this.element = el('div', { class: 'scene-controls', hidden: true, role: 'group', 'aria-label': 'The platform along the drive' });
  }

  setDrive(drive) {
    this.stop();
    this.drive = drive;
    this.variant = drive.variants.findLastIndex((_, number) => drive.moves(number));
    this.element.hidden = this.variant < 0;
    this.place(null);
    if (this.variant < 0) return;
    [this.fromS, this.toS] = drive.spanS;
    this.time = slider('Time', { min: 0, max: this.toS - this.fromS, step: 'any', value: 0, text: seconds }, () => this.show());
    this.offsets = el('span', { class: 'scene-note' });
    this.press = button('Play', () => (this.isPlaying ? this.stop() : this.play()));
    this.element.replaceChildren(
      this.press,
      this.time,
      choice('Motion of the mountings', FACTORS.map((x) => [x, `× ${x}`]), this.factor, (x) => { this.factor = x; this.show(); }),
      this.offsets,
    );
    this.show();
  }

  /** Shows the platform at the time of the slider. */
  show() {
    if (this.variant < 0) return;
    this.place(platform(this.drive, this.variant, this.fromS + this.time.get(), this.factor, this.app.theme));
    this.offsets.textContent = `Offsets from the mean mountings (grey axes): ${this.offsetsAt(this.fromS + this.time.get())}`;
    this.app.stage.move();
  }

  /** Offset of each mounting from its mean at a time, as text. */
  offsetsAt(timeS) {
    const { drive, variant } = this;
    const one = (fan) => {
      const mounting = drive.mounting(variant, fan, nearestProfile(drive, fan, timeS));
      const { shift, turn } = offset(mounting, drive.variants[variant].mountings[fan.number]);
      return `${fan.name} ${fixed(1e3 * shift, 1)} mm, ${fixed((180 / Math.PI) * turn, 2)}°`;
    };
    return drive.fans.filter((fan) => fan.counts.length > 0).map(one).join('; ');
  }

  place(glyph) {
    dispose(this.glyph);
    this.glyph = glyph;
    if (glyph) this.app.stage.lines.add(glyph);
  }

  play() {
    this.isPlaying = true;
    this.press.textContent = 'Pause';
    if (this.time.get() >= this.toS - this.fromS - 0.1) this.time.set(0);
    let last = performance.now();
    const step = (now) => {
      if (!this.isPlaying) return;
      const next = this.time.get() + (SPEED * (now - last)) / 1000;
      last = now;
      this.time.set(next);
      this.show();
      if (next >= this.toS - this.fromS) this.stop();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  stop() {
    this.isPlaying = false;
    if (this.press) this.press.textContent = 'Play';
  }
}
