// The canvas: draws only when something changed, and fewer points in motion.

import { Color, ColorManagement, LinearSRGBColorSpace, PerspectiveCamera, Scene, WebGLRenderer } from 'three';
import { Shading } from './shading.js';

/** Number of points drawn while the view moves: at first, and the bounds within which it adapts to the frame time. */
const WHILE_MOVING = 150_000;
const BOUNDS = [20_000, 2_000_000];
/** Frame times between which this number stays, and the time from the last motion until all points are drawn, milliseconds. */
const FRAME_MS = [20, 45];
const SETTLES_MS = 160;

// Colours are those of the page, without conversion.
ColorManagement.enabled = false;

/** Whether the browser has WebGL 2. */
export function hasWebGl() {
  try {
    return document.createElement('canvas').getContext('webgl2') !== null;
  } catch {
    return false;
  }
}

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: false, powerPreference: 'default' });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.shading = new Shading();
    this.scene = new Scene();
    this.scene.background = new Color();
    /** Lines and marks, which neither hide behind points nor shade them. */
    this.lines = new Scene();
    this.camera = new PerspectiveCamera(40, 1, 0.01, 1000);
    /** Objects whose points can be thinned: with `thin(share)` and `points`. */
    this.clouds = [];
    this.frames = 0;
    this.isAsked = false;
    this.settles = 0;
    this.whileMoving = WHILE_MOVING;
    this.lastMotion = -Infinity;
    this.before = () => {};
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener('webglcontextrestored', () => this.ask());
    this.resize();
  }

  ground(colour) {
    this.scene.background.set(colour);
    this.ask();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.shading.resize(this.renderer);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  /** Draws in the next frame. */
  ask() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.draw();
    });
  }

  /** Draws fewer points in the next frame, and all of them once nothing moves. */
  move() {
    const points = this.clouds.reduce((sum, cloud) => sum + cloud.points, 0);
    this.thin(Math.min(1, this.whileMoving / Math.max(points, 1)));
    this.isMoving = true;
    this.ask();
    clearTimeout(this.settles);
  }

  /** Draws all points after a while, unless something moves before. */
  settle() {
    clearTimeout(this.settles);
    this.settles = setTimeout(() => {
      this.isMoving = false;
      this.lastMotion = -Infinity;
      this.thin(1);
      this.ask();
    }, SETTLES_MS);
  }

  /** Draws fewer points if frames are slow, more if they are fast. */
  adapt() {
    const now = performance.now();
    const took = now - this.lastMotion;
    this.lastMotion = now;
    if (took > 2000) return;
    const [fast, slow] = FRAME_MS;
    const factor = took > slow ? Math.max(0.5, slow / took) : took < fast ? 1.2 : 1;
    this.whileMoving = Math.min(Math.max(this.whileMoving * factor, BOUNDS[0]), BOUNDS[1]);
  }

  thin(share) {
    this.clouds.forEach((cloud) => cloud.thin(share));
  }

  draw() {
    if (this.isMoving) this.adapt();
    this.before();
    this.shading.render(this.renderer, this.scene, this.camera);
    this.renderer.autoClear = false;
    this.renderer.clearDepth();
    this.renderer.render(this.lines, this.camera);
    this.renderer.autoClear = true;
    this.frames++;
    if (this.isMoving) this.settle();
  }
}
