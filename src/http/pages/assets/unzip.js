// Reads the directory of a zip, which is at its end, and heads of its members: nothing else of the file is read. ZIP64
// too. Needs no browser.

/** Bytes at the end in which the end record is: a comment has at most 65,535. */
const END = 65557;
/** Most bytes of a directory: 60,000 names. */
const MOST = 64 << 20;
/** What a zip has between folders. */
const SEPARATOR = String.fromCharCode(0x2f);

const numbers = (bytes) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

async function bytesOf(blob, from, length) {
  return new Uint8Array(await blob.slice(from, from + length).arrayBuffer());
}

/** Where the directory is: `{ at, size }`. */
async function place(blob) {
  const from = Math.max(0, blob.size - END);
  const tail = await bytesOf(blob, from, END);
  const data = numbers(tail);
  let end = tail.length - 22;
  // a comment may contain the signature
  const isEnd = () => data.getUint32(end, true) === 0x06054b50 && end + 22 + data.getUint16(end + 20, true) <= tail.length;
  while (end >= 0 && !isEnd()) end -= 1;
  if (end < 0) throw new Error('this is no zip, or its end is missing: it was not copied completely; copy or make it again');
  const short = { size: data.getUint32(end + 12, true), at: data.getUint32(end + 16, true), end: from + end };
  if (end < 20 || data.getUint32(end - 20, true) !== 0x07064b50) return short;
  const long = await bytesOf(blob, Number(data.getBigUint64(end - 12, true)), 56);
  if (long.length < 56 || numbers(long).getUint32(0, true) !== 0x06064b50) return short;
  const field = (offset) => Number(numbers(long).getBigUint64(offset, true));
  return { size: field(40), at: field(48), end: Number(data.getBigUint64(end - 12, true)) };
}

function text(bytes, isUtf8) {
  try { return new TextDecoder('utf-8', { fatal: true }).decode(bytes); } catch { /* an older zip */ }
  return new TextDecoder(isUtf8 ? 'utf-8' : 'latin1').decode(bytes);
}

/** The 64-bit numbers that replace those of an entry that are full, in their order. */
function wide(data, from, length, values) {
  let at = from;
  while (at + 4 <= from + length) {
    const [id, size] = [data.getUint16(at, true), data.getUint16(at + 2, true)];
    if (id === 1) {
      let field = at + 4;
      return values.map((value) => {
        if (value !== 0xffffffff || field + 8 > at + 4 + size) return value;
        field += 8;
        return Number(data.getBigUint64(field - 8, true));
      });
    }
    at += 4 + size;
  }
  return values;
}

/** A source, as `exif.js` reads it, of a member; one that is compressed is read from its beginning. */
function member(blob, { at, packed, size, method }) {
  let start = null;
  let head = null;
  const begin = async () => {
    const local = numbers(await bytesOf(blob, at, 30));
    return at + 30 + local.getUint16(26, true) + local.getUint16(28, true);
  };
  const inflated = async (length) => {
    if (head && head.length >= Math.min(length, size)) return head;
    const reader = blob.slice(start, start + packed).stream().pipeThrough(new DecompressionStream('deflate-raw')).getReader();
    const parts = [];
    for (let have = 0; have < length;) {
      const { done, value } = await reader.read();
      if (done) break;
      parts.push(value);
      have += value.length;
    }
    reader.cancel().catch(() => {});
    return new Uint8Array(await new Blob(parts).arrayBuffer());
  };
  return {
    size,
    async read(from, length) {
      start ??= await begin();
      if (method === 0) return bytesOf(blob, start + from, Math.min(length, size - from));
      if (method !== 8 || from + length > 1 << 20) return new Uint8Array(0);
      head = await inflated(Math.max(from + length, 1 << 16));
      return head.subarray(from, from + length);
    },
    /** The whole member as a Blob; only what is stored or deflated. */
    async blob() {
      start ??= await begin();
      const stored = blob.slice(start, start + packed);
      return method === 0 ? stored : new Response(stored.stream().pipeThrough(new DecompressionStream('deflate-raw'))).blob();
    },
  };
}

/** The files of a zip: `{ path, size, source }` each. Throws an Error with a sentence for a zip that cannot be read. */
export async function directory(blob) {
  const { at, size, end } = await place(blob);
  if (size > MOST) throw new Error('the directory of this zip is larger than 64 MiB; send fewer files');
  // a program may have put something before the zip
  const shift = Math.max(0, end - size - at);
  const bytes = await bytesOf(blob, at + shift, size);
  const data = numbers(bytes);
  const files = [];
  for (let from = 0; from + 46 <= bytes.length && data.getUint32(from, true) === 0x02014b50;) {
    const [flags, method] = [data.getUint16(from + 8, true), data.getUint16(from + 10, true)];
    const [name, extra, comment] = [28, 30, 32].map((offset) => data.getUint16(from + offset, true));
    const full = [24, 20, 42].map((offset) => data.getUint32(from + offset, true));
    const [plain, packed, offset] = wide(data, from + 46 + name, Math.min(extra, bytes.length - from - 46 - name), full);
    const path = text(bytes.subarray(from + 46, from + 46 + name), (flags & 0x800) !== 0).split('\\').join(SEPARATOR);
    if (!path.endsWith(SEPARATOR)) files.push({ path, size: plain, source: member(blob, { at: offset + shift, packed, size: plain, method }) });
    from += 46 + name + extra + comment;
  }
  return files;
}
