// The scenarios of the viewer's divider, of the slider through the slices, and of runs beside each other.
'use strict';
const assert = require('node:assert/strict');
const { changed, faults, reads, seen } = require('./scenes.cjs');

/** Nothing reaches beyond the width of the page. */
const isWide = (page) => page.evaluate(() => document.documentElement.scrollWidth > document.documentElement.clientWidth);

module.exports = ({ opened, base }) => {
  const stacks = async () => (await (await fetch(`${base}/v1/stacks`)).json()).items;

  /** Fuses a stack again and returns the id of the run. */
  async function again(stack, options) {
    const headers = { 'content-type': 'application/json', prefer: 'wait=60' };
    const answer = await fetch(`${base}/v1/stacks/${stack}/rerun`, { method: 'POST', headers, body: JSON.stringify(options) });
    return (await answer.json()).id;
  }

  /** Opens a stack, at the pixels of its picture. */
  async function atPixels(page, where) {
    await page.goto(base + where);
    await reads(page, '#readout', 'shown at');
    await page.focus('#viewer');
    await page.keyboard.press('1');
    await reads(page, '#readout', '100 %');
    await page.waitForFunction(() => !document.getElementById('readout').textContent.includes('loading'));
  }

  const place = async (page) => Number(await page.inputValue('#divider'));

  return {
    // any two pictures, the divider dragged by mouse, finger and keyboard
    async divider(browser) {
      const { id } = (await stacks()).at(-1);
      for (const colorScheme of ['light', 'dark']) {
        const page = await opened(browser, { colorScheme });
        await page.goto(`${base}/stacks/${id}`);
        await reads(page, '#readout', 'shown at');
        assert.equal(await page.locator('#divider').isVisible(), false);
        const whole = await seen(page, '.viewer');
        const others = await page.locator('#other option').allTextContents();
        const wanted = ['nothing', 'Image', 'Mask', 'Back light', 'Sharpest slice', 'Slices, front light, aligned', 'Slices, back light, aligned'];
        assert.deepEqual(others.filter((name) => wanted.includes(name)), wanted);
        await page.selectOption('#other', { label: 'Sharpest slice' });
        const half = await changed(page, '.viewer', whole);
        assert.deepEqual([await page.textContent('#layer-named'), await page.textContent('#other-named')], ['Image', 'Sharpest slice']);
        // the line is dragged, and the picture stays where it is
        const box = await page.locator('#viewer').boundingBox();
        const at = (share) => [box.x + box.width * share, box.y + box.height * 0.8];
        await page.mouse.move(...at(0.5));
        await page.mouse.down();
        await page.mouse.move(...at(0.25), { steps: 5 });
        await page.mouse.up();
        assert.ok(Math.abs(await place(page) - 25) < 1, `at ${await place(page)}`);
        const dragged = await changed(page, '.viewer', half);
        // beside the line, the picture is dragged
        await page.mouse.move(...at(0.6));
        await page.mouse.down();
        await page.mouse.move(...at(0.7), { steps: 3 });
        await page.mouse.up();
        assert.ok(Math.abs(await place(page) - 25) < 1, 'the line stays');
        await changed(page, '.viewer', dragged);
        // the wheel zooms on the line too
        const before = await page.textContent('#readout');
        await page.mouse.move(...at(0.25));
        await page.mouse.wheel(0, -240);
        await page.waitForFunction((text) => document.getElementById('readout').textContent !== text, before);
        // by keyboard alone
        await page.focus('#viewer');
        await page.keyboard.press('Tab');
        assert.equal(await page.evaluate(() => document.activeElement.id), 'divider');
        const unfocused = await seen(page, '.viewer');
        await page.keyboard.press('ArrowRight');
        assert.ok(Math.abs(await place(page) - 26) < 1.5);
        await page.keyboard.press('End');
        assert.equal(await place(page), 100);
        await page.keyboard.press('PageDown');
        assert.ok(Math.abs(await place(page) - 90) < 1);
        assert.equal(await page.getAttribute('#divider', 'aria-valuetext'), '90 % from the left');
        await changed(page, '.viewer', unfocused);
        await faults(page, colorScheme);
        await page.selectOption('#other', { label: 'nothing' });
        assert.equal(await page.locator('#divider').isVisible(), false);
        page.settled();
        await page.context().close();
      }
      for (const width of [820, 360]) {
        const finger = await opened(browser, { hasTouch: true, viewport: { width, height: 740 } });
        await finger.goto(`${base}/stacks/${id}`);
        await finger.selectOption('#other', { label: 'Slices, back light, aligned' });
        await finger.locator('#viewer').scrollIntoViewIfNeeded();
        const box = await finger.locator('#viewer').boundingBox();
        const client = await finger.context().newCDPSession(finger);
        const touch = (type, share) => client.send('Input.dispatchTouchEvent', { type, touchPoints: share === null ? [] : [{ x: box.x + box.width * share, y: box.y + box.height / 2 }] });
        await touch('touchStart', 0.5);
        for (const share of [0.55, 0.6, 0.65, 0.7]) await touch('touchMove', share);
        await touch('touchEnd', null);
        assert.ok(Math.abs(await place(finger) - 70) < 3, `at ${await place(finger)}`);
        assert.equal(await isWide(finger), false, `${width} px`);
        await faults(finger, `${width} px`);
        finger.settled();
        await finger.context().close();
      }
    },

    // the slices of a light one after another, where the person looks
    async slices(browser) {
      const [{ id, slices: { front: { length: count } } }] = await stacks();
      const page = await opened(browser);
      const asked = [];
      let hold = null;
      await page.route('**/tiles/slice-*/**', async (route) => {
        asked.push(Number(new URL(route.request().url()).pathname.match(/slice-front-(\d+)/)[1]));
        await hold;
        await route.continue();
      });
      const last = count - 1;
      const loaded = () => page.waitForFunction(() => !document.getElementById('readout').textContent.includes('loading'));
      /** What is seen while the picture has the focus. */
      const view = async () => { await loaded(); await page.focus('#viewer'); return seen(page, '#viewer'); };
      const open = async () => {
        await atPixels(page, `/stacks/${id}`);
        await page.keyboard.press('ArrowRight');
        await page.selectOption('#layer', { label: 'Slices, front light, aligned' });
        await reads(page, '#layer-told', `0 of 0 to ${last}`);
      };
      await open();
      const first = await view();
      await page.focus('#layer-slice');
      await page.keyboard.press('ArrowRight');
      await reads(page, '#layer-told', `1 of 0 to ${last}`);
      assert.notDeepEqual(await view(), first);
      assert.match(await page.textContent('#readout'), /100 %/, 'the zoom stays');
      // in the picture itself
      await page.keyboard.press('.');
      await reads(page, '#layer-told', `2 of 0 to ${last}`);
      for (let presses = 0; presses < 3; presses += 1) await page.keyboard.press(',');
      await reads(page, '#layer-told', `0 of 0 to ${last}`);
      assert.deepEqual(await view(), first, 'the place stays');
      // what is passed on the way is not made: one slice is asked for at a time, then the last that is wanted
      await open();
      await view();
      asked.length = 0;
      let go;
      hold = new Promise((resolve) => { go = resolve; });
      await page.keyboard.press('.');
      await reads(page, '#readout', 'loading');
      assert.deepEqual(await seen(page, '#viewer'), first, 'the slice before stays until the next is there');
      for (let presses = 0; presses <= count; presses += 1) await page.keyboard.press('.');
      go();
      await reads(page, '#layer-told', `${last} of 0 to ${last}`);
      await loaded();
      assert.deepEqual([...new Set(asked)], [1, last]);
      await page.unrouteAll({ behavior: 'wait' });
      // of two lights, the same slice
      await page.selectOption('#other', { label: 'Slices, back light, aligned' });
      await page.focus('#viewer');
      await page.keyboard.press(',');
      await reads(page, '#other-named', 'Slice ');
      await reads(page, '#layer-told', `${last - 1} of 0 to ${last}`);
      await faults(page, 'slices');
      page.settled();

      const finger = await opened(browser, { hasTouch: true, viewport: { width: 360, height: 740 } });
      await finger.goto(`${base}/stacks/${id}`);
      await finger.selectOption('#layer', { label: 'Slices, front light, aligned' });
      const box = await finger.locator('#layer-slice').boundingBox();
      await finger.touchscreen.tap(box.x + box.width - 8, box.y + box.height / 2);
      await reads(finger, '#layer-told', `${last} of 0 to ${last}`);
      assert.equal(await isWide(finger), false);
      finger.settled();
    },

    // what differs between runs, and both under the divider
    async runs(browser) {
      const { id } = (await stacks()).at(-1);
      const run = await again(id, { method: 'pyramid', crop: '20,10,200,120' });
      const without = await again(id, { mask: 'none' });
      const page = await opened(browser);
      await page.goto(`${base}/stacks/${id}`);
      const images = (await page.locator('#other option').allTextContents()).filter((name) => name.endsWith(' UTC: Image'));
      assert.equal(images.length, (await stacks()).length - 1, 'the image of each other run');
      await page.focus('text=/Compare the \\d runs/');
      await page.keyboard.press('Enter');
      await page.waitForURL('**/runs');
      while (await page.locator('form input:checked').count()) await page.locator('form input:checked').first().uncheck();
      for (const one of [id, run]) {
        await page.focus(`input[name="${one}"]`);
        await page.keyboard.press('Space');
      }
      await page.keyboard.press('Enter');
      await page.waitForURL(`**/runs?*${run}=1*`);
      assert.equal(await page.locator('table.runs thead th').count(), 2);
      assert.deepEqual(await page.locator('tr:has(th:text-is("Method")) td').allTextContents(), ['halo corrected', 'pyramid']);
      assert.equal(await page.locator('tr:has(th:text-is("Crop")) td').count(), 2);
      assert.ok(await page.locator('.best').count() > 0, 'something is better');
      const address = page.url();
      for (const colorScheme of ['light', 'dark']) {
        for (const width of [1440, 820, 360]) {
          const small = await opened(browser, { colorScheme, viewport: { width, height: 740 } });
          await small.goto(address);
          assert.equal(await isWide(small), false, `${width} px`);
          await faults(small, `runs, ${colorScheme}, ${width} px`);
          small.settled();
          await small.context().close();
        }
      }
      // reading needs no script
      const plain = await opened(browser, { javaScriptEnabled: false });
      await plain.goto(address);
      await plain.check(`input[name="${without}"]`);
      await plain.click('form button');
      assert.equal(await plain.locator('table.runs thead th').count(), 3);
      plain.settled();
      await page.click('text=Beside the first');
      await page.waitForURL(`**/stacks/${id}?compare=${run}`);
      await page.waitForSelector('#divider:not([hidden])');
      assert.match(await page.textContent('#other-named'), /^pyramid, .*: Image$/);
      // the cropped run lies on the image: no pixel of it is elsewhere
      const { layers } = JSON.parse(await page.getAttribute('#viewer', 'data-scene'));
      assert.deepEqual(layers.find((layer) => layer.tiles.includes(run)).at, [20, 10]);
      await faults(page, 'viewer with two runs');
      page.settled();
    },
  };
};
