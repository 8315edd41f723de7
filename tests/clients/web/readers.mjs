// The readers of models and height maps, and the geometry of the scenes, without a browser. Usage: node readers.mjs
import assert from 'node:assert/strict';
import { deflateSync } from 'node:zlib';

const module = (name) => import(new URL(`../../../src/http/pages/assets/${name}`, import.meta.url));
const near = (a, b, about) => [...a].forEach((value, k) => assert.ok(Math.abs(value - b[k]) < 1e-5, `${about}: ${[...a]} and ${b}`));

/** A PLY file of vertices, each as bytes, and faces of three corners. */
function ply(properties, vertices, faces = []) {
  const list = faces.length ? `element face ${faces.length}\nproperty list uchar int vertex_indices\n` : '';
  const head = `ply\nformat binary_little_endian 1.0\ncomment made by a test\nelement vertex ${vertices.length}\n`
    + `${properties.map((one) => `property ${one}\n`).join('')}${list}end_header\n`;
  const corners = faces.map((face) => Buffer.concat([Buffer.from([face.length]), Buffer.from(Int32Array.from(face).buffer)]));
  const all = Buffer.concat([Buffer.from(head), ...vertices, ...corners]);
  return all.buffer.slice(all.byteOffset, all.byteOffset + all.length);
}

const COLOURED = ['float x', 'float y', 'float z', 'uchar red', 'uchar green', 'uchar blue'];
const point = (at, colour) => Buffer.concat([Buffer.from(Float32Array.from(at).buffer), Buffer.from(colour)]);

const { parsePly } = await module('ply.js');
{
  const count = 1000;
  const cloud = parsePly(ply(COLOURED, Array.from({ length: count }, (_, k) => point([k, 2 * k, -k], [k % 256, 7, 9]))));
  assert.equal(cloud.positions.length, 3 * count);
  assert.equal(cloud.indices, undefined);
  const first = [];
  for (let k = 0; k < count; k += 1) {
    const x = cloud.positions[3 * k];
    near(cloud.positions.slice(3 * k, 3 * k + 3), [x, 2 * x, -x], 'a point');
    assert.deepEqual([...cloud.colours.slice(4 * k, 4 * k + 4)], [x % 256, 7, 9, 255]);
    first.push(x);
  }
  assert.equal(new Set(first).size, count, 'every point is there once');
  const mean = first.slice(0, 100).reduce((a, b) => a + b) / 100;
  assert.ok(Math.abs(mean - 500) < 25, `a tenth of the points is spread over all of them: mean ${mean}`);
  const surface = parsePly(ply(COLOURED, [0, 1, 2, 3].map((k) => point([k, k, 0], [1, 2, 3])), [[0, 1, 2, 3]]));
  assert.deepEqual([...surface.indices], [0, 1, 2, 0, 2, 3]);
  near(surface.positions.slice(3, 6), [1, 1, 0], 'the order of a surface stays');
  const plain = parsePly(ply(['double x', 'double y', 'double z'], [Buffer.from(Float64Array.of(1, 2, 3).buffer)]));
  near(plain.positions, [1, 2, 3], 'numbers of 8 bytes');
  assert.equal(plain.colours, undefined);
  assert.equal(parsePly(ply(COLOURED, [])).positions.length, 0);
  assert.throws(() => parsePly(new TextEncoder().encode('<html>').buffer), /not a PLY file/);
  assert.throws(() => parsePly(new TextEncoder().encode('ply\nformat ascii 1.0\nend_header\n').buffer), /not binary/);
  assert.throws(() => parsePly(ply(COLOURED, [point([0, 0, 0], [0, 0, 0])]).slice(0, -3)), /ends too early/);
  assert.throws(() => parsePly(ply(COLOURED, [point([0, 0, 0], [0, 0, 0])], [[0, 0, 5]])), /name points that it does not have/);
}

const { parseGlb } = await module('glb.js');
{
  const parts = [Float32Array.of(0, 0, 0, 1, 0, 0, 0, 1, 0), Uint8Array.of(255, 0, 0, 255, 0, 255, 0, 255, 55, 0, 255, 255), Uint16Array.of(0, 1, 2, 0)];
  let offset = 0;
  const bufferViews = parts.map((part) => { const view = { buffer: 0, byteOffset: offset, byteLength: part.byteLength }; offset += part.byteLength; return view; });
  const glb = (more = {}) => {
    const json = JSON.stringify({
      asset: { version: '2.0' }, buffers: [{ byteLength: offset }], bufferViews,
      accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3' },
        { bufferView: 1, componentType: 5121, normalized: true, count: 3, type: 'VEC4' },
        { bufferView: 2, componentType: 5123, count: 3, type: 'SCALAR', ...more }],
      meshes: [{ primitives: [{ attributes: { POSITION: 0, COLOR_0: 1 }, indices: 2 }] }],
    });
    const text = Buffer.from(json.padEnd(Math.ceil(json.length / 4) * 4));
    const body = Buffer.concat(parts.map((part) => Buffer.from(part.buffer)));
    const words = (...numbers) => Buffer.from(Uint32Array.from(numbers).buffer);
    const all = Buffer.concat([words(0x46546c67, 2, 28 + text.length + body.length), words(text.length, 0x4e4f534a), text, words(body.length, 0x004e4942), body]);
    return all.buffer.slice(all.byteOffset, all.byteOffset + all.length);
  };
  const mesh = parseGlb(glb());
  near(mesh.positions, [0, 0, 0, 1, 0, 0, 0, 1, 0], 'positions');
  assert.deepEqual([...mesh.indices], [0, 1, 2]);
  assert.deepEqual([...mesh.colours.slice(4, 7)], [0, 255, 0]);
  assert.deepEqual([...mesh.colours.slice(8, 11)], [128, 0, 255], 'linear light becomes sRGB');
  assert.equal(mesh.normals, undefined);
  assert.throws(() => parseGlb(glb({ sparse: {} })), /compressed/);
  assert.throws(() => parseGlb(new ArrayBuffer(64)), /not a GLB file/);
}

const { readMeans } = await module('heights.js');
{
  /** A grey PNG of 16 bits whose rows have every filter in turn. */
  const png = (width, height, value) => {
    const rows = [];
    let above = Buffer.alloc(2 * width);
    for (let y = 0; y < height; y += 1) {
      const row = Buffer.alloc(2 * width);
      for (let x = 0; x < width; x += 1) row.writeUInt16BE(value(x, y), 2 * x);
      const filter = y % 5;
      const out = Buffer.alloc(1 + row.length);
      out[0] = filter;
      for (let x = 0; x < row.length; x += 1) {
        const [left, up, corner] = [x < 2 ? 0 : row[x - 2], above[x], x < 2 ? 0 : above[x - 2]];
        const guess = left + up - corner;
        const [a, b, c] = [left, up, corner].map((one) => Math.abs(guess - one));
        const paeth = a <= b && a <= c ? left : b <= c ? up : corner;
        out[1 + x] = row[x] - [0, left, up, (left + up) >> 1, paeth][filter];
      }
      rows.push(out);
      above = row;
    }
    const chunk = (name, data) => {
      const length = Buffer.alloc(4);
      length.writeUInt32BE(data.length);
      return Buffer.concat([length, Buffer.from(name), data, Buffer.alloc(4)]);
    };
    const head = Buffer.alloc(13);
    head.writeUInt32BE(width);
    head.writeUInt32BE(height, 4);
    head.set([16, 0, 0, 0, 0], 8);
    const data = deflateSync(Buffer.concat(rows));
    const half = data.length >> 1;
    return Buffer.concat([Buffer.alloc(8), chunk('IHDR', head), chunk('IDAT', data.subarray(0, half)), chunk('IDAT', data.subarray(half)), chunk('IEND', Buffer.alloc(0))]);
  };
  /** The bytes in pieces as a network brings them. */
  const stream = (bytes, piece) => new ReadableStream({
    start(controller) {
      for (let at = 0; at < bytes.length; at += piece) controller.enqueue(new Uint8Array(bytes.subarray(at, at + piece)));
      controller.close();
    },
  });
  const value = (x, y) => (x * 1021 + y * 4093) % 65535 + 1;
  const exact = await readMeans(stream(png(31, 23, value), 7), 0, 64);
  assert.deepEqual([exact.width, exact.height, exact.side], [31, 23, 1]);
  exact.values.forEach((seen, at) => assert.equal(seen, value(at % 31, Math.floor(at / 31))));
  // a square has a mean when half of it is known
  const reduced = await readMeans(stream(png(30, 17, (x, y) => (x < 10 ? 0 : 100 * (x >= 20) + y)), 1000), 0, 3);
  assert.deepEqual([reduced.width, reduced.height, reduced.side, reduced.full], [3, 2, 10, [30, 17]]);
  near(reduced.values.filter((one) => !Number.isNaN(one)), [5, 104.5, 13, 113], 'means');
  assert.deepEqual(reduced.values.map(Number.isNaN), [true, false, false, true, false, false]);
  await assert.rejects(readMeans(stream(png(31, 23, value).subarray(0, 300), 7), 0, 64), /ends too early/);
}

const matrices = await module('matrix.js');
{
  const { looking, perspective, product, projected, upright, unit } = matrices;
  const matrix = product(perspective(1, 2, 0.1, 100), looking([[0, 1, 0], [0, 0, 1], [1, 0, 0]], [5, 0, 0]));
  near(projected(matrix, [0, 0, 0]), [0.5, 0.5, 5], 'the middle');
  const [x, y] = projected(matrix, [0, 1, 1]);
  assert.ok(x > 0.5 && y < 0.5, 'right is right and up is up');
  assert.equal(projected(matrix, [6, 0, 0]), null, 'behind the camera');
  for (const up of [[0, 0, 1], [0, 1, 0], [1, 2, -3]]) near(upright(up)(unit(up)), [0, 0, 1], 'up is z');
}

const { direction } = await module('ball.js');
near(direction(90, 0), [0, 1, 0], 'pan');
near(direction(0, 90), [0, 0, 1], 'tilt');
const { extent, frustum, upward } = await module('model.js');
{
  const camera = { center: [0, 0, 5], rotation: [1, 0, 0, 0, -1, 0, 0, 0, -1], width: 200, height: 100, focal_px: 100, principal_point: [100, 50] };
  const edges = frustum(camera, 1);
  assert.equal(edges.length, 48);
  near(edges.slice(3, 6), [-1, 0.5, 4], 'the upper left corner, one ahead');
  near(upward([camera], null), [0, 1, 0], 'the pictures have their upper edge there');
  near(upward([camera], { axis: [0, -1, 0] }), [0, 1, 0], 'the axis, turned to that side');
  const cloud = Float32Array.from([...Array.from({ length: 300 }, (_, k) => (k % 3 ? 0 : k / 300)), 1e6, 1e6, 1e6]);
  const { centre, radius } = extent(cloud);
  assert.ok(Math.abs(centre[0] - 0.5) < 0.02 && radius < 1, 'a stray point does not count');
}
const { surface } = await module('relief.js');
{
  const map = { width: 3, height: 2, side: 2, full: [6, 4], values: [1, 2, NaN, 1, 3, 2] };
  const { positions, places, indices, low, high } = surface(map, { offset: 10, scale: 0.5 });
  assert.deepEqual([low, high], [10, 11]);
  near(positions.slice(0, 3), [-2, 1, -0.5], 'the first place');
  near(places.slice(2, 4), [0.5, 0.25], 'its place in the picture');
  assert.deepEqual([...indices], [0, 3, 4, 0, 4, 1, 1, 4, 5], 'no triangle without a height');
}
const { round, length } = await module('measure.js');
assert.deepEqual([0.0123, 0.05, 0.49, 7, 10].map(round).map((one) => +one.toPrecision(6)), [0.01, 0.05, 0.2, 5, 10]);
assert.deepEqual([length(10, null), length(10, 0.005), length(10, 0.5), length(1, 0.0123)], ['10.0 px', '10.0 px = 50.0 µm', '10.0 px = 5.00 mm', '1.0 px = 12.3 µm']);

const { levels, Layer, Recent } = await module('tiles.js');
{
  assert.deepEqual(levels(1025, 300, 512), [[1025, 300], [513, 150], [257, 75]]);
  assert.deepEqual(levels(512, 512, 512), [[512, 512]]);
  const layer = new Layer({ tiles: '/t', version: 'v', width: 1025, height: 300 }, 512, () => {});
  assert.deepEqual([4, 1, 0.6, 0.5, 0.25, 0.01].map((scale) => layer.level(scale)), [0, 0, 0, 1, 2, 2]);
  assert.deepEqual([layer.url(1, 2, 0), layer.at], ['/t/1/2/0?v=v', [0, 0]]);
  const recent = new Recent(2);
  for (const key of ['a', 'b', 'a', 'c']) recent.use(key, () => key);
  assert.deepEqual([...recent.keys()], ['a', 'c'], 'what was used longest ago is forgotten');
}
const { Stepper, slice } = await module('compare.js');
{
  const asked = [];
  const stepper = new Stepper((number) => asked.push(number));
  for (const number of [0, 1, 2, 3]) stepper.want(number);
  assert.deepEqual(asked, [0], 'one at a time');
  stepper.came();
  stepper.came();
  stepper.came();
  assert.deepEqual(asked, [0, 3], 'then the last that was wanted');
  stepper.want(2);
  stepper.want(3);
  stepper.want(2);
  stepper.came();
  assert.deepEqual(asked, [0, 3, 2], 'what is there is not asked for again');
  assert.deepEqual(slice({ tiles: '/t/slice-uv-', version: 'v', slices: 20 }, 3), { tiles: '/t/slice-uv-3', version: 'v', slices: 20 });
}
console.log('readers: done');
