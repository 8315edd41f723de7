// Reads the triangles of binary glTF files (GLB): positions, normals and colours of every mesh, in one surface. Positions
// are those of the meshes: the node above them, which turns z to y and mm to metres for other programs, is left out, so
// that the surface agrees with the points and cameras.

const NUMBERS = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** The byte of a colour; glTF has linear light, a screen wants sRGB (IEC 61966-2-1). */
const byte = (linear) => 255.5 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);

/** Positions, colours (four bytes per point), normals (where all meshes have them) and indices of the triangles. */
export function parseGlb(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67) throw new Error('the file is not a GLB file');
  const length = view.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const accessors = (document.accessors ?? []).map((accessor) => numbers(document, accessor, buffer, 28 + length));
  const parts = (document.meshes ?? []).flatMap((mesh) => mesh.primitives).filter(({ mode = 4 }) => mode === 4);
  const total = (size) => parts.reduce((sum, part) => sum + size(part), 0);
  const count = ({ attributes }) => accessors[attributes.POSITION].values.length / 3;
  const [positions, normals] = [0, 1].map(() => new Float32Array(3 * total(count)));
  const colours = new Uint8Array(4 * total(count)).fill(200);
  const indices = new Uint32Array(total((part) => accessors[part.indices]?.values.length ?? count(part)));
  let [first, at, lit] = [0, 0, true];
  for (const part of parts) {
    const of = (name) => accessors[part.attributes[name]];
    positions.set(of('POSITION').values, 3 * first);
    if (of('NORMAL')) normals.set(of('NORMAL').values, 3 * first); else lit = false;
    const paint = of('COLOR_0');
    for (let k = 0; paint && k < count(part); k += 1) {
      for (let c = 0; c < 3; c += 1) colours[4 * (first + k) + c] = byte(paint.values[paint.width * k + c] * paint.unit);
    }
    const corners = accessors[part.indices]?.values ?? Uint32Array.from({ length: count(part) }, (_, k) => k);
    for (const corner of corners) indices[at++] = first + corner;
    first += count(part);
  }
  return { positions, colours, normals: lit ? normals : undefined, indices };
}

/** The numbers of an accessor, and the factor after which bytes of colours are from 0 to 1. */
function numbers(document, accessor, buffer, start) {
  const { componentType, type, count, byteOffset = 0, sparse } = accessor;
  const part = document.bufferViews?.[accessor.bufferView];
  const [Kind, width] = [NUMBERS[componentType], WIDTHS[type]];
  if (!part || !Kind || !width || sparse) throw new Error('the GLB file has parts that are compressed or lie elsewhere');
  const size = Kind.BYTES_PER_ELEMENT;
  const stride = part.byteStride ?? width * size;
  const from = start + (part.byteOffset ?? 0) + byteOffset;
  const isPacked = stride === width * size;
  const values = isPacked ? new Kind(buffer.slice(from, from + count * stride)) : new Kind(width * count);
  for (let k = 0; k < count && !isPacked; k += 1) {
    values.set(new Kind(buffer.slice(from + k * stride, from + k * stride + width * size)), width * k);
  }
  return { values, width, unit: Kind === Float32Array ? 1 : 1 / (2 ** (8 * size) - 1) };
}
