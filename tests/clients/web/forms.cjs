// Scenarios of the forms: what is told before anything is sent, the camera of a profile, and what happens to an upload
// when the sign-in ends or the server is gone. `suite.cjs` gives them what all scenarios use.
'use strict';
const assert = require('node:assert/strict');
const fs = require('node:fs');
const path = require('node:path');

module.exports = ({ base, folder, opened, describe, send, finished, zip, TUS }) => {
  /** Requests that send something, from now on. */
  function sending(page) {
    const seen = [];
    page.on('request', (request) => {
      if (request.method() !== 'GET' && !request.url().endsWith('/v1/groupings')) seen.push(`${request.method()} ${request.url()}`);
    });
    return seen;
  }
  const chosen = (page, text) => page.waitForFunction((part) => document.getElementById('chosen').textContent.includes(part), text);
  async function tabTo(page, id) {
    for (let presses = 0; await page.evaluate(() => document.activeElement.id) !== id; presses += 1) {
      assert.ok(presses < 60, `${id} can be reached`);
      await page.keyboard.press('Tab');
    }
  }
  /** Presses Enter until a chooser of files opens: a busy browser opens none when the permission by the key has expired. */
  async function chooser(page) {
    for (let presses = 0; presses < 8; presses += 1) {
      const opens = page.waitForEvent('filechooser', { timeout: 8000 }).catch(() => null);
      await page.keyboard.press('Enter');
      const found = await opens;
      if (found) return found;
    }
    return assert.fail('no chooser of files opens');
  }
  /** Copies a folder of slices under another name, without some of them. */
  function copied(from, to, without = []) {
    fs.mkdirSync(to, { recursive: true });
    for (const name of fs.readdirSync(from)) if (!without.includes(name)) fs.copyFileSync(path.join(from, name), path.join(to, name));
  }

  return {
    // from the choice to the result without a mouse; nothing is sent before the person says so
    async told(browser) {
      const page = await opened(browser);
      const seen = sending(page);
      await page.goto(`${base}/send`);
      await tabTo(page, 'pick-folder');
      await (await chooser(page)).setFiles(path.join(folder, 'slices'));
      await chosen(page, 'One stack: 4 slices, front and back light');
      await page.waitForFunction(() => document.querySelectorAll('.thirds canvas').length === 3);
      assert.match(await page.textContent('#summary'), /One stack: 4 slices/);
      for (const [id, text] of [['rig', 'rig'], ['lens', 'other']]) {
        await tabTo(page, id);
        await page.keyboard.press('Control+A');
        await page.keyboard.type(text);
      }
      await chosen(page, 'There is no profile of the rig rig with the lens other');
      await page.keyboard.press('Control+A');
      await page.keyboard.type('lens');
      await chosen(page, 'Nothing was found that does not fit');
      assert.deepEqual(seen, [], 'nothing was sent');
      await tabTo(page, 'go');
      await page.keyboard.press('Enter');
      await finished(page);
      // the next visit knows rig and lens
      await page.goto(`${base}/send`);
      assert.deepEqual([await page.inputValue('#rig'), await page.inputValue('#lens')], ['rig', 'lens']);
      page.settled();
    },

    // what does not fit is told with its cure, in a zip as in a folder, and names in all writings are read
    async misfits(browser) {
      const page = await opened(browser);
      const seen = sending(page);
      await describe(page);
      await page.setInputFiles('#file', zip);
      await chosen(page, 'One stack: 4 slices, front and back light');
      await page.waitForFunction(() => document.querySelectorAll('.thirds canvas').length === 3);
      const front = path.join(folder, 'slices', 'front');
      const bad = path.join(folder, 'schlecht');
      copied(front, path.join(bad, 'vorne'), ['img_3.jpg']);
      fs.writeFileSync(path.join(bad, 'vorne', 'img_2.jpg'), 'no picture');
      copied(front, path.join(bad, 'vorne'), ['img_3.jpg', 'img_2.jpg', 'img_1.jpg']);
      fs.copyFileSync(path.join(front, 'img_1.jpg'), path.join(bad, 'vorne', 'img_5.jpg'));
      await page.setInputFiles('#folder', bad);
      await chosen(page, 'img_2.jpg: no JPEG, PNG or TIFF picture');
      await chosen(page, 'No back light: the result has no mask');
      const scan = path.join(folder, '甲虫');
      for (const [view, without] of [['pan000_tilt00', []], ['pan020_tilt00', ['img_4.jpg']], ['pan040_tilt00', []]]) {
        copied(front, path.join(scan, view, 'خنفساء', 'front'), without);
        if (view !== 'pan040_tilt00') copied(path.join(folder, 'slices', 'back'), path.join(scan, view, 'خنفساء', 'back'), without);
      }
      await page.setInputFiles('#folder', scan);
      await chosen(page, 'A scan: 3 views of 4 slices');
      const told = await page.textContent('#chosen');
      assert.match(told, /pan020_tilt00[^.]* has 3 slices, and the profile of this rig and lens has 4\. Add or remove slices/);
      assert.match(told, /pan040_tilt00[^.]*: no back light, which the other views have\. Add its slices in a folder back/);
      assert.equal(await page.isChecked('input[value=scan]'), true, 'it is taken for what it is');
      await page.click('.views button >> nth=1');
      await page.waitForSelector('.slices h2 >> text=pan020_tilt00');
      assert.deepEqual(seen, [], 'nothing was sent');
      page.settled();
    },

    // a folder of 3,000 files stays quick
    async many(browser) {
      const page = await opened(browser);
      const picture = fs.readFileSync(path.join(folder, 'slices', 'front', 'img_1.jpg'));
      for (let view = 0; view < 75; view += 1) {
        const at = path.join(folder, 'many', `pan${String(view * 4).padStart(3, '0')}_tilt00`);
        fs.mkdirSync(at, { recursive: true });
        for (let slice = 0; slice < 40; slice += 1) fs.writeFileSync(path.join(at, `${slice}.jpg`), picture);
      }
      await describe(page);
      const began = Date.now();
      await page.setInputFiles('#folder', path.join(folder, 'many'));
      await chosen(page, 'A scan: 75 views of 40 slices');
      // the longest time for which the page does not answer to a key
      const longest = await page.evaluate(async () => {
        let longest = 0;
        let last = performance.now();
        for (const end = last + 3000; last < end;) {
          await new Promise((resolve) => { setTimeout(resolve); });
          longest = Math.max(longest, performance.now() - last);
          last = performance.now();
        }
        return longest;
      });
      console.log(`told after ${Date.now() - began - 3000} ms, longest pause ${Math.round(longest)} ms`);
      assert.ok(longest < 3000, `${longest} ms`);
      page.settled();
    },

    // a profile without a camera says so, here and on the page of a scan, and gets one without an upload
    async camera(browser) {
      const page = await opened(browser);
      const line = 'No camera: reconstruction must estimate the focal length';
      await page.goto(`${base}/scans/bee`);
      await page.waitForSelector(`text=${line}`);
      await page.click('text=Add the camera');
      await page.waitForURL(/\/profiles\/rig\/lens#camera/);
      const type = async (id, text) => { await tabTo(page, id); await page.keyboard.type(text); };
      await type('sensor_width_mm', '2,4');
      assert.equal(await page.inputValue('#pixel_pitch_mm'), '0.01', 'of 240 pixels');
      await type('focal_mm', '65');
      await page.keyboard.press('Enter');
      await page.waitForSelector('#told >> text=give magnification');
      await type('magnification', '1');
      await page.keyboard.press('Enter');
      await page.waitForSelector('dd >> text=± ');
      assert.match(await page.textContent('#camera'), /130\.000 ± \d.* = 13000\.0 px, rough, from the focal length as given/);
      // its results were made without it
      await page.goto(`${base}/scans/bee`);
      assert.match(await page.textContent('main'), /The profile has one by now: “Fuse all again” gives it to every view/);
      // the form of a calibration asks for it, and offers what EXIF says
      await page.goto(`${base}/send?purpose=calibration`);
      await page.setInputFiles('#folder', path.join(folder, 'slices'));
      await chosen(page, 'A dot target: 4 slices');
      assert.equal(await page.locator('.field:visible label').count(), 9);
      page.settled();
    },

    // a sign-in that ends in the middle of an upload loses nothing
    async signed_out(browser) {
      const bytes = fs.readFileSync(zip);
      const half = bytes.length >> 1;
      const page = await opened(browser);
      let signedIn = true;
      const offsets = [];
      await page.route('**/v1/uploads/*', async (route) => {
        const request = route.request();
        if (!signedIn) return route.fulfill({ status: 401, contentType: 'application/problem+json', body: '{"detail":"a token is needed","code":"unauthorized"}' });
        if (request.method() !== 'PATCH') return route.continue();
        offsets.push(Number(request.headers()['upload-offset']));
        if (offsets.length > 1) return route.continue();
        const headers = { ...TUS, 'upload-offset': '0', 'content-type': 'application/offset+octet-stream' };
        await fetch(request.url(), { method: 'PATCH', headers, body: bytes.subarray(0, half) });
        signedIn = false;
        return route.abort('connectionreset');
      });
      await describe(page);
      await page.setInputFiles('#file', zip);
      await send(page);
      await page.waitForSelector('#uploads >> text=Sign in in another tab');
      assert.match(await page.getAttribute('#uploads a', 'href'), /\/sign-in\?next=%2Fsend/);
      assert.equal(new URL(page.url()).pathname, '/send', 'the page with the files stays');
      signedIn = true;
      await page.evaluate(() => window.dispatchEvent(new Event('focus')));
      await page.waitForSelector('#uploads >> text=See the stack');
      await finished(page);
      assert.deepEqual(offsets, [0, half], 'it went on where it was');
      page.settled();
    },

    // a server that is gone is told, and the page goes on when it is back
    async gone(browser) {
      const page = await opened(browser);
      await page.addInitScript(() => {
        const wait = globalThis.setTimeout;
        globalThis.setTimeout = (run, ms) => wait(run, Math.min(ms, 50));
      });
      await page.goto(`${base}/stacks`);
      await page.route('**/stacks?part=rows', (route) => route.abort('connectionrefused'));
      await page.waitForSelector('[role=alert] >> text=The server does not answer');
      await page.unroute('**/stacks?part=rows');
      await page.waitForSelector('text=The server does not answer', { state: 'detached' });
      page.settled();
    },
  };
};
