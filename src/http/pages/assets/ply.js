// Reads PLY files (binary, little-endian): points with colours, and surfaces.

const TYPES = {
  char: [1, 'getInt8'], uchar: [1, 'getUint8'], short: [2, 'getInt16'], ushort: [2, 'getUint16'],
  int: [4, 'getInt32'], uint: [4, 'getUint32'], float: [4, 'getFloat32'], double: [8, 'getFloat64'],
  int8: [1, 'getInt8'], uint8: [1, 'getUint8'], int16: [2, 'getInt16'], uint16: [2, 'getUint16'],
  int32: [4, 'getInt32'], uint32: [4, 'getUint32'], float32: [4, 'getFloat32'], float64: [8, 'getFloat64'],
};

/** Elements of the header, each with its number and properties, and where the data begins. */
function header(buffer) {
  const text = new TextDecoder('latin1').decode(buffer.slice(0, 16384));
  const end = text.match(/end_header\r?\n/);
  if (!text.startsWith('ply') || !end) throw new Error('the file is not a PLY file');
  if (!/\nformat binary_little_endian 1\.0/.test(text)) throw new Error('the PLY file is not binary with little-endian numbers');
  const elements = [];
  for (const line of text.slice(0, end.index).split(/\r?\n/)) {
    const [word, ...rest] = line.trim().split(/\s+/);
    if (word === 'element') elements.push({ name: rest[0], count: Number(rest[1]), properties: [] });
    if (word === 'property') {
      const isList = rest[0] === 'list';
      const [type, length] = isList ? [rest[2], rest[1]] : [rest[0]];
      if (!TYPES[type] || (isList && !TYPES[length])) throw new Error(`the PLY file has numbers of the unknown type '${type}'`);
      elements.at(-1).properties.push({ name: rest.at(-1), type: TYPES[type], length: length && TYPES[length] });
    }
  }
  return { elements, start: end.index + end[0].length };
}

/** A step with which `(i * step) % count` visits every index once, far apart, so that each beginning of the points is
 *  a fair sample of them. */
function spread(count) {
  const divisor = (a, b) => (b ? divisor(b, a % b) : a);
  let step = Math.max(1, Math.round(count * 0.6180339887));
  while (divisor(step, count) !== 1) step += 1;
  return step;
}

/** Positions (three numbers per point), colours (four bytes per point) and, of a surface, indices of triangles. The
 *  points of a cloud are in an order in which each beginning shows all of it. */
export function parsePly(buffer) {
  const { elements, start } = header(buffer);
  const view = new DataView(buffer);
  const vertex = elements[0];
  const faces = elements.find((element) => element.name === 'face' && element.count > 0);
  if (vertex?.name !== 'vertex' || vertex.properties.some(({ length }) => length)) throw new Error('the PLY file does not begin with points');
  let stride = 0;
  const at = {};
  for (const { name, type } of vertex.properties) {
    at[name] = { offset: stride, read: type[1] };
    stride += type[0];
  }
  const { count } = vertex;
  if (!at.x || !at.y || !at.z) throw new Error('the points of the PLY file have no x, y and z');
  if (start + count * stride > buffer.byteLength) throw new Error('the PLY file ends too early');
  const positions = new Float32Array(3 * count);
  const colours = at.red && at.green && at.blue ? new Uint8Array(4 * count).fill(255) : undefined;
  const step = faces ? 1 : spread(count);
  const columns = [[positions, 3, ['x', 'y', 'z']], ...(colours ? [[colours, 4, ['red', 'green', 'blue']]] : [])];
  for (const [out, width, names] of columns) {
    for (const [column, name] of names.entries()) {
      const { offset, read } = at[name];
      for (let k = 0, to = 0; k < count; k += 1, to = (to + step) % count) out[width * to + column] = view[read](start + k * stride + offset, true);
    }
  }
  return { positions, colours, indices: faces && triangles(view, start + count * stride, faces, count) };
}

function triangles(view, start, { count, properties }, points) {
  const [list] = properties;
  if (properties.length !== 1 || !list.length) throw new Error('the faces of the PLY file have more than a list of points');
  const [[width, read], [before, readLength]] = [list.type, list.length];
  const out = [];
  let at = start;
  for (let k = 0; k < count; k += 1) {
    const corners = view[readLength](at, true);
    const corner = (c) => view[read](at + before + c * width, true);
    for (let c = 2; c < corners; c += 1) out.push(corner(0), corner(c - 1), corner(c));
    at += before + corners * width;
  }
  if (out.some((index) => index >= points)) throw new Error('the faces of the PLY file name points that it does not have');
  return Uint32Array.from(out);
}
