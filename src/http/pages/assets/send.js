// The page that sends: what was chosen is shown, packed if it is a folder, and uploaded.
import { bytes, call, duration, element, json, link, sentence, tell } from './page.js';
import { chosen, dropped, grouped, sorted } from './files.js';
import { Upload } from './tus.js';
import { zipped } from './zip.js';

const form = document.getElementById('send');
const by = (id) => document.getElementById(id);
const drop = by('drop');
let choice = null;

const purpose = () => form.querySelector('input[name=purpose]:checked').value;

function adapt() {
  for (const part of form.querySelectorAll('[data-for]')) part.hidden = !part.dataset.for.split(' ').includes(purpose());
  by('scan').required = purpose() === 'scan';
  show();
  group();
}
form.addEventListener('change', (event) => { if (event.target.name === 'purpose') adapt(); });

by('scan').addEventListener('change', () => {
  const known = [...by('scans').options].find((option) => option.value === by('scan').value);
  if (known) { by('rig').value = known.dataset.rig; by('lens').value = known.dataset.lens; }
});

for (const name of ['folder', 'file']) {
  by(`pick-${name}`).addEventListener('click', () => by(name).click());
  by(name).addEventListener('change', (event) => { take(chosen(event.target)); event.target.value = ''; });
}
drop.addEventListener('dragover', (event) => { event.preventDefault(); drop.classList.add('over'); });
drop.addEventListener('dragleave', () => drop.classList.remove('over'));
drop.addEventListener('drop', async (event) => {
  event.preventDefault();
  drop.classList.remove('over');
  try { take(await dropped(event.dataTransfer)); } catch { tell('told', 'the folder cannot be read; choose it with the button'); }
});

function take(files) {
  choice = sorted(files);
  tell('told', '');
  if (!choice.zip && choice.pictures.length === 0) {
    tell('told', choice.zips.length > 1
      ? 'there are several zips; send one at a time, or a folder of pictures'
      : 'there are no JPEG, PNG or TIFF pictures in it; convert raw files first');
    choice = null;
  }
  show();
  group();
}

/** Asks the server once how it groups what was chosen. */
async function group() {
  const own = choice;
  if (own === null || own.zip || own.isAsked || purpose() === 'calibration') return;
  own.isAsked = true;
  try {
    own.grouping = await grouped(own.pictures);
  } catch (error) {
    own.trouble = error.message;
  }
  // another folder may have been chosen meanwhile
  if (choice === own) show();
}

function show() {
  const place = by('chosen');
  by('go').disabled = choice === null;
  if (choice === null) return place.replaceChildren();
  if (choice.zip) {
    return place.replaceChildren(element('p', {}, element('strong', {}, choice.zip.name), ` ${bytes(choice.zip.size)}`));
  }
  const { pictures, others } = choice;
  const size = pictures.reduce((sum, { file }) => sum + file.size, 0);
  const parts = [element('p', {}, element('strong', {}, `${pictures.length} pictures`), `, ${bytes(size)}`)];
  if (choice.trouble) parts.push(element('p', { class: 'told' }, sentence(`the pictures cannot be grouped into views: ${choice.trouble}`)));
  const { views, ignored } = choice.grouping ?? { views: [], ignored: [] };
  if (purpose() === 'scan' ? views.length : views.length > 1) parts.push(table(views));
  if (purpose() === 'stack' && views.length > 1) {
    parts.push(element('p', { class: 'told' }, `These are ${views.length} views. If they are views of one object, choose “A scan”.`));
  }
  if (purpose() === 'scan' && ignored.length) {
    parts.push(element('details', {}, element('summary', {}, `${ignored.length} files belong to no view`),
      element('ul', {}, ...ignored.slice(0, 100).map(({ name, reason }) => element('li', {}, `${name}: ${reason}`)))));
  }
  if (others.length) parts.push(element('p', { class: 'soft' }, `${others.length} other files are not sent: ${others.slice(0, 3).map(({ path }) => path).join(', ')}${others.length > 3 ? ', …' : ''}`));
  return place.replaceChildren(...parts);
}

function table(views) {
  const counts = (view) => `${view.front.length}/${view.back.length}`;
  const usual = views.map(counts).sort().at(views.length >> 1);
  const angle = (degrees) => (degrees === null ? '' : String(Number(degrees.toFixed(3))));
  const row = (view) => {
    const remark = view.problem ?? (counts(view) === usual ? '' : 'differs from the others');
    return element('tr', {}, element('td', { class: 'l' }, view.name || '(no folder)'), element('td', {}, angle(view.pan_deg)), element('td', {}, angle(view.tilt_deg)),
      element('td', {}, String(view.front.length)), element('td', {}, String(view.back.length)), element('td', { class: 'l warn' }, remark && `! ${remark}`));
  };
  const head = ['View', 'Pan', 'Tilt', 'Front light', 'Back light', 'Remarks'].map((name, at) => element('th', { scope: 'col', class: at % 5 ? undefined : 'l' }, name));
  return element('div', { class: 'wide', tabindex: '0', role: 'region', 'aria-label': 'Views' }, element('table', {},
    element('caption', { class: 'soft small' }, `${views.length} ${views.length === 1 ? 'view' : 'views'}, as the server reads the names. Nothing has been sent yet.`),
    element('thead', {}, element('tr', {}, ...head)), element('tbody', {}, ...views.map(row))));
}

/** The values of the form as they are sent. */
function described() {
  const value = (name) => (form.elements[name]?.closest('[hidden]') ? '' : form.elements[name]?.value.trim() ?? '');
  const numbers = ['pan_deg', 'tilt_deg', 'target_pitch_mm', 'pixel_pitch_mm', 'rail_step_mm', 'pupil_ratio', 'target_advance_mm'];
  const options = {};
  for (const name of ['label', 'moved_target', ...numbers]) {
    const text = value(name);
    if (text) options[name] = numbers.includes(name) ? Number(text.replace(',', '.')) : text;
    if (Number.isNaN(options[name])) throw new Error(`${form.querySelector(`label[for=${name}]`).textContent}: “${text}” is not a number`);
  }
  const scan = value('scan');
  const metadata = { rig: value('rig'), lens: value('lens'), purpose: purpose() };
  if (purpose() === 'no_target') {
    metadata.purpose = 'calibration';
    options.source = 'stacks';
  }
  if (purpose() === 'scan') metadata.scan = scan;
  else if (scan && purpose() === 'stack') options.scan = scan;
  if (Object.keys(options).length) metadata.options = JSON.stringify(options);
  return { metadata, scan };
}

form.addEventListener('submit', async (event) => {
  event.preventDefault();
  if (!choice) return;
  tell('told', '');
  const button = by('go');
  button.disabled = true;
  try {
    const { metadata, scan } = described();
    if (scan) await makeScan(scan, metadata);
    start(choice, metadata);
    choice = null;
    show();
  } catch (error) {
    tell('told', error.message);
    button.disabled = false;
  }
});

/** Creates a scan that does not exist yet. */
async function makeScan(name, { rig, lens }) {
  try {
    await call('PUT', link(`/v1/scans/${encodeURIComponent(name)}`), JSON.stringify({ rig, lens }), { 'content-type': 'application/json', 'if-none-match': '*' });
  } catch (error) {
    if (error.status !== 412) throw error;
  }
}

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

async function start(what, metadata) {
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
      }[state];
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

const wanted = new URLSearchParams(location.search).get('purpose');
for (const name of ['scan', 'rig', 'lens']) {
  const given = new URLSearchParams(location.search).get(name);
  if (given) by(name).value = given;
}
const radio = form.querySelector(`input[name=purpose][value="${CSS.escape(wanted ?? '')}"]`);
if (radio) radio.checked = true;
adapt();
