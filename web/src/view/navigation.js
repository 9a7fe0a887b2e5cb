// Orbit, pan and zoom by mouse, touch and keyboard. The map's up is up on the screen.

/** Step of one key press: radians, share of the height, factor. */
const KEY_TURN = Math.PI / 36;
const KEY_PAN = 0.06;
const KEY_ZOOM = 1.15;
const MOST_PITCH = Math.PI / 2 - 1e-3;

export class Navigation {
  /**
   * Moves `camera` (of three.js) by pointer and keys on `canvas`. Calls `changed` after each change, and `clicked` for a
   * click or tap, with its position in CSS pixels of the canvas.
   */
  constructor(camera, canvas, { changed, clicked }) {
    Object.assign(this, { camera, canvas, changed, clicked });
    this.target = [0, 0, 0];
    this.yaw = 0;
    this.pitch = 0.6;
    this.distance = 10;
    this.pointers = new Map();
    this.wasMoved = false;
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(name, (event) => this.up(event));
    }
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  /** Looks at a sphere from the south and above. */
  frame(centre, radius, { yaw = 0, pitch = 0.75 } = {}) {
    const half = (this.camera.fov * Math.PI) / 360;
    const narrow = Math.min(1, this.camera.aspect);
    Object.assign(this, { target: [...centre], yaw, pitch, distance: radius / Math.sin(half) / narrow });
    this.home = { target: [...centre], yaw, pitch, distance: this.distance };
    this.update();
  }

  /** Back to the view of the last `frame`. */
  reset() {
    Object.assign(this, this.home, { target: [...this.home.target] });
    this.update();
  }

  /** From straight above, north up. */
  top() {
    Object.assign(this, { yaw: 0, pitch: MOST_PITCH });
    this.update();
  }

  /** Moves to a point without turning. */
  goTo(point, distance) {
    this.target = [...point];
    this.distance = distance;
    this.update();
  }

  update() {
    const { camera, target, yaw, pitch, distance } = this;
    const level = distance * Math.cos(pitch);
    camera.up.set(0, 0, 1);
    camera.position.set(
      target[0] + level * Math.sin(yaw),
      target[1] - level * Math.cos(yaw),
      target[2] + distance * Math.sin(pitch),
    );
    camera.lookAt(...target);
    camera.near = distance / 200;
    camera.far = distance * 20 + 1000;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    this.changed();
  }

  orbit(right, up) {
    this.yaw -= right;
    this.pitch = Math.min(Math.max(this.pitch + up, -MOST_PITCH), MOST_PITCH);
    this.update();
  }

  /** Shifts the view by shares of its height. */
  pan(right, up) {
    const reach = 2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360);
    const [a, b] = [this.camera.matrixWorld.elements.slice(0, 3), this.camera.matrixWorld.elements.slice(4, 7)];
    this.target = this.target.map((x, i) => x - reach * (right * a[i] - up * b[i]));
    this.update();
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance / factor, 0.02), 1e5);
    this.update();
  }

  down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    if (this.pointers.size === 0) this.wasMoved = false;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, start: [event.clientX, event.clientY] });
  }

  move(event) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    const height = this.canvas.clientHeight;
    const before = this.spread();
    const [dx, dy] = [event.clientX - pointer.x, event.clientY - pointer.y];
    Object.assign(pointer, { x: event.clientX, y: event.clientY });
    const way = Math.hypot(event.clientX - pointer.start[0], event.clientY - pointer.start[1]);
    this.wasMoved ||= way > 4 || this.pointers.size > 1;
    if (!this.wasMoved) return;
    if (this.pointers.size > 1) {
      const after = this.spread();
      if (before > 0 && after > 0) this.distance = Math.max(this.distance * (before / after), 0.02);
      this.pan(dx / height / this.pointers.size, dy / height / this.pointers.size);
    } else if (event.shiftKey || event.ctrlKey || event.buttons & 6) {
      this.pan(dx / height, dy / height);
    } else {
      this.orbit((dx / height) * Math.PI, (dy / height) * Math.PI);
    }
  }

  up(event) {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!pointer || this.wasMoved || event.type === 'pointercancel' || event.button !== 0) return;
    const box = this.canvas.getBoundingClientRect();
    this.clicked(event.clientX - box.left, event.clientY - box.top);
  }

  /** Distance between two fingers. */
  spread() {
    const [a, b] = [...this.pointers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  /** The wheel zooms if the view has the focus, and otherwise scrolls the page. */
  wheel(event) {
    if (document.activeElement !== this.canvas && !event.ctrlKey) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.zoom(Math.exp(-0.0015 * lines * event.deltaY));
  }

  key(event) {
    if (event.altKey || event.metaKey) return;
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const way = ways[event.key];
    if (way && event.shiftKey) this.pan(-KEY_PAN * way[0], KEY_PAN * way[1]);
    else if (way) this.orbit(KEY_TURN * way[0], KEY_TURN * way[1]);
    else if (event.key === '+' || event.key === '=') this.zoom(KEY_ZOOM);
    else if (event.key === '-' || event.key === '_') this.zoom(1 / KEY_ZOOM);
    else if (event.key === 'Home' || event.key === '0') this.reset();
    else if (event.key === 't') this.top();
    else if (event.key === 'Enter') this.clicked(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    else return;
    event.preventDefault();
  }
}
