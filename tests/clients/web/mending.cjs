// Scenarios of judging and mending: the buttons of findings, notes, two tabs, and pages that are enlarged.
'use strict';
const assert = require('node:assert/strict');

module.exports = ({ base, opened }) => {
  const read = async (at) => (await fetch(base + at)).json();
  /** The only stack with this label. */
  const labelled = async (label) => (await read(`/v1/stacks?q=${label}`)).items.find((one) => one.options.label === label);
  const done = (page) => page.waitForSelector('#state [data-state=succeeded]');
  /** The finding of a code on the page of a stack. */
  const finding = (page, code) => page.locator('.findings > li').filter({ has: page.locator(`code:text-is("${code}")`) });

  /** Presses a button that fuses again, and returns the stack that it made. */
  async function fused(page, code, label, how = (button) => button.click()) {
    const before = page.url();
    await how(finding(page, code).getByRole('button', { name: label, exact: true }));
    await page.waitForURL((url) => /\/stacks\//.test(url.pathname) && url.href !== before);
    await done(page);
    return read(`/v1${new URL(page.url()).pathname}`);
  }

  return {
    // each kind of button that a finding has does what it says
    async advice(browser) {
      const page = await opened(browser);
      const reversed = await labelled('reversed');
      assert.equal(reversed.verdict, 'do_not_use');
      await page.goto(`${base}/stacks/${reversed.id}`);
      await finding(page, 'slices_reversed').waitFor();
      const right = await fused(page, 'slices_reversed', 'Fuse again in the other order', async (button) => {
        await button.focus();
        await page.keyboard.press('Enter');
      });
      assert.deepEqual([right.options.order, right.rerun_of], ['name', reversed.id]);
      assert.ok(!right.warnings.some((one) => one.code === 'slices_reversed'), JSON.stringify(right.warnings));
      assert.equal(await finding(page, 'slices_reversed').count(), 0, 'the new page has the finding no more');
      assert.equal((await read(`/v1/stacks/${reversed.id}`)).verdict, 'do_not_use', 'the first one stays');

      const misfit = await labelled('misfit');
      const { revision } = await read('/v1/profiles/rig/lens');
      assert.ok(misfit.profile_revision < revision);
      await page.goto(`${base}/stacks/${misfit.id}`);
      const again = await fused(page, 'profile_misfit', 'Fuse again with the current revision of the profile');
      assert.equal(again.profile_revision, revision);
      await page.goto(`${base}/stacks/${misfit.id}`);
      await finding(page, 'profile_misfit').getByRole('link', { name: 'Calibrate again' }).click();
      await page.waitForURL(/\/send\?/);
      assert.deepEqual([await page.inputValue('#rig'), await page.inputValue('#lens'), await page.isChecked('input[value=calibration]')], ['rig', 'lens', true]);

      const unused = await labelled('unused');
      await page.goto(`${base}/stacks/${unused.id}`);
      assert.equal((await fused(page, 'unused_parameters', 'Fuse again by the guided method')).options.method, 'guided');

      // a view that is beyond repair is deleted, and its scan then misses it
      const exchanged = await labelled('exchanged');
      await page.goto(`${base}/stacks/${exchanged.id}`);
      const button = finding(page, 'lights_exchanged').getByRole('button', { name: 'Delete it: the scan then misses this view' });
      await button.click();
      await page.click('dialog >> text=Keep it');
      assert.equal((await fetch(`${base}/v1/stacks/${exchanged.id}`)).status, 200);
      await button.click();
      await page.click('dialog >> text="Delete"');
      await page.waitForURL(/\/scans$/);
      assert.equal((await fetch(`${base}/v1/stacks/${exchanged.id}`)).status, 404);
      await page.goto(`${base}/scans/bee`);
      assert.equal(await page.locator('.grid .gap').count(), 1);
      page.settled();
    },

    // notes on the pages of a stack, a scan and a profile; what another tab did is told in words
    async notes(browser) {
      const { items: [stack] } = await read('/v1/stacks');
      for (const where of [`/stacks/${stack.id}`, '/scans/bee', '/profiles/rig/lens']) {
        const page = await opened(browser);
        const other = await opened(browser);
        await page.goto(base + where);
        await page.fill('#note', 'left <wing>\nKäfer 甲虫');
        await page.click('text=Add the note');
        await page.waitForSelector('#notes li >> text=left <wing>');
        assert.deepEqual(await page.locator('#notes li p').allTextContents().then((texts) => texts.slice(0, 2)), ['left <wing>', 'Käfer 甲虫']);
        assert.equal(await page.inputValue('#note'), '');
        await other.goto(base + where);
        for (const [tab, told] of [[page, ''], [other, 'There is no note']]) {
          await tab.click('text=Delete this note');
          await tab.click('dialog >> text="Delete"');
          if (told) await tab.waitForSelector(`#notes-told >> text=${told}`);
          else await tab.waitForSelector('#notes >> text=There are none');
        }
        [page, other].forEach((tab) => tab.settled());
      }
      // a stack that was deleted in another tab
      const [page, other] = [await opened(browser), await opened(browser)];
      for (const tab of [page, other]) await tab.goto(`${base}/stacks/${stack.id}`);
      await page.click('#delete');
      await page.click('dialog >> text="Delete"');
      await page.waitForURL(/\/stacks$/);
      await other.fill('#note', 'too late');
      await other.click('text=Add the note');
      await other.waitForSelector('#notes-told >> text=There is no stack');
      assert.equal(await other.inputValue('#note'), 'too late', 'nothing that was typed is lost');
      [page, other].forEach((tab) => tab.settled());
    },

    // enlarged to 200 %, and to 400 % of a window of 1,280 px, no page scrolls sideways
    async zoom(browser) {
      const { items: [stack] } = await read('/v1/stacks');
      const headers = { 'content-type': 'application/json', prefer: 'wait=50' };
      const post = async (at, body) => (await fetch(base + at, { method: 'POST', headers, body: JSON.stringify(body) })).json();
      const long = await post(`/v1/stacks/${stack.id}/rerun`, { label: 'W'.repeat(200), crop: 'valid' });
      for (const about of [`stacks/${long.id}`, 'scans/bee', 'profiles/rig/lens']) await post(`/v1/${about}/notes`, { text: 'W'.repeat(500) });
      const pages = ['/', '/stacks', `/stacks/${stack.id}`, `/stacks/${long.id}`, '/send', '/scans', '/scans/bee', '/profiles', '/profiles/rig/lens', '/plan', '/sign-in'];
      for (const [width, deviceScaleFactor] of [[720, 2], [320, 4]]) {
        const page = await opened(browser, { viewport: { width, height: 450 }, deviceScaleFactor });
        for (const where of pages) {
          await page.goto(base + where);
          const beyond = await page.evaluate(() => {
            const { scrollWidth, clientWidth } = document.documentElement;
            if (scrollWidth <= clientWidth) return [];
            return [...document.querySelectorAll('body *')].filter((one) => one.getBoundingClientRect().right > clientWidth + 1).map((one) => one.outerHTML.slice(0, 120));
          });
          assert.deepEqual(beyond, [], `${where} at ${width} px`);
        }
        page.settled();
        await page.context().close();
      }
    },
  };
};
