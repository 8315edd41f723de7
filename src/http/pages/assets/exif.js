// What the head of a picture says, read in pieces of a few kilobytes: kind, size, and the EXIF of JPEG, PNG and TIFF.
// In: a source, `{ size, read(from, length) }` with bytes as a Uint8Array, of a file or of a member of a zip. Needs no
// browser.

const BLOCK = 4096;
const TAGS = { 0x100: 'width', 0x101: 'height', 0x10f: 'make', 0x110: 'model', 0x112: 'orientation', 0x8769: 'exif',
  0x829d: 'fNumber', 0x9003: 'taken', 0x920a: 'focal', 0xa002: 'exifWidth', 0xa003: 'exifHeight', 0xa20e: 'perUnit', 0xa210: 'unit', 0xa434: 'lens' };
const SIZES = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8];
/** Millimetres of the units of a focal plane resolution. */
const UNITS = { 2: 25.4, 3: 10, 4: 1, 5: 0.001 };

/** The source of a File or Blob. */
export const sourceOf = (blob) => ({
  get size() { return blob.size; },
  read: async (from, length) => new Uint8Array(await blob.slice(from, from + length).arrayBuffer()),
});

const view = (bytes) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

/** A source of a part of another. */
const within = (source, start, size) => ({ size, read: (from, length) => source.read(start + from, Math.min(length, size - from)) });

/** The tags of a TIFF structure: that of a TIFF file, or of the EXIF of another. */
async function tagsOf(source) {
  const head = await source.read(0, BLOCK);
  if (head.length < 8) return null;
  const order = String.fromCharCode(head[0], head[1]);
  const little = order === 'II';
  if ((!little && order !== 'MM') || view(head).getUint16(2, little) !== 42) return null;
  const found = {};
  const bytesAt = async (from, length) => (from + length <= head.length ? head.subarray(from, from + length) : source.read(from, length));
  const value = async (entry, tag) => {
    const type = entry.getUint16(2, little);
    const count = entry.getUint32(4, little);
    const length = (SIZES[type] ?? 0) * count;
    if (length === 0 || length > 1024) return undefined;
    const bytes = length <= 4 ? new Uint8Array(entry.buffer, entry.byteOffset + 8, length) : await bytesAt(entry.getUint32(8, little), length);
    if (bytes.length < length) return undefined;
    const data = view(bytes);
    if (type === 2) return new TextDecoder('latin1').decode(bytes).replace(/\0.*$/s, '').trim() || undefined;
    if (type === 5 || type === 10) return data[type === 5 ? 'getUint32' : 'getInt32'](0, little) / data.getUint32(4, little);
    if (type === 3) return data.getUint16(0, little);
    return type === 4 || tag === 'exif' ? data.getUint32(0, little) : undefined;
  };
  const directory = async (at, depth) => {
    const count = await bytesAt(at, 2);
    if (count.length < 2) return;
    const entries = await bytesAt(at + 2, Math.min(view(count).getUint16(0, little), 200) * 12);
    for (let from = 0; from + 12 <= entries.length; from += 12) {
      const entry = new DataView(entries.buffer, entries.byteOffset + from, 12);
      const tag = TAGS[entry.getUint16(0, little)];
      const read = tag === undefined ? undefined : await value(entry, tag);
      if (tag === 'exif' && depth === 0) await directory(read, 1);
      else if (read !== undefined && found[tag] === undefined) found[tag] = read;
    }
  };
  await directory(view(head).getUint32(4, little), 0);
  return found;
}

/** Walks the segments of a JPEG up to its frame header, which has the size. */
async function jpeg(source) {
  let [exif, at] = [null, 2];
  for (let segments = 0; segments < 500; segments += 1) {
    const head = await source.read(at, 16);
    if (head.length < 9 || head[0] !== 0xff) return null;
    const length = (head[2] << 8) | head[3];
    const kind = head[1];
    if (kind === 0xff) { at += 1; continue; }
    if (kind >= 0xc0 && kind <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(kind)) {
      return { kind: 'jpeg', height: (head[5] << 8) | head[6], width: (head[7] << 8) | head[8], exif };
    }
    if (kind === 0xda || kind === 0xd9) return null;
    if (kind === 0xe1 && String.fromCharCode(...head.subarray(4, 8)) === 'Exif') exif ??= await tagsOf(within(source, at + 10, length - 8));
    at += 2 + length;
  }
  return null;
}

/** Walks the chunks of a PNG up to its pixels. */
async function png(source) {
  const first = view(await source.read(16, 8));
  const made = { kind: 'png', width: first.getUint32(0), height: first.getUint32(4), exif: null };
  for (let [at, chunks] = [8, 0]; chunks < 100; chunks += 1) {
    const head = await source.read(at, 8);
    const name = String.fromCharCode(...head.subarray(4));
    if (head.length < 8 || name === 'IDAT') break;
    const length = view(head).getUint32(0);
    if (name === 'eXIf') made.exif = await tagsOf(within(source, at + 8, length));
    at += 12 + length;
  }
  return made;
}

async function tiff(source) {
  const exif = await tagsOf(source);
  return exif?.width && exif.height ? { kind: 'tiff', width: exif.width, height: exif.height, exif } : null;
}

/**
 * What a picture says: `{ kind, width, height, make, model, lens, focalMm, pitchMm, taken, orientation }`, each as far
 * as it is known, in px and mm; width and height are those of the sensor, not turned. `null`: it is no picture.
 */
export async function headOf(source) {
  const start = await source.read(0, 8);
  const begins = (...bytes) => bytes.every((byte, at) => start[at] === byte);
  let found = null;
  try {
    if (begins(0xff, 0xd8)) found = await jpeg(source);
    else if (begins(0x89, 0x50, 0x4e, 0x47)) found = await png(source);
    else if (begins(0x49, 0x49) || begins(0x4d, 0x4d)) found = await tiff(source);
  } catch (error) {
    // a head that is cut off
    if (!(error instanceof RangeError)) throw error;
  }
  if (!found) return null;
  const { exif, ...head } = found;
  const { make, model, lens, focal, taken, orientation = 1, perUnit, unit = 2, exifWidth, exifHeight } = exif ?? {};
  const known = { ...head, make, model, lens, taken, orientation };
  if (focal > 0 && focal < 1e4) known.focalMm = focal;
  // a picture that was reduced has larger pixels than its camera
  const reduced = exifWidth && exifHeight ? Math.max(exifWidth, exifHeight) / Math.max(head.width, head.height) : 1;
  const pitch = perUnit > 0 && UNITS[unit] ? (UNITS[unit] / perUnit) * reduced : 0;
  if (pitch > 1e-5 && pitch < 1) known.pitchMm = Number(pitch.toPrecision(6));
  return known;
}
