// A zip of files without compression, as a Blob that refers to the files: its bytes are read while they are sent, so
// a folder of any size needs no memory. Each file is read once before, for its CRC-32. Zip64, because a stack can be
// larger than 4 GB. The bytes depend on the files alone, so a later visit makes the same zip and
// can continue to send it.

const TABLES = (() => {
  const tables = [new Uint32Array(256)];
  for (let n = 0; n < 256; n += 1) {
    let c = n;
    for (let k = 0; k < 8; k += 1) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
    tables[0][n] = c;
  }
  for (let t = 1; t < 4; t += 1) {
    tables.push(tables[t - 1].map((c) => tables[0][c & 255] ^ (c >>> 8)));
  }
  return tables;
})();

/** CRC-32 of bytes that follow those with the CRC `before`. */
export function crc32(bytes, before = 0) {
  let crc = ~before;
  let at = 0;
  const [a, b, c, d] = TABLES;
  for (; at + 4 <= bytes.length; at += 4) {
    crc ^= bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16) | (bytes[at + 3] << 24);
    crc = d[crc & 255] ^ c[(crc >>> 8) & 255] ^ b[(crc >>> 16) & 255] ^ a[crc >>> 24];
  }
  for (; at < bytes.length; at += 1) crc = a[(crc ^ bytes[at]) & 255] ^ (crc >>> 8);
  return ~crc >>> 0;
}

async function crcOf(file, read) {
  const reader = file.stream().getReader();
  let crc = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return crc;
    crc = crc32(value, crc);
    read(value.length);
  }
}

/** Writes little-endian numbers: pairs of size in bytes and value. */
function packed(...fields) {
  const bytes = new Uint8Array(fields.reduce((sum, [size]) => sum + size, 0));
  const view = new DataView(bytes.buffer);
  let at = 0;
  for (const [size, value] of fields) {
    if (size === 2) view.setUint16(at, value, true);
    else if (size === 4) view.setUint32(at, value, true);
    else view.setBigUint64(at, BigInt(value), true);
    at += size;
  }
  return bytes;
}

function dosTime(ms) {
  const time = new Date(Math.max(ms, Date.UTC(1980, 0, 2)));
  const date = ((time.getUTCFullYear() - 1980) << 9) | ((time.getUTCMonth() + 1) << 5) | time.getUTCDate();
  return [(time.getUTCHours() << 11) | (time.getUTCMinutes() << 5) | (time.getUTCSeconds() >> 1), date];
}

/** The zip of `files`, `{path, file}` each. `progress` is called with the bytes read so far. */
export async function zipped(files, progress = () => {}) {
  const parts = [];
  const directory = [];
  let offset = 0;
  let read = 0;
  for (const { path, file } of files) {
    const name = new TextEncoder().encode(path);
    const crc = await crcOf(file, (count) => { read += count; progress(read); });
    const [time, date] = dosTime(file.lastModified);
    const sizes = packed([2, 1], [2, 16], [8, file.size], [8, file.size]);
    const common = [[2, 45], [2, 0x0800], [2, 0], [2, time], [2, date], [4, crc], [4, 0xffffffff], [4, 0xffffffff], [2, name.length]];
    const local = packed([4, 0x04034b50], ...common, [2, sizes.length]);
    parts.push(local, name, sizes, file);
    const extra = packed([2, 1], [2, 24], [8, file.size], [8, file.size], [8, offset]);
    directory.push(packed([4, 0x02014b50], [2, 45], ...common, [2, extra.length], [2, 0], [2, 0], [2, 0], [4, 0], [4, 0xffffffff]), name, extra);
    offset += local.length + name.length + sizes.length + file.size;
  }
  const size = directory.reduce((sum, part) => sum + part.length, 0);
  const count = files.length;
  const end64 = packed([4, 0x06064b50], [8, 44], [2, 45], [2, 45], [4, 0], [4, 0], [8, count], [8, count], [8, size], [8, offset]);
  const locator = packed([4, 0x07064b50], [4, 0], [8, offset + size], [4, 1]);
  const end = packed([4, 0x06054b50], [2, 0], [2, 0], [2, 0xffff], [2, 0xffff], [4, 0xffffffff], [4, 0xffffffff], [2, 0]);
  return new Blob([...parts, ...directory, end64, locator, end], { type: 'application/zip' });
}
