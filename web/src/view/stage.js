// The canvas: draws when something changed, and fewer points while it moves.

import { Color, ColorManagement, LinearSRGBColorSpace, PerspectiveCamera, Scene, WebGLRenderer } from 'three';

/** Points drawn while the view moves, and how long after the last motion all are drawn again, milliseconds. */
const WHILE_MOVING = 150_000;
const SETTLES_MS = 160;

// Colours are those of the page, as they are.
ColorManagement.enabled = false;

/** Whether the browser can draw in three dimensions as this needs it. */
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
    this.scene = new Scene();
    this.scene.background = new Color();
    this.camera = new PerspectiveCamera(40, 1, 0.01, 1000);
    /** What has points to thin: `thin(share)` and `points`. */
    this.clouds = [];
    this.frames = 0;
    this.isAsked = false;
    this.settles = 0;
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
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  /** Draws with the next frame. */
  ask() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.draw();
    });
  }

  /** Draws with the next frame with fewer points, and all of them once nothing moves. */
  move() {
    const points = this.clouds.reduce((sum, cloud) => sum + cloud.points, 0);
    const share = Math.min(1, WHILE_MOVING / Math.max(points, 1));
    this.thin(share);
    this.ask();
    clearTimeout(this.settles);
    this.settles = setTimeout(() => {
      this.thin(1);
      this.ask();
    }, SETTLES_MS);
  }

  thin(share) {
    this.clouds.forEach((cloud) => cloud.thin(share));
  }

  draw() {
    this.before();
    this.renderer.render(this.scene, this.camera);
    this.frames++;
  }
}
