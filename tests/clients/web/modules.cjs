// What the scripts of the pages compute without a browser. Usage: node modules.cjs FOLDER_OF_ASSETS FOLDER
// FOLDER gets what the tests write. Any failure ends the process with an error.
'use strict';
const assert = require('node:assert/strict');
const { execFileSync } = require('node:child_process');
const fs = require('node:fs');
const path = require('node:path');

const [assets, folder] = process.argv.slice(2);
/** An asset as a module: those that need no browser import nothing. */
function load(name) {
  const copy = path.join(folder, name.replace('.js', '.mjs'));
  fs.copyFileSync(path.join(assets, name), copy);
  return import(copy);
}

/** The TIFF structure of EXIF: entries of the first directory and of the EXIF directory, `[tag, type, value]`. */
function tiff(little, first, exif = []) {
  const bytes = Buffer.alloc(1024);
  const put = (at, size, value) => bytes[`write${size === 2 ? 'UInt16' : 'UInt32'}${little ? 'LE' : 'BE'}`](value, at);
  bytes.write(little ? 'II' : 'MM');
  put(2, 2, 42);
  put(4, 4, 8);
  let free = 512;
  const directory = (at, entries) => {
    put(at, 2, entries.length);
    entries.forEach(([tag, type, value], index) => {
      const entry = at + 2 + 12 * index;
      put(entry, 2, tag);
      put(entry + 2, 2, type);
      put(entry + 4, 4, type === 2 ? value.length + 1 : 1);
      if (type === 3) put(entry + 8, 2, value);
      else if (type === 4) put(entry + 8, 4, value);
      else {
        put(entry + 8, 4, free);
        if (type === 2) bytes.write(value, free); else { put(free, 4, value[0]); put(free + 4, 4, value[1]); }
        free += type === 2 ? value.length + 2 : 8;
      }
    });
  };
  directory(8, [...first, [0x8769, 4, 256]]);
  directory(256, exif);
  return bytes;
}

const CAMERA = [[0x10f, 2, 'Canon'], [0x110, 2, 'Canon EOS 5DS'], [0x112, 3, 6]];
const LENS = [[0x9003, 2, '2026:11:27 09:30:00'], [0x920a, 5, [65, 1]], [0xa002, 4, 8688], [0xa003, 3, 5792], [0xa20e, 5, [8688000, 1417]], [0xa210, 3, 2], [0xa434, 2, 'MP-E65mm f/2.8']];

function jpeg(width, height, exif) {
  const app1 = Buffer.concat([Buffer.from([0xff, 0xe1, (exif.length + 8) >> 8, (exif.length + 8) & 255]), Buffer.from('Exif\0\0'), exif]);
  const icc = Buffer.concat([Buffer.from([0xff, 0xe2, 0xea, 0x62]), Buffer.alloc(0xea60)]);
  const frame = Buffer.from([0xff, 0xc0, 0, 17, 8, height >> 8, height & 255, width >> 8, width & 255, 3, 1, 17, 0, 2, 17, 0, 3, 17, 0]);
  return Buffer.concat([Buffer.from([0xff, 0xd8]), icc, app1, frame]);
}

const tests = {
  async the_head_of_a_picture_tells_camera_and_pixels() {
    const { headOf, sourceOf } = await load('exif.js');
    const head = (bytes) => headOf(sourceOf(new Blob([bytes])));
    for (const little of [true, false]) {
      const found = await head(jpeg(8688, 5792, tiff(little, CAMERA, LENS)));
      const { width, height, make, model, lens, focalMm, taken, orientation } = found;
      assert.deepEqual([width, height, make, model, lens, focalMm, taken, orientation],
        [8688, 5792, 'Canon', 'Canon EOS 5DS', 'MP-E65mm f/2.8', 65, '2026:11:27 09:30:00', 6]);
      assert.ok(Math.abs(found.pitchMm - 25.4 * 1417 / 8688000) < 1e-7, `${found.pitchMm}`);
      // a picture of half the size has pixels of twice the size
      assert.ok(Math.abs((await head(jpeg(4344, 2896, tiff(little, CAMERA, LENS)))).pitchMm / found.pitchMm - 2) < 1e-4);
      const whole = await head(tiff(little, [[0x100, 4, 600], [0x101, 3, 400], ...CAMERA], LENS));
      assert.deepEqual([whole.kind, whole.width, whole.height, whole.focalMm], ['tiff', 600, 400, 65]);
    }
    const png = Buffer.concat([Buffer.from([0x89, 0x50, 0x4e, 0x47, 13, 10, 26, 10, 0, 0, 0, 13]), Buffer.from('IHDR'), Buffer.from([0, 0, 1, 0, 0, 0, 0, 200])]);
    assert.deepEqual([(await head(png)).width, (await head(png)).height], [256, 200]);
    // text, nothing, and pictures that are cut off at every byte are told, and are no error
    for (const bytes of ['a text', '', Buffer.from([0xff, 0xd8, 0xff])]) assert.equal(await head(bytes), null);
    const cut = jpeg(600, 400, tiff(true, CAMERA, LENS));
    for (let length = 0; length < cut.length; length += length < 70 ? 1 : 997) await head(cut.subarray(0, length));
  },

  async the_directory_of_a_zip_is_read_from_its_end() {
    const { directory } = await load('unzip.js');
    const { zipped } = await load('zip.js');
    const { headOf } = await load('exif.js');
    const picture = jpeg(600, 400, tiff(true, CAMERA, LENS));
    const names = ['Käfer/vorne/1.jpg', '甲虫/front/1.jpg', 'خنفساء/front/1.jpg'];
    // its own zip is a ZIP64; Python's has members that are compressed, and a comment
    const own = await zipped(names.map((name) => ({ path: name, file: new File([picture], 'x', { lastModified: 0 }) })));
    const other = path.join(folder, 'compressed.zip');
    execFileSync('python3', ['-c', `import sys, zipfile
with zipfile.ZipFile(sys.argv[1], "w", zipfile.ZIP_DEFLATED) as z:
    z.comment = b"PK\\x05\\x06 in a comment"
    for name in sys.argv[2:]: z.writestr(name, sys.stdin.buffer.read() if name == sys.argv[2] else b"x" * 300000)`, other, ...names], { input: picture });
    for (const zip of [own, await fs.openAsBlob(other)]) {
      const files = await directory(zip);
      assert.deepEqual(files.map((file) => file.path), names);
      assert.equal((await headOf(files[0].source)).model, 'Canon EOS 5DS');
      assert.equal((await files[0].source.blob()).size, picture.length);
    }
    // a zip of 20 GB is not read: only its end is there
    const sparse = path.join(folder, 'large.zip');
    execFileSync('python3', ['-c', `import sys, zipfile
file = open(sys.argv[1], "wb")
file.truncate(20 << 30)
file.seek(20 << 30)
with zipfile.ZipFile(file, "a") as z: z.writestr("front/1.jpg", b"x")`, sparse]);
    const file = fs.openSync(sparse);
    let read = 0;
    const part = (from, to) => ({
      async arrayBuffer() {
        const bytes = Buffer.alloc(to - from);
        read += bytes.length;
        return new Uint8Array(bytes.subarray(0, fs.readSync(file, bytes, 0, bytes.length, from))).buffer;
      },
    });
    assert.deepEqual((await directory({ size: fs.fstatSync(file).size, slice: part })).map((one) => one.path), ['front/1.jpg']);
    assert.ok(read < 100_000, `${read} bytes were read`);
    fs.rmSync(sparse);
    await assert.rejects(directory(new Blob(['no zip'])), /no zip, or its end is missing/);
    for (let length = 0; length < own.size; length += 61) await directory(own.slice(0, length)).catch((error) => assert.equal(error.name, 'Error', `${length}: ${error.stack}`));
  },

  async a_plan_tells_what_does_not_fit_with_its_cure() {
    const { planOf, purposeOf, worthReading } = await load('plan.js');
    const names = (count, name = 'front') => Array.from({ length: count }, (_, at) => `${name}/${at}.jpg`);
    const stack = { front: names(3), back: names(3, 'back'), lights: [], moved: [], gaps: null, problem: null };
    const view = (name, pan, front = 3, back = 3) => ({ name, pan_deg: pan, tilt_deg: 0, front: names(front, name), back: names(back, `${name}b`), problem: null, gaps: null });
    const ignored = [];
    const scan = { views: [view('a', 0), view('b', 20)], ignored, stack: { ...stack, front: [], problem: 'several folders' } };
    const one = { views: [view('', null)], ignored, stack };
    assert.deepEqual([purposeOf(scan, []), purposeOf(one, []), purposeOf({ ...one, stack: { ...stack, moved: ['moved/1.jpg'] } }, []), purposeOf(one, ['target/1.jpg'])],
      ['scan', 'stack', 'calibration', 'calibration']);
    const profile = { slice_count: 3, image_width: 600, image_height: 400 };
    const head = { width: 600, height: 400, orientation: 1 };
    const told = (more) => planOf({ purpose: 'stack', grouping: one, heads: new Map(stack.front.map((name) => [name, head])), profile, rig: 'r', lens: 'l', ...more })
      .findings.map(({ level, text, cure }) => `${level}: ${text}: ${cure}`).join('\n');
    assert.equal(told({}), '');
    const with_ = (changes) => ({ grouping: { ...one, stack: { ...stack, ...changes } } });
    assert.match(told({ profile: { ...profile, slice_count: 5 } }), /bad: The stack has 3 slices, and the profile .* has 5: Add or remove/);
    assert.match(told({ profile: null }), /bad: There is no profile of the rig r with the lens l/);
    assert.match(told({ profile: { ...profile, image_width: 900 } }), /600 × 400 px, and the profile is for 900 × 400/);
    assert.match(told(with_({ back: [] })), /note: No back light: the result has no mask/);
    assert.match(told(with_({ gaps: 'after 1.jpg comes 3.jpg' })), /warn: A slice may be missing: after 1.jpg comes 3.jpg: Add it/);
    assert.match(told({ others: ['a/log.txt'] }), /note: 1 other file is not sent: log.txt/);
    const heads = (...list) => ({ heads: new Map(stack.front.map((name, at) => [name, list[at]])) });
    assert.match(told(heads(head, null, head)), /bad: 1.jpg: no JPEG, PNG or TIFF/);
    assert.match(told(heads(head, head, { ...head, width: 300 })), /bad: 2.jpg: 300 × 400 px; the others have 600 × 400 px/);
    assert.match(told(heads(head, head, { ...head, orientation: 3 })), /turned otherwise/);
    const at = (second) => ({ ...head, taken: `2026:01:01 10:00:0${second}` });
    assert.match(told(heads(at(1), at(3), at(2))), /warn: By its EXIF time 2.jpg was not taken after 1.jpg/);
    assert.equal(told(heads(at(3), at(2), at(1))), '', 'from the last slice to the first is in order');
    const uneven = { ...scan, views: [view('a', 0), view('b', 20, 2, 0), { ...view('c', 40), problem: 'c has 1 slice; add the others' }] };
    const scanned = told({ purpose: 'scan', grouping: uneven, heads: new Map() });
    assert.match(scanned, /bad: c has 1 slice/);
    assert.match(scanned, /bad: b has 2 slices, and the profile/);
    assert.match(scanned, /warn: b: no back light, which the other views have/);
    assert.ok(scanned.indexOf('warn') > scanned.lastIndexOf('bad'), 'the worst first');
    const many = { front: names(1000), back: names(1000, 'back') };
    assert.deepEqual(worthReading([many], 3), ['front/0.jpg', 'front/500.jpg', 'front/999.jpg']);
  },
};

(async () => {
  for (const [name, test] of Object.entries(tests)) {
    await test();
    console.log(`${name}: ok`);
  }
  console.log('done');
})().catch((error) => { console.error(error); process.exitCode = 1; });
