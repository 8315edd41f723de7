// The model of a reconstruction: points, cameras, the circle of the turntable, and a surface. The canvas names the files:
// `data-points` (PLY), `data-cameras` (JSON), `data-hull` and `data-mesh` (GLB or PLY), each optional.
import { circle } from './ball.js';
import { parseGlb } from './glb.js';
import { add, cross, dot, scaled, subtract, unit, upright } from './matrix.js';
import { link } from './page.js';
import { parsePly } from './ply.js';
import { Scene, isAble } from './scene.js';

/** Place and size of most of the points: medians and the 95th percentile of the distances from them. */
export function extent(positions) {
  const step = 3 * Math.max(1, Math.floor(positions.length / 3 / 20000));
  const of = (axis) => { const out = []; for (let at = axis; at < positions.length; at += step) out.push(positions[at]); return out; };
  const axes = [0, 1, 2].map((axis) => of(axis));
  const centre = axes.map((values) => Float64Array.from(values).sort()[values.length >> 1] ?? 0);
  const distances = axes[0].map((_, k) => Math.hypot(...axes.map((values, axis) => values[k] - centre[axis])));
  return { centre, radius: Float64Array.from(distances).sort()[Math.floor(distances.length * 0.95)] || 1 };
}

/** The edges of a camera as pairs of points: from its centre to the corners of the picture, `depth` away. */
export function frustum({ center, rotation: r, width, height, focal_px: focal, principal_point: [px, py] }, depth) {
  const corner = (x, y) => {
    const ray = [((x - px) / focal) * depth, ((y - py) / focal) * depth, depth];
    return add(center, [0, 1, 2].map((column) => r[column] * ray[0] + r[3 + column] * ray[1] + r[6 + column] * ray[2]));
  };
  const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
  return corners.flatMap((at, k) => [...center, ...at, ...at, ...corners[(k + 1) % 4]]);
}

/** Which way is up: the axis of the turntable, on the side to which the cameras' pictures have their upper edges. */
export function upward(cameras, turntable) {
  const tops = cameras.reduce((sum, { rotation }) => subtract(sum, rotation.slice(3, 6)), [0, 0, 0]);
  if (!turntable) return Math.hypot(...tops) > 1e-6 ? unit(tops) : [0, 0, 1];
  return dot(tops, turntable.axis) < 0 ? scaled(turntable.axis, -1) : turntable.axis;
}

async function loaded(url, read) {
  if (!url) return null;
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`a file of the model cannot be loaded (${answer.status}): reload the page to try again`);
  return read(await answer.arrayBuffer());
}

const isGlb = (buffer) => new DataView(buffer).getUint32(0, true) === 0x46546c67;

/** Shows the model of `box`, which has the canvas, the toggles and the line below. */
async function show(box) {
  const [canvas, told] = ['canvas', '[role=status]'].map((one) => box.querySelector(one));
  const [anchor, hint] = ['a', 'span'].map((one) => told.querySelector(one));
  const say = (text) => { hint.textContent = text; };
  const { points, cameras, hull, mesh } = canvas.dataset;
  const surface = (buffer) => (isGlb(buffer) ? parseGlb(buffer) : parsePly(buffer));
  const [cloud, poses, shell, body] = await Promise.all([
    loaded(points, parsePly),
    loaded(cameras, (buffer) => JSON.parse(new TextDecoder().decode(buffer))),
    loaded(hull, surface),
    loaded(mesh, surface),
  ]);
  const seen = (poses?.cameras ?? []).filter(({ registered, center }) => registered && center);
  const turntable = poses?.turntable;
  const solid = (shell ?? body ?? cloud)?.positions ?? Float32Array.from(seen.flatMap(({ center }) => center));
  const { centre, radius } = extent(solid);
  const turn = upright(upward(seen, turntable));
  const place = (at) => turn(subtract(at, centre));
  const placed = (positions) => {
    for (let at = 0; at < positions.length; at += 3) positions.set(place([positions[at], positions[at + 1], positions[at + 2]]), at);
    return positions;
  };
  const count = cloud ? cloud.positions.length / 3 : 0;
  const parts = [cloud && `${count.toLocaleString('en')} points`, poses && `${seen.length} of ${poses.cameras.length} cameras`];
  const resting = `${parts.filter(Boolean).join(', ')}. Point at a camera to see its name; click to open its stack.`;
  const scene = new Scene(canvas, {
    selected(mark) {
      Object.assign(anchor, { textContent: mark?.name ?? '', hidden: !mark?.href });
      if (mark?.href) anchor.href = mark.href;
      say(mark ? (mark.href ? '' : mark.name) : resting);
      canvas.title = mark?.name ?? '';
    },
    opened: ({ href }) => { if (href) location.assign(href); },
  });
  if (cloud) {
    const { positions, colours } = cloud;
    scene.set('points', { kind: 'points', positions: placed(positions), colours, size: (radius * 2.2) / Math.sqrt(Math.max(count, 2000)) });
  }
  for (const [name, file] of [['hull', shell], ['mesh', body]].filter(([, file]) => file?.indices)) {
    const normals = file.normals?.slice();
    for (let at = 0; normals && at < normals.length; at += 3) normals.set(turn(normals.slice(at, at + 3)), at);
    scene.set(name, { kind: 'mesh', ...file, positions: placed(file.positions), normals });
  }
  if (turntable) {
    const x = unit(cross(turntable.axis, Math.abs(unit(turntable.axis)[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    const y = cross(unit(turntable.axis), x);
    const on = (angle) => place(add(turntable.center, add(scaled(x, Math.cos(angle) * turntable.radius), scaled(y, Math.sin(angle) * turntable.radius))));
    scene.set('turntable', { kind: 'lines', positions: circle(on), colour: '--warm' });
  }
  const depth = Math.max(...seen.map(({ center }) => Math.hypot(...subtract(center, centre))), radius) * 0.09;
  const lines = placed(Float32Array.from(seen.flatMap((camera) => frustum(camera, depth))));
  scene.set('cameras', { kind: 'lines', positions: lines, colour: '--blue' });
  const marks = seen.map(({ name, stack, center }) => {
    const href = stack ? link(`/stacks/${encodeURIComponent(String(stack).split('/').pop())}`) : undefined;
    return { name, href, position: place(center), shape: 'disc', colour: '--blue', px: 9 };
  });
  scene.setMarks(marks);
  const views = { all: Math.max(radius * 1.2, depth * 13), object: radius * 1.4 };
  const look = (which) => scene.orbit.frame({ radius: views[which] });
  look(seen.length ? 'all' : 'object');
  for (const box_ of box.querySelectorAll('input[type=checkbox]')) {
    box_.disabled = !scene.layers.has(box_.name);
    box_.checked &&= !box_.disabled;
    box_.addEventListener('input', () => {
      if (box_.name === 'cameras') marks.forEach((mark) => { mark.isHidden = !box_.checked; });
      scene.show(box_.name, box_.checked);
    });
    scene.show(box_.name, box_.checked);
  }
  for (const button of box.querySelectorAll('[data-look]')) button.addEventListener('click', () => look(button.dataset.look));
  say(resting);
}

for (const box of globalThis.document?.querySelectorAll('.model') ?? []) {
  if (!isAble()) continue;
  box.hidden = false;
  show(box).catch((error) => { box.querySelector('[role=status] span').textContent = error.message; });
}
