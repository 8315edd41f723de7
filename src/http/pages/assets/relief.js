// The relief of a height map: a surface in the picture's pixels, coloured by a layer of the viewer.
import { readMeans } from './heights.js';
import { Scene } from './scene.js';

const MOST_SAMPLES = 512;
const MOST_TEXTURE = 1100;

/** Positions (px to the right and up from the centre, heights in their unit), places in the picture, and triangles. */
export function surface({ width, height, side, full, values }, { offset, scale }) {
  const positions = new Float32Array(3 * width * height);
  const places = new Float32Array(2 * width * height);
  const indices = [];
  const known = values.map((value) => (Number.isNaN(value) ? NaN : offset + (value - 1) * scale));
  let [low, high] = [Infinity, -Infinity];
  for (const z of known) if (!Number.isNaN(z)) [low, high] = [Math.min(low, z), Math.max(high, z)];
  for (let row = 0, at = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1, at += 1) {
      const [x, y] = [Math.min(full[0], (column + 0.5) * side), Math.min(full[1], (row + 0.5) * side)];
      positions.set([x - full[0] / 2, full[1] / 2 - y, (known[at] || 0) - (low + high) / 2], 3 * at);
      places.set([x / full[0], y / full[1]], 2 * at);
      if (row + 1 === height || column + 1 === width) continue;
      const [a, b, c, d] = [at, at + 1, at + width, at + width + 1].map((corner) => (Number.isNaN(known[corner]) ? -1 : corner));
      if (a >= 0 && d >= 0 && c >= 0) indices.push(a, c, d);
      if (a >= 0 && d >= 0 && b >= 0) indices.push(a, d, b);
    }
  }
  return { positions, places, indices: Uint32Array.from(indices), low, high };
}

/** The middle of what is seen, and half of its width and height, px. */
function bounds({ positions, indices }) {
  const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
  for (const corner of indices) {
    for (const axis of [0, 1]) {
      const at = positions[3 * corner + axis];
      [low[axis], high[axis]] = [Math.min(low[axis], at), Math.max(high[axis], at)];
    }
  }
  return { middle: [0, 1].map((axis) => (low[axis] + high[axis]) / 2), half: [0, 1].map((axis) => (high[axis] - low[axis]) / 2) };
}

/** A layer of the viewer as one picture of at most `MOST_TEXTURE` px, made of its tiles. */
async function picture({ tiles, version, width, height }, tile) {
  const sizes = [[width, height]];
  while (Math.max(...sizes.at(-1)) > tile) sizes.push(sizes.at(-1).map((side) => Math.ceil(side / 2)));
  const level = Math.max(0, sizes.findIndex((size) => Math.max(...size) <= MOST_TEXTURE));
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = sizes[level];
  const paint = canvas.getContext('2d');
  const wanted = [];
  for (let y = 0; y * tile < canvas.height; y += 1) for (let x = 0; x * tile < canvas.width; x += 1) wanted.push([x, y]);
  await Promise.all(wanted.map(async ([x, y]) => {
    const image = new Image();
    image.src = `${tiles}/${level}/${x}/${y}?v=${version}`;
    await image.decode();
    paint.drawImage(image, x * tile, y * tile);
  }));
  return canvas;
}

/** Loads and shows the relief in `canvas` (`data-relief`). `layers` are those of the viewer, with tiles of `tile` px.
 *  Returns what sets the exaggeration and the layer that colours it. */
export async function relief(canvas, { layers, tile }, told) {
  const spec = JSON.parse(canvas.dataset.relief);
  const answer = await fetch(spec.url);
  if (!answer.ok) throw new Error('the heights cannot be loaded: reload the page to try again');
  const made = surface(await readMeans(answer.body, spec.invalid, MOST_SAMPLES), spec);
  const { low, high, ...mesh } = made;
  if (!mesh.indices.length) throw new Error('no height is known');
  const scene = new Scene(canvas);
  const { middle, half } = bounds(mesh);
  // a relief whose scale is unknown is a quarter as high as it is wide
  const perUnit = spec.mm_per_px ? 1 / spec.mm_per_px : Math.max(...half) / 2 / Math.max(high - low, 1e-9);
  scene.set('relief', { kind: 'mesh', ...mesh });
  scene.orbit.frame({ radius: Math.max(1, 1.1 * Math.hypot(...half)), target: [...middle, 0], yaw: -Math.PI / 2, pitch: 0.95 });
  return {
    stretch(factor) {
      scene.layers.get('relief').stretch = [1, 1, perUnit * factor];
      scene.draw();
      const words = [low, high].map((height) => height.toFixed(2).replace('-', '−')).join(' to ');
      const scale = spec.mm_per_px ? `Shown ${factor === 1 ? 'true to scale' : `${factor.toFixed(1)} times as high as they are`}.` : 'Their true scale is not known.';
      told.textContent = `Heights from ${words} ${spec.unit}. ${scale}${spec.is_near_unknown ? ' Which end is near is not known: below 0 they are turned around.' : ''}`;
    },
    async colour(layer) { scene.paintOn(scene.layers.get('relief'), await picture(layers[layer], tile)); },
  };
}
