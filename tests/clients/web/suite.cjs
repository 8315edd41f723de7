// The web pages in Chromium, as a person uses them. Usage: node suite.cjs SCENARIO URL FOLDER
// Any script error, any request to another server and anything that the content policy blocks fails the scenario.
'use strict';
const assert = require('node:assert/strict');
const fs = require('node:fs');
const path = require('node:path');
const { chromium } = require('playwright-core');

const [scenario, address, folder] = process.argv.slice(2);
// by its name the service is no secure context for the browser, as in a lab without TLS
const NAME = 'lab-pc.test';
const base = scenario === 'token' ? address.replace('127.0.0.1', NAME) : address;
const TUS = { 'tus-resumable': '1.0.0' };
const zip = path.join(folder, 'stack.zip');

/** A page that fails the scenario when something is wrong behind it. */
async function opened(browser, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(60000);
  const wrong = [];
  page.on('pageerror', (error) => wrong.push(error.message));
  page.on('console', (line) => { if (/content security policy|refused to/i.test(line.text())) wrong.push(line.text()); });
  page.on('request', (request) => { if (!/^(blob|data):/.test(request.url()) && !request.url().startsWith(base)) wrong.push(request.url()); });
  page.settled = () => assert.deepEqual(wrong, []);
  return page;
}

/** Fills the form for one stack. */
async function describe(page, rig = 'rig') {
  await page.goto(`${base}/send`);
  await page.fill('#rig', rig);
  await page.fill('#lens', 'lens');
}

const send = (page) => page.click('#go');
const done = (page) => page.waitForSelector('#state [data-state=succeeded]');

/** Opens the stack that was sent, when it is done. */
async function finished(page) {
  await page.click('#uploads a');
  await page.waitForURL(/\/stacks\//);
  await done(page);
}

/** Whether the canvas shows different colours. */
function colours(page) {
  return page.$eval('#viewer', (canvas) => {
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const seen = new Set();
    for (let at = 0; at < data.length; at += 4 * 97) seen.add((data[at] << 16) | (data[at + 1] << 8) | data[at + 2]);
    return seen.size;
  });
}

async function shows(page, least) {
  await page.waitForFunction(() => document.getElementById('readout').textContent.includes('shown at'));
  for (let tries = 0; tries < 200; tries += 1) {
    if (await colours(page) >= least) return;
    await page.evaluate(() => new Promise(requestAnimationFrame));
  }
  assert.fail(`the picture does not appear: ${await colours(page)} colours`);
}

const scenarios = {
  // a folder of slices becomes a picture; another run is shown beside it
  async upload(browser) {
    const page = await opened(browser);
    await describe(page);
    await page.fill('#label', 'from a folder');
    await page.setInputFiles('#folder', path.join(folder, 'slices'));
    await page.waitForSelector('#chosen >> text=8 pictures');
    await send(page);
    await finished(page);
    await page.waitForSelector('#viewer');
    await shows(page, 50);
    await page.selectOption('#layer', { label: 'Sharpest slice' });
    await page.selectOption('#other', { label: 'Mask' });
    await page.waitForSelector('#divider:not([hidden])');
    await page.click('text=Fuse again with other options');
    await page.selectOption('#rerun-method', 'pyramid');
    await page.click('#rerun button');
    await page.waitForSelector('text=Fused again from');
    await done(page);
    await page.waitForFunction(() => document.getElementById('other')?.selectedOptions[0]?.text.match(/^halo corrected, .*: Image$/));
    await shows(page, 50);
    page.settled();
    await page.goto(`${base}/stacks`);
    await page.waitForSelector('.thumb img');
    assert.equal(await page.locator('li[data-state=succeeded]').count(), 2);
    // a thumbnail arrives as a picture
    await page.waitForFunction(() => document.querySelector('.thumb img').naturalWidth > 0);
    page.settled();
  },

  // a folder of views becomes a scan, which is grouped before it is sent
  async scan(browser) {
    const page = await opened(browser);
    await describe(page);
    await page.check('input[value=scan]');
    await page.fill('#scan', 'bee');
    await page.setInputFiles('#folder', path.join(folder, 'views'));
    // as the server reads the names, before anything is sent
    await page.waitForSelector('#chosen table');
    assert.match(await page.textContent('#chosen'), /2 views[^]*pan000_tilt00[^]*pan020_tilt00/);
    assert.deepEqual(await page.locator('#chosen tbody tr').nth(1).locator('td').allTextContents(), ['views/pan020_tilt00', '20', '0', '4', '4', '']);
    // offered where the server has COLMAP
    const auto = page.locator('input[name=reconstruct]');
    const isOffered = await auto.count() === 1;
    if (isOffered) await auto.check();
    await send(page);
    await page.click('text=See the scan bee');
    await page.waitForSelector('.grid .view img');
    assert.equal(await page.locator('.grid .view').count(), 2);
    const made = await (await fetch(`${base}/v1/scans/bee`)).json();
    assert.deepEqual([made.reconstruct, made.expected_views], isOffered ? ['auto', 2] : ['on_request', null]);
    page.settled();
  },

  // without a dot target, a folder of views calibrates the rig
  async no_target(browser) {
    const page = await opened(browser);
    await describe(page, 'new');
    await page.check('input[value=no_target]');
    assert.deepEqual(await page.locator('[data-for]:visible label:visible').allTextContents(), ['Refine revision', 'Sensor width, mm', 'Pixel pitch, mm', 'Rail step, mm', 'What the rail moves']);
    await page.fill('#rail_step_mm', '0,5');
    await page.setInputFiles('#folder', path.join(folder, 'views'));
    await page.waitForSelector('#chosen table');
    await send(page);
    await page.click('text=See the calibration');
    await done(page);
    const { items: [{ options, result }] } = await (await fetch(`${base}/v1/calibrations?rig=new`)).json();
    assert.deepEqual([options.source, options.rail_step_mm], ['stacks', 0.5]);
    assert.match(result.verdict, /from 2 stacks/);
    await page.click('text=Open the report');
    assert.match(await page.textContent('dl'), /Pictures of objects, without a dot target/);
    page.settled();
  },

  // the line is cut in the middle of an upload, and the page is closed in the middle of another
  async cut(browser) {
    const bytes = fs.readFileSync(zip);
    const half = bytes.length >> 1;
    const page = await opened(browser);
    let offsets = [];
    let cuts = 1;
    await page.route('**/v1/uploads/*', async (route) => {
      const request = route.request();
      if (request.method() !== 'PATCH') return route.continue();
      offsets.push(Number(request.headers()['upload-offset']));
      if (cuts <= 0) return route.continue();
      cuts -= 1;
      // half of it arrives, then the line is cut
      const headers = { ...TUS, 'upload-offset': '0', 'content-type': 'application/offset+octet-stream' };
      const answer = await fetch(request.url(), { method: 'PATCH', headers, body: bytes.subarray(0, half) });
      assert.equal(answer.status, 204);
      return route.abort('connectionreset');
    });
    await describe(page);
    await page.setInputFiles('#file', zip);
    await send(page);
    await finished(page);
    assert.deepEqual(offsets, [0, half], 'it went on where it was cut');

    offsets = [];
    cuts = Infinity;
    await describe(page);
    await page.fill('#label', 'closed');
    await page.setInputFiles('#file', zip);
    // only the first request brings bytes: later ones are refused because of their offset
    await page.unroute('**/v1/uploads/*');
    await page.route('**/v1/uploads/*', async (route) => {
      const request = route.request();
      if (request.method() !== 'PATCH') return route.continue();
      const headers = { ...TUS, 'upload-offset': '0', 'content-type': 'application/offset+octet-stream' };
      await fetch(request.url(), { method: 'PATCH', headers, body: bytes.subarray(0, half) });
      return route.abort('connectionreset');
    });
    await send(page);
    await page.waitForSelector('#uploads >> text=the next attempt');
    page.on('dialog', (dialog) => dialog.accept());
    await page.unroute('**/v1/uploads/*');
    await page.route('**/v1/uploads/*', (route) => {
      if (route.request().method() === 'PATCH') offsets.push(Number(route.request().headers()['upload-offset']));
      return route.continue();
    });
    await describe(page);
    offsets = [];
    await page.fill('#label', 'closed');
    await page.setInputFiles('#file', zip);
    await send(page);
    await finished(page);
    assert.deepEqual(offsets, [half], 'a later visit went on');
    page.settled();
  },

  // a person stops an upload, lets it continue, and removes another
  async pause(browser) {
    const page = await opened(browser);
    let hold = true;
    let held;
    const isHeld = () => new Promise((resolve) => { held = resolve; });
    await page.route('**/v1/uploads/*', (route) => {
      if (!hold || route.request().method() !== 'PATCH') return route.continue();
      hold = false;
      return held();
    });
    await describe(page);
    await page.setInputFiles('#file', zip);
    let waiting = isHeld();
    await send(page);
    await waiting;
    await page.click('text=Pause');
    await page.waitForSelector('#uploads >> text=paused at');
    await page.click('#uploads >> text="Continue"');
    await finished(page);
    hold = true;
    await describe(page);
    await page.fill('#label', 'removed');
    await page.setInputFiles('#file', zip);
    waiting = isHeld();
    await send(page);
    await waiting;
    const removed = page.waitForResponse((response) => response.request().method() === 'DELETE');
    await page.click('text=Remove');
    assert.equal((await removed).status(), 204);
    await page.waitForSelector('#uploads li', { state: 'detached' });
    await page.goto(`${base}/stacks`);
    assert.equal(await page.locator('li[data-state]').count(), 1, 'nothing is left of what was removed');
    page.settled();
  },

  // the server has no workers: what is sent waits, and is cancelled and deleted with the keyboard alone
  async cancel(browser) {
    const page = await opened(browser);
    await describe(page);
    await page.setInputFiles('#file', zip);
    await send(page);
    await page.click('#uploads a');
    await page.waitForSelector('#state .state.soft >> text=Waiting');
    await page.focus('#cancel');
    await page.keyboard.press('Enter');
    await page.waitForSelector('dialog[open]');
    assert.equal(await page.evaluate(() => document.activeElement.textContent), 'Keep it', 'the safe answer has the focus');
    await page.keyboard.press('Enter');
    await page.waitForSelector('dialog', { state: 'detached' });
    assert.equal(await page.locator('#state >> text=Waiting').count(), 1, 'nothing happened');
    await page.focus('#cancel');
    await page.keyboard.press('Enter');
    await page.keyboard.press('Tab');
    await page.keyboard.press('Enter');
    await page.waitForSelector('#state >> text=Cancelled');
    await page.focus('#delete');
    await page.keyboard.press('Enter');
    await page.keyboard.press('Tab');
    await page.keyboard.press('Enter');
    await page.waitForSelector('text=There are no stacks yet');
    page.settled();
  },

  // what is refused is told in the words of the server, and nothing that was typed is lost
  async error(browser) {
    const page = await opened(browser);
    await describe(page, 'Rig');
    await page.setInputFiles('#file', zip);
    await send(page);
    await page.waitForSelector("#uploads >> text=There is no profile for rig 'Rig'");
    assert.match(await page.textContent('#uploads'), /there is rig 'rig'/);
    assert.equal(await page.inputValue('#lens'), 'lens');
    await page.setInputFiles('#file', path.join(folder, 'notes.txt'));
    await page.waitForSelector('#told >> text=There are no JPEG, PNG or TIFF pictures');
    page.settled();
  },

  // from the list to the pixels without a mouse
  async keyboard(browser) {
    const page = await opened(browser);
    await page.goto(`${base}/stacks`);
    await page.keyboard.press('Tab');
    assert.equal(await page.evaluate(() => document.activeElement.textContent), 'Skip to the content');
    await page.keyboard.press('Enter');
    const focused = () => page.evaluate(() => document.activeElement.className || document.activeElement.id);
    for (let presses = 0; await focused() !== 'name'; presses += 1) {
      assert.ok(presses < 30, 'the first stack can be reached');
      await page.keyboard.press('Tab');
    }
    const outline = await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle);
    assert.notEqual(outline, 'none', 'the focus is visible');
    await page.keyboard.press('Enter');
    await page.waitForSelector('#viewer');
    await shows(page, 50);
    for (let presses = 0; await focused() !== 'viewer'; presses += 1) {
      assert.ok(presses < 30, 'the viewer can be reached');
      await page.keyboard.press('Tab');
    }
    const before = await page.textContent('#readout');
    await page.keyboard.press('+');
    await page.waitForFunction((text) => document.getElementById('readout').textContent !== text, before);
    await page.keyboard.press('1');
    await page.waitForFunction(() => document.getElementById('readout').textContent.includes('100 %'));
    await page.keyboard.press('ArrowRight');
    await page.keyboard.press('0');
    await page.waitForFunction((text) => document.getElementById('readout').textContent === text, before);
    page.settled();
  },

  // the first look at a large picture takes the server seconds: the page says so, and says when it fails
  async loading(browser) {
    const page = await opened(browser);
    const { items: [stack] } = await (await fetch(`${base}/v1/stacks`)).json();
    const asked = [];
    let answer;
    const prepared = new Promise((resolve) => { answer = resolve; });
    await page.route('**/tiles/**', async (route) => {
      asked.push(new URL(route.request().url()).pathname.split('/').slice(-4).join('/'));
      if (route.request().url().includes('/mask/')) return route.abort();
      await prepared;
      return route.continue();
    });
    const reads = (text) => page.waitForFunction((part) => document.getElementById('readout').textContent.includes(part), text);
    await page.goto(`${base}/stacks/${stack.id}`);
    await reads('loading');
    await page.focus('#viewer');
    await page.keyboard.press('1');
    await reads('100 %');
    await page.keyboard.press('ArrowRight');
    assert.equal(asked.length, 1, `only one request waits: ${asked}`);
    answer();
    await shows(page, 50);
    await page.waitForFunction(() => !document.getElementById('readout').textContent.includes('loading'));
    await page.selectOption('#layer', { label: 'Mask' });
    await reads('a part cannot be loaded');
    page.settled();
  },

  // no page has a fault that axe knows, in either theme
  async axe(browser) {
    const { source } = require('axe-core');
    const { items: [stack] } = await (await fetch(`${base}/v1/stacks`)).json();
    const pages = ['/', '/stacks', '/stacks?q=from&verdict=use', `/stacks/${stack.id}`, '/send', '/scans', '/scans/bee', '/profiles', '/profiles/rig/lens', '/stacks/none',
      '/plan?focal_mm=65&f_number=5.6&magnification=1&pixel_pitch_um=4.14&object_depth_mm=5&mode=fixed_lens&image_width=6000&image_height=4000'];
    for (const colorScheme of ['light', 'dark']) {
      const page = await opened(browser, { colorScheme });
      for (const where of pages) {
        await page.goto(base + where);
        await page.evaluate(source);
        const { violations } = await page.evaluate(() => globalThis.axe.run());
        const found = violations.map(({ id, nodes }) => `${colorScheme} ${where}: ${id}: ${nodes.map(({ html, failureSummary }) => `${html} ${failureSummary}`).join('; ')}`);
        assert.deepEqual(found, []);
      }
      // both forms with all that they show
      await page.goto(`${base}/send?purpose=calibration`);
      await page.setInputFiles('#folder', path.join(folder, 'views'));
      await page.waitForSelector('.thirds canvas, .findings');
      await page.evaluate(source);
      for (const purpose of ['calibration', 'scan']) {
        await page.check(`input[value=${purpose}]`);
        const { violations } = await page.evaluate(() => globalThis.axe.run());
        assert.deepEqual(violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html)}`), [], purpose);
      }
      page.settled();
      await page.context().close();
    }
  },

  // a token in the form opens the pages, and signing out closes them
  async token(browser) {
    const page = await opened(browser);
    const secret = fs.readFileSync(path.join(folder, 'token'), 'utf8').trim();
    await page.goto(`${base}/send`);
    await page.waitForURL(/\/sign-in/);
    await page.fill('#token', 'pinstack_wrong');
    await page.keyboard.press('Enter');
    await page.waitForSelector('[role=alert] >> text=This is not a token');
    await page.fill('#token', secret);
    await page.keyboard.press('Enter');
    await page.waitForSelector('text=Send pictures');
    assert.equal(new URL(page.url()).pathname, '/send', 'on to the page that was asked for');
    assert.equal(await page.evaluate(() => document.cookie), '', 'no script sees the token');
    // a change by the script of a page
    await page.fill('#rig', 'rig');
    await page.fill('#lens', 'lens');
    await page.setInputFiles('#file', zip);
    await send(page);
    await page.waitForSelector("#uploads >> text=There is no profile for rig 'rig'");
    await page.click('text=Sign out');
    await page.goto(`${base}/scans`);
    await page.waitForURL(/\/sign-in/);
    page.settled();
  },
};

Object.assign(scenarios, require('./scenes.cjs')({ opened, base, folder }));
Object.assign(scenarios, require('./comparing.cjs')({ opened, base }));
Object.assign(scenarios, require('./mending.cjs')({ base, opened }));
Object.assign(scenarios, require('./forms.cjs')({ base, folder, opened, describe, send, finished, zip, TUS }));

(async () => {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || '/usr/bin/chromium', args: ['--no-sandbox', '--disable-gpu', '--enable-unsafe-swiftshader', '--disable-quic', `--host-resolver-rules=MAP ${NAME} 127.0.0.1`] });
  try {
    await scenarios[scenario](browser);
    console.log(`${scenario}: done`);
  } finally {
    await browser.close();
  }
})().catch((error) => { console.error(error); process.exitCode = 1; });
