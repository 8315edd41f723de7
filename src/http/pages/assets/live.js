// Follows what is in progress: asks for a part of this page again, often while something runs, seldom otherwise, and
// not at all while the page is hidden. One request, whatever the number of stacks.
import { call, element } from './page.js';

const BUSY_MS = 1500;
const CALM_MS = 10000;
// the server spends at most this share of the time on one page
const SHARE = 0.05;

/** Keeps `box` equal to the part `part` of this page; `changed` is called with its new content. */
export function follow(box, part, changed = () => {}) {
  const url = new URL(location.href);
  url.searchParams.set('part', part);
  let last = null;
  let failures = 0;
  let gone = null;
  const isBusy = () => box.querySelector('[data-state=queued], [data-state=running]') !== null;
  let timer;
  let took = 0;
  async function look() {
    timer = 0;
    if (document.hidden) return again();
    const began = performance.now();
    try {
      const response = await call('GET', url);
      const text = await response.text();
      took = performance.now() - began;
      failures = 0;
      gone?.remove();
      if (response.ok && text !== last) {
        const parsed = new DOMParser().parseFromString(text, 'text/html').body;
        merge(box, parsed);
        if (last !== null || text) changed(box);
        last = text;
      }
    } catch (error) {
      // a refusal is the answer of a server that is there
      if (error.status > 0 && error.status < 502) gone?.remove();
      else if (failures > 0 && !gone?.isConnected) {
        gone = element('p', { class: 'error', role: 'alert' }, 'The server does not answer. What you see may be old; this page goes on by itself when it is back.');
        document.querySelector('main').prepend(gone);
      }
      failures += 1;
    }
    return again();
  }
  function again() {
    timer = setTimeout(look, Math.max((isBusy() ? BUSY_MS : CALM_MS) * Math.min(1 + failures, 10), took / SHARE));
  }
  document.addEventListener('visibilitychange', () => { if (!document.hidden && timer) { clearTimeout(timer); timer = 0; look(); } });
  again();
}

/** Makes the children of `old` those of `fresh`; elements with an id that did not change stay, with their focus. */
function merge(old, fresh) {
  const lists = [old.querySelector('.rows'), fresh.querySelector('.rows')];
  if (!lists[0] || !lists[1]) {
    if (old.innerHTML !== fresh.innerHTML) keepFocus(() => old.replaceChildren(...fresh.childNodes));
    return;
  }
  keepFocus(() => {
    const have = new Map([...lists[0].children].map((row) => [row.id, row]));
    const rows = [...lists[1].children].map((row) => {
      const before = have.get(row.id);
      return before && before.outerHTML === row.outerHTML ? before : row;
    });
    if (rows.length !== lists[0].children.length || rows.some((row, i) => row !== lists[0].children[i])) {
      lists[0].replaceChildren(...rows);
    }
  });
}

function keepFocus(change) {
  const focused = document.activeElement;
  const href = focused && focused.getAttribute && focused.getAttribute('href');
  change();
  if (href && !focused.isConnected) document.querySelector(`main a[href="${CSS.escape(href)}"]`)?.focus();
  else if (focused && focused.isConnected && focused !== document.activeElement) focused.focus();
}
