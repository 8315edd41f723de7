// Shows a picture of any size in a canvas: fetches the tiles in view at the resolution in view, and nothing else.
// A second layer can be shown beside the first, divided by a line.

const MAX_TILES = 256;
const MAX_SCALE = 16;

class Layer {
  constructor(spec, tile, redraw) {
    Object.assign(this, spec);
    this.tile = tile;
    this.redraw = redraw;
    this.kept = new Map();
    this.levels = [[this.width, this.height]];
    while (Math.max(...this.levels.at(-1)) > tile) {
      this.levels.push(this.levels.at(-1).map((side) => Math.ceil(side / 2)));
    }
  }

  /** The picture of a tile, which is fetched if it is not there yet. */
  get(level, x, y) {
    const key = `${level}/${x}/${y}`;
    let image = this.kept.get(key);
    if (image) {
      this.kept.delete(key);
    } else {
      image = new Image();
      image.onload = () => this.redraw();
      image.onerror = () => { image.failed = true; this.redraw(); };
      image.src = `${this.tiles}/${key}?v=${this.version}`;
    }
    this.kept.set(key, image);
    while (this.kept.size > MAX_TILES) this.kept.delete(this.kept.keys().next().value);
    return image;
  }

  /** Red, green, blue and alpha at a point of the picture, as far as its tile is there; null otherwise. */
  sample([x, y], scale) {
    const coarsest = this.levels.length - 1;
    const wanted = Math.max(0, Math.min(coarsest, Math.floor(Math.log2(1 / scale) + 0.01)));
    const [columns, rows] = this.levels[wanted];
    const [column, row] = [Math.floor((x * columns) / this.width), Math.floor((y * rows) / this.height)];
    const image = this.kept.get(`${wanted}/${Math.floor(column / this.tile)}/${Math.floor(row / this.tile)}`);
    if (!image?.complete || !image.naturalWidth) return null;
    this.dot ??= new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    this.dot.clearRect(0, 0, 1, 1);
    this.dot.drawImage(image, column % this.tile, row % this.tile, 1, 1, 0, 0, 1, 1);
    return [...this.dot.getImageData(0, 0, 1, 1).data];
  }

  /** Draws the part of the layer that is in view. Returns whether it is there: 'ready', 'loading' or 'failed'. */
  draw(context, view, width, height) {
    let state = 'ready';
    const coarsest = this.levels.length - 1;
    const wanted = Math.max(0, Math.min(coarsest, Math.floor(Math.log2(1 / view.scale) + 0.01)));
    context.imageSmoothingEnabled = view.scale < 2 && view.scale !== 1;
    // coarse levels first: they show through until the finer tiles have arrived
    for (const level of wanted === coarsest ? [coarsest] : [coarsest, wanted]) {
      const [columns, rows] = this.levels[level];
      const factor = [this.width / columns, this.height / rows];
      const from = [-view.x / view.scale, -view.y / view.scale];
      const to = [(width - view.x) / view.scale, (height - view.y) / view.scale];
      const range = (axis, side) => [
        Math.max(0, Math.floor(from[axis] / factor[axis] / this.tile)),
        Math.min(Math.ceil(side / this.tile) - 1, Math.floor(to[axis] / factor[axis] / this.tile)),
      ];
      const [firstColumn, lastColumn] = range(0, columns);
      const [firstRow, lastRow] = range(1, rows);
      for (let y = firstRow; y <= lastRow; y += 1) {
        for (let x = firstColumn; x <= lastColumn; x += 1) {
          const image = this.get(level, x, y);
          if (!image.complete || image.naturalWidth === 0) {
            if (state !== 'failed') state = image.failed ? 'failed' : 'loading';
            continue;
          }
          // edges at whole pixels of the screen: tiles meet without a seam, and 1 : 1 shows the pixels unchanged
          const edge = (axis, at) => Math.round((axis ? view.y : view.x) + at * factor[axis] * view.scale);
          const [left, top] = [edge(0, x * this.tile), edge(1, y * this.tile)];
          const [right, bottom] = [edge(0, x * this.tile + image.naturalWidth), edge(1, y * this.tile + image.naturalHeight)];
          const area = [left, top, right - left, bottom - top];
          if (level === wanted && wanted !== coarsest) context.clearRect(...area);
          context.drawImage(image, ...area);
        }
      }
      // the server prepares a picture when a part of it is first asked for: one request waits for that, and not all
      // that the browser can send at a time
      if (state !== 'ready') break;
    }
    return state;
  }
}

/** A viewer in `canvas`. `options`: tile, layers, and `moved`, which is called with the scale and with
 *  whether what is in view is 'ready', 'loading' or 'failed'. */
export class Viewer {
  constructor(canvas, { tile, layers, moved }) {
    this.canvas = canvas;
    this.moved = moved;
    this.behind = 'checks';
    this.divider = 0.5;
    this.waiting = false;
    this.layers = layers.map((spec) => new Layer(spec, tile, () => this.draw()));
    this.first = this.layers[0];
    this.second = null;
    this.view = { x: 0, y: 0, scale: 1 };
    this.pointers = new Map();
    this.isFitted = true;
    new ResizeObserver(() => this.resize()).observe(canvas);
    for (const name of ['pointerdown', 'pointermove', 'pointerup', 'pointercancel', 'wheel', 'keydown', 'dblclick']) {
      canvas.addEventListener(name, (event) => this[name](event), { passive: false });
    }
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
    this.view = { scale, x: (this.width - this.first.width * scale) / 2, y: (this.height - this.first.height * scale) / 2 };
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
    const states = [this.side(context, this.first, 0, line)];
    if (this.second) {
      states.push(this.side(context, this.second, line, width));
      context.fillStyle = '#fff';
      context.fillRect(line - 1, 0, 2, height);
    }
    // beneath all of it
    context.globalCompositeOperation = 'destination-over';
    this.backdrop(context);
    context.globalCompositeOperation = 'source-over';
    this.over?.(context);
    const state = ['failed', 'loading'].find((one) => states.includes(one)) ?? 'ready';
    this.moved?.(this.view.scale / (window.devicePixelRatio || 1), state);
  }

  side(context, layer, from, to) {
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, this.height);
    context.clip();
    const state = layer.draw(context, this.view, this.width, this.height);
    context.restore();
    return state;
  }

  backdrop(context) {
    const { x, y, scale } = this.view;
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
