// Reads a grey PNG of 8 or 16 bits while it arrives, and keeps means over squares of its pixels: a height map of any
// size becomes one that can be drawn. (A browser itself decodes PNG to 8 bits.)

/** Yields the compressed bytes of the picture; `head` receives its width, height and bytes per sample. */
async function* compressed(stream, head) {
  const reader = stream.getReader();
  let rest = new Uint8Array(0);
  const take = async (length) => {
    const parts = [rest];
    for (let have = rest.length; have < length;) {
      const { value, done } = await reader.read();
      if (done) throw new Error('the picture ends too early');
      parts.push(value);
      have += value.length;
    }
    const all = new Uint8Array(await new Blob(parts).arrayBuffer());
    rest = all.subarray(length);
    return all.subarray(0, length);
  };
  await take(8);
  for (;;) {
    const start = await take(8);
    const length = new DataView(start.buffer, start.byteOffset).getUint32(0);
    const name = String.fromCharCode(...start.subarray(4));
    const data = await take(length);
    await take(4);
    if (name === 'IEND') return;
    if (name === 'IDAT') yield data;
    if (name !== 'IHDR') continue;
    const view = new DataView(data.buffer, data.byteOffset);
    Object.assign(head, { width: view.getUint32(0), height: view.getUint32(4), size: data[8] / 8 });
    if (data[8] < 8 || data[9] !== 0 || data[12] !== 0) throw new Error('the picture is not grey, or interlaced');
  }
}

/** Undoes the filter of a row in place; `above` is the row before. */
function unfilter(filter, row, above, size) {
  for (let x = 0; x < row.length; x += 1) {
    const left = x < size ? 0 : row[x - size];
    const up = above[x];
    if (filter === 1) row[x] += left;
    else if (filter === 2) row[x] += up;
    else if (filter === 3) row[x] += (left + up) >> 1;
    else if (filter === 4) {
      const corner = x < size ? 0 : above[x - size];
      const [a, b, c] = [Math.abs(up - corner), Math.abs(left - corner), Math.abs(left + up - 2 * corner)];
      row[x] += a <= b && a <= c ? left : b <= c ? up : corner;
    }
  }
}

/** Rows of samples, of the stream of a PNG. */
async function* rows(stream, head) {
  const source = compressed(stream, head);
  const pull = async (controller) => {
    const { value, done } = await source.next();
    if (done) controller.close(); else controller.enqueue(value);
  };
  const reader = new ReadableStream({ pull }).pipeThrough(new DecompressionStream('deflate')).getReader();
  let [row, above, filter, filled] = [null, null, 0, -1];
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    row ??= new Uint8Array(head.width * head.size);
    above ??= new Uint8Array(row.length);
    for (let at = 0; at < value.length;) {
      if (filled < 0) { filter = value[at]; at += 1; filled = 0; }
      const part = value.subarray(at, at + row.length - filled);
      row.set(part, filled);
      filled += part.length;
      at += part.length;
      if (filled < row.length) continue;
      unfilter(filter, row, above, head.size);
      yield row;
      [row, above, filled] = [above, row, -1];
    }
  }
}

/** Means over squares of the samples of a PNG, of which at most `most` lie on a side: `{ width, height, side, values }`,
 *  NaN where less than half of a square has a sample other than `invalid`. */
export async function readMeans(stream, invalid, most) {
  const head = {};
  let [out, sums, counts, y] = [null, null, null, 0];
  for await (const row of rows(stream, head)) {
    const { width, height, size } = head;
    const side = Math.ceil(Math.max(width, height) / most);
    out ??= { width: Math.ceil(width / side), height: Math.ceil(height / side), side, full: [width, height], values: [] };
    if (y % side === 0) [sums, counts] = [new Float64Array(out.width), new Uint32Array(out.width)];
    for (let x = 0, column = 0, next = side; x < width; x += 1) {
      if (x === next) { column += 1; next += side; }
      const value = size === 2 ? (row[2 * x] << 8) | row[2 * x + 1] : row[x];
      if (value !== invalid) { sums[column] += value; counts[column] += 1; }
    }
    y += 1;
    if (y % side !== 0 && y !== height) continue;
    const deep = y % side || side;
    for (let column = 0; column < out.width; column += 1) {
      const wide = Math.min(side, width - column * side);
      out.values.push(2 * counts[column] >= wide * deep ? sums[column] / counts[column] : NaN);
    }
  }
  if (!out || out.values.length !== out.width * out.height) throw new Error('the picture ends too early');
  return out;
}
