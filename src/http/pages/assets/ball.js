// The ball of the views of a scan: where the camera was, and what became of each view. The grid and the table of the
// page have the same as text.
import { Scene, isAble } from './scene.js';

const RADIANS = Math.PI / 180;
/** Shape, colour and size of each state; shapes differ, so that colour never carries a state alone. */
const LOOKS = {
  done: ['disc', '--good', 13],
  look: ['diamond', '--usable', 17],
  failed: ['cross', '--poor', 17],
  busy: ['dot', '--blue', 15],
  missing: ['ring', '--soft', 15],
};

/** The direction of pan and tilt, degrees. */
export function direction(pan, tilt) {
  const [p, t] = [pan * RADIANS, tilt * RADIANS];
  return [Math.cos(t) * Math.cos(p), Math.cos(t) * Math.sin(p), Math.sin(t)];
}

/** A circle as pairs of points; `at` is its place from an angle, radians. */
export function circle(at, steps = 96) {
  const points = Array.from({ length: steps + 1 }, (_, k) => at((2 * Math.PI * k) / steps));
  return Float32Array.from(points.slice(1).flatMap((point, k) => [...points[k], ...point]));
}

/** The lines of the ball: meridians every 30 degrees, parallels every 30, and the plate of the turntable. */
function lattice() {
  const parallel = (tilt, radius = 1) => circle((angle) => {
    const [x, y, z] = direction(angle / RADIANS, tilt);
    return [x * radius, y * radius, radius === 1 ? z : -0.12];
  });
  const meridian = (pan) => circle((angle) => direction(pan, angle / RADIANS));
  const join = (parts) => Float32Array.from(parts.flatMap((part) => [...part]));
  return {
    lattice: join([...[-60, -30, 30, 60].map((tilt) => parallel(tilt)), ...[0, 30, 60, 90, 120, 150].map(meridian)]),
    plate: join([parallel(0), parallel(0, 0.3), Float32Array.of(0, 0, -0.12, 0, 0, 0.25)]),
  };
}

/** Shows the views of `box` (`data-ball` of an element in it) in the section of the ball, when the browser can. Returns
 *  what to call when the views may have changed. */
export function ball(box, { canvas, section, told }) {
  if (!canvas || !isAble()) return () => {};
  const link = told.querySelector('a');
  const hint = told.querySelector('span');
  const resting = hint.textContent;
  section.hidden = false;
  const scene = new Scene(canvas, {
    selected(mark) {
      link.textContent = mark ? mark.name : '';
      link.hidden = !mark?.href;
      if (mark?.href) link.href = mark.href;
      hint.textContent = mark ? `${mark.href ? '' : `${mark.name} `}${mark.words}` : resting;
      canvas.title = mark ? `${mark.name}, ${mark.words}` : '';
    },
    opened: (mark) => { if (mark.href) location.assign(mark.href); },
  });
  scene.fading = 0.75;
  const lines = lattice();
  scene.set('lattice', { kind: 'lines', positions: lines.lattice, colour: '--line' });
  scene.set('plate', { kind: 'lines', positions: lines.plate, colour: '--law' });
  scene.setLabels([0, 90, 180, 270].map((pan) => ({ text: `${pan}°`, position: direction(pan, -9).map((x) => 1.22 * x) })));
  scene.orbit.frame({ radius: 1.24, pitch: 0.5 });
  let last;
  const update = () => {
    const text = box.querySelector('[data-ball]')?.dataset.ball ?? '[]';
    if (text === last) return;
    last = text;
    const views = JSON.parse(text);
    section.hidden = views.length === 0;
    scene.setMarks(views.map(({ pan_deg: pan, tilt_deg: tilt, mark, ...view }) => {
      const [shape, colour, px] = LOOKS[mark];
      return { ...view, position: direction(pan, tilt), shape, colour, px };
    }));
  };
  update();
  return update;
}
