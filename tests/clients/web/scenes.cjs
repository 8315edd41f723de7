// The scenarios of the pages that draw in three dimensions: the ball of views, the relief of a height map, the model.
'use strict';
const assert = require('node:assert/strict');
const fs = require('node:fs');
const path = require('node:path');

const POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/** The colours of a part of the page as a person sees them, and the number of pixels of each. */
async function seen(page, selector) {
  const png = (await page.locator(selector).screenshot()).toString('base64');
  const counts = await page.evaluate(async (text) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    const brush = canvas.getContext('2d');
    brush.drawImage(image, 0, 0);
    const { data } = brush.getImageData(0, 0, image.width, image.height);
    const found = {};
    for (let at = 0; at < data.length; at += 4) {
      const colour = `${data[at] >> 4},${data[at + 1] >> 4},${data[at + 2] >> 4}`;
      found[colour] = (found[colour] ?? 0) + 1;
    }
    return found;
  }, png);
  return counts;
}

const colours = async (page, selector) => Object.keys(await seen(page, selector)).length;

/** Waits until what is seen differs from `before`, and returns it. */
async function changed(page, selector, before) {
  for (let tries = 0; tries < 100; tries += 1) {
    const now = await seen(page, selector);
    if (JSON.stringify(now) !== JSON.stringify(before)) return now;
  }
  return assert.fail(`${selector} stays as it is`);
}

/** Waits for a text in an element. */
const reads = (page, selector, text) => page.waitForFunction(([one, part]) => document.querySelector(one)?.textContent.includes(part), [selector, text]);

async function faults(page, where) {
  await page.evaluate(require('axe-core').source);
  const { violations } = await page.evaluate(() => globalThis.axe.run());
  assert.deepEqual(violations.map(({ id, nodes }) => `${where}: ${id}: ${nodes.map(({ html }) => html).join('; ')}`), []);
}

/** A model: the points of a ball, cameras around it, and a hull of one tetrahedron. */
function model(stack, count = 5000) {
  const points = Buffer.alloc(15 * count);
  for (let k = 0; k < count; k += 1) {
    const [z, angle] = [1 - (2 * (k + 0.5)) / count, k * 2.39996];
    const at = [Math.cos(angle) * Math.sqrt(1 - z * z), Math.sin(angle) * Math.sqrt(1 - z * z), z];
    at.forEach((value, axis) => points.writeFloatLE(value + 100, 15 * k + 4 * axis));
    points.set([60 + 195 * (z > 0), 120 + 100 * at[0], 120 + 100 * at[1]], 15 * k + 12);
  }
  const kinds = ['float x', 'float y', 'float z', 'uchar red', 'uchar green', 'uchar blue'].map((one) => `property ${one}\n`).join('');
  const head = (vertices, more = '') => Buffer.from(`ply\nformat binary_little_endian 1.0\nelement vertex ${vertices}\n${kinds}${more}end_header\n`);
  const corners = Buffer.alloc(60);
  [[0, 0, 0.8], [0.7, 0, -0.4], [-0.4, 0.6, -0.4], [-0.4, -0.6, -0.4]].forEach((at, k) => {
    at.forEach((value, axis) => corners.writeFloatLE(value + 100, 15 * k + 4 * axis));
    corners.set([200, 170, 60], 15 * k + 12);
  });
  const faces = Buffer.concat([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]].map((face) => Buffer.concat([Buffer.of(3), Buffer.from(Int32Array.from(face).buffer)])));
  const cameras = Array.from({ length: 12 }, (_, k) => {
    const pan = (k * Math.PI) / 6;
    const [s, c] = [Math.sin(pan), Math.cos(pan)];
    const camera = { name: `pan${String(30 * k).padStart(3, '0')}_tilt00`, stack: `/v1/stacks/${stack}`, registered: k !== 5 };
    const shape = { width: 600, height: 400, focal_px: 900, principal_point: [300, 200] };
    return { ...camera, ...shape, center: k === 5 ? null : [100 + 4 * c, 100 + 4 * s, 100], rotation: [-s, c, 0, 0, 0, -1, -c, -s, 0] };
  });
  const turntable = { center: [100, 100, 100], axis: [0, 0, 1], radius: 4 };
  return {
    points: Buffer.concat([head(count), points]),
    hull: Buffer.concat([head(4, 'element face 4\nproperty list uchar int vertex_indices\n'), corners, faces]),
    cameras: JSON.stringify({ cameras, turntable }),
  };
}

/** Shows the page of a model with these files. */
async function modelPage(page, { base, folder }, files) {
  await page.route('**/model-test**', (route) => {
    const name = new URL(route.request().url()).pathname.split('/')[2];
    if (name) return files[name] === undefined ? route.fulfill({ status: 404, body: '' }) : route.fulfill({ body: files[name] });
    const viewer = fs.readFileSync(path.join(folder, 'model.html'), 'utf8');
    const style = viewer.match(/"([^"]*\/)model\.js"/)[1];
    const body = `<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
      <title>Model</title><link rel="stylesheet" href="${style}app.css"></head><body><main><h1>Model</h1>${viewer}</main></body></html>`;
    return route.fulfill({ body, contentType: 'text/html; charset=utf-8', headers: { 'content-security-policy': POLICY } });
  });
  await page.goto(`${base}/model-test`);
}

module.exports = ({ opened, base, folder }) => {
  const firstStack = async () => (await (await fetch(`${base}/v1/stacks`)).json()).items[0].id;

  return {
    // the ball of views: by mouse, by finger, and by keyboard alone
    async ball(browser) {
      const page = await opened(browser);
      await page.goto(`${base}/scans/bee`);
      await page.waitForSelector('#ball:not([hidden])');
      const still = await changed(page, '#ball-canvas', null);
      await page.focus('#ball-canvas');
      await page.keyboard.press('ArrowRight');
      const turned = await changed(page, '#ball-canvas', still);
      await page.keyboard.press('+');
      await changed(page, '#ball-canvas', turned);
      await page.keyboard.press('0');
      await page.keyboard.press('n');
      await reads(page, '#ball-told', 'pan000_tilt00');
      await page.keyboard.press('n');
      await reads(page, '#ball-told', 'pan020_tilt00');
      await page.keyboard.press('n');
      await reads(page, '#ball-told', 'pan000_tilt00');
      await page.keyboard.press('p');
      await reads(page, '#ball-told', 'pan020_tilt00');
      const href = await page.getAttribute('#ball-told a', 'href');
      await page.keyboard.press('Enter');
      await page.waitForURL(`**${href}`);
      await page.waitForSelector('#viewer');
      page.settled();

      // the place of the first view: turned until it is in the middle, it is hit there
      await page.goBack();
      await page.waitForSelector('#ball:not([hidden])');
      const box = await page.locator('#ball-canvas').boundingBox();
      const middle = [box.x + box.width / 2, box.y + box.height / 2];
      await page.mouse.move(...middle);
      await page.mouse.down();
      await page.mouse.move(middle[0] - Math.PI / 3 / 0.008, middle[1] - 0.5 / 0.008, { steps: 8 });
      await page.mouse.up();
      await page.mouse.move(...middle);
      await reads(page, '#ball-told', 'pan000_tilt00');
      assert.match(await page.textContent('#ball-told'), /Use it|Look at it|Do not use it/);
      await page.mouse.click(...middle);
      await page.waitForURL(/\/stacks\//);
      page.settled();

      const finger = await opened(browser, { hasTouch: true, viewport: { width: 360, height: 740 } });
      await finger.goto(`${base}/scans/bee`);
      await finger.waitForSelector('#ball:not([hidden])');
      await finger.focus('#ball-canvas');
      for (let presses = 0; presses < 6; presses += 1) await finger.keyboard.press('ArrowRight');
      for (let presses = 0; presses < 3; presses += 1) await finger.keyboard.press('ArrowDown');
      await finger.locator('#ball-canvas').scrollIntoViewIfNeeded();
      const small = await finger.locator('#ball-canvas').boundingBox();
      const tap = () => finger.touchscreen.tap(small.x + small.width / 2, small.y + small.height / 2);
      await tap();
      await reads(finger, '#ball-told', 'pan000_tilt00');
      assert.match(finger.url(), /scans\/bee$/, 'the first touch chooses');
      await tap();
      await finger.waitForURL(/\/stacks\//);
      finger.settled();
    },

    // every view of a scan is within the width of its page, on paper too
    async widths(browser) {
      const scan = await (await fetch(`${base}/v1/scans/bee`)).json();
      const source = await (await fetch(`${base}/scans/bee`)).text();
      // the same view at 18 pans
      const item = source.match(/<ul class="ring"><li>(.*?)<\/li>/)[1];
      const items = Array.from({ length: 18 }, (_, k) => `<li>${item.replace('0°', `${20 * k}°`)}</li>`).join('');
      for (const width of [1440, 820, 360]) {
        const page = await opened(browser, { viewport: { width, height: 800 } });
        await page.route('**/scans/bee', (route) => route.fulfill({
          body: source.replace(/<ul class="ring">.*?<\/ul>/, `<ul class="ring">${items}</ul>`), contentType: 'text/html; charset=utf-8', headers: { 'content-security-policy': POLICY },
        }));
        await page.goto(`${base}/scans/bee`);
        await page.waitForSelector('#ball:not([hidden])');
        const beyond = () => page.evaluate(() => [...document.querySelectorAll('.ring li, .folding td, main > *')]
          .filter((one) => one.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map((one) => one.outerHTML.slice(0, 80)));
        assert.deepEqual(await beyond(), [], `${width} px`);
        assert.equal(await page.locator('.ring li:visible').count(), 18);
        assert.equal(await page.locator('.folding tbody tr:visible').count(), scan.views.length);
        await faults(page, `${width} px`);
        await page.emulateMedia({ media: 'print' });
        assert.deepEqual(await beyond(), [], `${width} px of paper`);
        assert.equal(await page.locator('#ball').isVisible(), false, 'paper has the text');
        page.settled();
        await page.context().close();
      }
    },

    // the heights of a stack as a relief, of the sharpest slices or of a height map
    async relief(browser) {
      const stack = await firstStack();
      const headers = { 'content-type': 'application/json', prefer: 'wait=60' };
      const answer = await fetch(`${base}/v1/stacks/${stack}/rerun`, { method: 'POST', headers, body: '{"height":"auto"}' });
      const { id } = await answer.json();
      for (const [which, words] of [[stack, 'steps between slices'], [id, 'Heights from']]) {
        const page = await opened(browser);
        await page.goto(`${base}/stacks/${which}`);
        await page.waitForSelector('#state [data-state=succeeded]');
        await page.waitForSelector('#relief:not([hidden])');
        await page.focus('#relief');
        await page.keyboard.press('Enter');
        await reads(page, '#relief-told', words);
        for (let tries = 0; await colours(page, '#relief-canvas') < 20; tries += 1) assert.ok(tries < 100, 'the relief appears');
        const before = await seen(page, '#relief-canvas');
        await page.focus('#stretch');
        await page.keyboard.press('End');
        await reads(page, '#stretch-told', '4.0');
        const high = await changed(page, '#relief-canvas', before);
        await page.selectOption('#relief-colour', { label: 'Sharpest slice' });
        const coloured = await changed(page, '#relief-canvas', high);
        await page.focus('#relief-canvas');
        await page.keyboard.press('ArrowLeft');
        await changed(page, '#relief-canvas', coloured);
        await faults(page, 'relief');
        await page.click('#relief');
        assert.equal(await page.locator('#relief-canvas').isVisible(), false);
        page.settled();
        await page.context().close();
      }
    },

    // colour, slice and length at the pointer, by keyboard, and by finger
    async values(browser) {
      const stack = await firstStack();
      const page = await opened(browser, { hasTouch: true });
      await page.goto(`${base}/stacks/${stack}`);
      await reads(page, '#readout', 'shown at');
      await page.focus('text=Values and lengths');
      await page.keyboard.press('Enter');
      await page.focus('#viewer');
      await reads(page, '#values', 'In the middle: x ');
      await reads(page, '#values', 'sharpest in slice');
      await page.keyboard.press('m');
      await reads(page, '#values', 'length 0.0 px');
      await page.keyboard.press('ArrowLeft');
      await page.waitForFunction(() => /length [1-9]/.test(document.getElementById('values').textContent));
      await page.keyboard.press('m');
      const box = await page.locator('#viewer').boundingBox();
      const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
      await page.mouse.move(x - 30, y);
      await page.waitForFunction(() => /^x \d+, y \d+ · colour \d+ \d+ \d+, alpha \d+/.test(document.getElementById('values').textContent));
      await page.mouse.click(x - 30, y);
      await page.touchscreen.tap(x + 30, y);
      await reads(page, '#values', 'length ');
      await faults(page, 'values');
      await page.click('text=Values and lengths');
      await page.waitForFunction(() => document.getElementById('values').textContent === '');
      page.settled();
    },

    // the model of a reconstruction, from files that this scenario makes
    async model(browser) {
      const stack = await firstStack();
      const files = model(stack);
      for (const colorScheme of ['light', 'dark']) {
        const page = await opened(browser, { colorScheme });
        await modelPage(page, { base, folder }, files);
        await reads(page, '.model', '5,000 points, 11 of 12 cameras');
        for (let tries = 0; await colours(page, '.model canvas') < 20; tries += 1) assert.ok(tries < 100, 'the model appears');
        let last = await seen(page, '.model canvas');
        for (const name of ['points', 'mesh', 'cameras', 'turntable']) {
          await page.uncheck(`.model input[name=${name}]`);
          last = await changed(page, '.model canvas', last);
        }
        const all = Object.values(last).reduce((sum, one) => sum + one);
        // but the frame
        assert.ok(Math.max(...Object.values(last)) > 0.99 * all, `nothing is left: ${JSON.stringify(last)}`);
        await page.check('.model input[name=hull]');
        last = await changed(page, '.model canvas', last);
        await page.check('.model input[name=cameras]');
        await page.focus('.model canvas');
        await page.keyboard.press('n');
        await reads(page, '.model [role=status]', 'pan000_tilt00');
        await faults(page, colorScheme);
        await page.keyboard.press('Enter');
        await page.waitForURL(`**/stacks/${stack}`);
        page.settled();
        await page.context().close();
      }
      const page = await opened(browser);
      await modelPage(page, { base, folder }, { ...files, hull: undefined });
      await reads(page, '.model [role=status]', 'cannot be loaded (404)');
      await modelPage(page, { base, folder }, { ...files, points: files.points.subarray(0, 400) });
      await reads(page, '.model [role=status]', 'ends too early');
      page.settled();
    },

    // no test, a measurement: how long a frame of two million points takes, at rest and while it is turned
    async frames(browser) {
      const page = await opened(browser);
      await page.goto(`${base}/scans`);
      const told = await page.evaluate(async () => {
        const { Scene } = await import(document.querySelector('link[rel=stylesheet]').href.replace('app.css', 'scene.js'));
        const place = document.querySelector('main').appendChild(Object.assign(document.createElement('div'), { className: 'scene' }));
        const canvas = place.appendChild(document.createElement('canvas'));
        const count = 2e6;
        const [positions, colours] = [new Float32Array(3 * count), new Uint8Array(4 * count).fill(255)];
        // a ball, in an order in which each beginning is spread over all of it
        for (let k = 0; k < count; k += 1) {
          const [z, angle] = [1 - 2 * ((k * 0.6180339887) % 1), k * 2.39996];
          const flat = Math.sqrt(1 - z * z);
          positions.set([flat * Math.cos(angle), flat * Math.sin(angle), z], 3 * k);
          colours.set([128 + 100 * z, 128, 128 - 100 * z], 4 * k);
        }
        const scene = new Scene(canvas);
        scene.set('points', { kind: 'points', positions, colours, size: 2.2 / Math.sqrt(count) });
        const frame = () => new Promise(requestAnimationFrame);
        await frame();
        const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];
        const still = [];
        for (let k = 0; k < 5; k += 1) {
          scene.isMoving = false;
          const began = performance.now();
          scene.paint();
          // waits for the picture
          scene.gl.readPixels(0, 0, 1, 1, scene.gl.RGBA, scene.gl.UNSIGNED_BYTE, new Uint8Array(4));
          still.push(performance.now() - began);
        }
        const turning = [];
        for (let k = 0; k < 60; k += 1) {
          scene.orbit.turn(0.05, 0);
          scene.took = undefined;
          while (scene.took === undefined) await frame();
          turning.push(scene.took);
        }
        return { px: [canvas.width, canvas.height], still_ms: median(still), turning_ms: median(turning.slice(30)), drawn: scene.share };
      });
      console.log(`2000000 points, ${told.px.join(' x ')} px: ${told.still_ms.toFixed(0)} ms at rest, ${told.turning_ms.toFixed(0)} ms while turned (${(100 * told.drawn).toFixed(0)} % of the points)`);
      page.settled();
    },

    // without WebGL 2 or without scripts there is the text, and no empty place
    async no_webgl(browser) {
      const stack = await firstStack();
      const page = await opened(browser);
      await page.addInitScript(() => {
        const before = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function get(kind, ...rest) { return kind === 'webgl2' ? null : before.call(this, kind, ...rest); };
      });
      const plain = await opened(browser, { javaScriptEnabled: false });
      for (const one of [page, plain]) {
        await one.goto(`${base}/scans/bee`);
        assert.equal(await one.locator('.grid .view').count(), 2);
        assert.equal(await one.locator('#ball').isVisible(), false);
        await one.goto(`${base}/stacks/${stack}`);
        assert.equal(await one.locator('#relief').isVisible(), false);
        one.settled();
      }
    },
  };
};
module.exports.model = model;
module.exports.seen = seen;
module.exports.changed = changed;
module.exports.reads = reads;
module.exports.faults = faults;
module.exports.modelPage = modelPage;
