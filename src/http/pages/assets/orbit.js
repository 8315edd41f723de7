// A camera that a person turns around a point: by mouse, by touch (one finger turns, two zoom and move), by wheel, and
// by keyboard. z is up.
import { add, looking, perspective, product, scaled } from './matrix.js';

const ANGLE = 0.6;
const STEP = Math.PI / 18;
const CLICK_PX = 5;

/** The camera of a canvas. `changed` is called after every move, `clicked` with a place (CSS px) and the event. */
export class Orbit {
  constructor(canvas, { changed, clicked, hovered }) {
    Object.assign(this, { canvas, changed, clicked, hovered });
    this.pointers = new Map();
    this.home = { yaw: -Math.PI / 3, pitch: 0.45, radius: 1, target: [0, 0, 0] };
    this.reset();
    for (const name of ['pointerdown', 'pointermove', 'pointerup', 'pointercancel', 'pointerleave', 'wheel', 'keydown', 'contextmenu']) {
      canvas.addEventListener(name, (event) => this[name](event), { passive: false });
    }
  }

  /** Shows a sphere around `target`, seen from `yaw` and `pitch` (radians). */
  frame(home) {
    Object.assign(this.home, home);
    this.reset();
  }

  reset() {
    const { yaw, pitch, target } = this.home;
    Object.assign(this, { yaw, pitch, target, zoomed: 1 });
    this.changed();
  }

  /** Distance of the camera at which the sphere fits. */
  get distance() {
    const { clientWidth, clientHeight } = this.canvas;
    const narrow = Math.min(1, clientWidth / (clientHeight || 1)) || 1;
    return this.home.radius / Math.sin(Math.atan(Math.tan(ANGLE / 2) * narrow)) / this.zoomed;
  }

  /** Right, up and back of the camera. */
  get axes() {
    const [sy, cy, sp, cp] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [cp * cy, cp * sy, sp]];
  }

  /** The place of the camera. */
  get eye() { return add(this.target, scaled(this.axes[2], this.distance)); }

  /** World to clip space. */
  matrix(aspect) {
    const { distance } = this;
    const reach = 4 * this.home.radius;
    const lens = perspective(ANGLE, aspect, Math.max(distance / 50, distance - reach), distance + reach);
    return product(lens, looking(this.axes, this.eye));
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.pitch + pitch));
    this.changed();
  }

  zoom(factor) {
    this.zoomed = Math.max(0.2, Math.min(40, this.zoomed * factor));
    this.changed();
  }

  /** Moves what is seen by this many CSS px. */
  move(dx, dy) {
    const unit = (2 * this.distance * Math.tan(ANGLE / 2)) / (this.canvas.clientHeight || 1);
    const [right, up] = this.axes;
    this.target = add(this.target, add(scaled(right, -dx * unit), scaled(up, dy * unit)));
    this.changed();
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  pointerdown(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.at(event));
    // a click is one pointer that hardly moved
    this.pressed = this.pointers.size === 1 ? this.at(event) : null;
    this.canvas.classList.add('held');
  }

  pointermove(event) {
    const before = this.pointers.get(event.pointerId);
    const now = this.at(event);
    if (!before) return this.hovered?.(now);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.pointers.set(event.pointerId, now);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (this.pressed && Math.hypot(now[0] - this.pressed[0], now[1] - this.pressed[1]) > CLICK_PX) this.pressed = null;
    if (others.length === 1) {
      const distance = (a) => Math.hypot(a[0] - others[0][0], a[1] - others[0][1]);
      if (distance(before) > 0) this.zoom(distance(now) / distance(before));
      this.move(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      this.move(dx, dy);
    } else if (!this.pressed) {
      this.turn(-dx * 0.008, dy * 0.008);
    }
    return undefined;
  }

  pointerup(event) {
    const isClick = this.pressed && this.pointers.delete(event.pointerId);
    this.pointercancel(event);
    if (isClick && event.button === 0) this.clicked?.(this.at(event), event);
  }

  pointercancel(event) {
    this.pointers.delete(event.pointerId);
    this.pressed = null;
    if (this.pointers.size === 0) this.canvas.classList.remove('held');
  }

  pointerleave() { this.hovered?.(null); }

  wheel(event) {
    // who scrolls the page across the picture does not want to zoom it
    if (document.activeElement !== this.canvas && !event.ctrlKey) return;
    event.preventDefault();
    this.zoom(Math.exp(-Math.max(-120, Math.min(120, event.deltaY)) * 0.002));
  }

  contextmenu(event) { event.preventDefault(); }

  keydown(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const go = (x, y) => (event.shiftKey ? this.move(-40 * x, -40 * y) : this.turn(STEP * x, -STEP * y));
    const act = {
      ArrowLeft: () => go(-1, 0),
      ArrowRight: () => go(1, 0),
      ArrowUp: () => go(0, -1),
      ArrowDown: () => go(0, 1),
      '+': () => this.zoom(1.25),
      '=': () => this.zoom(1.25),
      '-': () => this.zoom(1 / 1.25),
      0: () => this.reset(),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}
