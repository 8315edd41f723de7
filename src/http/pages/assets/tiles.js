// Pictures in tiles: which tiles of which resolution a view needs, and those that were fetched.

/** Tiles that are kept, of all pictures together. */
const MOST_TILES = 512;

/** The sizes of a picture at each of its resolutions, the finest first: the coarsest fits into one tile. */
export function levels(width, height, tile) {
  const all = [[width, height]];
  while (Math.max(...all.at(-1)) > tile) all.push(all.at(-1).map((side) => Math.ceil(side / 2)));
  return all;
}

/** A list of what was used last, which forgets what was used longest ago. */
export class Recent extends Map {
  constructor(most) {
    super();
    this.most = most;
  }

  /** What is there under the key, or what `make` returns. */
  use(key, make) {
    const found = this.get(key) ?? make();
    this.delete(key);
    this.set(key, found);
    if (this.size > this.most) this.delete(this.keys().next().value);
    return found;
  }
}

const kept = new Recent(MOST_TILES);

/** A picture. `spec`: URL of its tiles, their version, width, height, and its place in the first picture. */
export class Layer {
  constructor(spec, tile, redraw) {
    Object.assign(this, { at: [0, 0], ...spec, tile, redraw });
    this.levels = levels(this.width, this.height, tile);
  }

  url(level, x, y) { return `${this.tiles}/${level}/${x}/${y}?v=${this.version}`; }

  /** The number of the resolution that a scale needs. */
  level(scale) { return Math.max(0, Math.min(this.levels.length - 1, Math.floor(Math.log2(1 / scale) + 0.01))); }

  /** The picture of a tile, which is fetched if it is not there yet. */
  get(level, x, y) {
    const url = this.url(level, x, y);
    return kept.use(url, () => {
      const image = new Image();
      image.onload = () => this.redraw();
      image.onerror = () => { image.failed = true; this.redraw(); };
      image.src = url;
      return image;
    });
  }

  /** Red, green, blue and alpha at a point of the first picture, as far as the tile is there; null otherwise. */
  sample([x, y], scale) {
    const wanted = this.level(scale);
    const [columns, rows] = this.levels[wanted];
    const [column, row] = [Math.floor(((x - this.at[0]) * columns) / this.width), Math.floor(((y - this.at[1]) * rows) / this.height)];
    const image = kept.get(this.url(wanted, Math.floor(column / this.tile), Math.floor(row / this.tile)));
    if (!image?.complete || !image.naturalWidth) return null;
    this.dot ??= new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    this.dot.clearRect(0, 0, 1, 1);
    this.dot.drawImage(image, column % this.tile, row % this.tile, 1, 1, 0, 0, 1, 1);
    return [...this.dot.getImageData(0, 0, 1, 1).data];
  }

  /** Draws the part of the layer that is in view. Returns whether it is there: 'ready', 'loading' or 'failed'. */
  draw(context, { scale, ...corner }, width, height) {
    let state = 'ready';
    const view = { scale, x: corner.x + this.at[0] * scale, y: corner.y + this.at[1] * scale };
    const coarsest = this.levels.length - 1;
    const wanted = this.level(scale);
    context.imageSmoothingEnabled = scale < 2 && scale !== 1;
    // coarse levels first: they show through until the finer tiles have arrived
    for (const level of wanted === coarsest ? [coarsest] : [coarsest, wanted]) {
      const [columns, rows] = this.levels[level];
      const factor = [this.width / columns, this.height / rows];
      const from = [-view.x / scale, -view.y / scale];
      const to = [(width - view.x) / scale, (height - view.y) / scale];
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
          const edge = (axis, at) => Math.round((axis ? view.y : view.x) + at * factor[axis] * scale);
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
