// Shows a picture of any size in a canvas: fetches the tiles in view at the resolution in view, and nothing else.
// A second picture can be shown at the right of the first, divided by a line.
import { Layer } from './tiles.js';

const MAX_SCALE = 16;

/** A viewer in `canvas` of pictures with tiles of `tile` px, of which it shows `first` at first. `moved` is called with
 *  the scale and, of each picture shown, whether what is in view of it is 'ready', 'loading' or 'failed'. */
export class Viewer {
  constructor(canvas, { tile, first, moved }) {
    this.canvas = canvas;
    this.moved = moved;
    this.behind = 'checks';
    this.divider = 0.5;
    this.waiting = false;
    this.tile = tile;
    // at the left and at the right of the divider: the layer, and what is drawn beneath it until it is there
    this.sides = [{}, {}];
    this.show(0, first);
    this.view = { x: 0, y: 0, scale: 1 };
    this.pointers = new Map();
    this.isFitted = true;
    new ResizeObserver(() => this.resize()).observe(canvas);
    for (const name of ['pointerdown', 'pointermove', 'pointerup', 'pointercancel', 'wheel', 'keydown', 'dblclick']) {
      canvas.addEventListener(name, (event) => this[name](event), { passive: false });
    }
  }

  get first() { return this.sides[0].layer; }

  get second() { return this.sides[1].layer; }

  /** Shows the picture `spec` at the left (0) or right (1) of the divider; null: nothing. With `stays`, what was there
   *  is seen until the new one is there. */
  show(side, spec, stays = false) {
    const { layer } = this.sides[side];
    this.sides[side] = { layer: spec && new Layer(spec, this.tile, () => this.draw()), before: stays ? layer : null };
    this.draw();
  }

  resize() {
    const dense = window.devicePixelRatio || 1;
    this.width = Math.max(1, Math.round(this.canvas.clientWidth * dense));
    this.height = Math.max(1, Math.round(this.canvas.clientHeight * dense));
    this.canvas.width = this.width;
    this.canvas.height = this.height;
    if (this.isFitted) this.fit(); else this.draw();
  }

  get fitting() { return Math.min(this.width / this.first.width, this.height / this.first.height); }

  /** Shows all of the picture. */
  fit() {
    const scale = this.fitting;
    const middle = (axis, side, size) => (side - size * scale) / 2 - this.first.at[axis] * scale;
    this.view = { scale, x: middle(0, this.width, this.first.width), y: middle(1, this.height, this.first.height) };
    this.isFitted = true;
    this.draw();
  }

  /** Changes the scale, keeping the point of the picture at (x, y) of the canvas in its place. */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const least = Math.min(this.fitting, 1) / 2;
    const scale = Math.max(least, Math.min(MAX_SCALE, this.view.scale * factor));
    const change = scale / this.view.scale;
    this.view = { scale, x: x - (x - this.view.x) * change, y: y - (y - this.view.y) * change };
    this.isFitted = false;
    this.hold();
  }

  pan(dx, dy) {
    this.view.x += dx;
    this.view.y += dy;
    this.isFitted = false;
    this.hold();
  }

  /** Keeps a part of the picture in view. */
  hold() {
    const keep = 60;
    const bound = (at, size, side) => Math.max(keep - size, Math.min(side - keep, at));
    this.view.x = bound(this.view.x, this.first.width * this.view.scale, this.width);
    this.view.y = bound(this.view.y, this.first.height * this.view.scale, this.height);
    this.draw();
  }

  draw() {
    if (this.waiting || !this.width) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.paint(); });
  }

  paint() {
    const { width, height } = this;
    const context = this.canvas.getContext('2d');
    context.clearRect(0, 0, width, height);
    const line = this.second ? Math.round(width * this.divider) : width;
    const states = [this.side(context, this.sides[0], 0, line)];
    if (this.second) {
      states.push(this.side(context, this.sides[1], line, width));
      context.fillStyle = '#fff';
      context.fillRect(line - 1, 0, 2, height);
    }
    // beneath all of it
    context.globalCompositeOperation = 'destination-over';
    this.backdrop(context);
    context.globalCompositeOperation = 'source-over';
    this.over?.(context);
    this.moved?.(this.view.scale / (window.devicePixelRatio || 1), states);
  }

  side(context, side, from, to) {
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, this.height);
    context.clip();
    const draw = (layer) => layer.draw(context, this.view, this.width, this.height);
    const state = draw(side.layer);
    if (state === 'ready') side.before = null;
    if (side.before) {
      draw(side.before);
      draw(side.layer);
    }
    context.restore();
    return state;
  }

  backdrop(context) {
    const { scale } = this.view;
    const [x, y] = [this.view.x + this.first.at[0] * scale, this.view.y + this.first.at[1] * scale];
    const edges = [x, y, x + this.first.width * scale, y + this.first.height * scale].map(Math.round);
    const area = [edges[0], edges[1], edges[2] - edges[0], edges[3] - edges[1]];
    const plain = { black: '#000', white: '#fff', grey: '#808080' }[this.behind];
    if (!plain && !this.checks) {
      const small = document.createElement('canvas');
      small.width = small.height = 24;
      const paint = small.getContext('2d');
      paint.fillStyle = '#d4d4d4';
      paint.fillRect(0, 0, 24, 24);
      paint.fillStyle = '#f4f4f4';
      paint.fillRect(0, 0, 12, 12);
      paint.fillRect(12, 12, 12, 12);
      this.checks = context.createPattern(small, 'repeat');
    }
    context.fillStyle = plain ?? this.checks;
    context.fillRect(...area);
  }

  at(event) {
    const dense = window.devicePixelRatio || 1;
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * dense, (event.clientY - box.top) * dense];
  }

  pointerdown(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.at(event));
    this.canvas.classList.add('held');
  }

  pointermove(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = this.at(event);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.pointers.set(event.pointerId, now);
    if (others.length === 0) {
      this.pan(now[0] - before[0], now[1] - before[1]);
    } else if (others.length === 1) {
      // two fingers
      const [other] = others;
      const distance = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
      this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
      if (distance(before) > 0) this.zoom(distance(now) / distance(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    }
  }

  pointerup(event) {
    this.pointers.delete(event.pointerId);
    if (this.pointers.size === 0) this.canvas.classList.remove('held');
  }

  pointercancel(event) { this.pointerup(event); }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-Math.max(-120, Math.min(120, event.deltaY)) * 0.0025), ...this.at(event));
  }

  dblclick(event) { this.zoom(2, ...this.at(event)); }

  keydown(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = Math.round(Math.min(this.width, this.height) / 8);
    const act = {
      ArrowLeft: () => this.pan(step, 0),
      ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step),
      ArrowDown: () => this.pan(0, -step),
      '+': () => this.zoom(1.5),
      '=': () => this.zoom(1.5),
      '-': () => this.zoom(1 / 1.5),
      0: () => this.fit(),
      1: () => this.full(),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  /** One pixel of the picture per pixel of the screen. */
  full() { this.zoom(1 / this.view.scale); }
}
