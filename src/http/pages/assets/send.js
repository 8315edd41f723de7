// The page that sends: what was chosen is read, told, and uploaded.
import { call, element, json, link, sentence, tell } from './page.js';
import { headOf } from './exif.js';
import { chosen, dropped, grouped, sorted } from './files.js';
import { followSensor, numbersOf, offer } from './measures.js';
import { planOf, purposeOf, viewsOf, worthReading } from './plan.js';
import { Preview } from './preview.js';
import { start } from './upload.js';

/** Heads that are read: those of the first, middle and last slices come first. */
const MOST_HEADS = 600;
const AT_ONCE = 6;
const KEPT = 'pinstack-cameras';
const NUMBERS = ['pan_deg', 'tilt_deg', 'target_pitch_mm', 'pixel_pitch_mm', 'rail_step_mm', 'focal_mm', 'pupil_ratio', 'target_advance_mm', 'from'];

const form = document.getElementById('send');
const by = (id) => document.getElementById(id);
const drop = by('drop');
const preview = new Preview(by('chosen'));
let choice = null;
let profile;
let isPurposeChosen = false;
const typed = new Set();

const purpose = () => form.querySelector('input[name=purpose]:checked').value;

function adapt() {
  for (const part of form.querySelectorAll('[data-for]')) part.hidden = !part.dataset.for.split(' ').includes(purpose());
  by('scan').required = purpose() === 'scan';
  read();
  show();
}
form.addEventListener('change', (event) => {
  if (event.target.name === 'purpose') { isPurposeChosen = true; adapt(); }
});
let soon;
form.addEventListener('input', (event) => {
  if (!['rig', 'lens'].includes(event.target.name)) return;
  typed.add(event.target.name);
  clearTimeout(soon);
  soon = setTimeout(findProfile, 300);
});

by('scan').addEventListener('change', () => {
  const known = [...by('scans').options].find((option) => option.value === by('scan').value);
  if (known) { by('rig').value = known.dataset.rig; by('lens').value = known.dataset.lens; findProfile(); }
});

for (const name of ['folder', 'file']) {
  by(`pick-${name}`).addEventListener('click', () => by(name).click());
  by(name).addEventListener('change', (event) => { const files = chosen(event.target); event.target.value = ''; take(files); });
}
// what is dropped beside the place would replace the page
for (const name of ['dragover', 'drop']) document.addEventListener(name, (event) => event.preventDefault());
document.addEventListener('dragover', () => drop.classList.add('over'));
document.addEventListener('dragleave', (event) => { if (!event.relatedTarget) drop.classList.remove('over'); });
document.addEventListener('drop', async (event) => {
  drop.classList.remove('over');
  try { await take(await dropped(event.dataTransfer)); } catch { tell('told', 'the folder cannot be read; choose it with the button'); }
});

/** Takes what was chosen: groups it by the rules of the service, and reads the heads of its pictures. */
async function take(files) {
  const own = { heads: new Map(), files: new Map() };
  tell('told', '');
  preview.clear();
  choice = own;
  by('go').disabled = true;
  try {
    Object.assign(own, await sorted(files));
    if (own.pictures.length === 0) {
      throw new Error(own.zips.length > 1 ? 'there are several zips; send one at a time, or a folder of pictures'
        : 'there are no JPEG, PNG or TIFF pictures in it; convert raw files first');
    }
    own.files = new Map(own.pictures.map((file) => [file.path, file]));
    own.grouping = await grouped(own.pictures);
  } catch (error) {
    if (choice !== own) return;
    tell('told', own.pictures?.length ? `the pictures cannot be grouped into views: ${error.message}` : error.message);
    if (!own.pictures?.length) choice = null;
  }
  // another folder may have been chosen meanwhile
  if (choice !== own) return;
  by('go').disabled = choice === null;
  const guess = own.grouping && form.querySelector(`input[name=purpose][value=${purposeOf(own.grouping, [...own.files.keys()])}]`);
  if (guess && !isPurposeChosen) guess.checked = true;
  adapt();
}

/** Reads heads that were not read, a few at a time, and shows what they tell. */
async function read() {
  const own = choice;
  if (!own?.grouping) return;
  const names = worthReading(viewsOf(purpose(), own.grouping), MOST_HEADS).filter((name) => !own.heads.has(name) && own.files.has(name));
  let shown = performance.now();
  const next = async () => {
    for (let name = names.shift(); name !== undefined && choice === own; name = names.shift()) {
      if (own.heads.has(name)) continue;
      const head = await headOf(own.files.get(name).source).catch(() => undefined);
      if (head !== undefined) own.heads.set(name, head);
      if (performance.now() - shown > 250) { shown = performance.now(); show(); }
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, next));
  if (choice !== own) return;
  const head = [...own.heads.values()].find(Boolean);
  offer(form, head);
  remembered(head);
  follow();
  show();
}
const follow = followSensor(form, () => {
  const head = [...(choice?.heads.values() ?? [])].find(Boolean);
  return head ? Math.max(head.width, head.height) : 0;
});

const cameras = () => { try { return JSON.parse(localStorage.getItem(KEPT)) ?? {}; } catch { return {}; } };
const keyOf = (head) => [head?.make, head?.model, head?.lens].join('|');

/** Proposes the rig and the lens with which pictures of this camera were sent last, or the last ones at all. */
function remembered(head) {
  const kept = cameras();
  const last = (head && kept[keyOf(head)]) || kept.last;
  const isFree = (name) => !typed.has(name) && (by(name).value === '' || by(name).dataset.proposed === by(name).value);
  if (!last || !['rig', 'lens'].every(isFree)) return;
  for (const name of ['rig', 'lens']) { by(name).value = last[name]; by(name).dataset.proposed = last[name]; }
  findProfile();
}

/** Gets the profile of the rig and the lens, to compare what was chosen with. */
async function findProfile() {
  const [rig, lens] = [by('rig').value.trim(), by('lens').value.trim()];
  let found;
  if (rig && lens) {
    try { found = await json('GET', link(`/v1/profiles/${encodeURIComponent(rig)}/${encodeURIComponent(lens)}`)); } catch (error) {
      found = error.status === 404 ? null : undefined;
    }
  }
  if (rig !== by('rig').value.trim() || lens !== by('lens').value.trim()) return;
  profile = found;
  show();
}

function show() {
  if (!choice?.grouping) return;
  const plan = planOf({ purpose: purpose(), grouping: choice.grouping, heads: choice.heads, profile, others: choice.others.map(({ path }) => path), rig: by('rig').value, lens: by('lens').value });
  preview.show(plan, { ...choice, purpose: purpose() });
  const bad = plan.findings.filter(({ level }) => level === 'bad').length;
  const said = `${plan.title}. ${bad ? `${bad} ${bad === 1 ? 'thing does' : 'things do'} not fit.` : ''}`;
  if (by('summary').textContent !== said) by('summary').textContent = said;
}

/** The values of the form as they are sent. */
function described() {
  const value = (name) => (form.elements[name]?.closest('[hidden]') ? '' : form.elements[name]?.value.trim() ?? '');
  const measured = numbersOf(form, NUMBERS);
  // a revision that is refined has its own camera
  const options = measured.from ? { from: measured.from } : measured;
  for (const name of ['label', 'moved_target', 'capture_mode']) if (value(name) && !measured.from) options[name] = value(name);
  const scan = value('scan');
  const metadata = { rig: value('rig'), lens: value('lens'), purpose: purpose() };
  if (purpose() === 'no_target') {
    metadata.purpose = 'calibration';
    options.source = 'stacks';
  }
  if (purpose() === 'scan') metadata.scan = scan;
  else if (scan && purpose() === 'stack') options.scan = scan;
  if (Object.keys(options).length) metadata.options = JSON.stringify(options);
  const auto = form.elements.reconstruct;
  const reconstruct = auto?.checked && !auto.closest('[hidden]') && choice.grouping;
  return {
    metadata, scan, ...numbersOf(form, ['radius_mm']),
    ...(reconstruct ? { reconstruct: 'auto', expected_views: choice.grouping.views.length } : {}),
  };
}

form.addEventListener('submit', async (event) => {
  event.preventDefault();
  const own = choice;
  if (!own) return;
  tell('told', '');
  const button = by('go');
  button.disabled = true;
  try {
    const { metadata, scan, ...given } = described();
    if (scan) await makeScan(scan, metadata, given);
    const { rig, lens } = metadata;
    const head = [...own.heads.values()].find(Boolean);
    try { localStorage.setItem(KEPT, JSON.stringify({ ...cameras(), last: { rig, lens }, ...(head ? { [keyOf(head)]: { rig, lens } } : {}) })); } catch { /* the next visit asks again */ }
    start(own.zip ? { zip: own.zip } : own, metadata);
    choice = null;
    isPurposeChosen = false;
    preview.clear();
    by('summary').textContent = '';
    by('uploads').scrollIntoView({ block: 'nearest' });
  } catch (error) {
    tell('told', error.message);
    button.disabled = false;
  }
});

/** Creates a scan that does not exist yet; one that does gets what is given, but keeps its number of views. */
async function makeScan(name, { rig, lens }, given) {
  const url = link(`/v1/scans/${encodeURIComponent(name)}`);
  try {
    await call('PUT', url, JSON.stringify({ rig, lens, ...given }), { 'content-type': 'application/json', 'if-none-match': '*' });
  } catch (error) {
    if (error.status !== 412) throw error;
    if (Object.keys(given).length === 0) return;
    const scan = await json('GET', url);
    const changed = { ...given, expected_views: scan.expected_views ?? given.expected_views ?? null };
    if (Object.keys(changed).some((key) => scan[key] !== changed[key])) await json('PUT', url, { ...scan, ...changed });
  }
}

const asked = new URLSearchParams(location.search);
for (const name of ['scan', 'rig', 'lens']) {
  const given = asked.get(name);
  if (given) { by(name).value = given; typed.add(name); }
}
const radio = form.querySelector(`input[name=purpose][value="${CSS.escape(asked.get('purpose') ?? '')}"]`);
if (radio) { radio.checked = true; isPurposeChosen = true; }
remembered(null);
adapt();
findProfile();
