// Values and lengths in the viewer of a stack: colour and height at a point, a scale bar, the length between two points,
// and the colours of heights. The point is where the pointer is, or the middle of the view, for the keyboard.
import { readMeans } from './heights.js';
import { element } from './page.js';

const MOST_SAMPLES = 2048;
// as the server colours heights and slices (viridis)
const MAP = ['#440154', '#472c7a', '#3b518b', '#2c718e', '#21908d', '#27ad81', '#5cc863', '#aadc32', '#fde725'];

/** The longest of 1, 2 and 5 times a power of ten that is not above `most`. */
export function round(most) {
  const ten = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((one) => one * ten).find((length) => length <= most * (1 + 1e-9));
}

/** A length in px, and in mm or µm where the size of a pixel is known. */
export function length(px, mmPerPx) {
  const mm = px * mmPerPx;
  const known = mm >= 1 ? `${mm.toFixed(2)} mm` : `${(1000 * mm).toFixed(mm < 0.1 ? 1 : 0)} µm`;
  return mmPerPx ? `${px.toFixed(1)} px = ${known}` : `${px.toFixed(1)} px`;
}

/** Adds values and lengths to `viewer`. `spec` describes the heights (see `stack/relief.rs`), or is null. */
export function measure(viewer, { spec, mmPerPx, tools, told }) {
  const { canvas } = viewer;
  let [isOn, at, map] = [false, null, null];
  let points = [];
  // what the ends of the colours mean
  let ends = { depth: ['first slice', 'last slice'], height: ['lowest', 'highest'] };
  const button = element('button', { type: 'button', 'aria-pressed': 'false' }, 'Values and lengths');
  tools.append(button);
  const dense = () => window.devicePixelRatio || 1;
  const middle = () => [viewer.width / 2, viewer.height / 2];
  const inPicture = ([x, y]) => [(x - viewer.view.x) / viewer.view.scale, (y - viewer.view.y) / viewer.view.scale];
  const onCanvas = ([x, y]) => [x * viewer.view.scale + viewer.view.x, y * viewer.view.scale + viewer.view.y];

  const isDepth = spec?.url.endsWith('/depth');
  /** A value of the map in words; slices are counted from 0. */
  const words = (value) => {
    const shown = (spec.offset + (value - 1) * spec.scale).toFixed(spec.unit === 'mm' ? 3 : 1).replace('-', '−');
    return isDepth ? `slice ${Math.round(value)}` : `${shown} ${spec.unit}`;
  };
  const height = ([x, y]) => {
    const value = map?.values[Math.floor(y / map.side) * map.width + Math.floor(x / map.side)];
    if (value === undefined) return '';
    return Number.isNaN(value) ? ' · height unknown' : ` · ${isDepth ? 'sharpest in' : 'height'} ${words(value)}`;
  };

  const own = viewer.first.tiles.split('/tiles/')[0];
  const isOwn = (layer) => Boolean(layer?.tiles.startsWith(own));

  const tell = () => {
    const place = inPicture(at ?? middle());
    const isSecond = viewer.second && (at ?? middle())[0] > viewer.width * viewer.divider;
    const layer = isSecond ? viewer.second : viewer.first;
    const { width, height: rows, at: [left, top] } = layer;
    const isInside = place[0] >= left && place[1] >= top && place[0] < left + width && place[1] < top + rows;
    const rgba = isInside && layer.sample(place, viewer.view.scale);
    const colour = rgba ? ` · colour ${rgba.slice(0, 3).join(' ')}, alpha ${rgba[3]}` : '';
    const values = isInside ? `x ${Math.floor(place[0])}, y ${Math.floor(place[1])}${colour}${isOwn(layer) ? height(place) : ''}` : 'beside the picture';
    const [from, to = place] = points;
    const span = from ? ` · length ${length(Math.hypot(to[0] - from[0], to[1] - from[1]), mmPerPx)}` : '';
    told.textContent = isOn ? `${at ? '' : 'In the middle: '}${values}${span}` : '';
  };

  /** Sets the first point, then the second; a third begins anew. */
  const put = () => {
    points = points.length === 1 ? [points[0], inPicture(at ?? middle())] : [inPicture(at ?? middle())];
    viewer.draw();
  };

  button.addEventListener('click', async () => {
    isOn = !isOn;
    points = [];
    button.setAttribute('aria-pressed', String(isOn));
    viewer.draw();
    if (!isOn || map || !spec) return;
    told.textContent = 'Loading the heights …';
    try {
      map = await readMeans((await fetch(spec.url)).body, spec.invalid, MOST_SAMPLES);
      const known = map.values.filter((value) => !Number.isNaN(value));
      const [low, high] = known.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
      if (known.length) ends = { ...ends, [isDepth ? 'depth' : 'height']: [words(low), words(high)] };
    } catch { /* the other values remain */ }
    viewer.draw();
  });
  let pressed = null;
  canvas.addEventListener('pointerdown', (event) => { pressed = viewer.at(event); });
  canvas.addEventListener('pointermove', (event) => { if (isOn) { at = viewer.at(event); viewer.draw(); } });
  canvas.addEventListener('pointerleave', () => { at = null; if (isOn) viewer.draw(); });
  canvas.addEventListener('pointerup', (event) => {
    at = viewer.at(event);
    const isClick = pressed && Math.hypot(at[0] - pressed[0], at[1] - pressed[1]) < 5 * dense();
    if (isOn && isClick) put();
  });
  canvas.addEventListener('keydown', (event) => {
    if (!isOn || event.key !== 'm' || event.ctrlKey || event.metaKey || event.altKey) return;
    at = null;
    put();
  });

  /** Draws above the picture. */
  viewer.over = (context) => {
    const unit = dense();
    const { height: rows } = viewer;
    const stroke = (path, colour = '#fff') => {
      context.beginPath();
      path.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      for (const [wide, ink] of [[4, '#000'], [2, colour]]) {
        Object.assign(context, { lineWidth: wide * unit, strokeStyle: ink });
        context.stroke();
      }
    };
    const write = (text, x, y) => {
      Object.assign(context, { font: `${12 * unit}px system-ui, sans-serif`, lineWidth: 3 * unit, strokeStyle: '#000', fillStyle: '#fff' });
      context.strokeText(text, x, y);
      context.fillText(text, x, y);
    };
    if (mmPerPx) {
      const mm = round((viewer.width / 4 / viewer.view.scale) * mmPerPx);
      const [x, y] = [14 * unit, rows - 14 * unit];
      stroke([[x, y], [x + (mm / mmPerPx) * viewer.view.scale, y]]);
      write(mm >= 1 ? `${mm} mm` : `${+(1000 * mm).toPrecision(1)} µm`, x, y - 7 * unit);
    }
    const kinds = [viewer.first, viewer.second].filter(isOwn).map((layer) => layer.tiles.split('/').pop());
    const kind = kinds.find((one) => one === 'height' || one === 'depth');
    if (kind) legend(context, write, kind, unit);
    if (isOn) {
      const path = points.map(onCanvas);
      if (path.length) stroke(path.length === 2 ? path : [path[0], at ?? middle()], '#ffe14d');
      const [x, y] = at ?? middle();
      for (const [dx, dy] of [[9, 0], [0, 9]]) stroke([[x - dx * unit, y - dy * unit], [x + dx * unit, y + dy * unit]]);
    }
    tell();
  };

  const legend = (context, write, kind, unit) => {
    const [x, y, side] = [viewer.width - 26 * unit, (viewer.second ? 48 : 22) * unit, 110 * unit];
    const ramp = context.createLinearGradient(0, y + side, 0, y);
    MAP.forEach((colour, k) => ramp.addColorStop(k / (MAP.length - 1), colour));
    Object.assign(context, { fillStyle: ramp, textAlign: 'right' });
    context.fillRect(x, y, 14 * unit, side);
    write(ends[kind][1], x - 5 * unit, y + 10 * unit);
    write(ends[kind][0], x - 5 * unit, y + side);
    context.textAlign = 'left';
  };
  viewer.draw();
}
