// One upload on the page that sends: its line with progress and buttons, and what became of it.
import { bytes, duration, element, json, link, sentence } from './page.js';
import { Upload } from './tus.js';
import { zipped } from './zip.js';

const by = (id) => document.getElementById(id);

/** A short text that is the same for the same files and options. */
async function fingerprint(files, metadata) {
  const text = JSON.stringify([files.map(({ path, file }) => [path, file.size, file.lastModified]), metadata]);
  if (globalThis.crypto?.subtle) {
    const digest = await crypto.subtle.digest('SHA-256', new TextEncoder().encode(text));
    return [...new Uint8Array(digest, 0, 16)].map((byte) => byte.toString(16).padStart(2, '0')).join('');
  }
  // browsers have no digests on a page without TLS
  let hashes = [0x811c9dc5, 0x1234567];
  for (const c of text) hashes = hashes.map((hash, at) => Math.imul(hash ^ (c.codePointAt(0) + at), 0x01000193) >>> 0);
  return hashes.map((hash) => hash.toString(16)).join('') + text.length.toString(16);
}

/** Sends `what`, `{ zip }` or `{ pictures }`, and shows how far it is. */
export async function start(what, metadata) {
  const title = what.zip ? what.zip.name : what.pictures[0].path.split('/')[0];
  const files = what.zip ? [{ path: what.zip.name, file: what.zip }] : what.pictures;
  const bar = element('progress', { max: '1', value: '0', 'aria-label': `Progress of ${title}` });
  const words = element('span', { class: 'soft' }, 'begins');
  const pause = element('button', { type: 'button' }, 'Pause');
  const stop = element('button', { type: 'button', class: 'danger' }, 'Remove');
  const buttons = element('div', { class: 'buttons' }, pause, stop);
  const line = element('div', { class: 'line' }, element('strong', {}, title), buttons);
  const item = element('li', {}, line, bar, words);
  by('uploads').prepend(item);
  const end = (...shown) => { buttons.remove(); bar.remove(); words.replaceWith(...shown); };
  const leave = (event) => { event.preventDefault(); };
  window.addEventListener('beforeunload', leave);
  try {
    const total = files.reduce((sum, { file }) => sum + file.size, 0);
    pause.hidden = !what.zip;
    const blob = what.zip ?? await zipped(files, (read) => {
      bar.value = read / Math.max(total, 1);
      words.textContent = `reading ${bytes(read)} of ${bytes(total)}`;
    });
    pause.hidden = false;
    const key = await fingerprint(files, metadata);
    const began = performance.now();
    let first = null;
    const upload = new Upload(blob, { ...metadata, filename: what.zip ? title : `${title}.zip` }, key, ({ state, sent, detail }) => {
      first ??= sent;
      bar.value = sent / Math.max(blob.size, 1);
      const rate = (sent - first) / (performance.now() - began) * 1000;
      const left = rate > 0 ? `, about ${duration((blob.size - sent) / rate)} left` : '';
      words.textContent = {
        sending: `sent ${bytes(sent)} of ${bytes(blob.size)}${left}`,
        checking: 'all is sent; the server checks it',
        paused: `paused at ${bytes(sent)} of ${bytes(blob.size)}`,
        waiting: detail,
        signed_out: '',
      }[state];
      if (state === 'signed_out') words.append(...signIn());
    });
    pause.addEventListener('click', () => {
      upload.setPaused(!upload.isPaused);
      pause.textContent = upload.isPaused ? 'Continue' : 'Pause';
    });
    stop.addEventListener('click', () => upload.remove());
    const job = await upload.run();
    if (job === null) return item.remove();
    end(...await made(job, metadata));
    by('said').textContent = `${title}: everything has arrived.`;
  } catch (error) {
    end(element('p', { class: 'error', role: 'alert' }, sentence(error.message)));
  } finally {
    window.removeEventListener('beforeunload', leave);
  }
}

/** The way back for a session that ended in mid-upload: in another tab, because this one has the files. */
function signIn() {
  const next = `${location.pathname.slice(link('').length)}${location.search}`;
  const there = element('a', { href: link(`/sign-in?next=${encodeURIComponent(next)}`), target: '_blank', rel: 'noopener' }, 'Sign in in another tab');
  return ['Your sign-in has ended; nothing is lost. ', there, ', and the upload goes on where it was.'];
}

/** What became of an upload: a link, and for a scan how it was grouped. */
async function made(job, metadata) {
  if (metadata.purpose === 'scan') {
    return [element('p', {}, 'Everything has arrived. ', element('a', { href: link(`/scans/${encodeURIComponent(metadata.scan)}`) }, `See the scan ${metadata.scan}`))];
  }
  const page = link(job.replace(/^.*\/v1(?=\/)/, ''));
  const shown = [element('p', {}, 'Everything has arrived. ', element('a', { href: page }, metadata.purpose === 'calibration' ? 'See the calibration' : 'See the stack'))];
  const { warnings = [] } = await json('GET', job).catch(() => ({}));
  if (warnings.length) {
    shown.push(element('ul', { class: 'warnings' }, ...warnings.map(({ detail }) => element('li', {}, sentence(detail)))));
  }
  return shown;
}
